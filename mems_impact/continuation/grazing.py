"""Grazing on a branch: change of the event sequence, and the normal form of the first impact.

An impact at a small speed changes the state, once what follows on it has died out, by a kick that
goes with the square root of the penetration that the orbit without impact would have. Whether the
orbit comes back to the stopper after k periods is decided by the sign of the kick's image in the
margin, xi_k = grad h . M^k kick, M being the monodromy matrix of the orbit without impact, based at
the grazing (Nordmark 1991).

At a grazing, and where an event moves past another one, the other signature follows from the orbit
(`change_signature`). Elsewhere a run from a little beyond shows it (`neighbour`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.continuation.arclength import CONTINUATION_ERRORS, tangent
from mems_impact.continuation.special_points import IN_NO_TIME, BranchEvent
from mems_impact.continuation.test_functions import (
    ClosestApproach,
    ClosestApproachTest,
    ContactSpeedTest,
    DefiningSystem,
    SegmentLengthTest,
    TestFunction,
    closest_approach,
)
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.hybrid.differences import central_difference
from mems_impact.hybrid.event_loop.workspace import NONE, TRANSITION
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational.derivatives import Variational
from mems_impact.orbits.newton import newton, solve
from mems_impact.orbits.periodic_orbit import PeriodicOrbit, defects, reduced_components
from mems_impact.orbits.shooting import Shooting, ShootingEvaluation
from mems_impact.orbits.signature import BOUNDARY, OrbitGuess, Segment, read_signature

__all__ = ["CONTINUOUS", "DEAD", "JUMP", "contact_coefficients", "grazing_type"]

# --- What a grazing does to the attractor: the normal form of the first impact.

TRIAL_SPEED = 1e-3  # of the trial impacts that show the kick
NULL_KICK_RATIO = 1e-6  # part of a kick that is none across the flow
SIGN_PERIODS = 200  # periods over which the signs are looked at

CONTINUOUS, JUMP, DEAD = "continuous", "jump", "died earlier"


@dataclass(frozen=True)
class DegenerateGrazingTest(TestFunction):
    """The first coefficient of the impacts that follow a grazing, on a curve of grazings."""

    @property
    def name(self) -> str:
        """What a zero is called."""
        return f"degenerate {self.kind}"

    def value(self, equations: Any, point: Any, along: Floats) -> None:
        """Return None: it is defined on a curve of grazings."""

    def on_curve(self, condition: DefiningSystem, point: ShootingEvaluation) -> float | None:
        """Return that coefficient."""
        assert isinstance(condition.monitor, ClosestApproachTest)
        return contact_coefficient(condition.shooting, point, condition.monitor, 1)


def contact_coefficient(
    shooting: Shooting, point: ShootingEvaluation, monitor: ClosestApproachTest, k: int
) -> float | None:
    """Return xi_k = grad h . M^k kick: positive if the kick leads away from the stopper.

    None if the orbit has other events, for which the formula does not hold, or a mode to which a
    weak contact does not lead back.
    """
    try:
        sequence = contact_coefficients(shooting, point, monitor, k)
    except OrbitError:
        return None
    return None if sequence is None else float(sequence[-1])


def contact_coefficients(
    shooting: Shooting, point: ShootingEvaluation, monitor: ClosestApproachTest, count: int
) -> Floats | None:
    """Return xi_1 .. xi_count, or None if the orbit has events, or the kick goes along it.

    The kick of a cycle in a plane does: it comes to the stopper a little later or sooner, no more.
    """
    if any(event is not None for event in point.events):
        return None
    touch = closest_approach(shooting, point, monitor.guard)
    if touch is None:
        return None
    i, time = touch.segment, touch.time
    segment = shooting.segments[i]
    states, _ = shooting.unpack(point.unknowns)
    free = shooting.free
    variational = shooting.variational(point.setting)
    to_touch = variational.arc(segment.mode, states[i], point.starts[i], time)
    from_touch = variational.arc(segment.mode, to_touch.end, time, point.ends[i])
    total = from_touch.by_state[free]
    others = len(shooting.segments)
    for j in range(1, others):
        total = point.arcs[(i + j) % others].by_state[free] @ total
    total = to_touch.by_state[free] @ total
    event = variational.event(segment.mode, monitor.guard, time, to_touch.end)
    # A component that the mode holds fixed has no part in it, but for rounding, which would grow.
    keep = reduced_components(shooting, point)
    total = total[np.ix_(keep, keep)]
    gradient = event.margin_by_state[monitor.guard][free][keep]
    image = impact_direction(shooting, point, segment.mode, monitor.guard, time, to_touch.end)[keep]
    if shooting.phase is not None:
        along = to_touch.slope_end[free][keep]
        aside = image - along * float(along @ image) / float(along @ along)
        if np.linalg.norm(aside) < NULL_KICK_RATIO * np.linalg.norm(image):
            return None
    values = []
    for _ in range(count):
        image = total @ image
        values.append(float(gradient @ image))
    return np.array(values)


def stays_positive(sequence: Floats) -> bool:
    """Return whether all xi_k that are more than rounding of the first ones are positive."""
    return bool(np.all(sequence > -1e-10 * np.abs(sequence).max()))


def impact_direction(
    shooting: Shooting, point: ShootingEvaluation, mode: int, guard: int, time: float, y: Floats
) -> Floats:
    """Return the change of the state per speed that a weak impact at (time, y) leaves behind.

    Learnt from trials: the impact and what follows on it (a slip, say) until the mode is the old
    one, compared with the flow of the old mode over the same time, pulled back to the impact.

    Raises
    ------
    OrbitError
        If the mode does not come back.
    """
    problem = shooting.problem(point)
    free, variational = shooting.free, shooting.variational(point.setting)

    def left_behind(speed: float) -> Floats:
        before = low_velocity_contact(variational, mode, guard, time, y, speed)
        events = run(problem, HybridState(0, time, mode, before), 0.02).events
        back = np.flatnonzero((events.kind == TRANSITION) & (events.mode_after == mode))
        if not back.size:
            raise OrbitError(
                "a weak contact does not lead back to the mode it came from",
                "take a range in which the stopper is touched while the frame is at rest",
            )
        last = back[0]
        elapsed = float(events.time[last]) + problem.period * int(events.cycle[last])
        undisturbed = variational.arc(mode, before, time, elapsed)
        difference = events.after[last][free] - undisturbed.end[free]
        return np.asarray(np.linalg.lstsq(undisturbed.by_state[free], difference)[0]) / speed

    # The limit of vanishing speed, from which a finite one differs in proportion to it.
    return 2.0 * left_behind(0.5 * TRIAL_SPEED) - left_behind(TRIAL_SPEED)


def low_velocity_contact(
    variational: Variational, mode: int, guard: int, time: float, y: Floats, speed: float
) -> Floats:
    """Return the state nearest to `y` on the guard, with its margin falling at `speed`."""
    h, free = 1e-5, list(variational.free)
    margin, rate = variational.margins(mode, time, y)

    def along(unit: Floats, step: float) -> Floats:
        return np.array(variational.margins(mode, time, y + step * unit))[:, guard]

    units = np.eye(y.size)[free]
    rows = np.array([central_difference(partial(along, unit), h) for unit in units]).T
    wanted = np.array([-margin[guard], -speed - rate[guard]])
    weak = y.copy()
    weak[free] += np.linalg.lstsq(rows, wanted)[0]
    return weak


def grazing_type(orbit: PeriodicOrbit, monitor: TestFunction) -> str:
    """Return how the attractor leaves a grazing orbit without impacts.

    Returns
    -------
    str
        "continuous" (all xi_k positive and the orbit stable: the paper's type II), "jump" (some
        xi_k negative: type I), "died earlier" (a multiplier beyond +1: type III).
    """
    if not isinstance(monitor, ClosestApproachTest):
        raise InvalidParameter(
            field="monitor", value=monitor, allowed="the closest approach of a free orbit"
        )
    if not orbit.stable:
        return DEAD
    sequence = contact_coefficients(orbit.shooting, orbit.point, monitor, SIGN_PERIODS)
    if sequence is None:
        problem = "the type is that of an orbit without events, and of a cycle only outside a plane"
        raise InvalidParameter(field="orbit", value=None, allowed="", problem=problem)
    return CONTINUOUS if stays_positive(sequence) else JUMP


# --- Where the sequence of events changes, branches of two signatures meet: from one to the
# other.

ENTRY_RATE = 1e-4  # rate at the guard with which the other signature is entered
PASSING = 1e-6  # time before two events meet at which the modes between them are looked up
DEPTH = 1e-6  # margin that the orbit keeps when an event is left out
# Time after two events have met at which the other order is entered. The branch has a corner where
# they meet: a tangent and differences (of 1e-6) must be taken on the side that they are meant for.
MIN_GRAZING_SEPARATION = 1e-5
RESTART_DISTANCES = (1e-4, 1e-5, 1e-3, 1e-6)  # on the branch beyond a loss, from where a run starts
MIN_PARAMETER_SHARE = (
    0.01  # part of that distance by which the parameter moves at least, as in a fold
)
SEQUENCES = 4  # that are tried at each distance, each read off a run along the one before
CONVERGENCE_RATIO = 0.1  # part of the distance at which the other branch must have come closer ...
CLOSER = 0.5  # ... to the orbit where the two meet, by this factor
NO_ORBIT_BEYOND = (
    "no orbit was found near this one beyond: there the motion jumps, or impacts accumulate"
)


def change_signature(
    orbit: PeriodicOrbit, monitor: TestFunction, parameter: str
) -> tuple[Shooting, ShootingEvaluation, Floats]:
    """Return the branch of the other signature that meets `orbit`, and the direction away from it.

    It may lie on either side of `orbit` in the parameter. It is entered a little away from where
    the two meet, since the equations have a corner there if one of two events is a switch.

    Parameters
    ----------
    orbit : PeriodicOrbit
        Located at a zero of `monitor`.
    monitor : TestFunction
        A closest approach (an event comes in), a contact speed (one drops out) or the length of a
        segment (one moves into another period, or past another event).

    Returns
    -------
    shooting, point, direction

    Raises
    ------
    OrbitError
        If there is no such branch, or none that is found: says why.
    """
    guess, wanted, level = guess_beyond(orbit, monitor)
    shooting = orbit.equations((parameter,), guess.segments, pinned={})
    unknowns = shooting.pack(guess)
    value = orbit.family.values[parameter]
    shooting.pin(shooting.evaluate(unknowns, np.array([value])))
    condition = wanted.equation(shooting)
    point = _at_level(shooting, unknowns, value, condition, level)
    direction = tangent(point)
    gain = float(condition.gradient(point) @ direction)
    return shooting, point, direction if gain > 0.0 else -direction


def guess_beyond(
    orbit: PeriodicOrbit, monitor: TestFunction
) -> tuple[OrbitGuess, TestFunction, float]:
    """Return a guess of the other signature, the test function that grows from zero, a small value.

    Raises
    ------
    OrbitError
        If no other signature is known to join.
    """
    if isinstance(monitor, SegmentLengthTest):
        # The orbit is only cut elsewhere.
        guess, grows = move_event_across_period(orbit, monitor.segment) or swap_adjacent_events(
            orbit, monitor.segment
        )
        return guess, replace(monitor, segment=grows), MIN_GRAZING_SEPARATION
    if isinstance(monitor, ContactSpeedTest):
        # Where it happened: what is left may touch the guard elsewhere at the same value.
        there = ClosestApproachTest(monitor.kind, monitor.guard, monitor.segment)
        return remove_event(orbit, monitor), there, DEPTH
    assert isinstance(monitor, ClosestApproachTest)
    touch = closest_approach(orbit.shooting, orbit.point, monitor.guard)
    if touch is None or not touch.inside:
        raise OrbitError(
            "the margin is touched at another event or at a switch, not in between",
            "find an orbit beyond and follow that",
        )
    guess = insert_event(orbit, monitor.guard, touch)
    return guess, ContactSpeedTest(monitor.kind, monitor.guard, touch.segment), ENTRY_RATE


def changed_guard(one: Shooting, other: Shooting) -> int:
    """Return the guard that fires more often in one of two sequences; NONE if they differ in order.

    Of several the one with impacts, or the first.
    """
    fired = [Counter(s.guard(one.m) for s in each.segments) for each in (one, other)]
    changed = {j for each in fired for j in each if fired[0][j] != fired[1][j]} - {NONE}
    guards = one.automaton.guards
    return min(changed, key=lambda j: (not guards[j].impact, j), default=NONE)


def move_event_across_period(orbit: PeriodicOrbit, i: int) -> tuple[OrbitGuess, int] | None:
    """Return the orbit with the event next to segment `i` on the other side of the boundary.

    Also returned: which segment of the new signature grows from length zero.
    """
    segments, point = list(orbit.segments), orbit.point
    all_states, _ = orbit.shooting.unpack(point.unknowns)
    states, times = list(all_states), list(point.ends)
    count = len(segments)
    before, after = (i - 1) % count, (i + 1) % count
    m = orbit.shooting.m
    if segments[before].code == BOUNDARY and segments[i].guard(m) != NONE:
        # The event at the start of a period moves to the end of the one before.
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

    Also returned: the segment that grows from length zero.

    Raises
    ------
    OrbitError
        Unless the state and the mode after both are the same in either order.
    """
    matters = OrbitError("two events meet whose order matters", "find an orbit beyond")
    shooting, point = orbit.shooting, orbit.point
    segments, count = list(orbit.segments), len(orbit.segments)
    switch = shooting.automaton.switch_code
    first, second = (i - 1) % count, i
    one, other = segments[first], segments[second]
    if i == 0 or one.cycle != other.cycle or BOUNDARY in (one.code, other.code):
        raise OrbitError(
            "two events meet at the start of a period, which cannot pass each other there",
            "begin the period elsewhere: give the forcing a phase",
        )
    if one.code == other.code == switch:
        raise matters
    problem = orbit.problem
    p = np.asarray(problem.parameters, dtype=float)
    automaton, time = shooting.automaton, float(point.ends[first])
    # A guard's event before the switch belongs to the voltage before it.
    earlier = time if other.code == switch else float(np.nextafter(time, 0.0))
    end = np.array(point.arcs[first].end)
    # The event that comes later in the new order has not happened yet where the other one does.
    before = end - PASSING * np.array(point.arcs[first].slope_end)
    early = before if other.code == switch else end
    mode, _ = automaton.state_after(one.mode, other.code, earlier, early, p)
    _, after = automaton.state_after(one.mode, other.code, earlier, end, p)
    last, final = automaton.state_after(mode, one.code, time, after, p)
    states, _ = shooting.unpack(point.unknowns)
    following = (i + 1) % count
    free = shooting.free
    if last != segments[following].mode:
        raise matters
    if np.abs(final[free] - states[following][free]).max() > 1e-6:
        raise matters
    segments[first] = Segment(one.mode, one.cycle, other.code, other.switch)
    segments[second] = Segment(mode, one.cycle, one.code, one.switch)
    states = np.array(states)
    states[second][free] = after[free]
    return OrbitGuess(tuple(segments), states, np.array(point.ends)), i


def _rotated(items: list[Any], by: int) -> list[Any]:
    return items[by:] + items[:by]


def insert_event(orbit: PeriodicOrbit, guard: int, touch: ClosestApproach) -> OrbitGuess:
    """Return a guess with the events that a weak contact at the closest approach brings.

    What follows on a contact at vanishing speed is learnt from a run that starts on the guard with
    a small speed into it, until it is back in the mode that it came from.

    Raises
    ------
    OrbitError
        If it does not come back before the period ends or the drive switches.
    """
    shooting, point = orbit.shooting, orbit.point
    i, time = touch.segment, touch.time
    segment = orbit.segments[i]
    states, _ = shooting.unpack(point.unknowns)
    variational = shooting.variational(point.setting)
    contact = variational.arc(segment.mode, states[i], point.starts[i], time).end
    weak = low_velocity_contact(variational, segment.mode, guard, time, contact, ENTRY_RATE)
    problem = orbit.problem
    share = 0.02
    trajectory = run(problem, HybridState(0, time, segment.mode, weak), share)
    whole = 1 if time + share * problem.period < problem.period else 2
    piece = read_signature(trajectory, whole, problem.switches)
    back = (k for k, s in enumerate(piece.segments) if k > 0 and s.mode == segment.mode)
    count = next(back, 0)
    followed = piece.segments[:count]
    elsewhere = any(s.guard(shooting.m) == NONE for s in followed)
    if not followed or followed[0].code != guard or elsewhere:
        raise OrbitError(
            f"after a weak contact the mode is not {shooting.automaton.modes[segment.mode]} again "
            "before the period ends or the forcing switches",
            "find an orbit beyond",
        )
    inserted = tuple(Segment(s.mode, segment.cycle, s.code) for s in followed)
    segments = orbit.segments[:i] + inserted + orbit.segments[i:]
    new_states = np.vstack([states[: i + 1], piece.states[1 : count + 1], states[i + 1 :]])
    times = np.concatenate([point.ends[:i], piece.times[:count], point.ends[i:]])
    return OrbitGuess(segments, new_states, times)


def remove_event(orbit: PeriodicOrbit, monitor: ContactSpeedTest) -> OrbitGuess:
    """Return a guess without the event, and without what followed on it in no time.

    Raises
    ------
    OrbitError
        If what followed on it lasts.
    """
    shooting, point = orbit.shooting, orbit.point
    segments, i = orbit.segments, monitor.segment
    states, _ = shooting.unpack(point.unknowns)
    mode, cycle = segments[i].mode, segments[i].cycle
    lengths = point.ends - point.starts
    following = i + 1
    while following < len(segments) and segments[following].mode != mode:
        if lengths[following] > IN_NO_TIME:
            break
        following += 1
    if (
        following == len(segments)
        or segments[following].mode != mode
        or segments[following].cycle != cycle
    ):
        raise OrbitError(
            f"what the event sets off does not return to {shooting.automaton.modes[mode]} at once",
            "find an orbit beyond",
        )
    keep = [*range(i + 1), *range(following + 1, len(segments))]
    times = np.concatenate([point.ends[:i], point.ends[following:]])
    return OrbitGuess(segments[:i] + segments[following:], states[keep], times)


def neighbour(lost: BranchEvent, parameter: str) -> tuple[Shooting, ShootingEvaluation, Floats]:
    """Return the branch that meets another one at `lost`, by a run from a little beyond.

    The run gives the sequence of events there. The orbit that has it lies on the same side, or, if
    two branches end in `lost`, on the side from which this one came.

    Parameters
    ----------
    lost : BranchEvent
        Where the sequence of a branch is no longer the automaton's.
    parameter : str

    Returns
    -------
    shooting, point, direction
        An orbit close to `lost`, and the direction away from it.

    Raises
    ------
    OrbitError
        If no such branch is found.
    """
    # Where a segment vanishes, a branch of segments without length crosses, and its tangent is as
    # good as its opposite.
    for distance in (side * each for side in (1.0, -1.0) for each in RESTART_DISTANCES):
        for shooting, point in _admissible_near(lost, parameter, distance):
            if not _joins(lost, shooting, point):
                continue
            direction = tangent(point)
            free = shooting.free
            moved = _first_state(shooting, point)[free] - lost.orbit.state[free]
            onward = moved @ direction[: len(free)] + _gain(lost, point) * direction[-1]
            return shooting, point, direction if onward >= 0.0 else -direction
    raise OrbitError(NO_ORBIT_BEYOND, "find an orbit beyond")


def _admissible_near(
    lost: BranchEvent, parameter: str, distance: float
) -> Iterator[tuple[Shooting, ShootingEvaluation]]:
    """Yield orbits of the automaton whose sequences runs from the virtual orbit beyond have."""
    orbit, along = lost.orbit, lost.direction
    moved = distance * along[-1]
    step = float(np.copysign(max(abs(moved), MIN_PARAMETER_SHARE * abs(distance)), moved))
    unknowns = orbit.point.unknowns + distance * along[:-1]
    start, known = orbit.shooting.unpack(unknowns)[0][0], [orbit.segments]
    for _ in range(SEQUENCES):
        try:
            guess = _sequence(orbit, parameter, lost.value + step, start, unknowns)
            if guess.segments in known:
                return
            known.append(guess.segments)
            shooting = orbit.equations((parameter,), guess.segments, pinned={})
            unknowns = shooting.pack(guess)
            shooting.pin(shooting.evaluate(unknowns, np.array([lost.value + step])))
        except CONTINUATION_ERRORS:
            return
        for value in (lost.value + step, lost.value - step):
            try:
                point = solve(shooting, unknowns, np.array([value]))
            except CONTINUATION_ERRORS:
                continue
            if not defects(shooting, point):
                yield shooting, point
            if value == lost.value + step:
                start, unknowns = _first_state(shooting, point), point.unknowns


def _sequence(
    orbit: PeriodicOrbit, parameter: str, value: float, start: Floats, unknowns: Floats
) -> OrbitGuess:
    """Return what a run from `start` goes through, as long as the orbit is."""
    problem = orbit.family.at(**{parameter: value}).problem()
    if orbit.shooting.phase is not None:
        problem = problem.with_time_unit(orbit.shooting.unit * float(unknowns[-1]))
    begin = HybridState(0, 0.0, orbit.segments[0].mode, start)
    return read_signature(run(problem, begin, orbit.periods), orbit.periods, problem.switches)


def _first_state(shooting: Shooting, point: ShootingEvaluation) -> Floats:
    return np.asarray(shooting.unpack(point.unknowns)[0][0])


def _gain(lost: BranchEvent, point: ShootingEvaluation) -> float:
    return float(point.values[0]) - lost.value


def _joins(lost: BranchEvent, shooting: Shooting, point: ShootingEvaluation) -> bool:
    """Return whether orbits of this sequence come closer to `lost` as the parameter does."""
    free = shooting.free

    def apart(there: ShootingEvaluation) -> float:
        gap = _first_state(shooting, there)[free] - lost.orbit.state[free]
        return float(np.abs(gap).max(initial=0.0))

    # Along the tangent, lest a short segment vanish on the way.
    along, back = tangent(point), (CONVERGENCE_RATIO - 1.0) * _gain(lost, point)
    if along[-1] == 0.0:
        return False
    guess = point.unknowns + back / along[-1] * along[:-1]
    try:
        near = solve(shooting, guess, point.values + back)
    except CONTINUATION_ERRORS:
        return False
    return (
        not defects(shooting, near)
        and apart(near) <= CLOSER * apart(point) + DEPTH * CONVERGENCE_RATIO
    )


def _at_level(
    shooting: Shooting, unknowns: Floats, value: float, condition: DefiningSystem, level: float
) -> ShootingEvaluation:
    """Solve for the orbit on which `condition` has the value `level`, the parameter being free.

    Raises
    ------
    OrbitError
        If the iteration does not converge.
    """
    start = np.append(unknowns, value)
    # The way is short, so that the gradient at its start will do.
    gradient = condition.gradient(shooting.evaluate(unknowns, start[-1:]))

    def equations(u: Floats) -> tuple[ShootingEvaluation, Floats, Floats]:
        point = shooting.evaluate(u[:-1], u[-1:])
        matrix = np.vstack([np.hstack([point.jacobian, point.by_parameter]), gradient])
        return point, np.append(point.residual, condition.value(point) - level), matrix

    reason = "the orbits of the other signature could not be corrected"
    return newton(
        equations, start, reason=reason, remedy="find an orbit beyond and follow that"
    ).point
