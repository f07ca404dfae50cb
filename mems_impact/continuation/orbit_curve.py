"""Curves of special points of orbits in two parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.continuation.arclength import LocatedEvents, PredictorStep, StepControl
from mems_impact.continuation.branch import CurveEvent, OrbitCurve, OrbitEvent
from mems_impact.continuation.criticality import CriticalityTest
from mems_impact.continuation.curve import (
    BranchPointCurve,
    CurveProblem,
    correct_branch_point,
    correct_condition,
    curve_direction,
    curve_tangent,
    follow,
)
from mems_impact.continuation.grazing import DegenerateGrazingTest
from mems_impact.continuation.orbit_branch import OrbitProblem, oriented
from mems_impact.continuation.test_functions import (
    BRANCH_POINT,
    FOLD,
    FOLLOWED_NAMES,
    GRAZING,
    MINUS,
    NEUTRAL_RESONANCES,
    PAIR,
    BorderedCondition,
    ClosestApproachTest,
    ContactSpeedTest,
    DefiningSystem,
    ModeChoiceTest,
    MultiplierTest,
    NeimarkSackerCondition,
    TestFunction,
    closest_approach,
    curve_tests,
    orbit_tests,
    sign_changes,
)
from mems_impact.errors import InvalidParameter
from mems_impact.orbits.division import OtherEquations
from mems_impact.orbits.monodromy import multipliers_at
from mems_impact.orbits.periodic_orbit import PeriodicOrbit, make_orbit
from mems_impact.orbits.shooting import Shooting, ShootingEvaluation

COINCIDENT = 1e-7  # distance on the curve below which two losses count as one
Tests = dict[TestFunction, float]
MARGIN_TESTS = (ClosestApproachTest, ContactSpeedTest)


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
) -> OrbitCurve:
    """Continue a special point of a branch in `parameter` also in a `second` parameter.

    The point is a grazing, fold, period-doubling, Neimark-Sacker or branch point, or the contact of
    another guard. Other arguments as in `curve.follow`.
    """
    if parameter == second:
        raise InvalidParameter(field="second", value=second, allowed=f"other than {parameter}")
    curve = OrbitCurve(special.kind, (parameter, second))
    orbit = special.solution

    def begin() -> tuple[OrbitCurveProblem, ShootingEvaluation]:
        shooting = orbit.equations(curve.parameters)
        kind = OrbitBranchPointCurve if special.kind == BRANCH_POINT else OrbitCurveProblem
        values = np.array([orbit.family.values[name] for name in curve.parameters])
        near = shooting.evaluate(orbit.point.unknowns, values)
        return kind(curve, special, shooting, (low, high)), near

    return follow(
        curve,
        orbit.family,
        begin,
        low=low,
        high=high,
        direction=direction,
        steps=steps or StepControl(),
        progress=progress,
    )


class OrbitCurveProblem(
    OrbitProblem[PeriodicOrbit, CurveEvent[PeriodicOrbit]],
    CurveProblem[ShootingEvaluation, PeriodicOrbit],
):
    """Orbits at which one test function is zero, in two parameters."""

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
        # The guard of the orbit's impacts, or else the guard that the orbit approaches most
        # closely.
        self.guard = self._main_guard(special.solution)

    @property
    def equations(self) -> Shooting:
        """The equations of the orbit."""
        return self.shooting

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

    def solution(self, point: ShootingEvaluation) -> PeriodicOrbit:
        """Return the orbit of a point. On a mode choice, either of the two modes is admissible."""
        orbit = make_orbit(self.shooting, point)
        if not isinstance(self.monitor, ModeChoiceTest):
            return orbit
        segment = self.monitor.segment
        defects = (d for d in orbit.defects if (d.kind, d.segment) != ("mode", segment))
        return replace(orbit, defects=tuple(defects))

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
        return tests | self._other_margins(point)

    def _other_margins(self, point: ShootingEvaluation) -> Tests:
        """Return the margins and contact speeds that are not zero along the whole curve."""
        tests = orbit_tests(self.shooting, point, np.zeros(1))
        return {
            test: value
            for test, value in tests.items()
            if isinstance(test, MARGIN_TESTS) and test not in self.zero
        }

    def name_of(self, test: TestFunction) -> str:
        """Return the name of a zero of `test` on this curve."""
        if not isinstance(test, MARGIN_TESTS):
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
        candidates = self.zeros(step, length, sign_changes(before, after))
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

    def _beyond(self, test: TestFunction, after: Mapping[TestFunction, float]) -> str:
        """Return the reason for an end at a zero of `test`; empty if the curve continues."""
        if test.ends_orbits:
            return "the orbit is inadmissible" if after[test] < 0.0 else ""
        if isinstance(test, MultiplierTest) and test.test in NEUTRAL_RESONANCES:
            return "the pair of multipliers is real, as of a neutral saddle"
        return ""


class OrbitBranchPointCurve(BranchPointCurve[ShootingEvaluation, PeriodicOrbit], OrbitCurveProblem):
    """Continuation problem of orbits at which another branch crosses, in two parameters."""

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

    def tests(self, point: ShootingEvaluation, direction: Floats) -> Tests:
        """Return the test functions for points of codimension two."""
        multipliers = multipliers_at(self.shooting, point)
        # A second multiplier +1 is not separated from the first.
        named = (MultiplierTest(BRANCH_POINT, name) for name in (MINUS, PAIR))
        tests: Tests = {test: test.of(multipliers) for test in named}
        return tests | self._other_margins(point)
