"""Curves of branch points in two parameters.

A branch point is a solution of the equations ``F + beta b = 0`` and ``g = 0`` of `branch_points` at
which beta is zero. With a second parameter they have a curve of solutions. Along it beta stays zero
where a symmetry or an invariant subspace keeps the branch point; elsewhere the second parameter
unfolds the crossing, and beta leaves zero.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.continuation.arclength import (
    SHORTER_STEP_REMEDY,
    Corrector,
)
from mems_impact.continuation.branch_points import extended_equations, null_vectors
from mems_impact.continuation.codim1_curve import (
    MARGIN_TESTS,
    MAX_CURVE_ITERATIONS,
    CurveProblem,
    Tests,
)
from mems_impact.continuation.orbit_branch import oriented
from mems_impact.continuation.test_functions import (
    BRANCH_POINT,
    MINUS,
    PAIR,
    DefiningSystem,
    MultiplierTest,
    orbit_tests,
)
from mems_impact.errors import OrbitError
from mems_impact.orbits.division import OtherEquations
from mems_impact.orbits.monodromy import multipliers_at
from mems_impact.orbits.newton import Linearized, P, Solution, Solvable, newton
from mems_impact.orbits.shooting import RESIDUAL_TOLERANCE, ShootingEvaluation

__all__ = ["BranchPointCurve"]

UNFOLDS = "the branch point unfolds"


def unfolding(point: Linearized) -> float:
    """Return the residual of the branch point condition at a solution of the extended equations."""
    return float(np.abs(point.residual).max(initial=0.0))


def correct_branch_point(
    equations: Solvable[P], near: P, plane: Floats, direction: Floats, guess: Floats
) -> Solution[P]:
    """Solve the extended equations in the plane through `plane` normal to `direction`.

    Parameters
    ----------
    equations : Shooting or EquilibriumEquations
        With two active parameters.
    near : ShootingEvaluation or EquilibriumEvaluation
        A branch point nearby, which provides the borders.
    plane, direction, guess : float array
        Unknowns and parameters.

    Raises
    ------
    OrbitError
        If the correction does not converge.
    """
    border, kernel = null_vectors(near)

    def extended(u: Floats) -> tuple[P, Floats, Floats]:
        point, residual, matrix = extended_equations(equations, border, kernel, u)
        rows = np.vstack([matrix, np.append(direction, 0.0)])
        return point, np.append(residual, direction @ (u[:-1] - plane)), rows

    solution = newton(
        extended,
        np.append(guess, 0.0),
        reason="the correction of a step did not converge",
        remedy=SHORTER_STEP_REMEDY,
        iterations=MAX_CURVE_ITERATIONS,
    )
    return Solution(solution.unknowns[:-1], solution.point, solution.iterations)


def curve_tangent(equations: Solvable[P], point: P) -> Floats:
    """Return a unit tangent of a curve of branch points, of arbitrary sign."""
    border, kernel = null_vectors(point)
    u = np.concatenate([point.unknowns, point.values, [0.0]])
    _, _, matrix = extended_equations(equations, border, kernel, u)
    direction = np.linalg.svd(matrix)[2][-1][:-1]
    return np.asarray(direction / np.linalg.norm(direction))


class BranchPointCurve(CurveProblem):
    """Orbits at which another branch crosses, in two parameters."""

    def _defining_system(self) -> DefiningSystem:
        return DefiningSystem(self.shooting, self.monitor)

    def with_equations(
        self, other: OtherEquations, point: ShootingEvaluation, direction: Floats
    ) -> tuple[ShootingEvaluation, Floats]:
        """Return the orbit of a point with other equations, and the tangent of the curve."""
        shooting, unknowns, first = other
        near = shooting.evaluate(unknowns, point.values)
        start, across = np.concatenate([unknowns, point.values]), curve_tangent(shooting, near)
        restarted = correct_branch_point(shooting, near, start, across, start).point
        count = len(self.shooting.segments)
        self.zero = {test.rebased(count, first) for test in self.zero}
        self.shooting, self.condition = shooting, DefiningSystem(shooting, self.monitor)
        return restarted, oriented(curve_tangent(shooting, restarted), direction, shooting)

    def tangent(self, point: ShootingEvaluation, direction: Floats) -> Floats:
        """Return the unit tangent of the curve, oriented along `direction`."""
        vector = curve_tangent(self.shooting, point)
        return vector if vector @ direction >= 0.0 else -vector

    def corrector(self, point: ShootingEvaluation) -> Corrector[ShootingEvaluation]:
        """Return the corrector of a step."""
        self._near = point
        return partial(correct_branch_point, self.shooting, point)

    def solve(self, guess: Floats) -> ShootingEvaluation:
        """Correct a guess at its value of the second parameter."""
        point = self.corrector(self._near)(guess, np.eye(guess.size)[-1], guess).point
        if unfolding(point) > RESIDUAL_TOLERANCE:
            raise OrbitError(UNFOLDS, SHORTER_STEP_REMEDY)
        return point

    def record(self, point: ShootingEvaluation, direction: Floats) -> None:
        """Append an orbit to the curve, unless it is no branch point."""
        if unfolding(point) <= RESIDUAL_TOLERANCE:
            super().record(point, direction)

    def end_at(self, point: ShootingEvaluation) -> str:
        """Return the reason for an end where the branch point unfolds."""
        if unfolding(point) <= RESIDUAL_TOLERANCE:
            return ""
        name = self.parameters[1]
        value = self.family.amount(name, float(self.branch.points[-1].family.values[name]))
        return f"{UNFOLDS}: at another value of {name} than {value}, no branch crosses"

    def tests(self, point: ShootingEvaluation, direction: Floats) -> Tests:
        """Return the test functions for points of codimension two."""
        multipliers = multipliers_at(self.shooting, point)
        # A second multiplier +1 is not separated from the first.
        named = (MultiplierTest(BRANCH_POINT, name) for name in (MINUS, PAIR))
        tests: Tests = {test: test.of(multipliers) for test in named}
        for other, value in orbit_tests(self.shooting, point, np.zeros(1)).items():
            if isinstance(other, MARGIN_TESTS) and other not in self.zero:
                tests[other] = value
        return tests
