"""Where a guard is touched at zero speed, orbits of two signatures meet: from one to the other."""

from __future__ import annotations

from itertools import takewhile
from typing import Any

import numpy as np

from mems_impact.continuation.corrector import tangent
from mems_impact.continuation.grazing import weak_contact
from mems_impact.continuation.monitors import Closest, Monitor, closest, monitors
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.hybrid.run import run
from mems_impact.hybrid.trajectory import Floats, Instant
from mems_impact.orbits.orbit import PeriodicOrbit
from mems_impact.orbits.shooting import ACCEPTED, Point, Shooting
from mems_impact.orbits.signature import BOUNDARY, Guess, Segment, guess_from

SPEED = 1e-4  # rate at the guard with which the other signature is entered
PASSING = 1e-6  # time before two events meet at which the modes between them are looked up
DEPTH = 1e-6  # margin that the orbit keeps when an event is left out
# Time after two events have met at which the other order is entered. The branch has a corner where
# they meet: a tangent and differences (of 1e-6) must be taken on the side that they are meant for.
APART = 1e-5


def reconnect(
    orbit: PeriodicOrbit, monitor: Monitor, parameter: str
) -> tuple[Shooting, Point, Floats] | None:
    """Return the branch of the other signature that meets `orbit`, and the direction away from it.

    Parameters
    ----------
    orbit : PeriodicOrbit
        Located at a zero of `monitor`.
    monitor : Monitor
        With the role "approach" (an event comes in), "rate" (one drops out) or "length" (one moves
        into another period, or past another event).

    Returns
    -------
    shooting, point, direction
        Or None where no orbit of another signature is found.
    """
    if monitor.role == "length":
        return pass_by(orbit, monitor.segment, parameter)
    touch = closest(orbit.shooting, orbit.point, monitor.guard)
    if monitor.role == "approach" and touch is not None and touch.inside:
        guess = with_event(orbit, monitor.guard, touch)
        wanted = Monitor(monitor.kind, "rate", touch.segment, monitor.guard)
        level = SPEED
    elif monitor.role == "rate":
        guess = without_event(orbit, monitor)
        wanted = Monitor(monitor.kind, "approach", -1, monitor.guard)
        level = DEPTH
    else:
        return None
    if guess is None:
        return None
    shooting = Shooting(orbit.family, guess.segments, (parameter,))
    unknowns = shooting.pack(guess)
    value = orbit.family.values[parameter]
    try:
        shooting.pin(shooting.evaluate(unknowns, np.array([value])))
        point = _at_level(shooting, unknowns, value, wanted, level)
        if point is None:
            return None
        direction = tangent(point)
        gain = _derivative(shooting, point, wanted, direction)
    except (OrbitError, InvalidParameter):
        return None
    return shooting, point, direction if gain > 0.0 else -direction


def pass_by(orbit: PeriodicOrbit, i: int, parameter: str) -> tuple[Shooting, Point, Floats] | None:
    """Let the event at an end of the vanishing segment `i` pass the other end.

    It moves into the neighbouring period, or changes places with another event. Nothing happens
    to the orbit there; it is only cut elsewhere. None if two events meet whose order matters.
    """
    moved = move_event(orbit, i) or swap_events(orbit, i)
    if moved is None:
        return None
    guess, grows = moved
    shooting = Shooting(orbit.family, guess.segments, (parameter,))
    value = orbit.family.values[parameter]
    unknowns = shooting.pack(guess)
    length = Monitor("simultaneous events", "length", grows)
    try:
        shooting.pin(shooting.evaluate(unknowns, np.array([value])))
        point = _at_level(shooting, unknowns, value, length, APART)
        if point is None:
            return None
        direction = tangent(point)
        gain = _derivative(shooting, point, length, direction)
    except OrbitError:
        return None
    return shooting, point, direction if gain > 0.0 else -direction


def move_event(orbit: PeriodicOrbit, i: int) -> tuple[Guess, int] | None:
    """Return the orbit with the event next to segment `i` on the other side of the boundary.

    Also returned: which segment of the new signature grows from length zero.
    """
    segments, point = list(orbit.segments), orbit.point
    all_states, _ = orbit.shooting.unpack(point.unknowns)
    states, times = list(all_states), list(point.ends)
    count = len(segments)
    before, after = (i - 1) % count, (i + 1) % count
    m = orbit.shooting.m
    if segments[before].code == BOUNDARY and segments[i].code not in (BOUNDARY, 2 * m):
        # The event at the start of a period moves to the end of the one before.
        event, mode = segments[i].code, segments[after].mode
        cycle = segments[before].cycle
        segments[before] = Segment(segments[before].mode, cycle, event)
        times[before] = orbit.shooting.period
        segments[i], states[i] = Segment(mode, cycle, BOUNDARY), states[after].copy()
        times[i] = orbit.shooting.period
        if i == 0:
            segments, states, times = _rotated(segments, 1), _rotated(states, 1), _rotated(times, 1)
            return Guess(tuple(segments), np.array(states), np.array(times)), count - 1
        return Guess(tuple(segments), np.array(states), np.array(times)), i
    if segments[i].code == BOUNDARY and segments[before].code not in (BOUNDARY, 2 * m):
        # The event at the end of a period moves to the start of the next.
        event, mode = segments[before].code, segments[before].mode
        segments[before] = Segment(mode, segments[before].cycle, BOUNDARY)
        times[before] = orbit.shooting.period
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
            return Guess(tuple(segments), np.array(states), np.array(times)), 0
        return Guess(tuple(segments), np.array(states), np.array(times)), i
    return None


def swap_events(orbit: PeriodicOrbit, i: int) -> tuple[Guess, int] | None:
    """Return the orbit with the two events around segment `i` in the other order.

    Also returned: the segment that grows from length zero. None unless the state and the mode after
    both are the same in either order.
    """
    shooting, point = orbit.shooting, orbit.point
    segments, count = list(orbit.segments), len(orbit.segments)
    switch = 2 * shooting.m
    first, second = (i - 1) % count, i
    one, other = segments[first], segments[second]
    if i == 0 or one.cycle != other.cycle or BOUNDARY in (one.code, other.code):
        return None
    if one.code == other.code == switch:
        return None
    problem = orbit.family.problem()
    p = np.asarray(problem.parameters, dtype=float)
    automaton, time = shooting.automaton, float(point.ends[first])
    # A guard's event before the switch belongs to the voltage before it.
    earlier = time if other.code == switch else float(np.nextafter(time, 0.0))
    end = np.array(point.arcs[first].end)
    # The event that comes later in the new order has not happened yet where the other one does.
    before = end - PASSING * np.array(point.arcs[first].slope_end)
    early = np.array(before if other.code == switch else end)
    mode = int(automaton.transition(one.mode, other.code, earlier, early, p))
    after = np.array(end)
    automaton.transition(one.mode, other.code, earlier, after, p)
    final = np.array(after)
    last = int(automaton.transition(mode, one.code, time, final, p))
    states, _ = shooting.unpack(point.unknowns)
    following = (i + 1) % count
    free = shooting.free
    if last != segments[following].mode:
        return None
    if np.abs(final[free] - states[following][free]).max() > 1e-6:
        return None
    segments[first] = Segment(one.mode, one.cycle, other.code, other.switch)
    segments[second] = Segment(mode, one.cycle, one.code, one.switch)
    states = np.array(states)
    states[second][free] = after[free]
    return Guess(tuple(segments), states, np.array(point.ends)), i


def _rotated(items: list[Any], by: int) -> list[Any]:
    return items[by:] + items[:by]


def with_event(orbit: PeriodicOrbit, guard: int, touch: Closest) -> Guess | None:
    """Return a guess with the events that a weak contact at the closest approach brings.

    What follows on a contact at vanishing speed is learnt from a run that starts on the guard with
    a small speed into it, until it is back in the mode that it came from.
    """
    shooting, point = orbit.shooting, orbit.point
    i, time = touch.segment, touch.time
    segment = orbit.segments[i]
    states, _ = shooting.unpack(point.unknowns)
    contact = shooting.variational.arc(segment.mode, states[i], point.starts[i], time).end
    weak = weak_contact(shooting, segment.mode, guard, time, contact, SPEED)
    problem = orbit.family.problem()
    share = 0.02
    trajectory = run(problem, Instant(0, time, segment.mode, weak), share)
    whole = 1 if time + share * problem.period < problem.period else 2
    try:
        piece = guess_from(trajectory, whole, problem.switches)
    except OrbitError:
        return None
    codes = list(takewhile(lambda s: s.code != BOUNDARY, piece.segments))
    if not codes or codes[0].code != guard:
        return None
    count = len(codes)
    # Back in the mode that it came from, and in the same period.
    if count == len(piece.segments) or piece.segments[count].mode != segment.mode:
        return None
    inserted = tuple(Segment(s.mode, segment.cycle, s.code) for s in codes)
    segments = orbit.segments[:i] + inserted + orbit.segments[i:]
    new_states = np.vstack([states[: i + 1], piece.states[1 : count + 1], states[i + 1 :]])
    times = np.concatenate([point.ends[:i], piece.times[:count], point.ends[i:]])
    return Guess(segments, new_states, times)


def without_event(orbit: PeriodicOrbit, monitor: Monitor) -> Guess | None:
    """Return a guess without the event, and without what followed on it in no time."""
    shooting, point = orbit.shooting, orbit.point
    i = monitor.segment
    states, _ = shooting.unpack(point.unknowns)
    mode = orbit.segments[i].mode
    following = i + 1
    while following < len(orbit.segments) and orbit.segments[following].mode != mode:
        if point.ends[following] - point.starts[following] > 1e-3:
            return None
        following += 1
    if (
        following >= len(orbit.segments)
        or orbit.segments[following].cycle != orbit.segments[i].cycle
    ):
        return None
    segments = orbit.segments[:i] + orbit.segments[following:]
    keep = [*range(i + 1), *range(following + 1, len(orbit.segments))]
    times = np.concatenate([point.ends[:i], point.ends[following:]])
    return Guess(segments, states[keep], times)


def _at_level(
    shooting: Shooting, unknowns: Floats, value: float, monitor: Monitor, level: float
) -> Point | None:
    """Solve for the orbit on which `monitor` has the value `level`, by Newton's method.

    The parameter is free. The gradient of the monitor is taken by differences.
    """
    u = np.append(unknowns, value)

    def observed(x: Floats) -> float:
        point = shooting.evaluate(x[:-1], x[-1:])
        return monitors(shooting, point, np.zeros(x.size)).get(monitor, np.nan)

    for _ in range(12):
        point = shooting.evaluate(u[:-1], u[-1:])
        here = monitors(shooting, point, np.zeros(u.size)).get(monitor, np.nan)
        if not np.isfinite(here):
            return None
        gradient = np.zeros(u.size)
        for c in range(u.size):
            shift = np.zeros(u.size)
            shift[c] = 1e-6
            gradient[c] = (observed(u + shift) - observed(u - shift)) / 2e-6
        matrix = np.vstack([np.hstack([point.jacobian, point.by_parameter[:, :1]]), gradient])
        residual = np.append(point.residual, here - level)
        if not np.isfinite(matrix).all():
            return None
        change = np.linalg.lstsq(matrix, -residual)[0]
        u = u + change
        if np.abs(change).max() < 1e-10:
            break
    point = shooting.evaluate(u[:-1], u[-1:])
    return point if np.abs(point.residual).max() < ACCEPTED else None


def _derivative(shooting: Shooting, point: Point, monitor: Monitor, direction: Floats) -> float:
    """Return how `monitor` changes along `direction`."""
    h = 1e-6
    u = np.append(point.unknowns, point.values[0])
    values = []
    for sign in (1.0, -1.0):
        x = u + sign * h * direction
        there = shooting.evaluate(x[:-1], x[-1:])
        values.append(monitors(shooting, there, direction).get(monitor, np.nan))
    change = float(values[0] - values[1])
    if not np.isfinite(change):
        raise OrbitError("the closest approach is gone", "take another point")
    return change
