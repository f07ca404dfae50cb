"""Branches of periodic orbits."""

from __future__ import annotations

import contextlib
import math
from abc import abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.continuation.arclength import (
    CONTINUATION_ERRORS,
    NEUTRAL_DISTANCE,
    ORBIT_CONTINUUM,
    ClosureDetector,
    Continuation,
    ContinuationProblem,
    Corrector,
    E,
    LocatedEvents,
    PredictorStep,
    R,
    Restart,
    StepControl,
    correct,
    no_orbit_message,
    reason_of,
    tangent,
)
from mems_impact.continuation.branch import OrbitBranch, OrbitEvent, OrbitPoint
from mems_impact.continuation.branching_equation import branch_direction
from mems_impact.continuation.chatter_onset import (
    ACROSS_START,
    BEYOND_ONSET,
    chatter_onset,
    rests_after_chatter,
)
from mems_impact.continuation.grazing import (
    NO_ORBIT_BEYOND,
    at_level,
    change_signature,
    changed_guard,
    neighbour,
)
from mems_impact.continuation.homoclinic import has_large_error_growth, slow_passage
from mems_impact.continuation.sliding import ADDING_SLIDING, discontinuity, is_discontinuity
from mems_impact.continuation.special_points import (
    MAX_VANISHING_LENGTH,
    admissible_bracket,
    classify,
    locate_choice,
    locate_defect,
    locate_zero,
    priority,
)
from mems_impact.continuation.stability import (
    CIRCLE,
    CROSSING,
    UNEXPLAINED_STEP_RATIO,
    Bifurcations,
    Spectrum,
)
from mems_impact.continuation.test_functions import (
    BRANCH_POINT,
    FOLD,
    GRAZING,
    MEETING,
    NEIMARK_SACKER,
    ORBIT_LABELS,
    PERIOD_DOUBLING,
    BranchPointTest,
    ClosestApproachTest,
    ModeChoiceTest,
    SegmentLengthTest,
    TestFunction,
    bifurcation_test,
    kind_of,
    orbit_tests,
    sign_changes,
)
from mems_impact.continuation.user_test_functions import FunctionTest, FunctionZeros
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.hybrid.event_loop.workspace import NONE
from mems_impact.orbits.division import OtherEquations, divided
from mems_impact.orbits.limit_cycle import check_not_degenerate, phase_is_clear, rebase_phase
from mems_impact.orbits.monodromy import monodromy_factors
from mems_impact.orbits.newton import solve
from mems_impact.orbits.periodic_orbit import PeriodicOrbit, defects, make_orbit
from mems_impact.orbits.shooting import Shooting, ShootingEvaluation, length_gradient
from mems_impact.orbits.signature import BOUNDARY

# --- Other equations of the same orbits


def corrected(
    other: OtherEquations, point: ShootingEvaluation, direction: Floats
) -> tuple[ShootingEvaluation, Floats]:
    """Return the solution of other equations for an orbit, and the tangent of the branch.

    Raises OrbitError if it cannot be corrected there.
    """
    # Normal to the branch: at a fold the equations for a fixed parameter are singular.
    shooting, unknowns, _ = other
    across = tangent(shooting.evaluate(unknowns, point.values))
    solution = correct(shooting, np.concatenate([unknowns, point.values]), across).point
    return solution, oriented(tangent(solution), direction, shooting)


def oriented(onward: Floats, direction: Floats, other: Shooting) -> Floats:
    """Orient a tangent of other equations along the former one.

    The changes of period and parameters are independent of the start of a limit cycle; a forced
    orbit has the same start and the same events.
    """
    shared = len(other.active) + (len(other.events) if other.phase is None else 1)
    same = onward[-shared:] @ direction[-shared:]
    if other.phase is None:
        first = len(other.free)
        same += onward[:first] @ direction[:first]
    return onward if same >= 0.0 else -onward


# --- Continuation problem of periodic orbits


class OrbitProblem(ContinuationProblem[ShootingEvaluation, R, E]):
    """Continuation problem of periodic orbits, of one signature at a time."""

    def __init__(self, shooting: Shooting) -> None:
        self.shooting, self.family, self.parameters = shooting, shooting.family, shooting.active

    def begin(self, point: ShootingEvaluation, direction: Floats) -> None:
        """Set the first orbit and the tangent there."""
        self._beginning = ClosureDetector(self.shooting, point, direction)

    def norm(self, vector: Floats) -> float:
        """Return the norm, which does not grow with the number of segments."""
        return self.shooting.norm(vector)

    def check(self, point: ShootingEvaluation, following: ShootingEvaluation) -> None:
        """Raise an OrbitError if an orbit has shrunk to a point."""
        check_not_degenerate(self.shooting, point, following)

    def closing(self, step: PredictorStep[ShootingEvaluation], length: float) -> float | None:
        """Return the position in a step of a return to the first orbit, in the same direction."""
        return self._beginning.within(self.shooting, step, length)

    def rebased(
        self, point: ShootingEvaluation, direction: Floats
    ) -> tuple[ShootingEvaluation, Floats] | None:
        """Restart a cycle if its start is close to an event; choose other nodes if necessary."""
        if not phase_is_clear(self.shooting, point):
            return self.with_equations(rebase_phase(self.shooting, point), point, direction)
        other = divided(self.shooting, point)
        return None if other is None else self.with_equations(other, point, direction)

    @abstractmethod
    def with_equations(
        self, other: OtherEquations, point: ShootingEvaluation, direction: Floats
    ) -> tuple[ShootingEvaluation, Floats]:
        """Return the orbit of a point with other equations, and the tangent of branch or curve."""

    def rates(self, point: ShootingEvaluation, name: str, value: float) -> Floats:
        """Return the flow at both ends of all segments, and the states after the events."""
        automaton = self.family.automaton
        values = {**dict(zip(self.parameters, point.values.tolist(), strict=True)), name: value}
        p = np.asarray(self.family.numbers(**values).parameters, dtype=float)
        states, _ = self.shooting.unpack(point.unknowns)
        rates = []
        for i, segment in enumerate(self.shooting.segments):
            mode, end, last = segment.mode, float(point.ends[i]), point.arcs[i].end
            rates.append(automaton.slope_at(mode, float(point.starts[i]), states[i], p))
            rates.append(automaton.slope_at(mode, end, last, p))
            if segment.code != BOUNDARY:
                rates.append(automaton.state_after(mode, segment.code, end, last, p)[1])
        return np.concatenate(rates)

    def no_step(self, point: ShootingEvaluation, error: Exception) -> str:
        """Return the message for an orbit beyond which no step of any length succeeds."""
        message = super().no_step(point, error)
        multipliers = make_orbit(self.shooting, point).multipliers
        if np.abs(multipliers - 1.0).min() < NEUTRAL_DISTANCE:
            return f"{message}; {ORBIT_CONTINUUM}"
        return message


# --- Branches of periodic orbits in one parameter

REGULARITY_NOISE = 1e-6  # largest error of the regularity within a continuum of orbits
MATRIX_ERROR_SAFETY = 10.0  # factor on estimates of the error of derivatives
REFINED_VALUE = 1e-10  # of a test function that is not zero at a located crossing
REFINEMENT_RATIO = 1e-3  # of a step, on each side of the crossing, in which its zero is located
COINCIDENT = 1e-7  # distance on the branch below which two losses count as one
COMMON_CAUSE_DISTANCE = 1e-5  # distance on the branch below which losses share one cause
MULTIPLIER_JUMP = 1e-3  # least relative change of a multiplier at a corner of the branch
MULTIPLIER_NOISE = 1e-8  # error of multipliers
MARGIN_ROUNDING = 1e-8  # margin at an equilibrium on a guard, relative to the largest of the cycle
BEYOND_BOUNDS = "the period grows beyond bounds"
HALF_PERIOD = "the orbit of half the period, from which this branch bifurcates"


def follow(
    orbit: PeriodicOrbit,
    parameter: str,
    *,
    low: float,
    high: float,
    direction: float | Floats = 1.0,
    steps: StepControl | None = None,
    reconnecting: bool = True,
    functions: Sequence[FunctionTest] = (),
    stop_at: Collection[str] = (),
    progress: Callable[[float], None] | None = None,
) -> OrbitBranch:
    """Continue `orbit` in `parameter` up to a bound, an end or the budget of points.

    `direction` is the sign of the first step in the parameter, or a change of unknowns and
    parameter to follow; the branch is continued in this direction only. If `reconnecting`, it
    continues with the changed signature where a margin is touched; otherwise it keeps its
    signature, and its orbits become inadmissible. Zeros of the user's `functions` are located. The
    branch ends at special points of the kinds `stop_at`, and `ended` is the reason; `progress` is
    called with every value of the parameter.
    """
    branch = OrbitBranch(parameter)
    points = points_of(
        branch, orbit, low=low, high=high, direction=direction, steps=steps,
        reconnecting=reconnecting, functions=functions, stop_at=stop_at,
    )  # fmt: skip
    for solution in points:
        if progress is not None:
            progress(solution.value)
    return branch


def points_of(
    branch: OrbitBranch,
    orbit: PeriodicOrbit,
    *,
    low: float,
    high: float,
    direction: float | Floats = 1.0,
    steps: StepControl | None = None,
    reconnecting: bool = True,
    functions: Sequence[FunctionTest] = (),
    stop_at: Collection[str] = (),
) -> Iterator[OrbitPoint]:
    """Continue `orbit` as `follow` does, one point per iteration of the caller.

    `branch` is empty, in the parameter to vary; points and special points are appended to it.
    """
    parameter, value = branch.parameter, orbit.family.value(branch.parameter)
    if not low <= value <= high:
        lowest, present, highest = (orbit.family.amount(parameter, v) for v in (low, value, high))
        reason = f"is {present}, must be between the bounds {lowest} and {highest}"
        raise InvalidParameter(parameter, None, "", problem=reason)
    shooting = orbit.equations((parameter,))
    start = orbit.point.unknowns
    try:
        if np.ndim(direction):  # of many orbits at one value, the one across it
            away = np.asarray(direction)
            point = correct(shooting, np.append(start, value), away).point
            first_direction = tangent(point, away)
        else:
            point = solve(shooting, start, np.array([value]))
            first_direction = float(np.sign(direction)) * tangent(point)
    except CONTINUATION_ERRORS as error:
        branch.ended = f"the first orbit could not be corrected: {reason_of(error, orbit.family)}"
        return
    steps = steps or StepControl()
    problem = _BranchProblem(branch, shooting, low, high, steps, reconnecting, functions)
    yield from Continuation(
        problem, point, first_direction, low=low, high=high, steps=steps, stop_at=stop_at
    )


class _BranchProblem(OrbitProblem[OrbitPoint, OrbitEvent]):
    """Orbits in one parameter, with changes of the signature."""

    branch: OrbitBranch

    def __init__(
        self,
        branch: OrbitBranch,
        shooting: Shooting,
        low: float,
        high: float,
        steps: StepControl,
        reconnecting: bool,
        functions: Sequence[FunctionTest] = (),
    ) -> None:
        super().__init__(shooting)
        self.functions = FunctionZeros[ShootingEvaluation](shooting, functions)
        self.branch, self.low, self.high, self.steps = branch, low, high, steps
        self.reconnecting = reconnecting
        self.piece = 0
        self.budget = steps.max_points  # of changes of the order of events
        self.bifurcations: Bifurcations[ShootingEvaluation] | None = None  # of the last signature

    def corrector(self, point: ShootingEvaluation) -> Corrector[ShootingEvaluation]:
        """Return the corrector of a step."""
        return partial(correct, self.shooting)

    def solve(self, guess: Floats) -> ShootingEvaluation:
        """Correct a guess at its value of the parameter."""
        return solve(self.shooting, guess[:-1], guess[-1:])

    def tests(self, point: ShootingEvaluation, direction: Floats) -> dict[TestFunction, float]:
        """Return the test functions of an orbit."""
        return orbit_tests(self.shooting, point, tangent(point, direction))

    def record(self, point: ShootingEvaluation, direction: Floats) -> None:
        """Append an orbit to the branch."""
        orbit = make_orbit(self.shooting, point)
        self.branch.points.append(OrbitPoint(orbit, float(point.values[0]), direction, self.piece))

    def record_event(self, event: OrbitEvent) -> None:
        """Append a special point, at which the branch ends, to its points."""
        self.branch.points.append(
            OrbitPoint(event.solution, event.value, event.direction, self.piece)
        )

    def accept(self, located: LocatedEvents[ShootingEvaluation, OrbitEvent]) -> None:
        """Append the special points of a step to the branch."""
        assert self.bifurcations is not None
        self.branch.special_points[:] = self.bifurcations.without_spurious_folds(
            self.branch.special_points, lambda each: each.solution.point
        )
        self.branch.special_points += located.events

    def pass_loss(
        self, located: LocatedEvents[ShootingEvaluation, OrbitEvent], length: float
    ) -> Restart[ShootingEvaluation] | str:
        """Continue with the signature of orbits beyond a loss, or end there."""
        loss, before = located.loss, located.before
        assert loss is not None
        assert before is not None
        if located.reason:
            self.record(loss.solution.point, loss.direction)
            return located.reason
        ended = self._end_at_equilibrium(loss) or self._end_of_rest(loss)
        if ended:
            return ended
        joined, reason = self._change_signature(loss)
        # If only the order of events changes, the motion is the same.
        passing = False
        if joined is not None and _short_segments(loss.solution.shooting, loss.solution.point):
            loss = self._adding_sliding(loss, joined)
        if joined is not None and isinstance(loss.monitor, SegmentLengthTest):
            guard = changed_guard(loss.solution.shooting, joined[0])
            passing = guard == NONE
            loss = self._named(loss, guard)
        if not passing and not loss.solution.defects:
            self.record_event(loss)
        if joined is None:
            return f"{loss.kind}: {reason}"
        self.shooting, point, direction = joined
        if not passing:
            self.piece += 1
            self.record(point, direction)
            return Restart(point, direction, self.steps.initial_step)
        self._reclassify_coincident(loss, before, self.shooting, point, direction)
        self.budget -= 1
        if self.budget == 0:
            self.stalled()
            swapped = OrbitError("events exchange their order repeatedly", "take shorter steps")
            return self.no_step(point, swapped)
        return Restart(point, direction, max(length / 2.0, self.steps.initial_step))

    def pass_stall(
        self, point: ShootingEvaluation, direction: Floats
    ) -> Restart[ShootingEvaluation] | None:
        """Continue with the orbits without segments that vanish together.

        An example is an orbit that leaves its sliding region several times in a period: where
        these excursions vanish, either sign of each of their lengths solves the equations.
        """
        shooting = self.shooting
        shrinking = [
            i
            for i in _short_segments(shooting, point)
            if length_gradient(shooting, point, i) @ direction < 0.0
        ]
        if not shrinking or not self.reconnecting:
            return None
        value, orbit = float(point.values[0]), make_orbit(shooting, point)
        monitor = SegmentLengthTest(MEETING, shrinking[0])
        loss = OrbitEvent(MEETING, MEETING, value, orbit, direction, monitor)
        try:
            joined = neighbour(loss, self.branch.parameter)
            touch = _touch_beyond(loss, joined)
        except CONTINUATION_ERRORS:
            return None
        self.branch.special_points.append(touch)
        self.record_event(touch)
        self.shooting, start, onward = joined
        self.piece += 1
        self.record(start, onward)
        return Restart(start, onward, self.steps.initial_step)

    def with_equations(
        self, other: OtherEquations, point: ShootingEvaluation, direction: Floats
    ) -> tuple[ShootingEvaluation, Floats]:
        """Return the orbit of a point with other equations, and the tangent of the branch."""
        self.shooting = other.shooting
        return corrected(other, point, direction)

    def end_at(self, point: ShootingEvaluation) -> str:
        """Return the reason for an end at an orbit; empty if the branch continues."""
        if has_large_error_growth(point):
            self.stalled()
        return BEYOND_BOUNDS if self.branch.passage is not None else ""

    def _end_at_equilibrium(self, loss: OrbitEvent) -> str:
        """Return the reason for an end where a cycle reaches a guard at an equilibrium; else empty.

        Near the equilibrium the rate of the guard is rounding, as the flow is.
        """
        orbit = loss.solution
        passage = slow_passage([*self.branch.solutions, orbit])
        if passage is None:
            return ""
        variational = orbit.shooting.variational(orbit.point.parameter_point)
        margins, _ = variational.margins(passage.mode, 0.0, passage.state)
        sizes = np.abs([arc.margins for arc in orbit.point.arcs]).max(axis=(0, 1))
        if not (np.abs(margins) < MARGIN_ROUNDING * sizes).any():
            return ""
        self.branch.passage = passage
        return BEYOND_BOUNDS

    def stalled(self) -> None:
        """Record the slow passage of the last limit cycle, if its period grows beyond bounds."""
        self.branch.passage = slow_passage(self.branch.solutions)

    def _end_of_rest(self, loss: OrbitEvent) -> str:
        """Return the reason for an end where a rest after chatter has length zero; else empty.

        The special point is reclassified and relocated, and orbits beyond it are removed.
        """
        segments, m = loss.solution.segments, loss.solution.shooting.m
        if not isinstance(loss.monitor, SegmentLengthTest):
            return ""
        i = loss.monitor.segment
        if not rests_after_chatter(segments, i, m):
            return ""
        if segments[i].code == BOUNDARY:
            # The start of the period is no event of the motion.
            self.branch.special_points[:] = [s for s in self.branch.special_points if s is not loss]
            return ACROSS_START
        onset = chatter_onset(loss, self.branch.parameter)
        if onset is None:
            return ""
        self.branch.special_points[-1] = onset
        points, onward = self.branch.points, loss.direction[-1]
        while len(points) > 1 and (points[-1].value - onset.value) * onward > 0.0:
            points.pop()
        self.branch.points.append(
            OrbitPoint(onset.solution, onset.value, onset.direction, self.piece)
        )
        return f"{onset.kind}: {BEYOND_ONSET}"

    def _change_signature(self, loss: OrbitEvent) -> tuple[Joined | None, str]:
        """Return the branch that joins at `loss`, or None with the reason."""
        parameter = self.branch.parameter
        try:
            # The shortest excursions from sliding are known least, and a run finds longer ones.
            if not isinstance(loss.monitor, ModeChoiceTest) and not _adds_sliding(loss):
                joined = change_signature(loss.solution, loss.monitor, parameter)
                if not defects(*joined[:2]):
                    return joined, ""
        except CONTINUATION_ERRORS as error:
            reason = no_orbit_message(error, loss.solution.family)
        else:
            reason = NO_ORBIT_BEYOND
        try:
            return neighbour(loss, parameter), ""
        except CONTINUATION_ERRORS:
            by_impact = loss.kind == GRAZING or ORBIT_CONTINUUM in reason
            return None, reason if by_impact else NO_ORBIT_BEYOND

    def _adding_sliding(self, loss: OrbitEvent, joined: Joined) -> OrbitEvent:
        """Return the point at which the orbits beyond a loss touch the boundary of sliding.

        The length of an excursion from sliding is known to the root of the residual where it
        vanishes; the orbits that slide on are smooth there. Any other loss is returned unchanged.
        """
        try:
            touch = _touch_beyond(loss, joined)
        except CONTINUATION_ERRORS:
            return loss
        if not _adds_sliding(touch):
            return loss
        self.branch.special_points[-1] = touch
        return touch

    def _named(self, event: OrbitEvent, guard: int) -> OrbitEvent:
        """Name a point of simultaneous events after the guard that gains or loses an event."""
        if guard == NONE:
            return event
        kind = kind_of(event.solution.shooting.automaton.guards[guard])
        renamed = replace(event, kind=kind, label=ORBIT_LABELS.get(kind, kind))
        self.branch.special_points[-1] = renamed
        return renamed

    def _reclassify_coincident(
        self,
        event: OrbitEvent,
        earlier: ShootingEvaluation,
        shooting: Shooting,
        point: ShootingEvaluation,
        direction: Floats,
    ) -> None:
        """Reclassify a point of simultaneous events, or remove it if the motion is unchanged.

        At a switch of the drive the branch has a corner, and may fold or change its stability
        there. Elsewhere the test functions continue across the change of order, unless the field
        between the two events differs: then the multipliers jump.
        """
        try:  # multipliers may change fast along the branch
            solution = solve(shooting, point.unknowns, np.array([event.value]))
        except CONTINUATION_ERRORS:
            solution = point
        before = CIRCLE.spectrum(monodromy_factors(event.solution.shooting, earlier))
        after = CIRCLE.spectrum(monodromy_factors(shooting, solution))
        passing = CIRCLE.crossings(before, after)
        changed = [_kind_of(complex(before.values[i])) for i, _ in passing]
        if event.direction[-1] * direction[-1] < 0.0:
            changed.insert(0, FOLD)
        assert isinstance(event.monitor, SegmentLengthTest)
        i, segments = event.monitor.segment, event.solution.segments
        at_switch = 2 * event.solution.shooting.m in (segments[i - 1].code, segments[i].code)
        # By identity, since comparing events compares arrays.
        self.branch.special_points[:] = [s for s in self.branch.special_points if s is not event]
        if (at_switch and changed) or (not at_switch and not changed and _jumps(before, after)):
            self.branch.special_points.append(event)
        elif changed:
            orbit, test = event.solution, bifurcation_test(changed[0])
            special = classify(test, orbit.shooting, orbit.point, event.direction)
            self.branch.special_points += [special] if special else []

    def locate(
        self,
        step: PredictorStep[ShootingEvaluation],
        length: float,
        before: Mapping[TestFunction, float],
        after: Mapping[TestFunction, float],
    ) -> LocatedEvents[ShootingEvaluation, OrbitEvent]:
        """Locate all special points of a step, up to a loss."""
        shooting = self.shooting

        def crossed(
            after: Mapping[TestFunction, float], reach: float
        ) -> list[tuple[float, OrbitEvent]]:
            zeros = [
                locate_zero(shooting, step, reach, monitor)
                for monitor, *_ in sign_changes(before, after)
            ]
            inside = [item for item in zeros if item and self.low <= item[1].value <= self.high]
            return sorted(inside, key=lambda item: item[0])

        # A crossing from inadmissible to admissible orbits is no loss.
        lost = crossed(
            {m: v for m, v in after.items() if m.ends_orbits and before.get(m, 0.0) > 0.0}, length
        )
        first, reach, point = None, length, step.at(length).point
        if lost:
            first = min(
                (item for item in lost if item[0] <= lost[0][0] + COINCIDENT),
                key=lambda item: priority(item[1]),
            )
            if isinstance(first[1].monitor, ClosestApproachTest) and first[1].kind != GRAZING:
                first = self._mode_choice(shooting, step, first) or first
            # Beyond a loss the test functions may jump, and are not evaluated.
            reach = max(lost[0][0] - COINCIDENT, 0.0)
        if self._is_inadmissible(
            shooting, step, max(reach - COMMON_CAUSE_DISTANCE, 0.0) if lost else reach
        ):
            hidden = locate_defect(shooting, step, reach)
            if self.low <= hidden[1].value <= self.high:
                first, reach = hidden, max(hidden[0] - COINCIDENT, 0.0)
        if reach < length:
            point = step.at(reach).point
            after = orbit_tests(shooting, point, tangent(point, step.direction))
        bifurcations = self._bifurcations(shooting, step, reach, before, after)
        located = [*bifurcations, *self._function_zeros(shooting, step, reach)]
        located.sort(key=lambda item: item[0])
        for position, each in bifurcations:
            if each.kind == PERIOD_DOUBLING and each.monitor.kind == FOLD:
                until = [other for other_position, other in located if other_position < position]
                return LocatedEvents([*until, each], each, HALF_PERIOD, point)
        special_points = [each for _, each in located]
        if first is None:
            return LocatedEvents(special_points)
        loss_at_first = self._admissible(shooting, step, *first)
        # Where an event coincides with a switch the branch has a corner, and one-sided tangents.
        corner = isinstance(loss_at_first.monitor, SegmentLengthTest)
        if corner:
            loss_at_first = replace(loss_at_first, direction=tangent(point, step.direction))
        loss = loss_at_first if self.reconnecting else None
        return LocatedEvents([*special_points, loss_at_first], loss, "", point, corner)

    def _mode_choice(
        self,
        shooting: Shooting,
        step: PredictorStep[ShootingEvaluation],
        loss: tuple[float, OrbitEvent],
    ) -> tuple[float, OrbitEvent] | None:
        """Locate a change of the mode after an event at or just before a loss, if there is one."""
        choice = locate_choice(shooting, step, loss[0])
        if choice is not None or not self._requires_admissibility:
            return choice
        # Beyond such a change a margin is zero up to rounding, and its sign is arbitrary.
        begin = max(loss[0] - COMMON_CAUSE_DISTANCE, 0.0)
        if not loss[1].solution.defects or self._is_inadmissible(shooting, step, begin):
            return None
        bracket, _ = admissible_bracket(shooting, step, begin, loss[0])
        return locate_choice(shooting, step, bracket)

    def _admissible(
        self,
        shooting: Shooting,
        step: PredictorStep[ShootingEvaluation],
        position: float,
        special: OrbitEvent,
    ) -> OrbitEvent:
        """Return a loss with the last admissible orbit before it.

        At the loss itself a margin is zero, and rounding determines its sign.
        """
        back = COINCIDENT * 1e-2
        while (
            special.solution.defects
            and back < min(COMMON_CAUSE_DISTANCE, position)
            and self._requires_admissibility
        ):
            orbit = make_orbit(shooting, step.at(position - back).point)
            if orbit.admissible:
                return replace(special, solution=orbit)
            back *= 10.0
        return special

    @property
    def _requires_admissibility(self) -> bool:
        """Whether the branch is restricted to admissible orbits."""
        return self.reconnecting and self.branch.points[-1].solution.admissible

    def _is_inadmissible(
        self, shooting: Shooting, step: PredictorStep[ShootingEvaluation], reach: float
    ) -> bool:
        """Return whether the orbit at `reach` in a step is inadmissible."""
        return self._requires_admissibility and bool(defects(shooting, step.at(reach).point))

    def _bifurcations(
        self,
        shooting: Shooting,
        step: PredictorStep[ShootingEvaluation],
        length: float,
        before: Mapping[TestFunction, float],
        after: Mapping[TestFunction, float],
    ) -> list[tuple[float, OrbitEvent]]:
        """Return folds, branch points and changes of stability, with their positions."""
        if self.bifurcations is None or self.bifurcations.equations is not shooting:
            short = UNEXPLAINED_STEP_RATIO * self.steps.max_step
            self.bifurcations = Bifurcations(
                shooting, CIRCLE, partial(monodromy_factors, shooting), short
            )
        first, last = (test[BranchPointTest()] for test in (before, after))
        largest = max(abs(first), abs(last))
        if largest < REGULARITY_NOISE and largest < _matrix_error(shooting, step.at(length).point):
            first = last = 0.0
        bifurcations, located = [], self.bifurcations.within(step, length, first, last)
        if any(each.kind == CROSSING for each in located):
            ends = [make_orbit(shooting, step.at(s).point).stable for s in (0.0, length)]
            if ends == [None, None]:  # errors of neutral multipliers
                located = [each for each in located if each.kind != CROSSING]
        for position, kind, here, value in located:
            monitor = bifurcation_test(_kind_of(value) if kind == CROSSING else kind)
            if monitor.kind == PERIOD_DOUBLING:
                position, here = _refined(shooting, step, length, position, monitor)
            crossed = kind == BRANCH_POINT  # the tangent there is not unique
            direction = branch_direction(step, here) if crossed else tangent(here, step.direction)
            special = classify(monitor, shooting, here, direction)
            if special is not None and self.low <= special.value <= self.high:
                bifurcations.append((position, special))
        return bifurcations

    def _function_zeros(
        self, shooting: Shooting, step: PredictorStep[ShootingEvaluation], length: float
    ) -> list[tuple[float, OrbitEvent]]:
        """Return the zeros of the user's functions, with their positions."""
        if self.functions.equations is not shooting:
            self.functions = FunctionZeros(shooting, self.functions.tests)
        found = []
        for position, test, here in self.functions.within(step, length):
            special = classify(test, shooting, here, tangent(here, step.direction))
            if special is not None and self.low <= special.value <= self.high:
                found.append((position, special))
        return found


Joined = tuple[Shooting, ShootingEvaluation, Floats]
"""An orbit of the changed signature, and the direction of its branch."""


def _short_segments(shooting: Shooting, point: ShootingEvaluation) -> list[int]:
    """Return the segments of vanishing length between two events of guards, shortest first."""
    lengths, m = point.ends - point.starts, shooting.m
    codes = [segment.guard(m) for segment in shooting.segments]
    order = np.argsort(lengths)[: int((lengths < MAX_VANISHING_LENGTH).sum())]
    return [i for i in order.tolist() if NONE not in (codes[i - 1], codes[i])]


def _adds_sliding(event: OrbitEvent) -> bool:
    """Return whether a sliding orbit touches the boundary of its sliding region at a point."""
    if not isinstance(event.monitor, ClosestApproachTest) or not is_discontinuity(event):
        return False
    try:
        return discontinuity(event).type == ADDING_SLIDING
    except CONTINUATION_ERRORS:
        return False


def _touch_beyond(loss: OrbitEvent, joined: Joined) -> OrbitEvent:
    """Return the point at which orbits without the short segments of a loss touch their guards.

    Raises OrbitError if it is not found.
    """
    shooting, start, onward = joined
    before = loss.solution.segments
    touches = [
        ClosestApproachTest(kind_of(shooting.automaton.guards[guard]), guard)
        for i in _short_segments(loss.solution.shooting, loss.solution.point)
        if (guard := before[i - 1].guard(shooting.m)) != NONE
    ]
    rooms = [test.value(shooting, start, onward) for test in touches]
    first = touches[int(np.argmin([math.inf if room is None else room for room in rooms]))]
    here = at_level(shooting, start, first.equation(shooting), 0.0)
    special = classify(first, shooting, here, tangent(here, onward))
    assert special is not None
    return special


def _refined(
    shooting: Shooting,
    step: PredictorStep[ShootingEvaluation],
    length: float,
    position: float,
    monitor: TestFunction,
) -> tuple[float, ShootingEvaluation]:
    """Return the zero of a test function near a position, with its point; else that position.

    Where two multipliers meet on the unit circle, as without damping, each has the square root of
    the error of their matrix, but the test function is smooth.
    """

    def test(point: ShootingEvaluation) -> float:
        return float(monitor.value(shooting, point, step.direction) or 0.0)

    if abs(test(step.at(position).point)) > REFINED_VALUE:
        reach = REFINEMENT_RATIO * length
        with contextlib.suppress(ValueError):  # it has a double zero
            position = step.zero(test, min(position + reach, length), max(position - reach, 0.0))
    return position, step.at(position).point


def _matrix_error(shooting: Shooting, point: ShootingEvaluation) -> float:
    """Return the error of the derivatives of the equations, by smaller tolerances and steps."""
    refined = shooting.refined.evaluate(point.unknowns, point.values)
    change = refined.derivatives - point.derivatives
    return MATRIX_ERROR_SAFETY * float(np.linalg.norm(change, 2))


def _jumps(before: Spectrum, after: Spectrum) -> bool:
    """Return whether multipliers differ on the two sides of a point."""
    rows, columns = CIRCLE.pairing(before, after)
    here, there = before.values[rows], after.values[columns]
    limits = MULTIPLIER_JUMP * np.maximum(np.abs(here), np.abs(there)) + MULTIPLIER_NOISE
    return bool(np.any(np.abs(here - there) > limits))


def _kind_of(multiplier: complex) -> str:
    """Return the kind of bifurcation at a multiplier on the unit circle."""
    if multiplier.imag != 0.0:
        return NEIMARK_SACKER
    return FOLD if multiplier.real > 0.0 else PERIOD_DOUBLING
