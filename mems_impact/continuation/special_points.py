"""Location and classification of special points."""

from __future__ import annotations

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.bisection import bisect
from mems_impact.continuation.arclength import PredictorStep, tangent
from mems_impact.continuation.branch import OrbitEvent
from mems_impact.continuation.test_functions import (
    BRANCH_POINT,
    FOLD,
    MARGIN_ROUNDING,
    MEETING,
    MULTIPLIER_TOLERANCE,
    NEIMARK_SACKER,
    ORBIT_LABELS,
    PERIOD_DOUBLING,
    ClosestApproachTest,
    ContactSpeedTest,
    FoldTest,
    ModeChoiceTest,
    SegmentLengthTest,
    TestFunction,
    choice_margins,
    closest_approach,
    kind_of,
)
from mems_impact.errors import OrbitError
from mems_impact.hybrid.event_loop.workspace import NONE
from mems_impact.orbits.monodromy import reduced_components, reduced_monodromy
from mems_impact.orbits.periodic_orbit import PeriodicOrbit, defects, make_orbit
from mems_impact.orbits.shooting import Shooting, ShootingEvaluation, without_flow_direction

MIN_BRACKET_RATIO = 1e-13  # bracket of the last admissible orbit, relative to the step
COMPARISON_DISTANCE = (
    1e-6  # distance on the branch at which margins on both sides of a loss are compared
)
MAX_VANISHING_LENGTH = 1e-3  # length below which a segment vanishes at a located grazing
HALF_PERIOD_RTOL = 2e-3  # largest relative difference between the halves of a double cover


def locate_zero(
    shooting: Shooting, step: PredictorStep, length: float, monitor: TestFunction
) -> tuple[float, OrbitEvent] | None:
    """Locate the zero of `monitor` within the first `length` of a step.

    Return the position in the step with the point, or None if the sign change is no zero. Raises
    OrbitError if no zero is found within the step.
    """

    def test(here: ShootingEvaluation) -> float:
        value = monitor.value(shooting, here, tangent(here, step.direction))
        if value is None:
            raise ValueError(monitor)
        return value

    try:
        position = step.zero(test, length)
        here = step.at(position).point
    except ValueError as error:
        raise OrbitError(f"a {monitor.kind} could not be located", "take a shorter step") from error
    special = classify(monitor, shooting, here, tangent(here, step.direction))
    return None if special is None else (position, special)


def locate_defect(
    shooting: Shooting, step: PredictorStep[ShootingEvaluation], length: float
) -> tuple[float, OrbitEvent]:
    """Locate the last admissible orbit within the first `length` of a step.

    The search detects losses without a zero of a test function: an event leads to another mode, or
    a new closest approach appears with a negative margin. Raises OrbitError if a point within the
    step cannot be corrected.
    """
    kept, lost = admissible_bracket(shooting, step, 0.0, length)
    defect = defects(shooting, step.at(lost).point)[0]
    i, guards = defect.segment, shooting.automaton.guards
    monitor: TestFunction
    if defect.kind in ("missed", "reversed"):
        j = [guard.name for guard in guards].index(defect.guard)
        kind = kind_of(guards[j])
        missed = defect.kind == "missed"
        monitor = ClosestApproachTest(kind, j) if missed else ContactSpeedTest(kind, j, i)
    elif defect.kind == "order":
        monitor = SegmentLengthTest(MEETING, i)
    else:
        guard = shooting.segments[i].guard(shooting.m)
        kind = kind_of(guards[guard]) if guard != NONE else defect.guard
        monitor = ModeChoiceTest(kind, NONE, i)
    return locate_choice(shooting, step, kept) or _event_at(shooting, step, kept, monitor)


def admissible_bracket(
    shooting: Shooting, step: PredictorStep[ShootingEvaluation], begin: float, length: float
) -> tuple[float, float]:
    """Return adjacent positions of an admissible and an inadmissible orbit within a step."""
    bracket = max(MIN_BRACKET_RATIO, 4.0 * float(np.spacing(length)))
    return bisect(lambda at: not defects(shooting, step.at(at).point), begin, length, bracket)


def locate_choice(
    shooting: Shooting, step: PredictorStep[ShootingEvaluation], position: float
) -> tuple[float, OrbitEvent] | None:
    """Locate a change of the mode after an event of an orbit near `position`, if there is one.

    Raises OrbitError if a point nearby cannot be corrected.
    """
    sides = [step.at(position + s).point for s in (-COMPARISON_DISTANCE, COMPARISON_DISTANCE)]
    for i, segment in enumerate(shooting.segments):
        events = [side.events[i] for side in sides]
        led = {int(event.mode) for event in events if event is not None}
        guard = segment.guard(shooting.m)
        if len(led) < 2 or guard == NONE:
            continue
        kind = kind_of(shooting.automaton.guards[guard])
        for mode in sorted(led):
            before, after = (choice_margins(shooting, side, i, mode) for side in sides)
            # The margin of the event's own guard is zero on both sides, up to rounding.
            sure = np.minimum(np.abs(before), np.abs(after)) > MARGIN_ROUNDING
            turned = np.flatnonzero(sure & (before * after < 0.0))
            if turned.size:
                monitor = ModeChoiceTest(kind, int(turned[0]), i, mode)
                return _turn(shooting, step, position, monitor)
    return None


def _turn(
    shooting: Shooting,
    step: PredictorStep[ShootingEvaluation],
    position: float,
    monitor: ModeChoiceTest,
) -> tuple[float, OrbitEvent]:
    def margin(point: ShootingEvaluation) -> float:
        return float(choice_margins(shooting, point, monitor.segment, monitor.mode)[monitor.guard])

    position = step.zero(margin, position + COMPARISON_DISTANCE, position - COMPARISON_DISTANCE)
    return _event_at(shooting, step, position, monitor)


def _event_at(
    shooting: Shooting,
    step: PredictorStep[ShootingEvaluation],
    position: float,
    monitor: TestFunction,
) -> tuple[float, OrbitEvent]:
    here = step.at(position).point
    orbit, direction = make_orbit(shooting, here), tangent(here, step.direction)
    label, value = ORBIT_LABELS.get(monitor.kind, monitor.kind), float(here.values[0])
    return position, OrbitEvent(monitor.kind, label, value, orbit, direction, monitor)


def classify(
    monitor: TestFunction, shooting: Shooting, here: ShootingEvaluation, direction: Floats
) -> OrbitEvent | None:
    """Return the special point at a sign change of `monitor`; None if it is not a zero.

    A test function may change its sign at infinity (an impact at zero speed), and the product of
    two real multipliers may equal one.
    """
    orbit = make_orbit(shooting, here)
    if (
        monitor.kind == PERIOD_DOUBLING
        and np.abs(orbit.multipliers + 1.0).min() > MULTIPLIER_TOLERANCE
    ):
        return None
    if (
        monitor.kind == BRANCH_POINT
        and np.abs(orbit.multipliers - 1.0).min() > MULTIPLIER_TOLERANCE
    ):
        return None
    off_axis = orbit.multipliers[np.abs(orbit.multipliers.imag) > 1e-9]
    if monitor.kind == NEIMARK_SACKER and not np.any(
        np.abs(np.abs(off_axis) - 1.0) < MULTIPLIER_TOLERANCE
    ):
        return None
    kind = monitor.kind
    # The branch of doubled period folds at its period doubling.
    if kind in (FOLD, BRANCH_POINT) and is_double_cover(orbit):
        kind, monitor = PERIOD_DOUBLING, FoldTest()
    label, value = ORBIT_LABELS.get(kind, kind), float(here.values[0])
    return OrbitEvent(kind, label, value, orbit, direction, monitor)


def priority(special: OrbitEvent) -> tuple[int, bool, int]:
    """Return the rank of a loss among several at one point; the lowest one determines the change.

    At a contact at zero speed, margins of the events that it causes are zero as well, and the event
    that reverses it has zero speed and ends a vanishing segment. Where two events coincide, a
    margin is zero at an end of a segment.
    """
    monitor, point = special.monitor, special.solution.point
    if isinstance(monitor, ContactSpeedTest):
        i = monitor.segment
        return 0, bool(point.ends[i] - point.starts[i] < MAX_VANISHING_LENGTH), i
    if isinstance(monitor, ClosestApproachTest):
        touch = closest_approach(special.solution.shooting, point, monitor.guard)
        return 1 if touch is not None and touch.inside else 3, False, monitor.guard
    assert isinstance(monitor, SegmentLengthTest | ModeChoiceTest)
    return 2, False, monitor.segment


def is_double_cover(orbit: PeriodicOrbit) -> bool:
    """Return whether an orbit is a double cover at its period doubling.

    Its second half repeats the first, and a multiplier over half the period is near -1: the branch
    of doubled period folds back onto itself there. With a multiplier near +1 the point is a fold
    of an orbit traversed twice.
    """
    split = _half_cycle(orbit) if orbit.shooting.phase is not None else _half(orbit)
    if split is None:
        return False
    apart, size, matrix = split
    if apart >= HALF_PERIOD_RTOL * size:
        return False
    multipliers = np.linalg.eigvals(matrix)
    return bool(np.abs(multipliers + 1.0).min() < np.abs(multipliers - 1.0).min())


def _half(orbit: PeriodicOrbit) -> tuple[float, float, Floats] | None:
    """Return the difference of the halves, their size, and the reduced matrix over the first.

    None if their events differ.
    """
    half, odd = divmod(len(orbit.segments), 2)
    codes = [segment.code for segment in orbit.segments]
    if odd or orbit.periods % 2 or codes[:half] != codes[half:]:
        return None
    states, _ = orbit.shooting.unpack(orbit.point.unknowns)
    apart = float(np.abs(states[:half] - states[half:]).max())
    return apart, float(np.abs(states).max()), reduced_monodromy(orbit.shooting, orbit.point, half)


def _half_cycle(orbit: PeriodicOrbit) -> tuple[float, float, Floats] | None:
    """Return the same for a limit cycle, whose second half starts within a segment."""
    shooting, point = orbit.shooting, orbit.point
    half, odd = divmod(len(orbit.segments) - 1, 2)
    codes = [segment.code for segment in orbit.segments[:-1]]
    middle, begin = 0.5 * point.period, float(point.starts[half])
    if odd or codes[:half] != codes[half:] or not begin < middle:
        return None
    states, _ = shooting.unpack(point.unknowns)
    mode = orbit.segments[half].mode
    arc = shooting.variational(point.parameter_point).arc(mode, states[half], begin, middle)
    free, keep = shooting.free, reduced_components(shooting, point)
    matrix = (arc.by_state[free] @ shooting.monodromy(point, half))[np.ix_(keep, keep)]
    apart = float(np.abs(arc.end - states[0])[free].max())
    flow = point.arcs[0].slope_start[free]
    if keep:
        matrix = without_flow_direction(matrix, flow[keep])
    # Its states would be those of the equilibrium around which a small cycle turns.
    return apart, float(point.period * np.abs(flow).max()), matrix
