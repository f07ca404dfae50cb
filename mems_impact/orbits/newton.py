"""Newton's method."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.errors import OrbitError
from mems_impact.orbits.shooting import ACCEPTED, Shooting, ShootingEvaluation

TOLERANCE = 1e-11  # of a Newton step
RESIDUAL_ROUNDING = (
    4.0 * np.finfo(float).eps
)  # of a residual, as a part of the terms that it is a sum of
MAX_STEP_NORM = 1e6  # a longer step leads nowhere
MAX_NEWTON_ITERATIONS = 20
NEARER = (
    "take a guess nearer to an orbit: let transients die out (transient=300), or change periods"
)
NEARER_CYCLE = (
    "let transients die out (transient=…, in units of time) or give a guess nearer to a cycle; a "
    "chaotic motion comes close to where it was and leaves again"
)


class Linearised(Protocol):
    """One evaluation of equations, as of an orbit or of an equilibrium."""

    @property
    def unknowns(self) -> Floats:
        """Shape (size,)."""

    @property
    def values(self) -> Floats:
        """Of the active parameters, shape (k,)."""

    @property
    def residual(self) -> Floats:
        """Shape (size,)."""

    @property
    def jacobian(self) -> Floats:
        """Derivatives by the unknowns, shape (size, size)."""

    @property
    def by_parameter(self) -> Floats:
        """Derivatives by the active parameters, shape (size, k)."""


P = TypeVar("P", bound=Linearised)
P_co = TypeVar("P_co", bound=Linearised, covariant=True)


class Solvable(Protocol[P_co]):
    """What can be evaluated: `Shooting`, `EquilibriumEquations`."""

    def evaluate(self, unknowns: Floats, values: Floats) -> P_co:
        """Evaluate residual and derivatives."""


class Solution(NamedTuple, Generic[P]):
    """What Newton's method found.

    Attributes
    ----------
    unknowns : float array
    point : ShootingEvaluation or EquilibriumEvaluation
        The equations there.
    iterations : int
        Newton steps until the next one was as small as the error of the integration.
    """

    unknowns: Floats
    point: P
    iterations: int


def newton(
    equations: Callable[[Floats], tuple[P, Floats, Floats]],
    guess: Floats,
    *,
    reason: str,
    remedy: str,
    iterations: int = MAX_NEWTON_ITERATIONS,
) -> Solution[P]:
    """Correct `guess` until the equations hold.

    From unknowns, `equations` returns the equations there, all residuals, and the matrix of their
    derivatives.

    Done is where the next step would be below `TOLERANCE`, or where steps no longer shrink while no
    residual is above `ACCEPTED`: they are at the level of the integration error then. Where the
    matrix is nearly singular, rounding alone may make steps of any length; so residuals that are
    rounding are the end, too.

    Raises
    ------
    OrbitError
        With `reason` and `remedy` if that does not come about; the last `ShootingEvaluation` is in
        it.
    """
    unknowns, previous, needed = guess, np.inf, iterations
    point, residual, matrix = equations(unknowns)
    for iteration in range(iterations):
        if not (np.isfinite(matrix).all() and np.isfinite(residual).all()):
            break
        rounding = RESIDUAL_ROUNDING * (np.abs(matrix) @ np.abs(unknowns))
        if np.all(np.abs(residual) <= np.minimum(rounding, ACCEPTED)):
            return Solution(unknowns, point, min(needed, iteration))
        try:
            change = np.linalg.solve(matrix, -residual)
        except np.linalg.LinAlgError:
            change = np.linalg.lstsq(matrix, -residual)[0]
            if np.abs(matrix @ change + residual).max() > ACCEPTED:
                break  # no way leads there from here
        size = float(np.abs(change).max())
        if size < ACCEPTED:
            needed = min(needed, iteration)
        stalled = size >= previous and float(np.abs(residual).max()) < ACCEPTED
        if size < TOLERANCE or stalled:
            return Solution(unknowns, point, min(needed, iteration))
        if not size <= MAX_STEP_NORM:
            break
        previous = size
        try:
            unknowns = unknowns + change
            point, residual, matrix = equations(unknowns)
        except OrbitError:
            break  # the iteration has left what can be integrated
    worst = float(np.abs(residual).max())
    raise OrbitError(f"{reason} (the residual stays at {worst:.2g})", remedy, point)


def solve(shooting: Shooting, unknowns: Floats, values: Floats) -> ShootingEvaluation:
    """Correct the unknowns of an orbit at fixed parameters.

    Raises
    ------
    OrbitError
        If the iteration does not converge; the last `ShootingEvaluation` is in it.
    """
    return solve_at(
        shooting,
        unknowns,
        values,
        reason="no orbit with this signature near the guess",
        remedy=NEARER if shooting.phase is None else NEARER_CYCLE,
    )


def solve_at(
    equations: Solvable[P], unknowns: Floats, values: Floats, *, reason: str, remedy: str
) -> P:
    """Correct unknowns at fixed parameters; raises as `newton` does."""

    def at(u: Floats) -> tuple[P, Floats, Floats]:
        point = equations.evaluate(u, values)
        return point, point.residual, point.jacobian

    return newton(at, unknowns, reason=reason, remedy=remedy).point
