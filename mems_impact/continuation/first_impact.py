"""What a grazing does to the attractor: the normal form of the first impact.

An impact at a small speed changes the state, once what follows on it has died out, by a kick that
goes with the square root of the penetration that the orbit without impact would have. Whether the
orbit comes back to the stopper after k periods is decided by the sign of the kick's image in the
margin, xi_k = grad h . M^k kick, M being the monodromy matrix of the orbit without impact, based at
the grazing (Nordmark 1991).
"""

from __future__ import annotations

import numpy as np

from mems_impact.continuation.monitors import Monitor, closest
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.hybrid.loop import TRANSITION
from mems_impact.hybrid.run import run
from mems_impact.hybrid.trajectory import Floats, Instant
from mems_impact.hybrid.variational import Variational
from mems_impact.orbits.orbit import PeriodicOrbit, reduced_components
from mems_impact.orbits.shooting import Point, Shooting

SPEED = 1e-3  # of the trial impacts that show the kick
ALONG = 1e-6  # part of a kick that is none across the flow
SEQUENCE = 200  # periods over which the signs are looked at

CONTINUOUS, JUMP, DEAD = "continuous", "jump", "died earlier"


def contact_coefficient(shooting: Shooting, point: Point, monitor: Monitor, k: int) -> float | None:
    """Return xi_k = grad h . M^k kick: positive if the kick leads away from the stopper.

    None if the orbit has other events, for which the formula does not hold, or a mode to which a
    weak contact does not lead back.
    """
    try:
        sequence = contact_sequence(shooting, point, monitor, k)
    except OrbitError:
        return None
    return None if sequence is None else float(sequence[-1])


def contact_sequence(
    shooting: Shooting, point: Point, monitor: Monitor, count: int
) -> Floats | None:
    """Return xi_1 .. xi_count, or None if the orbit has events, or the kick goes along it.

    The kick of a cycle in a plane does: it comes to the stopper a little later or sooner, no more.
    """
    if any(event is not None for event in point.events):
        return None
    touch = closest(shooting, point, monitor.guard)
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
    image = kick(shooting, point, segment.mode, monitor.guard, time, to_touch.end)[keep]
    if shooting.phase is not None:
        along = to_touch.slope_end[free][keep]
        aside = image - along * float(along @ image) / float(along @ along)
        if np.linalg.norm(aside) < ALONG * np.linalg.norm(image):
            return None
    values = []
    for _ in range(count):
        image = total @ image
        values.append(float(gradient @ image))
    return np.array(values)


def stays_positive(sequence: Floats) -> bool:
    """Return whether all xi_k that are more than rounding of the first ones are positive."""
    return bool(np.all(sequence > -1e-10 * np.abs(sequence).max()))


def kick(shooting: Shooting, point: Point, mode: int, guard: int, time: float, y: Floats) -> Floats:
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
        before = weak_contact(variational, mode, guard, time, y, speed)
        events = run(problem, Instant(0, time, mode, before), 0.02).events
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
    return 2.0 * left_behind(0.5 * SPEED) - left_behind(SPEED)


def weak_contact(
    variational: Variational, mode: int, guard: int, time: float, y: Floats, speed: float
) -> Floats:
    """Return the state nearest to `y` on the guard, with its margin falling at `speed`."""
    h, free = 1e-5, list(variational.free)
    margin, rate = variational.margins(mode, time, y)
    rows = np.zeros((2, len(free)))
    for c, i in enumerate(free):
        shift = np.zeros(y.size)
        shift[i] = h
        up = variational.margins(mode, time, y + shift)
        down = variational.margins(mode, time, y - shift)
        rows[0, c] = (up[0][guard] - down[0][guard]) / (2.0 * h)
        rows[1, c] = (up[1][guard] - down[1][guard]) / (2.0 * h)
    wanted = np.array([-margin[guard], -speed - rate[guard]])
    weak = y.copy()
    weak[free] += np.linalg.lstsq(rows, wanted)[0]
    return weak


def grazing_type(orbit: PeriodicOrbit, monitor: Monitor) -> str:
    """Return how the attractor leaves a grazing orbit without impacts.

    Returns
    -------
    str
        "continuous" (all xi_k positive and the orbit stable: the paper's type II), "jump" (some
        xi_k negative: type I), "died earlier" (a multiplier beyond +1: type III).
    """
    if monitor.role != "approach":
        raise InvalidParameter(
            field="monitor", value=monitor.role, allowed="the closest approach of a free orbit"
        )
    if not orbit.stable:
        return DEAD
    sequence = contact_sequence(orbit.shooting, orbit.point, monitor, SEQUENCE)
    if sequence is None:
        problem = "the type is that of an orbit without events, and of a cycle only outside a plane"
        raise InvalidParameter(field="orbit", value=None, allowed="", problem=problem)
    return CONTINUOUS if stays_positive(sequence) else JUMP


__all__ = ["CONTINUOUS", "DEAD", "JUMP", "contact_sequence", "grazing_type"]
