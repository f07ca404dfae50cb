"""Curves of special points in two parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.continuation.arclength import (
    CONTINUATION_ERRORS,
    NODES,
    ClosureDetector,
    PredictorStep,
    StepControl,
    no_step_message,
    reason_of,
)
from mems_impact.continuation.grazing import contact_coefficient
from mems_impact.continuation.orbit_branch import oriented, renumbered
from mems_impact.continuation.special_points import BranchEvent
from mems_impact.continuation.test_functions import (
    CONTACT,
    CUSP,
    FIRST,
    FOLD,
    GRAZING,
    NEIMARK_SACKER,
    NEUTRAL,
    FoldCondition,
    TestFunction,
    closest_approach,
    condition_of,
    is_zero,
    monitors,
    multiplier_tests,
    name_of,
    value_of,
)
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.orbits.limit_cycle import check_not_degenerate, phase_is_clear, rebase_phase
from mems_impact.orbits.newton import Solution, newton
from mems_impact.orbits.periodic_orbit import PeriodicOrbit, make_orbit, reduced_monodromy
from mems_impact.orbits.shooting import ShootingEvaluation

__all__ = ["CurveEvent", "CurvePoint", "OrbitCurve", "follow_curve"]

ITERATIONS = 10
COINCIDENT = 1e-7  # distance on the curve below which two losses are one
Tests = dict[str | TestFunction, float]  # test functions by their name, or by the margin
CONTINUOUS = 1e-3  # part of its values beside it of a test function at a zero that is no jump


@dataclass(frozen=True)
class CurvePoint:
    """One orbit on a curve.

    Attributes
    ----------
    orbit : PeriodicOrbit
    values : tuple of float
        Of the two parameters.
    """

    orbit: PeriodicOrbit
    values: tuple[float, float]


@dataclass(frozen=True)
class CurveEvent:
    """A point of a curve at which a second thing happens.

    Attributes
    ----------
    kind : str
    values : tuple of float
        Of the two parameters.
    orbit : PeriodicOrbit
    """

    kind: str
    values: tuple[float, float]
    orbit: PeriodicOrbit


@dataclass
class OrbitCurve:
    """A curve of special points in two parameters.

    Attributes
    ----------
    kind : str
        Of the special points.
    parameters : tuple of str
    points : list of CurvePoint
    special_points : list of CurveEvent
    ended : str
        Why the curve ends.
    """

    kind: str
    parameters: tuple[str, str]
    points: list[CurvePoint] = field(default_factory=list)
    special_points: list[CurveEvent] = field(default_factory=list)
    ended: str = ""


def follow_curve(
    special: BranchEvent,
    parameter: str,
    second: str,
    *,
    low: float,
    high: float,
    direction: float = 1.0,
    steps: StepControl | None = None,
    progress: Callable[[float], None] | None = None,
) -> OrbitCurve:
    """Follow a special point of a branch in a second parameter.

    Parameters
    ----------
    special : BranchEvent
        A grazing, fold, period doubling or Neimark-Sacker point (or the touching of another guard).
    parameter : str
        The parameter of the branch.
    second : str
        The other one.
    low, high : float
        Bounds of the second parameter.
    direction : float
        Sign of the first step in the second parameter.
    steps : StepControl, optional
    progress : callable, optional
        Called with every value of the second parameter.

    Returns
    -------
    OrbitCurve
    """
    if parameter == second:
        raise InvalidParameter(field="second", value=second, allowed=f"another than {parameter}")
    return _CurveContinuation(special, parameter, second, (low, high), steps or StepControl()).go(
        direction, progress
    )


class _CurveContinuation:
    """The iteration along a curve."""

    def __init__(
        self,
        special: BranchEvent,
        parameter: str,
        second: str,
        bounds: tuple[float, float],
        steps: StepControl,
    ) -> None:
        orbit = special.orbit
        self.monitor, self.bounds, self.steps = special.monitor, bounds, steps
        self.shooting = orbit.equations((parameter, second))
        self.condition = condition_of(self.shooting, self.monitor)
        values = [orbit.family.values[parameter], orbit.family.values[second]]
        self.start = np.concatenate([orbit.point.unknowns, values])
        self.curve = OrbitCurve(special.kind, (parameter, second))
        self.gradient = np.zeros(self.start.size)  # of the condition, where a step begins
        self.zero: set[TestFunction] = set()
        # The guard of the impacts that the orbit has, or of the one that it comes closest to.
        self.guard = self._main_guard(orbit)

    def _main_guard(self, orbit: PeriodicOrbit) -> int:
        if orbit.impacts:
            return orbit.impacts[0][0]
        impacts = [j for j, guard in enumerate(self.shooting.automaton.guards) if guard.impact]
        nearest = [(closest_approach(orbit.shooting, orbit.point, j), j) for j in impacts]
        gaps = [(gap.value, j) for gap, j in nearest if gap is not None]
        return min(gaps, default=(0.0, -1))[1]

    def go(self, direction: float, progress: Callable[[float], None] | None) -> OrbitCurve:
        curve, steps = self.curve, self.steps
        try:
            point = self._evaluate(self.start)
            self.gradient = self.condition.gradient(point)
            along = self._tangent(point)
            along = along if along[-1] * direction >= 0.0 else -along
            point = self._correct(self.start, along, self.start).point
        except CONTINUATION_ERRORS as error:
            curve.ended = (
                f"the first point could not be corrected: {reason_of(error, self.shooting.family)}"
            )
            return curve
        length = steps.initial
        behind: list[Floats] = []
        self._append(point)
        # What a touched guard takes with it is zero all along, and no point of codimension two.
        touched = monitors(self.shooting, point, np.zeros(1))
        self.zero = {other for other, value in touched.items() if abs(value) < 1e-6}
        before = self._tests(point)
        beginning = ClosureDetector(self.shooting, point, along)
        while len(curve.points) < steps.most:
            try:
                step = PredictorStep(self._correct, point, along, behind[-NODES:])
                following = step.at(length).point
                check_not_degenerate(self.shooting, point, following)
                closing = beginning.within(self.shooting, step, length)
                if closing is not None:  # what lies beyond has been passed before
                    length, following = closing, step.at(closing).point
                after = self._tests(following)
                special, lost, beyond = self._special(step, length, before, after)
                self.gradient = self.condition.gradient(following)
                ahead = self._tangent(following, along)
                if ahead @ along < 0.95:
                    raise OrbitError("the curve turns too sharply", "take a shorter step")
            except CONTINUATION_ERRORS as error:
                self.gradient = self.condition.gradient(point)
                length /= 2.0
                if length < steps.smallest:
                    curve.ended = no_step_message(curve.points[-1].orbit, curve.parameters, error)
                    return curve
                continue
            curve.special_points += special
            if lost is not None:
                curve.points.append(CurvePoint(lost.orbit, lost.values))
                curve.ended = f"{lost.kind}: beyond, {beyond}"
                return curve
            if not self._inside(float(following.values[1])):
                self._correct_at_bound(step, length)
                curve.ended = f"{curve.parameters[1]} reached its bound"
                return curve
            behind.append(step.start)
            point, along, before = following, ahead, after
            self._append(point)
            if closing is not None:
                curve.ended = "the curve closed upon itself"
                return curve
            if not phase_is_clear(self.shooting, point):
                try:
                    point, along = self._begin_anew(point, along)
                    before, behind = self._tests(point), []
                except CONTINUATION_ERRORS as error:
                    curve.ended = no_step_message(curve.points[-1].orbit, curve.parameters, error)
                    return curve
            if progress is not None:
                progress(float(point.values[1]))
            length = min(1.5 * length, steps.largest)
        curve.ended = f"the budget of {steps.most} points is used up"
        return curve

    def _begin_anew(
        self, point: ShootingEvaluation, along: Floats
    ) -> tuple[ShootingEvaluation, Floats]:
        """Begin the cycles elsewhere; return the same point of the curve, and its direction."""
        count = len(self.shooting.segments)
        self.shooting, unknowns, first = rebase_phase(self.shooting, point)
        self.monitor = renumbered(self.monitor, count, first)
        self.zero = {renumbered(other, count, first) for other in self.zero}
        self.condition = condition_of(self.shooting, self.monitor)
        start = np.concatenate([unknowns, point.values])
        there = self._evaluate(start)
        self.gradient = self.condition.gradient(there)
        there = self._correct(start, self._tangent(there), start).point
        self.gradient = self.condition.gradient(there)
        return there, oriented(self._tangent(there), along, 2)

    def _append(self, point: ShootingEvaluation) -> None:
        values = (float(point.values[0]), float(point.values[1]))
        self.curve.points.append(CurvePoint(self._orbit(point), values))

    def _orbit(self, point: ShootingEvaluation) -> PeriodicOrbit:
        """Return the orbit of a point. Where two modes may follow, either is the automaton's."""
        orbit = make_orbit(self.shooting, point)
        if self.monitor.role != "choice":
            return orbit
        here = self.monitor.segment
        kept = (d for d in orbit.defects if (d.kind, d.segment) != ("mode", here))
        return replace(orbit, defects=tuple(kept))

    def _evaluate(self, u: Floats) -> ShootingEvaluation:
        return self.shooting.evaluate(u[:-2], u[-2:])

    def _tangent(self, point: ShootingEvaluation, along: Floats | None = None) -> Floats:
        wide = np.vstack([np.hstack([point.jacobian, point.by_parameter]), self.gradient])
        direction = np.linalg.svd(wide)[2][-1]
        if along is not None and direction @ along < 0.0:
            direction = -direction
        return np.asarray(direction)

    def _correct(self, plane: Floats, along: Floats, guess: Floats) -> Solution:
        """Correct `guess` in the plane through `plane` across `along`.

        A gradient that costs too much to be taken anew is the one from where the step began,
        brought up to date by what the condition turns out to be (Broyden 1965).
        """
        gradient, last = self.gradient, None

        def equations(u: Floats) -> tuple[ShootingEvaluation, Floats, Floats]:
            nonlocal gradient, last
            point = self._evaluate(u)
            here = self.condition.value(point)
            if self.condition.derived:
                gradient = self.condition.gradient(point)
            elif last is not None:
                moved = u - last[0]
                missed = here - last[1] - gradient @ moved
                gradient = gradient + missed * moved / (moved @ moved)
            last = u, here
            residual = np.concatenate([point.residual, [here, along @ (u - plane)]])
            matrix = np.vstack([np.hstack([point.jacobian, point.by_parameter]), gradient, along])
            return point, residual, matrix

        return newton(
            equations,
            guess,
            reason="the correction of a step did not converge",
            remedy="take a shorter step",
            iterations=ITERATIONS,
        )

    def _correct_at_bound(self, step: PredictorStep, length: float) -> None:
        """Put the last point at the bound, which lies within a step."""
        u, beyond = step.start, step.at(length).unknowns
        bound = self.bounds[0] if beyond[-1] < self.bounds[0] else self.bounds[1]
        share = (bound - u[-1]) / (beyond[-1] - u[-1])
        guess = u + share * (beyond - u)
        fixed = np.eye(u.size)[-1]
        try:
            self._append(self._correct(guess, fixed, guess).point)
        except OrbitError:
            return

    def _tests(self, point: ShootingEvaluation) -> Tests:
        """Return the test functions for points of codimension two."""
        names = [
            *multiplier_tests(self.monitor.kind),
            *([CUSP] if self.monitor.kind == FOLD else []),
            *([CONTACT] if self.monitor.role == "approach" else []),
        ]
        named = {name: self._test(name, point) for name in names}
        tests: Tests = {name: value for name, value in named.items() if value is not None}
        for other, value in monitors(self.shooting, point, np.zeros(1)).items():
            if other.role in ("approach", "rate") and other not in self.zero:
                tests[other] = value
        return tests

    def _test(self, test: str | TestFunction, point: ShootingEvaluation) -> float | None:
        """Return one of them; None where it has no meaning."""
        if isinstance(test, TestFunction):
            return monitors(self.shooting, point, np.zeros(1)).get(test)
        if test == CUSP:
            assert isinstance(self.condition, FoldCondition)
            return self.condition.curvature(point)
        if test == CONTACT:
            return contact_coefficient(self.shooting, point, self.monitor, 1)
        multipliers = np.linalg.eigvals(reduced_monodromy(self.shooting, point)).astype(complex)
        return value_of(self.monitor.kind, test, multipliers)

    def _kind(self, test: str | TestFunction) -> str:
        """Return what it is called where `test` is zero on this curve."""
        if isinstance(test, str):
            return name_of(self.monitor.kind, test)
        name = self.shooting.automaton.guards[test.guard].name
        if test.kind == GRAZING and self.monitor.kind == FOLD:
            # Folds of orbits with an impact set in where its speed is zero; those without, where
            # the grazing orbit has a multiplier +1.
            what = "degenerate grazing" if test.role == "rate" else "grazing-fold"
            return what if test.guard == self.guard else f"{what} ({name})"
        what, own = test.kind, FIRST.get(self.monitor.kind, self.monitor.kind)
        if what == GRAZING and test.guard not in (self.guard, self.monitor.guard):
            what = f"{GRAZING} ({name})"
        if not self.monitor.role:
            return f"{what}-{own}"
        return f"double {what}" if what == own else f"{own}-{what}"

    def _special(
        self, step: PredictorStep, length: float, before: Tests, after: Tests
    ) -> tuple[list[CurveEvent], CurveEvent | None, str]:
        """Return points of codimension two in a step, the one that ends the curve, and why."""
        found: list[tuple[float, str | TestFunction, CurveEvent]] = []
        for test, value in before.items():
            if test in after and value * after[test] < 0.0:
                located = self._locate(test, step, length, (value, after[test]))
                if located is not None and self._inside(located[1].values[1]):
                    found.append((located[0], test, located[1]))
        found.sort(key=lambda item: item[0])
        lost = [item for item in found if self._beyond(item[1], after)]
        if not lost:
            return [special for _, _, special in found], None, ""
        # An impact at zero speed takes with it what follows on it; it is the one to name.
        first = min(
            (item for item in lost if item[0] <= lost[0][0] + COINCIDENT),
            key=lambda item: (
                isinstance(item[1], TestFunction) and item[1].kind != GRAZING,
                item[0],
            ),
        )
        kept = [special for position, _, special in found if position < first[0] - COINCIDENT]
        return [*kept, first[2]], first[2], self._beyond(first[1], after)

    def _beyond(self, test: str | TestFunction, after: Tests) -> str:
        """Return why the curve ends where `test` is zero; empty if it goes on."""
        if isinstance(test, TestFunction):
            return "the automaton has no such orbit" if after[test] < 0.0 else ""
        if self.monitor.kind == NEIMARK_SACKER and test in NEUTRAL:
            return "the two multipliers of product 1 are real, those of neutral saddles"
        return ""

    def _inside(self, value: float) -> bool:
        return bool(self.bounds[0] <= value <= self.bounds[1])

    def _locate(
        self,
        test: str | TestFunction,
        step: PredictorStep,
        length: float,
        ends: tuple[float, float],
    ) -> tuple[float, CurveEvent] | None:
        """Locate a zero of `test` within a step: where in it, and the point.

        `ends`: its values at both ends.
        """

        def value(point: ShootingEvaluation) -> float:
            found = self._test(test, point)
            if found is None:
                raise KeyError(test)
            return found

        kind = self._kind(test)
        try:
            position = step.zero(value, length)
            point = step.at(position).point
        except (KeyError, ValueError) as error:
            raise OrbitError(f"{kind} could not be located", "take a shorter step") from error
        orbit = self._orbit(point)
        if isinstance(test, str) and not is_zero(self.monitor.kind, test, orbit.multipliers):
            return None
        if test == CUSP and abs(value(point)) > CONTINUOUS * min(map(abs, ends)):
            return None  # the derivative by the first parameter has changed its sign
        values = (float(point.values[0]), float(point.values[1]))
        return position, CurveEvent(kind, values, orbit)
