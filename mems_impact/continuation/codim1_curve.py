"""Curves of special points in two parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Protocol, TypeVar

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.continuation.arclength import (
    CONTINUATION_ERRORS,
    SHORTER_STEP_REMEDY,
    Continuation,
    Corrector,
    LocatedEvents,
    PredictorStep,
    StepControl,
    reason_of,
)
from mems_impact.continuation.branch import CurveEvent, OrbitCurve, OrbitEvent
from mems_impact.continuation.criticality import CriticalityTest
from mems_impact.continuation.grazing import DegenerateGrazingTest
from mems_impact.continuation.orbit_branch import OrbitProblem, oriented
from mems_impact.continuation.test_functions import (
    FOLD,
    FOLLOWED_NAMES,
    GRAZING,
    NEUTRAL_RESONANCES,
    BorderedCondition,
    ClosestApproachTest,
    ContactSpeedTest,
    CuspTest,
    DefiningSystem,
    ModeChoiceTest,
    MultiplierTest,
    NeimarkSackerCondition,
    TestFunction,
    closest_approach,
    curve_tests,
    orbit_tests,
)
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.orbits.division import OtherEquations
from mems_impact.orbits.linear_equations import null_vector
from mems_impact.orbits.monodromy import multipliers_at
from mems_impact.orbits.newton import Linearized, P, Solution, Solvable, newton
from mems_impact.orbits.periodic_orbit import PeriodicOrbit, make_orbit
from mems_impact.orbits.shooting import Shooting, ShootingEvaluation

__all__ = ["CurveProblem", "follow_curve"]

MAX_CURVE_ITERATIONS = 10
COINCIDENT = 1e-7  # distance on the curve below which two losses count as one
Tests = dict[TestFunction, float]
P_contra = TypeVar("P_contra", contravariant=True)
MARGIN_TESTS = (ClosestApproachTest, ContactSpeedTest)
MAX_ZERO_RATIO = 1e-3  # largest ratio of a test function at a zero to its values at the step's ends


def follow_curve(
    special: OrbitEvent,
    parameter: str,
    second: str,
    *,
    low: float,
    high: float,
    direction: float = 1.0,
    steps: StepControl | None = None,
    progress: Callable[[float], None] | None = None,
    problem: type[CurveProblem] | None = None,
) -> OrbitCurve:
    """Continue a special point of a branch in a second parameter.

    Parameters
    ----------
    special : OrbitEvent
        A grazing, fold, period-doubling or Neimark-Sacker point, or the contact of another guard.
    parameter : str
        The parameter of the branch.
    second : str
        The second parameter.
    low, high : float
        Bounds of the second parameter.
    direction : float
        Sign of the first step in the second parameter.
    steps : StepControl, optional
    progress : callable, optional
        Called with every value of the second parameter.
    problem : type, optional
        Of the curve, by default `CurveProblem`.

    Returns
    -------
    SolutionCurve
    """
    if parameter == second:
        raise InvalidParameter(field="second", value=second, allowed=f"other than {parameter}")
    curve = OrbitCurve(special.kind, (parameter, second))
    orbit, steps = special.solution, steps or StepControl()
    try:
        shooting = orbit.equations(curve.parameters)
        curve_problem = (problem or CurveProblem)(curve, special, shooting, (low, high))
        values = np.array([orbit.family.values[name] for name in curve.parameters])
        near = shooting.evaluate(orbit.point.unknowns, values)
        first_direction = curve_problem.tangent(
            near, direction * np.eye(near.unknowns.size + 2)[-1]
        )
        start = np.concatenate([near.unknowns, values])
        point = curve_problem.corrector(near)(start, first_direction, start).point
        curve_problem.begin(point, first_direction)
    except CONTINUATION_ERRORS as error:
        curve.ended = f"the first point could not be corrected: {reason_of(error, orbit.family)}"
        return curve
    try:
        for solution in Continuation(
            curve_problem, point, first_direction, low=low, high=high, steps=steps
        ):
            if progress is not None:
                progress(curve.values(solution)[1])
    except CONTINUATION_ERRORS as error:
        curve.ended = reason_of(error, orbit.family)
    return curve


class CurveProblem(OrbitProblem[PeriodicOrbit, CurveEvent[PeriodicOrbit]]):
    """Orbits at which one test function is zero, in two parameters."""

    noun = "curve"

    def __init__(
        self,
        curve: OrbitCurve,
        special: OrbitEvent,
        shooting: Shooting,
        bounds: tuple[float, float],
    ) -> None:
        super().__init__(shooting)
        self.branch, self.monitor, self.bounds = curve, special.monitor, bounds
        self.condition = self._defining_system()
        self._linear: tuple[ShootingEvaluation, Floats] | None = None  # the condition's gradient
        # The guard of the orbit's impacts, or else the one that it approaches most closely.
        self.guard = self._main_guard(special.solution)

    def _defining_system(self) -> DefiningSystem:
        """Return the equation that the special point adds."""
        return self.monitor.equation(self.shooting)

    def begin(self, point: ShootingEvaluation, direction: Floats) -> None:
        """Set the first orbit, the tangent there, and the test functions that mark no point."""
        super().begin(point, direction)
        # Test functions that are zero along the whole curve mark no point of codimension two.
        touched = orbit_tests(self.shooting, point, np.zeros(1))
        self.zero = {other for other, value in touched.items() if abs(value) < 1e-6}

    def _main_guard(self, orbit: PeriodicOrbit) -> int:
        if orbit.impacts:
            return orbit.impacts[0][0]
        impacts = [j for j, guard in enumerate(self.shooting.automaton.guards) if guard.impact]
        nearest = [(closest_approach(orbit.shooting, orbit.point, j), j) for j in impacts]
        gaps = [(gap.value, j) for gap, j in nearest if gap is not None]
        return min(gaps, default=(0.0, -1))[1]

    def with_equations(
        self, other: OtherEquations, point: ShootingEvaluation, direction: Floats
    ) -> tuple[ShootingEvaluation, Floats]:
        """Return the orbit of a point with other equations, and the tangent of the curve."""
        shooting, unknowns, first = other
        count = len(self.shooting.segments)
        monitor = self.monitor.rebased(count, first)
        condition = monitor.equation(shooting)
        near = shooting.evaluate(unknowns, point.values)
        gradient, start = condition.gradient(near), np.concatenate([unknowns, point.values])
        across = curve_direction(near, gradient)
        restarted = correct_condition(shooting, condition, gradient, start, across, start).point
        self._linear = restarted, condition.gradient(restarted)
        self.shooting, self.monitor, self.condition = shooting, monitor, condition
        self.zero = {test.rebased(count, first) for test in self.zero}
        return restarted, oriented(curve_direction(*self._linear), direction, shooting)

    def record(self, point: ShootingEvaluation, direction: Floats) -> None:
        """Append an orbit to the curve."""
        self.branch.points.append(self._orbit(point))

    def _orbit(self, point: ShootingEvaluation) -> PeriodicOrbit:
        """Return the orbit of a point. On a mode choice, either of the two modes is admissible."""
        orbit = make_orbit(self.shooting, point)
        if not isinstance(self.monitor, ModeChoiceTest):
            return orbit
        segment = self.monitor.segment
        defects = (d for d in orbit.defects if (d.kind, d.segment) != ("mode", segment))
        return replace(orbit, defects=tuple(defects))

    def tangent(self, point: ShootingEvaluation, direction: Floats) -> Floats:
        """Return the unit tangent of the curve, oriented along `direction`."""
        vector = curve_direction(point, self._gradient(point))
        return vector if vector @ direction >= 0.0 else -vector

    def _gradient(self, point: ShootingEvaluation) -> Floats:
        """Return the gradient of the condition, whose scaling is fixed at this point."""
        if self._linear is None or self._linear[0] is not point:
            self._linear = point, self.condition.gradient(point)
        return self._linear[1]

    def corrector(self, point: ShootingEvaluation) -> Corrector[ShootingEvaluation]:
        """Return the corrector of a step.

        An expensive gradient is evaluated at the start of the step only, and then updated by the
        values of the condition (Broyden 1965).
        """
        return partial(correct_condition, self.shooting, self.condition, self._gradient(point))

    def solve(self, guess: Floats) -> ShootingEvaluation:
        """Correct a guess at its value of the second parameter."""
        assert self._linear is not None
        fixed = np.eye(guess.size)[-1]
        return self.corrector(self._linear[0])(guess, fixed, guess).point

    def tests(self, point: ShootingEvaluation, direction: Floats) -> Tests:
        """Return the test functions for points of codimension two."""
        named: list[TestFunction] = [*curve_tests(self.monitor.kind)]
        if isinstance(self.monitor, ClosestApproachTest):
            named.append(DegenerateGrazingTest(self.monitor.kind))
        if isinstance(self.condition, BorderedCondition | NeimarkSackerCondition) and (
            self.monitor.kind in CriticalityTest.NAMES
        ):
            named.append(CriticalityTest(self.monitor.kind))
        multipliers = multipliers_at(self.shooting, point)  # once for all tests that need them
        values = {
            test: test.of(multipliers)
            if isinstance(test, MultiplierTest)
            else test.on_curve(self.condition, point)
            for test in named
        }
        tests: Tests = {test: value for test, value in values.items() if value is not None}
        for other, value in orbit_tests(self.shooting, point, np.zeros(1)).items():
            if isinstance(other, MARGIN_TESTS) and other not in self.zero:
                tests[other] = value
        return tests

    def _kind(self, test: TestFunction) -> str:
        """Return the name of a zero of `test` on this curve."""
        if not isinstance(test, MARGIN_TESTS):
            assert isinstance(
                test, MultiplierTest | CuspTest | CriticalityTest | DegenerateGrazingTest
            )
            return test.name
        name = self.shooting.automaton.guards[test.guard].name
        if test.kind == GRAZING and self.monitor.kind == FOLD:
            # Folds of orbits with an impact start at zero impact speed, folds without an impact
            # where the grazing orbit has a multiplier +1.
            kind = "degenerate grazing" if isinstance(test, ContactSpeedTest) else "grazing-fold"
            return kind if test.guard == self.guard else f"{kind} ({name})"
        kind, curve_kind = test.kind, FOLLOWED_NAMES.get(self.monitor.kind, self.monitor.kind)
        own_guard = getattr(self.monitor, "guard", -1)
        double = kind == curve_kind
        if kind == GRAZING and test.guard not in (self.guard, own_guard):
            kind = f"{GRAZING} ({name})"
        if not self.monitor.ends_orbits:
            return f"{kind}-{curve_kind}"
        return f"double {kind}" if double else f"{curve_kind}-{kind}"

    def locate(
        self,
        step: PredictorStep[ShootingEvaluation],
        length: float,
        before: Mapping[TestFunction, float],
        after: Mapping[TestFunction, float],
    ) -> LocatedEvents[ShootingEvaluation, CurveEvent[PeriodicOrbit]]:
        """Locate points of codimension two in a step, up to one that ends the curve."""
        candidates: list[tuple[float, TestFunction, CurveEvent[PeriodicOrbit]]] = []
        for test, value in before.items():
            if test in after and value * after[test] < 0.0:
                located = self._locate(test, step, length, (value, after[test]))
                if located is not None and self._inside(located[1].values[1]):
                    candidates.append((located[0], test, located[1]))
        candidates.sort(key=lambda item: item[0])
        beyond = [item for item in candidates if self._beyond(item[1], after)]
        if not beyond:
            return LocatedEvents([special for _, _, special in candidates])
        # An impact at zero speed makes later margins zero as well; it gives the name.
        first = min(
            (item for item in beyond if item[0] <= beyond[0][0] + COINCIDENT),
            key=lambda item: (
                isinstance(item[1], MARGIN_TESTS) and item[1].kind != GRAZING,
                item[0],
            ),
        )
        earlier = [
            special for position, _, special in candidates if position < first[0] - COINCIDENT
        ]
        reason = f"{first[2].kind}: beyond it, {self._beyond(first[1], after)}"
        return LocatedEvents([*earlier, first[2]], first[2], reason)

    def pass_loss(
        self, located: LocatedEvents[ShootingEvaluation, CurveEvent[PeriodicOrbit]], length: float
    ) -> str:
        """End the curve at a loss."""
        assert located.loss is not None
        self.branch.points.append(located.loss.solution)
        return located.reason

    def _beyond(self, test: TestFunction, after: Mapping[TestFunction, float]) -> str:
        """Return the reason for an end at a zero of `test`; empty if the curve continues."""
        if test.ends_orbits:
            return "the orbit is inadmissible" if after[test] < 0.0 else ""
        if isinstance(test, MultiplierTest) and test.test in NEUTRAL_RESONANCES:
            return "the pair of multipliers is real, as of a neutral saddle"
        return ""

    def _inside(self, value: float) -> bool:
        return bool(self.bounds[0] <= value <= self.bounds[1])

    def _locate(
        self,
        test: TestFunction,
        step: PredictorStep[ShootingEvaluation],
        length: float,
        ends: tuple[float, float],
    ) -> tuple[float, CurveEvent[PeriodicOrbit]] | None:
        """Return the position in a step and the point of a zero of `test`, with values `ends`."""

        def value(point: ShootingEvaluation) -> float:
            value_on_curve = test.on_curve(self.condition, point)
            if value_on_curve is None:
                raise ValueError(test)
            return value_on_curve

        kind = self._kind(test)
        try:
            if isinstance(test, CriticalityTest):
                zero = test.zero(self.condition, step, length)
                if zero is None:
                    return None  # the change of sign is not confirmed
                position = zero
            else:
                position = step.zero(value, length)
            point = step.at(position).point
        except ValueError as error:
            raise OrbitError(f"{kind} could not be located", "take a shorter step") from error
        orbit = self._orbit(point)
        if isinstance(test, MultiplierTest) and not test.is_zero(orbit.multipliers):
            return None
        if isinstance(test, CuspTest) and abs(value(point)) > MAX_ZERO_RATIO * min(map(abs, ends)):
            return None  # only the derivative by the first parameter has changed its sign
        values = (float(point.values[0]), float(point.values[1]))
        return position, CurveEvent(kind, values, orbit)


def curve_direction(point: Linearized, gradient: Floats) -> Floats:
    """Return a unit tangent of the curve at a point, of arbitrary sign."""
    rows = np.hstack([point.jacobian, point.by_parameter]), gradient
    return null_vector(np.vstack(rows))


class Condition(Protocol[P_contra]):
    """An additional equation: `DefiningSystem`, `EquilibriumCondition`."""

    @property
    def derived(self) -> bool:
        """Whether the gradient is evaluated at every iteration."""

    def value(self, point: P_contra) -> float:
        """Return the value."""

    def gradient(self, point: P_contra) -> Floats:
        """Return the derivatives by unknowns and parameters."""


def correct_condition(
    equations: Solvable[P],
    condition: Condition[P],
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
        matrix = np.vstack([np.hstack([point.jacobian, point.by_parameter]), gradient, direction])
        return point, residual, matrix

    return newton(
        extended,
        guess,
        reason="the correction of a step did not converge",
        remedy=SHORTER_STEP_REMEDY,
        iterations=MAX_CURVE_ITERATIONS,
    )
