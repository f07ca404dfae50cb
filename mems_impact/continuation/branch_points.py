"""Branch points by bordered systems."""

from __future__ import annotations

from functools import partial
from typing import Generic

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.continuation.arclength import PredictorStep
from mems_impact.errors import OrbitError
from mems_impact.orbits.equilibrium import EquilibriumEquations
from mems_impact.orbits.linear_equations import SparseFactorization, is_sparse
from mems_impact.orbits.newton import Linearized, P, Solvable, newton

KERNEL_STEPS = 10.0 ** -np.arange(4, 10)  # of differences along the null vectors of orbits
# Largest change of the derivatives by a third derivative at a step, relative to that by a second
# derivative, and to the derivatives if both are rounding errors.
CURVATURE_RATIO, ROUNDING_RATIO = 0.1, 1e-11
MIN_FOLD_DISTANCE = 1e-5  # least distance on a branch of a fold from a branch point
UNFOLDING_RATIO = (
    5.0  # distance by which a unit error of the equations separates two crossing branches
)
NOT_LOCATED = "a branch point could not be located"


def regularity(point: Linearized, direction: Floats) -> float:
    """Return the signed smallest singular value of the equations bordered by the tangent.

    The value has the sign of the determinant. It is zero at a branch point and nonzero at a fold.
    """
    matrix = np.vstack([point.derivatives, direction])
    if is_sparse(matrix):
        try:
            factors = SparseFactorization(matrix)
        except np.linalg.LinAlgError:
            return 0.0
        return factors.sign * factors.smallest_singular_value()
    sizes = np.linalg.svd(matrix, compute_uv=False)
    return float(np.linalg.slogdet(matrix)[0] * sizes[-1])


class BranchPoints(Generic[P]):
    """Branch points of a branch, of equations with one active parameter.

    At a branch point the derivatives F_x of the equations by unknowns and parameter are rank
    deficient. With the bordered system ``w F_x + g V = 0`` and ``w b = 1``, the two numbers g are
    zero there. Together with ``F + beta b = 0`` these are regular equations for x and beta, and
    beta is zero at a branch point (Govaerts 2000, Numerical Methods for Bifurcations, chapter 6).

    An error of the equations unfolds the crossing and separates the branches, at a pitchfork by a
    distance proportional to its cube root. The solution has this error as beta, and its point is
    the branch of the equations without the error.
    """

    def __init__(self, equations: Solvable[P]) -> None:
        self._equations = equations
        self._known: list[tuple[Floats, float]] = []  # points, each with its radius of unfolding

    def locate(
        self, step: PredictorStep[P], length: float, first: float, last: float
    ) -> tuple[float, P]:
        """Return the position of a branch point in a step, and the point.

        `first` and `last` are the `regularity` at the ends, of opposite signs. Raises OrbitError
        without a branch point.
        """
        guess = step.expected(length * first / (first - last))
        near = self._equations.evaluate(guess[:-1], guess[-1:])
        solution = newton(
            partial(extended_equations, self._equations, *null_vectors(near)),
            np.append(guess, 0.0),
            reason=NOT_LOCATED,
            remedy="take a shorter step",
        )
        # Relative to the rate along the branch the unfolding does not depend on a factor of the
        # equations.
        rate = abs(last - first) / length
        x, beta = solution.unknowns[:-1], abs(float(solution.unknowns[-1])) / rate
        position = float((x - step.start) @ step.direction)
        aside = float(np.linalg.norm(x - step.start - position * step.direction))
        radius = max(MIN_FOLD_DISTANCE, UNFOLDING_RATIO * beta ** (1.0 / 3.0))
        if (
            not -radius <= position <= length + radius
            or aside > abs(position) + radius
            or beta > self._equations.error(solution.point, rate)
        ):
            raise OrbitError(NOT_LOCATED, "take a shorter step", solution.point)
        self._known.append((x, radius))
        return min(max(position, 0.0), length), solution.point

    def intervals(self, step: PredictorStep[P], length: float) -> list[tuple[float, float]]:
        """Return the parts of a step outside the radii of branch points."""
        intervals, begin = [], 0.0
        around = [((x - step.start) @ step.direction, radius) for x, radius in self._known]
        for position, radius in sorted(around):
            if -radius < position < length + radius:
                intervals.append((begin, position - radius))
                begin = position + radius
        return [(a, b) for a, b in [*intervals, (begin, length)] if a < b]

    def is_known(self, point: P) -> bool:
        """Return whether a point coincides with a known branch point."""
        position = np.concatenate([point.unknowns, point.values])
        same = [(x, radius) for x, radius in self._known if x.size == position.size]
        return any(float(np.linalg.norm(position - x)) < radius for x, radius in same)


def extended_equations(
    equations: Solvable[P], border: Floats, kernel: Floats, u: Floats
) -> tuple[P, Floats, Floats]:
    """Evaluate the equations of a branch point in the first parameter: point, residual, matrix.

    `border` is an approximate left null vector b, shape (unknowns,), `kernel` approximate null
    vectors of the derivatives by unknowns and the first parameter, shape (2, unknowns + 1); `u` are
    unknowns, parameters and beta.
    """
    x, beta, size = u[:-1], u[-1], border.size
    point = equations.evaluate(x[:size], x[size:])
    derivatives = point.derivatives
    bordered = np.zeros((size + 2, size + 2))
    bordered[:size, :-1], bordered[:size, -1] = derivatives[:, : size + 1], border
    bordered[size:, :-1] = kernel
    units = np.eye(size + 2)
    solved = np.linalg.solve(bordered.T, units[-1])
    w, g = solved[:size], solved[size:]
    matrix = np.zeros((size + 2, u.size))
    matrix[:size, :-1], matrix[:size, -1] = derivatives, border
    for j, v in enumerate(np.linalg.solve(bordered, units[:, size:])[:-1].T):
        towards = np.concatenate([v, np.zeros(x.size - v.size)])
        matrix[size + j, :-1] = -w @ second_derivatives(equations, point, towards)
    return point, np.concatenate([point.residual + beta * border, g]), matrix


def null_vectors(point: Linearized) -> tuple[Floats, Floats]:
    """Return the left null vector at a branch point in the first parameter, and the kernel."""
    left, _, rows = np.linalg.svd(point.derivatives[:, : point.unknowns.size + 1])
    return left[:, -1], rows[-2:]


def second_derivatives(equations: Solvable[P], point: P, v: Floats) -> Floats:
    """Return the derivative along `v` of the derivatives by unknowns and parameters.

    It is exact for equilibria. For orbits it is a central difference, with the longest step at
    which the derivatives change almost linearly.
    """
    if isinstance(equations, EquilibriumEquations):
        return equations.derivatives_along(point, v)
    x, size = np.concatenate([point.unknowns, point.values]), point.unknowns.size
    center, failure = point.derivatives, OrbitError(NOT_LOCATED, "take a shorter step", point)
    smallest = ROUNDING_RATIO * float(np.linalg.norm(center))
    second = None
    for step in KERNEL_STEPS.tolist():
        try:
            up, down = (
                equations.evaluate(each[:size], each[size:]).derivatives
                for each in (x + step * v, x - step * v)
            )
        except OrbitError as error:
            failure = error
            continue
        second, change = (up - down) / (2.0 * step), float(np.linalg.norm(up - down))
        curved = float(np.linalg.norm(up + down - 2.0 * center))
        if curved <= max(CURVATURE_RATIO * change, smallest):
            break
    if second is None:
        raise failure
    return second
