"""Curves of special points in two parameters, of orbits and equilibria alike.

A special point with a test function adds the function as one equation. A branch point is a solution
of the equations ``F + beta b = 0`` and ``g = 0`` of `branch_points` at which beta is zero. With a
second parameter these have a curve of solutions. Along it beta stays zero where a symmetry or an
invariant subspace keeps the branch point; elsewhere the second parameter unfolds the crossing, and
beta leaves zero.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.continuation.arclength import (
    CONTINUATION_ERRORS,
    SHORTER_STEP_REMEDY,
    Continuation,
    ContinuationProblem,
    Corrector,
    LocatedEvents,
    PredictorStep,
    StepControl,
    reason_of,
)
from mems_impact.continuation.branch import CurveEvent, N, SolutionCurve
from mems_impact.continuation.branch_points import extended_equations, null_vectors
from mems_impact.continuation.test_functions import DefiningSystem, TestFunction
from mems_impact.errors import OrbitError
from mems_impact.orbits.family import Family
from mems_impact.orbits.linear_equations import null_vector
from mems_impact.orbits.newton import Linearized, P, Solution, Solvable, newton
from mems_impact.orbits.shooting import RESIDUAL_TOLERANCE

MAX_CURVE_ITERATIONS = 10
MAX_ZERO_RATIO = 1e-3  # largest ratio of a test function at a zero to its values at the step's ends
UNFOLDS = "the branch point unfolds"
C = TypeVar("C", bound=SolutionCurve)


def follow(
    curve: C,
    family: Family,
    begin: Callable[[], tuple[CurveProblem[P, N], P]],
    *,
    low: float,
    high: float,
    direction: float,
    steps: StepControl,
    progress: Callable[[float], None] | None = None,
) -> C:
    """Continue a special point in a second parameter; append the points to `curve` and return it.

    `begin` returns the problem of the curve, and the evaluation of its equations at the special
    point. Bounds, the sign `direction` of the first step, and `progress` are of the second
    parameter.
    """
    try:
        problem, near = begin()
        start = np.concatenate([near.unknowns, near.values])
        first_direction = problem.tangent(near, direction * np.eye(start.size)[-1])
        point = problem.corrector(near)(start, first_direction, start).point
    except CONTINUATION_ERRORS as error:
        curve.ended = f"the first point could not be corrected: {reason_of(error, family)}"
        return curve
    for solution in Continuation(problem, point, first_direction, low=low, high=high, steps=steps):
        if progress is not None:
            progress(curve.values(solution)[1])
    return curve


# --- Curves of one test function


class CurveProblem(ContinuationProblem[P, N, CurveEvent[N]]):
    """Continuation problem of solutions at which one condition holds, in two parameters."""

    noun = "curve"
    branch: SolutionCurve[N]  # the result
    condition: DefiningSystem
    bounds: tuple[float, float]  # of the second parameter
    _linear: tuple[P, Floats] | None = None  # the gradient of the condition at a point

    @property
    @abstractmethod
    def equations(self) -> Solvable[P]:
        """The equations of orbit or equilibrium, with two active parameters."""

    @abstractmethod
    def solution(self, point: P) -> N:
        """Return the orbit or equilibrium of a point."""

    @abstractmethod
    def name_of(self, test: TestFunction) -> str:
        """Return the name of a zero of `test` on this curve."""

    def record(self, point: P, direction: Floats) -> None:
        """Append a solution to the curve."""
        self.branch.points.append(self.solution(point))

    def tangent(self, point: P, direction: Floats) -> Floats:
        """Return the unit tangent of the curve, oriented along `direction`."""
        vector = curve_direction(point, self.gradient(point))
        return vector if vector @ direction >= 0.0 else -vector

    def gradient(self, point: P) -> Floats:
        """Return the gradient of the condition, whose scaling is fixed at this point."""
        if self._linear is None or self._linear[0] is not point:
            self._linear = point, self.condition.gradient(point)
        return self._linear[1]

    def corrector(self, point: P) -> Corrector[P]:
        """Return the corrector of a step.

        An expensive gradient is evaluated at the start of the step only, and then updated by the
        values of the condition (Broyden 1965).
        """
        return partial(correct_condition, self.equations, self.condition, self.gradient(point))

    def solve(self, guess: Floats) -> P:
        """Correct a guess at its value of the second parameter."""
        assert self._linear is not None
        return self.corrector(self._linear[0])(guess, np.eye(guess.size)[-1], guess).point

    def pass_loss(self, located: LocatedEvents[P, CurveEvent[N]], length: float) -> str:
        """End the curve at a loss."""
        assert located.loss is not None
        self.branch.points.append(located.loss.solution)
        return located.reason

    def zeros(
        self,
        step: PredictorStep[P],
        length: float,
        changes: Sequence[tuple[TestFunction, float, float]],
    ) -> list[tuple[float, TestFunction, CurveEvent[N]]]:
        """Return the zeros of test functions within the bounds, in order along a step.

        `changes` are test functions with their values at both ends, of different signs.
        """
        found = []
        for test, *ends in changes:
            located = self.locate_zero(test, step, length, min(map(abs, ends)))
            if located is not None and self.bounds[0] <= located[1].values[1] <= self.bounds[1]:
                found.append((located[0], test, located[1]))
        return sorted(found, key=lambda item: item[0])

    def locate_zero(
        self, test: TestFunction, step: PredictorStep[P], length: float, size: float
    ) -> tuple[float, CurveEvent[N]] | None:
        """Return the position in a step and the point of a zero of `test`; None without a zero.

        `size` is the smaller absolute value of the test function at the ends of the step.
        """
        name = self.name_of(test)
        try:
            position = test.zero_on_curve(self.condition, step, length)
            if position is None:
                return None
            point = step.at(position).point
            value = test.on_curve(self.condition, point) if test.may_jump else 0.0
        except ValueError as error:
            raise OrbitError(f"{name} could not be located", SHORTER_STEP_REMEDY) from error
        jumps = value is None or abs(value) > MAX_ZERO_RATIO * size
        if jumps or not test.is_zero(self.condition, point):
            return None
        values = (float(point.values[0]), float(point.values[1]))
        return position, CurveEvent(name, values, self.solution(point))


def curve_direction(point: Linearized, gradient: Floats) -> Floats:
    """Return a unit tangent of the curve at a point, of arbitrary sign."""
    return null_vector(np.vstack([point.derivatives, gradient]))


def correct_condition(
    equations: Solvable[P],
    condition: DefiningSystem,
    gradient: Floats,
    plane: Floats,
    direction: Floats,
    guess: Floats,
) -> Solution[P]:
    """Correct `guess` to a zero of a condition, in the plane through `plane` normal to `direction`.

    `gradient` is the gradient of the condition at a nearby point.
    """
    last: tuple[Floats, float] | None = None

    def extended(u: Floats) -> tuple[P, Floats, Floats]:
        nonlocal gradient, last
        point = equations.evaluate(u[:-2], u[-2:])
        level = condition.value(point)
        if condition.derived:
            gradient = condition.gradient(point)
        elif last is not None:
            moved = u - last[0]
            missed = level - last[1] - gradient @ moved
            gradient = gradient + missed * moved / (moved @ moved)
        last = u, level
        residual = np.concatenate([point.residual, [level, direction @ (u - plane)]])
        matrix = np.vstack([point.derivatives, gradient, direction])
        return point, residual, matrix

    return newton(
        extended,
        guess,
        reason="the correction of a step did not converge",
        remedy=SHORTER_STEP_REMEDY,
        iterations=MAX_CURVE_ITERATIONS,
    )


# --- Curves of branch points


def unfolding(point: Linearized) -> float:
    """Return the residual of the branch point condition at a solution of the extended equations."""
    return float(np.abs(point.residual).max(initial=0.0))


def correct_branch_point(
    equations: Solvable[P], near: P, plane: Floats, direction: Floats, guess: Floats
) -> Solution[P]:
    """Solve the extended equations in the plane through `plane` normal to `direction`.

    The equations have two active parameters; a branch point `near` provides the borders. The
    vectors are unknowns and parameters. Raises OrbitError if the correction does not converge.
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


class BranchPointCurve(CurveProblem[P, N]):
    """Continuation problem of solutions at which another branch crosses, in two parameters."""

    _near: P

    def tangent(self, point: P, direction: Floats) -> Floats:
        """Return the unit tangent of the curve, oriented along `direction`."""
        vector = curve_tangent(self.equations, point)
        return vector if vector @ direction >= 0.0 else -vector

    def corrector(self, point: P) -> Corrector[P]:
        """Return the corrector of a step."""
        self._near = point
        return partial(correct_branch_point, self.equations, point)

    def solve(self, guess: Floats) -> P:
        """Correct a guess at its value of the second parameter."""
        point = self.corrector(self._near)(guess, np.eye(guess.size)[-1], guess).point
        if unfolding(point) > RESIDUAL_TOLERANCE:
            raise OrbitError(UNFOLDS, SHORTER_STEP_REMEDY)
        return point

    def record(self, point: P, direction: Floats) -> None:
        """Append a solution to the curve, unless it is no branch point."""
        if unfolding(point) <= RESIDUAL_TOLERANCE:
            super().record(point, direction)

    def end_at(self, point: P) -> str:
        """Return the reason for an end where the branch point unfolds."""
        if unfolding(point) <= RESIDUAL_TOLERANCE:
            return ""
        name = self.parameters[1]
        value = self.family.amount(name, float(self.branch.points[-1].family.values[name]))
        return f"{UNFOLDS}: at another value of {name} than {value}, no branch crosses"
