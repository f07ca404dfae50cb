"""Newton's method."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.errors import OrbitError
from mems_impact.orbits.linear_equations import is_sparse, solve_linear
from mems_impact.orbits.shooting import (
    RESIDUAL_TOLERANCE,
    STEP_TOLERANCE,
    Shooting,
    ShootingEvaluation,
)

RESIDUAL_ROUNDING = 4.0 * np.finfo(float).eps  # of a residual, relative to its terms
# Ratio of two steps below `RESIDUAL_TOLERANCE` from which they are integration errors.
NOISE_RATIO = 0.02
SINGULAR_GAIN = 1e6  # ratio of step and residual from which a matrix may be singular
SINGULAR_RTOL = 1e-12  # ratio of singular values of a matrix that is singular to rounding
MAX_STEP_NORM = 1e6  # longest step of a convergent iteration
MAX_NEWTON_ITERATIONS = 20
ORBIT_GUESS_REMEDY = (
    "give a guess closer to an orbit: raise transient, for example to 300, if the orbit is stable, "
    "or change periods"
)
CYCLE_GUESS_REMEDY = (
    "raise transient (in units of time) or give a guess closer to a limit cycle; a chaotic motion "
    "returns only approximately"
)


class Linearized(Protocol):
    """One evaluation of the equations of an orbit or an equilibrium."""

    @property
    def unknowns(self) -> Floats:
        """Shape (size,)."""

    @property
    def values(self) -> Floats:
        """Values of the active parameters, shape (k,)."""

    @property
    def residual(self) -> Floats:
        """Shape (size,)."""

    @property
    def derivatives(self) -> Floats:
        """Derivatives by the unknowns and the active parameters, shape (size, size + k)."""

    @property
    def jacobian(self) -> Floats:
        """Derivatives by the unknowns, shape (size, size)."""

    @property
    def by_parameter(self) -> Floats:
        """Derivatives by the active parameters, shape (size, k)."""


P = TypeVar("P", bound=Linearized)
P_co = TypeVar("P_co", bound=Linearized, covariant=True)


class Solvable(Protocol[P_co]):
    """Equations for `newton`: `Shooting`, `EquilibriumEquations`."""

    @property
    def tolerance(self) -> float:
        """Of a Newton step."""

    def evaluate(self, unknowns: Floats, values: Floats) -> P_co:
        """Evaluate residual and derivatives."""

    def error(self, point: Any, rate: float) -> float:
        """Return the error of the residual, which a known imperfection of a crossing exceeds.

        It is divided by the rate at which the derivatives become singular along the branch.
        """

    def integration_error(self, point: Any) -> Floats:
        """Return the errors of the residual by integration."""


class Solution(NamedTuple, Generic[P]):
    """The result of Newton's method: the unknowns and the evaluation of the equations there."""

    unknowns: Floats
    point: P
    iterations: int  # number of Newton steps larger than the integration error


def newton(
    equations: Callable[[Floats], tuple[P, Floats, Floats]],
    guess: Floats,
    *,
    reason: str,
    remedy: str,
    iterations: int = MAX_NEWTON_ITERATIONS,
    tolerance: float = STEP_TOLERANCE,
) -> Solution[P]:
    """Correct `guess` until the equations hold.

    ``equations(unknowns)`` returns the evaluation, all residuals, and their Jacobian matrix.

    The iteration converges if the next step is below `tolerance`, or if steps no longer shrink
    while no residual exceeds `RESIDUAL_TOLERANCE`: they are then at the level of the integration
    error. Steps below `RESIDUAL_TOLERANCE` that no longer shrink quadratically are accepted too,
    unless the tolerance is zero; then also those below `STEP_TOLERANCE` that still shrink after the
    last iteration. If the matrix is nearly singular, rounding alone may cause steps of any length,
    so the iteration also ends at residuals of the order of rounding.

    Raises OrbitError with `reason` and `remedy` if it does not converge; the error holds the last
    `ShootingEvaluation`.
    """
    unknowns, previous, iterations_needed = guess, np.inf, iterations
    point, residual, matrix = equations(unknowns)
    for iteration in range(iterations):
        if not (np.isfinite(matrix).all() and np.isfinite(residual).all()):
            break
        rounding = RESIDUAL_ROUNDING * (np.abs(matrix) @ np.abs(unknowns))
        if np.all(np.abs(residual) <= np.minimum(rounding, RESIDUAL_TOLERANCE)):
            return Solution(unknowns, point, min(iterations_needed, iteration))
        try:
            change = solve_linear(matrix, -residual)
        except np.linalg.LinAlgError:
            change = np.asarray(np.linalg.lstsq(matrix, -residual)[0], dtype=float)
            if np.abs(matrix @ change + residual).max() > RESIDUAL_TOLERANCE:
                break  # no step reduces the residual
        size, worst = float(np.abs(change).max()), float(np.abs(residual).max())
        if size > SINGULAR_GAIN * worst and not is_sparse(matrix):
            # Along a family of orbits the matrix is singular, and rounding determines the step.
            sizes = np.abs(matrix).max(axis=1)
            sizes[sizes == 0.0] = 1.0
            rows = matrix / sizes[:, None]
            least, _, rank, _ = np.linalg.lstsq(rows, -residual / sizes, SINGULAR_RTOL)
            if rank == len(matrix) - 1 and np.abs(matrix @ least + residual).max() < 0.5 * worst:
                change, size = np.asarray(least, dtype=float), float(np.abs(least).max())
        if size < RESIDUAL_TOLERANCE:
            iterations_needed = min(iterations_needed, iteration)
        is_noise = tolerance > 0.0 and previous < RESIDUAL_TOLERANCE
        slow = size >= (NOISE_RATIO * previous if is_noise else previous)
        stalled = slow and worst < RESIDUAL_TOLERANCE
        if size < tolerance or stalled:
            return Solution(unknowns, point, min(iterations_needed, iteration))
        if not size <= MAX_STEP_NORM:
            break
        previous = size
        try:
            unknowns = unknowns + change
            point, residual, matrix = equations(unknowns)
        except OrbitError:
            break  # the iteration has left the domain of the flow
    else:
        if previous < STEP_TOLERANCE and np.abs(residual).max() < RESIDUAL_TOLERANCE:
            return Solution(unknowns, point, iterations_needed)  # steps become ever shorter
    worst = float(np.abs(residual).max())
    raise OrbitError(f"{reason} (residual {worst:.2g})", remedy, point)


def solve(shooting: Shooting, unknowns: Floats, values: Floats) -> ShootingEvaluation:
    """Correct the unknowns of an orbit at fixed parameters.

    Raises OrbitError, which holds the last `ShootingEvaluation`, if the iteration does not
    converge.
    """
    return solve_at(
        shooting,
        unknowns,
        values,
        reason="no orbit with this signature near the guess",
        remedy=ORBIT_GUESS_REMEDY if shooting.phase is None else CYCLE_GUESS_REMEDY,
    )


def solve_at(
    equations: Solvable[P], unknowns: Floats, values: Floats, *, reason: str, remedy: str
) -> P:
    """Correct unknowns at fixed parameters; errors are as in `newton`."""

    def at(u: Floats) -> tuple[P, Floats, Floats]:
        point = equations.evaluate(u, values)
        return point, point.residual, point.jacobian

    tolerance = equations.tolerance
    return newton(at, unknowns, reason=reason, remedy=remedy, tolerance=tolerance).point
