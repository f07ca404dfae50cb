"""Branches of equilibria."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.continuation.arclength import (
    CONTINUATION_ERRORS,
    PREDICTOR_POINTS,
    SHORTER_STEP_REMEDY,
    Continuation,
    ContinuationProblem,
    Corrector,
    E,
    LocatedEvents,
    PredictorStep,
    R,
    StepControl,
    correct,
    reason_of,
    tangent,
)
from mems_impact.continuation.branch import EquilibriumBranch, EquilibriumEvent, EquilibriumPoint
from mems_impact.continuation.branch_points import regularity
from mems_impact.continuation.branching_equation import branch_direction
from mems_impact.continuation.stability import (
    CROSSING,
    IMAGINARY_AXIS,
    UNEXPLAINED_STEP_RATIO,
    Bifurcations,
)
from mems_impact.continuation.test_functions import (
    BRANCH_POINT,
    FOLD,
    MULTIPLIER_TOLERANCE,
    UNEXPLAINED,
    BoundaryTest,
    BranchPointTest,
    TestFunction,
)
from mems_impact.continuation.user_test_functions import FunctionTest, FunctionZeros
from mems_impact.errors import OrbitError
from mems_impact.orbits.equilibrium import (
    EQUILIBRIUM_MARGIN_TOLERANCE,
    EquilibriumEquations,
    EquilibriumEvaluation,
    EquilibriumState,
    make_equilibrium,
)
from mems_impact.orbits.newton import solve_at

HOPF, BOUNDARY = "Hopf", "boundary equilibrium"
EQUILIBRIUM_LABELS = {FOLD: "LP", HOPF: "H", BRANCH_POINT: "BP", BOUNDARY: "BE", UNEXPLAINED: "?"}
MIN_IMAGINARY_RATIO = 1e-6  # least ratio of imaginary part to size of an eigenvalue at a Hopf point
SAME_EQUILIBRIUM_DISTANCE = 1e-5  # largest distance of two equilibria that count as one


def follow_equilibrium(
    equilibrium: EquilibriumState,
    parameter: str,
    *,
    low: float,
    high: float,
    direction: float,
    steps: StepControl,
    functions: Sequence[FunctionTest] = (),
    stop_at: Collection[str] = (),
    progress: Callable[[float], None] | None = None,
) -> EquilibriumBranch:
    """Continue an isolated equilibrium up to a bound, an end or the budget of points.

    `direction` is the sign of the first step. The branch ends at special points of the kinds
    `stop_at`, and `ended` is the reason; `progress` is called with every value of the parameter.
    """
    branch = EquilibriumBranch(parameter)
    equations = EquilibriumEquations(equilibrium.family, equilibrium.mode, (parameter,))
    try:
        value = np.array([equilibrium.family.value(parameter)])
        first = equations.evaluate(equilibrium.balance.unknowns, value)
        first_direction = float(np.sign(direction)) * tangent(first)
    except CONTINUATION_ERRORS as error:
        branch.ended = reason_of(error, equilibrium.family)
        return branch
    problem = _EquilibriumBranchProblem(branch, equations, low, high, steps, functions)
    points = Continuation(
        problem, first, first_direction, low=low, high=high, steps=steps, stop_at=stop_at
    )
    for solution in points:
        if progress is not None:
            progress(solution.value)
    return branch


class EquilibriumProblem(ContinuationProblem[EquilibriumEvaluation, R, E]):
    """Equilibria in one mode, along a branch or a curve."""

    equations: EquilibriumEquations

    def begin(self, point: EquilibriumEvaluation, direction: Floats) -> None:
        """Set the first point and its tangent."""
        self.first, self.at_first = np.concatenate([point.unknowns, point.values]), direction

    def closing(self, step: PredictorStep[EquilibriumEvaluation], length: float) -> float | None:
        """Return the position in a step of a return to the first point and tangent, or None."""
        position = float((self.first - step.start) @ step.direction)
        if len(self.branch.points) <= PREDICTOR_POINTS or not 0.0 < position <= length:
            return None
        near = np.abs(step.at(position).unknowns - self.first).max() < SAME_EQUILIBRIUM_DISTANCE
        return position if near and step.direction @ self.at_first > 0.5 else None

    def rates(self, point: EquilibriumEvaluation, name: str, value: float) -> Floats:
        """Return the flow at an equilibrium, at another value of a parameter."""
        values = point.values.copy()
        values[self.parameters.index(name)] = value
        return self.equations.evaluate(point.unknowns, values).residual


class _EquilibriumBranchProblem(EquilibriumProblem[EquilibriumPoint, EquilibriumEvent]):
    """Equilibria in one parameter."""

    def __init__(
        self,
        branch: EquilibriumBranch,
        equations: EquilibriumEquations,
        low: float,
        high: float,
        steps: StepControl,
        functions: Sequence[FunctionTest],
    ) -> None:
        self.functions = FunctionZeros[EquilibriumEvaluation](equations, functions)
        self.branch, self.equations, self.family = branch, equations, equations.family
        self.parameters, self.low, self.high = (branch.parameter,), low, high
        self.bifurcations = Bifurcations(
            equations,
            IMAGINARY_AXIS,
            lambda balance: balance.jacobian,
            UNEXPLAINED_STEP_RATIO * steps.max_step,
        )

    def corrector(self, point: EquilibriumEvaluation) -> Corrector[EquilibriumEvaluation]:
        """Return the corrector of a step."""
        return partial(correct, self.equations)

    def solve(self, guess: Floats) -> EquilibriumEvaluation:
        """Correct a guess at its value of the parameter."""
        reason, remedy = "the correction at the bound did not converge", "take shorter steps"
        return solve_at(self.equations, guess[:-1], guess[-1:], reason=reason, remedy=remedy)

    def record(self, point: EquilibriumEvaluation, direction: Floats) -> None:
        """Append an equilibrium to the branch."""
        equilibrium = make_equilibrium(self.equations, point)
        self.branch.points.append(EquilibriumPoint(equilibrium, float(point.values[0]), direction))

    def accept(self, located: LocatedEvents[EquilibriumEvaluation, EquilibriumEvent]) -> None:
        """Append the special points of a step, also to the points of the branch."""
        branch = self.branch
        branch.special_points[:] = self.bifurcations.without_spurious_folds(
            branch.special_points, lambda each: each.solution.balance
        )
        branch.special_points += located.events
        branch.points += [
            EquilibriumPoint(each.solution, each.value, each.direction) for each in located.events
        ]

    def tests(self, point: EquilibriumEvaluation, direction: Floats) -> dict[TestFunction, float]:
        """Return the test functions of an equilibrium."""
        tests: dict[TestFunction, float] = {
            BranchPointTest(): regularity(point, tangent(point, direction))
        }
        guards = self.family.automaton.guards
        for j, margin in enumerate(self.equations.margins(point).tolist()):
            if np.isfinite(margin) and not guards[j].records:
                tests[BoundaryTest(BOUNDARY, j)] = margin
        return tests

    def locate(
        self,
        step: PredictorStep[EquilibriumEvaluation],
        length: float,
        before: Mapping[TestFunction, float],
        after: Mapping[TestFunction, float],
    ) -> LocatedEvents[EquilibriumEvaluation, EquilibriumEvent]:
        """Locate the special points of a step, in order."""
        candidates = []
        ends = before[BranchPointTest()], after[BranchPointTest()]
        for position, kind, located, _ in self.bifurcations.within(step, length, *ends):
            crossed = kind == BRANCH_POINT  # the tangent there is not unique
            direction = (
                branch_direction(step, located) if crossed else tangent(located, step.direction)
            )
            kind = HOPF if kind == CROSSING else kind
            candidates.append((position, self._event(located, direction, kind)))
        for test in before:
            if not isinstance(test, BoundaryTest) or test not in after:
                continue
            changes_sign = (before[test] < 0.0) != (after[test] < 0.0)
            # Where both are zero up to rounding, the branch lies on the boundary.
            largest = max(abs(before[test]), abs(after[test]))
            if changes_sign and largest > EQUILIBRIUM_MARGIN_TOLERANCE:
                position = self._zero(step, length, test)
                located = step.at(position).point
                direction = tangent(located, step.direction)
                candidates.append(
                    (position, self._event(located, direction, test.kind, test.guard))
                )
        for position, function, located in self.functions.within(step, length):
            direction = tangent(located, step.direction)
            candidates.append((position, self._event(located, direction, function.kind)))
        candidates.sort(key=lambda item: item[0])
        return LocatedEvents(
            [each for _, each in candidates if self.low <= each.value <= self.high]
        )

    def _zero(
        self, step: PredictorStep[EquilibriumEvaluation], length: float, test: BoundaryTest
    ) -> float:
        def value(evaluation: EquilibriumEvaluation) -> float:
            return test.value(self.equations, evaluation, step.direction)

        try:
            return step.zero(value, length)
        except ValueError as error:
            raise OrbitError(f"a {test.kind} could not be located", SHORTER_STEP_REMEDY) from error

    def _event(
        self, balance: EquilibriumEvaluation, direction: Floats, kind: str, guard: int = -1
    ) -> EquilibriumEvent:
        equilibrium = make_equilibrium(self.equations, balance)
        name = self.family.automaton.guards[guard].name if guard >= 0 else ""
        label, value = EQUILIBRIUM_LABELS.get(kind, kind), float(balance.values[0])
        return EquilibriumEvent(kind, label, value, equilibrium, direction, guard=name)


def frequency(equilibrium: EquilibriumState) -> float | None:
    """Return the frequency of the limit cycle at a Hopf point, None at any other point."""
    values = equilibrium.eigenvalues
    rotating = values[np.abs(values.imag) > MIN_IMAGINARY_RATIO * np.abs(values)]
    beside = np.abs(rotating.real) / np.abs(rotating)
    if not beside.min(initial=1.0) < MULTIPLIER_TOLERANCE:
        return None
    return float(abs(rotating[np.argmin(beside)].imag))
