"""Grazing on a branch: change of the event sequence, and the normal form of the first impact.

The test functions `ClosestApproachTest` and `ContactSpeedTest` detect it.

An impact at low speed, with the events that it causes, changes the state by a kick proportional to
the square root of the penetration of the orbit without impact. The sign of the kick's image in the
margin, xi_k = grad h . M^k kick, determines whether the orbit reaches the stopper again after k
periods; M is the monodromy matrix of the orbit without impact, based at the grazing point
(Nordmark 1991).

At a grazing, and where two events exchange their order, the other signature follows from the orbit
(`change_signature`). Elsewhere a run from a point slightly beyond determines it (`neighbour`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.continuation.arclength import CONTINUATION_ERRORS, tangent
from mems_impact.continuation.branch import OrbitEvent
from mems_impact.continuation.special_points import MAX_VANISHING_LENGTH
from mems_impact.continuation.test_functions import (
    ClosestApproach,
    ClosestApproachTest,
    ContactSpeedTest,
    CurveTest,
    DefiningSystem,
    SegmentLengthTest,
    TestFunction,
    closest_approach,
)
from mems_impact.errors import OrbitError
from mems_impact.hybrid.event_loop.workspace import NONE, TRANSITION
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational.derivatives import Variational
from mems_impact.orbits.monodromy import reduced_components
from mems_impact.orbits.newton import newton, solve
from mems_impact.orbits.periodic_orbit import PeriodicOrbit, defects, make_orbit
from mems_impact.orbits.shooting import Shooting, ShootingEvaluation
from mems_impact.orbits.signature import BOUNDARY, OrbitGuess, Segment, read_signature

# --- Normal form of the first impact

TRIAL_SPEED = 1e-3  # of the trial impacts that determine the kick
NULL_KICK_RATIO = 1e-6  # relative size below which a kick has no component transverse to the flow
SIGN_PERIODS = 200  # number of coefficients xi_k whose signs are evaluated

CONTINUOUS, JUMP, AFTER_FOLD = "continuous", "jump", "after a fold"


@dataclass(frozen=True)
class DegenerateGrazingTest(CurveTest):
    """The coefficient xi_1 on a curve of grazings."""

    @property
    def name(self) -> str:
        """Name of a zero."""
        return f"degenerate {self.kind}"

    def on_curve(self, condition: DefiningSystem, point: ShootingEvaluation) -> float | None:
        """Return the coefficient."""
        assert isinstance(condition.monitor, ClosestApproachTest)
        return contact_coefficient(condition.equations, point, condition.monitor, 1)


def contact_coefficient(
    shooting: Shooting, point: ShootingEvaluation, monitor: ClosestApproachTest, k: int
) -> float | None:
    """Return xi_k = grad h . M^k kick: positive if the kick leads away from the stopper.

    None if the orbit has events, for which the formula does not hold, or if a weak contact does not
    return to the mode of the orbit.
    """
    try:
        sequence = contact_coefficients(shooting, point, monitor, k)
    except OrbitError:
        return None
    return None if sequence is None else float(sequence[-1])


def contact_coefficients(
    shooting: Shooting, point: ShootingEvaluation, monitor: ClosestApproachTest, count: int
) -> Floats | None:
    """Return xi_1 .. xi_count, or None if the orbit has events or the kick is along the flow.

    Switches at fixed times are no events. The kick of a planar limit cycle is along the flow, and
    only shifts the time of contact.
    """
    if any(segment.guard(shooting.m) != NONE for segment in shooting.segments):
        return None
    touch = closest_approach(shooting, point, monitor.guard)
    if touch is None:
        return None
    i, time = touch.segment, touch.time
    segment = shooting.segments[i]
    states, _ = shooting.unpack(point.unknowns)
    free = shooting.free
    variational = shooting.variational(point.parameter_point)
    to_touch = variational.arc(segment.mode, states[i], point.starts[i], time)
    from_touch = variational.arc(segment.mode, to_touch.end, time, point.ends[i])

    def switched(j: int, by_state: Floats) -> Floats:
        switch = point.events[j]
        return (by_state if switch is None else switch.jump_by_state @ by_state)[free]

    total = switched(i, from_touch.by_state)
    others = len(shooting.segments)
    for j in range(i + 1, i + others):
        total = switched(j % others, point.arcs[j % others].by_state) @ total
    total = to_touch.by_state[free] @ total
    event = variational.event(segment.mode, monitor.guard, time, to_touch.end)
    # Components that the mode holds fixed contribute rounding errors only, which would grow.
    keep = reduced_components(shooting, point)
    total = total[np.ix_(keep, keep)]
    gradient = event.margin_by_state[monitor.guard][free][keep]
    image = impact_direction(shooting, point, segment.mode, monitor.guard, time, to_touch.end)[keep]
    if shooting.phase is not None:
        # A shift along the flow does not decay, so its rounding errors would grow relative to
        # decaying components.
        along = to_touch.slope_end[free][keep]
        across = np.eye(along.size) - np.outer(along, along) / float(along @ along)
        if np.linalg.norm(across @ image) < NULL_KICK_RATIO * np.linalg.norm(image):
            return None
        total, image = across @ total, across @ image
    values = []
    for _ in range(count):
        image = total @ image
        values.append(float(gradient @ image))
    return np.array(values)


def stays_positive(sequence: Floats) -> bool:
    """Return whether all xi_k above the rounding error of the largest are positive."""
    return bool(np.all(sequence > -1e-10 * np.abs(sequence).max()))


def impact_direction(
    shooting: Shooting, point: ShootingEvaluation, mode: int, guard: int, time: float, y: Floats
) -> Floats:
    """Return the change of the state per impact speed caused by a weak impact at (time, y).

    A trial run covers the impact and the events that it causes (such as a slip) until the mode is
    the initial one. Its end is compared with the undisturbed flow over the same time, and the
    difference is pulled back to the impact. Raises OrbitError if the run does not return to the
    mode.
    """
    problem = shooting.problem(point)
    free, variational = shooting.free, shooting.variational(point.parameter_point)

    def left_behind(speed: float) -> Floats:
        before = low_velocity_contact(variational, mode, guard, time, y, speed)
        events = run(problem, HybridState(0, time, mode, before), 0.02).events
        back = np.flatnonzero((events.kind == TRANSITION) & (events.mode_after == mode))
        if not back.size:
            raise OrbitError(
                "a weak contact does not return to the mode before it",
                "choose a range in which the frame sticks at the contact",
            )
        last = back[0]
        elapsed = float(events.time[last]) + problem.period * int(events.cycle[last])
        undisturbed = variational.arc(mode, before, time, elapsed)
        difference = events.after[last][free] - undisturbed.end[free]
        return np.asarray(np.linalg.lstsq(undisturbed.by_state[free], difference)[0]) / speed

    # Richardson extrapolation to zero speed; the error is proportional to the speed.
    return 2.0 * left_behind(0.5 * TRIAL_SPEED) - left_behind(TRIAL_SPEED)


def low_velocity_contact(
    variational: Variational, mode: int, guard: int, time: float, y: Floats, speed: float
) -> Floats:
    """Return the state nearest to `y` on the guard, with its margin decreasing at `speed`."""
    codes, times = np.array([[mode, guard]]), np.full((1, 3), time)
    contact = variational.traverse(codes, y[None], times)
    event = contact.event(0)
    margin, rate = event.margins[guard], event.rates[guard]
    # A mode with constraints projects the state.
    by_state = event.margin_by_state[[guard, variational.m + guard]] @ contact.arc(0).by_state
    target = np.array([-margin, -speed - rate])
    weak = y.copy()
    weak[list(variational.free)] += np.linalg.lstsq(by_state, target)[0]
    return weak


def grazing_type(orbit: PeriodicOrbit, monitor: TestFunction) -> str:
    """Classify the transition of the attractor at a grazing orbit without impacts.

    The result is "continuous" (all xi_k positive and the orbit stable: the paper's type II), "jump"
    (some xi_k negative: type I) or "after a fold" (a multiplier beyond +1: type III). Raises
    OrbitError if the orbit has other events, or is a limit cycle in a plane.
    """
    sequence = None
    if isinstance(monitor, ClosestApproachTest):
        if orbit.stable is False:
            return AFTER_FOLD
        sequence = contact_coefficients(orbit.shooting, orbit.point, monitor, SIGN_PERIODS)
    if sequence is None:
        raise OrbitError(
            "the grazing has no type: its orbit has other events, or is a limit cycle in a plane",
            "take a grazing of an orbit without impacts",
        )
    return CONTINUOUS if stays_positive(sequence) else JUMP


# --- Change of the signature

ENTRY_RATE = 1e-4  # contact speed of the first orbit with an inserted event
ORDER_TIME_OFFSET = (
    1e-6  # time before two simultaneous events at which the mode between them is evaluated
)
REMOVED_EVENT_MARGIN = 1e-6  # margin of the first orbit with a removed event
# Time between two events of the first orbit in their new order. The branch has a corner where they
# coincide: tangents and differences (with steps of 1e-6) must be one-sided.
MIN_GRAZING_SEPARATION = 1e-5
RESTART_DISTANCES = (1e-4, 1e-5, 1e-3, 1e-6)  # of initial states from a loss, along the branch
MIN_PARAMETER_SHARE = 0.01  # least ratio of the parameter change to that distance, as near a fold
MAX_SIGNATURES = 4  # maximum number of signatures per distance, each from a run on the last orbit
CONVERGENCE_RATIO = 0.1  # ratio of two distances between which a joining branch approaches ...
APPROACH_RATIO = 0.5  # ... the common orbit by this factor
NO_ORBIT_BEYOND = (
    "no orbit was found near this one beyond it: the motion may jump, lose its period, or have "
    "impacts that accumulate"
)


def change_signature(
    orbit: PeriodicOrbit, monitor: TestFunction, parameter: str
) -> tuple[Shooting, ShootingEvaluation, Floats]:
    """Return the branch of the other signature that joins at `orbit`, and its direction there.

    The orbit is a zero of `monitor`: a closest approach (an event is inserted), a contact speed
    (one is removed) or the length of a segment (one moves into another period, or past another
    event). The branch may lie on either side of `orbit` in the parameter. Its first orbit lies at a
    small distance from the common one, where the equations have a corner if one of two events is a
    switch. Raises OrbitError if no such branch is found.
    """
    guess, test, level = guess_beyond(orbit, monitor)
    shooting = orbit.equations((parameter,), guess.segments, pinned={})
    unknowns = shooting.pack(guess)
    value = orbit.family.values[parameter]
    shooting.pin(shooting.evaluate(unknowns, np.array([value])))
    condition, begin = test.equation(shooting), shooting.evaluate(unknowns, np.array([value]))
    point = at_level(shooting, begin, condition, level)
    if not isinstance(monitor, SegmentLengthTest):
        # An event that changes the state at zero speed too, as a reset, leads to a distant orbit.
        closer = CONVERGENCE_RATIO * level
        near = at_level(shooting, point, condition, closer)
        if not _approaches(orbit, value, shooting, near, point):
            raise OrbitError(NO_ORBIT_BEYOND, "find an orbit beyond it")
    direction = tangent(point)
    gain = float(condition.gradient(point) @ direction)
    return shooting, point, direction if gain > 0.0 else -direction


def guess_beyond(
    orbit: PeriodicOrbit, monitor: TestFunction
) -> tuple[OrbitGuess, TestFunction, float]:
    """Return a guess of the other signature, a test function that is zero here, and its value.

    Raises OrbitError if the other signature is unknown.
    """
    if isinstance(monitor, SegmentLengthTest):
        guess, grows = move_event_across_period(orbit, monitor.segment) or swap_adjacent_events(
            orbit, monitor.segment
        )
        return guess, replace(monitor, segment=grows), MIN_GRAZING_SEPARATION
    if isinstance(monitor, ContactSpeedTest):
        # In this segment only: the orbit may touch the guard elsewhere at the same value.
        test = ClosestApproachTest(monitor.kind, monitor.guard, monitor.segment)
        return remove_event(orbit, monitor), test, REMOVED_EVENT_MARGIN
    assert isinstance(monitor, ClosestApproachTest)
    touch = closest_approach(orbit.shooting, orbit.point, monitor.guard)
    if touch is None or not touch.inside:
        raise OrbitError(
            "the margin is zero at another event or a switch, not between events",
            "find an orbit beyond it and continue that orbit",
        )
    guess = insert_event(orbit, monitor.guard, touch)
    return guess, ContactSpeedTest(monitor.kind, monitor.guard, touch.segment), ENTRY_RATE


def changed_guard(one: Shooting, other: Shooting) -> int:
    """Return a guard whose number of events differs between two sequences, else NONE.

    Guards with impacts take precedence, then the first.
    """
    fired = [Counter(s.guard(one.m) for s in each.segments) for each in (one, other)]
    changed = {j for each in fired for j in each if fired[0][j] != fired[1][j]} - {NONE}
    guards = one.automaton.guards
    return min(changed, key=lambda j: (not guards[j].impact, j), default=NONE)


def move_event_across_period(orbit: PeriodicOrbit, i: int) -> tuple[OrbitGuess, int] | None:
    """Return the orbit with the event next to segment `i` on the other side of the boundary.

    The second result is the segment of the new signature that grows from length zero.
    """
    segments, point = list(orbit.segments), orbit.point
    all_states, _ = orbit.shooting.unpack(point.unknowns)
    states, times = list(all_states), list(point.ends)
    count = len(segments)
    before, after = (i - 1) % count, (i + 1) % count
    m = orbit.shooting.m
    if segments[before].code == BOUNDARY and segments[i].guard(m) != NONE:
        # The event at the start of a period moves to the end of the period before.
        event, mode = segments[i].code, segments[after].mode
        cycle = segments[before].cycle
        segments[before] = Segment(segments[before].mode, cycle, event)
        times[before] = point.period
        segments[i], states[i] = Segment(mode, cycle, BOUNDARY), states[after].copy()
        times[i] = point.period
        if i == 0:
            segments, states, times = _rotated(segments, 1), _rotated(states, 1), _rotated(times, 1)
            return OrbitGuess(tuple(segments), np.array(states), np.array(times)), count - 1
        return OrbitGuess(tuple(segments), np.array(states), np.array(times)), i
    if segments[i].code == BOUNDARY and segments[before].guard(m) != NONE:
        # The event at the end of a period moves to the start of the next.
        event, mode = segments[before].code, segments[before].mode
        segments[before] = Segment(mode, segments[before].cycle, BOUNDARY)
        times[before] = point.period
        segments[i] = Segment(mode, segments[after].cycle, event)
        states[i] = np.array(point.arcs[before].end)
        states[i][list(orbit.shooting.automaton.cyclic)] = 0.0
        times[i] = 0.0
        if i == count - 1:
            segments, states, times = (
                _rotated(segments, -1),
                _rotated(states, -1),
                _rotated(times, -1),
            )
            return OrbitGuess(tuple(segments), np.array(states), np.array(times)), 0
        return OrbitGuess(tuple(segments), np.array(states), np.array(times)), i
    return None


def swap_adjacent_events(orbit: PeriodicOrbit, i: int) -> tuple[OrbitGuess, int]:
    """Return the orbit with the two events around segment `i` in the other order.

    The second result is the segment that grows from length zero. Raises OrbitError unless the state
    and the mode after both are the same in either order.
    """
    order_matters = OrbitError(
        "two events coincide, and the motion depends on their order", "find an orbit beyond it"
    )
    shooting, point = orbit.shooting, orbit.point
    segments, count = list(orbit.segments), len(orbit.segments)
    switch = shooting.automaton.switch_code
    first, second = (i - 1) % count, i
    one, other = segments[first], segments[second]
    if i == 0 or one.cycle != other.cycle or BOUNDARY in (one.code, other.code):
        raise OrbitError(
            "two events coincide at the start of a period, where their order cannot change",
            "shift the start of the period: give the forcing a phase",
        )
    if one.code == other.code == switch:
        raise order_matters
    problem = orbit.problem
    p = np.asarray(problem.parameters, dtype=float)
    automaton, time = shooting.automaton, float(point.ends[first])
    # An event just before a switch of the drive uses the voltage before the switch.
    earlier = time if other.code == switch else float(np.nextafter(time, 0.0))
    end = np.array(point.arcs[first].end)
    # In the new order the later event has not occurred at the time of the earlier one.
    before = end - ORDER_TIME_OFFSET * np.array(point.arcs[first].slope_end)
    early = before if other.code == switch else end
    mode, _ = automaton.state_after(one.mode, other.code, earlier, early, p)
    _, after = automaton.state_after(one.mode, other.code, earlier, end, p)
    last, final = automaton.state_after(mode, one.code, time, after, p)
    states, _ = shooting.unpack(point.unknowns)
    following = (i + 1) % count
    free = shooting.free
    if last != segments[following].mode:
        raise order_matters
    if np.abs(final[free] - states[following][free]).max() > 1e-6:
        raise order_matters
    segments[first] = Segment(one.mode, one.cycle, other.code, other.switch)
    segments[second] = Segment(mode, one.cycle, one.code, one.switch)
    states = np.array(states)
    states[second][free] = after[free]
    return OrbitGuess(tuple(segments), states, np.array(point.ends)), i


def _rotated(items: list[Any], by: int) -> list[Any]:
    return items[by:] + items[:by]


def insert_event(orbit: PeriodicOrbit, guard: int, touch: ClosestApproach) -> OrbitGuess:
    """Return a guess with the events that a weak contact at the closest approach causes.

    A run from the guard, with a small speed into it, gives these events up to the return to the
    initial mode. Raises OrbitError if the run does not return before the period ends or the drive
    switches.
    """
    shooting, point = orbit.shooting, orbit.point
    i, time = touch.segment, touch.time
    segment = orbit.segments[i]
    states, _ = shooting.unpack(point.unknowns)
    variational = shooting.variational(point.parameter_point)
    contact = shooting.arc_to(point, i, time).end
    weak = low_velocity_contact(variational, segment.mode, guard, time, contact, ENTRY_RATE)
    problem = orbit.problem
    share = 0.02
    trajectory = run(problem, HybridState(0, time, segment.mode, weak), share)
    periods = 1 if time + share * problem.period < problem.period else 2
    piece = read_signature(trajectory, periods, problem.switches)
    back = (k for k, s in enumerate(piece.segments) if k > 0 and s.mode == segment.mode)
    count = next(back, 0)
    followed = piece.segments[:count]
    elsewhere = any(s.guard(shooting.m) == NONE for s in followed)
    if not followed or followed[0].code != guard or elsewhere:
        raise OrbitError(
            f"a weak contact does not return to the mode {shooting.automaton.modes[segment.mode]} "
            "before the period ends or the forcing switches",
            "find an orbit beyond it",
        )
    inserted = tuple(Segment(s.mode, segment.cycle, s.code) for s in followed)
    segments = orbit.segments[:i] + inserted + orbit.segments[i:]
    new_states = np.vstack([states[: i + 1], piece.states[1 : count + 1], states[i + 1 :]])
    times = np.concatenate([point.ends[:i], piece.times[:count], point.ends[i:]])
    return OrbitGuess(segments, new_states, times)


def remove_event(orbit: PeriodicOrbit, monitor: ContactSpeedTest) -> OrbitGuess:
    """Return a guess without the event and the segments of negligible length after it.

    Raises OrbitError if a segment after it in another mode has a finite length.
    """
    shooting, point = orbit.shooting, orbit.point
    segments, i = orbit.segments, monitor.segment
    states, _ = shooting.unpack(point.unknowns)
    mode, cycle = segments[i].mode, segments[i].cycle
    lengths = point.ends - point.starts
    following = i + 1
    while following < len(segments) and segments[following].mode != mode:
        if lengths[following] > MAX_VANISHING_LENGTH:
            break
        following += 1
    if (
        following == len(segments)
        or segments[following].mode != mode
        or segments[following].cycle != cycle
    ):
        raise OrbitError(
            f"the motion after the event does not return at once to the mode "
            f"{shooting.automaton.modes[mode]}",
            "find an orbit beyond it",
        )
    keep = [*range(i + 1), *range(following + 1, len(segments))]
    times = np.concatenate([point.ends[:i], point.ends[following:]])
    return OrbitGuess(segments[:i] + segments[following:], states[keep], times)


def neighbour(loss: OrbitEvent, parameter: str) -> tuple[Shooting, ShootingEvaluation, Floats]:
    """Return the branch that joins at `loss`, by a run from an initial state slightly beyond.

    Beyond `loss` the sequence of events of its branch is inadmissible; the run gives the sequence
    there. The orbit with this sequence lies beyond `loss`, or, if both branches end there, on the
    side of the known branch. The results are equations, an orbit close to `loss`, and the direction
    away from it. Raises OrbitError if no such branch is found.
    """
    # Where a segment vanishes, orbits with a segment of zero length form another branch, whose
    # tangent has no preferred sign.
    distances = [side * each for side in (1.0, -1.0) for each in RESTART_DISTANCES]
    for begun, distance in product(_starts(loss, parameter), distances):
        for shooting, point in _admissible_near(begun, parameter, distance):
            if not _joins(begun, shooting, point):
                continue
            direction = tangent(point)
            free = shooting.free
            moved = _first_state(shooting, point)[free] - begun.solution.state[free]
            onward = moved @ direction[: len(free)] + _gain(begun, point) * direction[-1]
            return shooting, point, direction if onward >= 0.0 else -direction
    raise OrbitError(NO_ORBIT_BEYOND, "find an orbit beyond it")


def _starts(loss: OrbitEvent, parameter: str) -> Iterator[OrbitEvent]:
    """Yield a loss, then the same with its orbit begun one forcing period later.

    An event that meets the start of an orbit of several periods meets the start of a later period
    of the other, where a run passes it.
    """
    yield loss
    orbit, shooting = loss.solution, loss.solution.shooting
    if orbit.periods == 1 or shooting.phase is not None:
        return
    cycles = [segment.cycle for segment in orbit.segments]
    first, f = cycles.count(0), len(shooting.free)
    before = sum(cycles[i] == 0 for i in shooting.events)
    order = [*range(first, len(cycles)), *range(first)]
    segments = tuple(
        replace(orbit.segments[i], cycle=(cycles[i] - 1) % orbit.periods) for i in order
    )
    blocks = np.arange(f * len(cycles)).reshape(-1, f)[order].ravel()
    times = f * len(cycles) + np.roll(np.arange(len(shooting.events)), -before)
    unknowns = np.concatenate([blocks, times])
    try:
        later = orbit.equations((parameter,), segments, pinned={})
        point = later.evaluate(orbit.point.unknowns[unknowns], np.array([loss.value]))
        begun = make_orbit(later, point)
    except CONTINUATION_ERRORS:
        return
    direction = np.append(loss.direction[:-1][unknowns], loss.direction[-1])
    yield replace(loss, solution=begun, direction=direction)


def _admissible_near(
    loss: OrbitEvent, parameter: str, distance: float
) -> Iterator[tuple[Shooting, ShootingEvaluation]]:
    """Yield admissible orbits with the sequences of runs from the virtual orbit beyond a loss."""
    orbit, direction = loss.solution, loss.direction
    moved = distance * direction[-1]
    step = float(np.copysign(max(abs(moved), MIN_PARAMETER_SHARE * abs(distance)), moved))
    unknowns = orbit.point.unknowns + distance * direction[:-1]
    start, tried = orbit.shooting.unpack(unknowns)[0][0], [orbit.segments]
    mode = _first_mode(orbit, unknowns, loss.value + step)
    for _ in range(MAX_SIGNATURES):
        try:
            guess = _sequence(orbit, parameter, loss.value + step, mode, start, unknowns)
            if guess.segments in tried:
                return
            tried.append(guess.segments)
            shooting = orbit.equations((parameter,), guess.segments, pinned={})
            unknowns = shooting.pack(guess)
            shooting.pin(shooting.evaluate(unknowns, np.array([loss.value + step])))
        except CONTINUATION_ERRORS:
            return
        for value in (loss.value + step, loss.value - step):
            try:
                point = solve(shooting, unknowns, np.array([value]))
            except CONTINUATION_ERRORS:
                continue
            if not defects(shooting, point):
                yield shooting, point
            if value == loss.value + step:
                start, unknowns = _first_state(shooting, point), point.unknowns


def _first_mode(orbit: PeriodicOrbit, unknowns: Floats, value: float) -> int:
    """Return the mode at the start of a virtual orbit, which a switch there may change."""
    mode = orbit.segments[0].mode
    if orbit.segments[-1].code != orbit.shooting.automaton.switch_code:
        return mode
    try:
        event = orbit.shooting.evaluate(unknowns, np.array([value])).events[-1]
    except CONTINUATION_ERRORS:
        return mode
    return mode if event is None else int(event.mode)


def _sequence(
    orbit: PeriodicOrbit, parameter: str, value: float, mode: int, start: Floats, unknowns: Floats
) -> OrbitGuess:
    """Return the signature of a run from `start` over the period of the orbit."""
    problem = orbit.family.at(**{parameter: value}).problem()
    if orbit.shooting.phase is not None:
        problem = problem.with_time_unit(orbit.shooting.unit * float(unknowns[-1]))
    begin = HybridState(0, 0.0, mode, start, switched=True)
    return read_signature(run(problem, begin, orbit.periods), orbit.periods, problem.switches)


def _first_state(shooting: Shooting, point: ShootingEvaluation) -> Floats:
    return np.asarray(shooting.unpack(point.unknowns)[0][0])


def _gain(loss: OrbitEvent, point: ShootingEvaluation) -> float:
    return float(point.values[0]) - loss.value


def _joins(loss: OrbitEvent, shooting: Shooting, point: ShootingEvaluation) -> bool:
    """Return whether orbits of this sequence approach `loss` as the parameter does."""
    back = (CONVERGENCE_RATIO - 1.0) * _gain(loss, point)
    try:
        # Along the tangent, so that a short segment does not vanish.
        slope = np.linalg.solve(point.jacobian, -point.by_parameter[:, 0])
        near = solve(shooting, point.unknowns + back * slope, point.values + back)
    except CONTINUATION_ERRORS:
        return False
    return not defects(shooting, near) and _approaches(
        loss.solution, loss.value, shooting, near, point
    )


def _approaches(
    orbit: PeriodicOrbit,
    value: float,
    shooting: Shooting,
    near: ShootingEvaluation,
    point: ShootingEvaluation,
) -> bool:
    """Return whether `near` lies closer to `orbit`, in state and parameter, than `point`."""
    free = shooting.free

    def apart(evaluation: ShootingEvaluation) -> float:
        gap = _first_state(shooting, evaluation)[free] - orbit.state[free]
        return max(float(np.abs(gap).max(initial=0.0)), abs(float(evaluation.values[0]) - value))

    return apart(near) <= APPROACH_RATIO * apart(point) + REMOVED_EVENT_MARGIN * CONVERGENCE_RATIO


def at_level(
    shooting: Shooting, begin: ShootingEvaluation, condition: DefiningSystem, level: float
) -> ShootingEvaluation:
    """Solve for the orbit and the parameter at which `condition` has the value `level`.

    Raises OrbitError if the iteration does not converge.
    """
    start = np.append(begin.unknowns, begin.values)
    # The distance is short, so the gradient at its start suffices.
    gradient = condition.gradient(begin)

    def equations(u: Floats) -> tuple[ShootingEvaluation, Floats, Floats]:
        point = shooting.evaluate(u[:-1], u[-1:])
        matrix = np.vstack([point.derivatives, gradient])
        return point, np.append(point.residual, condition.value(point) - level), matrix

    reason = "the orbits of the other signature could not be corrected"
    return newton(
        equations, start, reason=reason, remedy="find an orbit beyond it and continue that orbit"
    ).point
