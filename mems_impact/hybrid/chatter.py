"""Sequences of impacts that accumulate: recognised, and completed in one go.

Under a constant closing acceleration the speeds of separation, and with them the flights, shrink by
a constant ratio. What remains after a flight of length T is T ratio/(1 - ratio); then the contact
persists, which is an impact without rebound. Functions over the engine's contract, as in `guards`.
"""

from __future__ import annotations

import math
from typing import Any

from mems_impact.engines import contract as arc
from mems_impact.hybrid.guards import follow, resolution, violated
from mems_impact.hybrid.record import (
    ACCUMULATION,
    AHEAD,
    ENTERED,
    EPS,
    GAIN,
    HIT_INTERVAL,
    HIT_REACH,
    HIT_SPEED,
    HIT_TIME,
    LEFT,
    MOVED,
    NONE,
    PAST,
    SIZE,
    G,
    next_switch,
    note,
)

# A flight is weak if it is lower than this part of what makes up the gap, or of the highest flight
# of its sequence, or than the absolute tolerance: below that its impacts are not counted one by
# one, while the gap still has digits.
WEAK = 5e-11
ABRUPT = 1e3  # flights this much shorter than the acceleration says are none
STEADY = 1e-4  # the end of a sequence is known to about this part of its last flight
BISECTIONS = 60


def complete_chatter(
    engine: Any, s: Any, t: float, y: Any, guard: int, layout: Any, buffers: Any
) -> float:
    """Complete a sequence of impacts at `guard` once its flights are weak; return the new time.

    `y` is the state after the impact at `t`. It becomes that at the end of the sequence, all that
    moves having moved on until then; or it stays, and the sequence goes on.
    """
    work = buffers.work
    past, entered, left = work[PAST], work[ENTERED], work[LEFT]
    mode, code = s.mode, layout.order.size + guard
    remaining, interval = what_is_left(engine, s, t, y, guard, layout, buffers)
    end = min((s.end_cycle - s.cycle) * s.period + s.end_phase, next_switch(s, t, layout))
    if t + remaining >= end:
        return t
    for j in range(y.size):
        past[j] = y[j]
        entered[j] = y[j]
        left[j] = y[j]
    if remaining > 0.0:
        # On average over the impacts that are left, the bodies keep in touch.
        arc.transition(engine, mode, code, t, entered)
        # The closing acceleration changes a little, and has done so in the last flight: that is
        # in its length and in the ratio of its speeds. To first order, all of it together is this.
        follow(engine, mode, t, entered, remaining, left, buffers)
        h = 0.125 * interval
        first = acceleration(engine, s, mode, t, entered, guard, h, layout, buffers)
        last = acceleration(engine, s, mode, t + remaining, left, guard, h, layout, buffers)
        change = (last - first) / first if first != 0.0 else math.inf
        if not change * change * remaining <= STEADY * interval:
            return t
        remaining = max(0.0, remaining - 2.0 / 3.0 * change * (interval + remaining))
        if not carry(engine, s, t, remaining, guard, layout, buffers):
            s.mode = mode
            return t
    t += remaining
    s.mode = arc.transition(engine, s.mode, code, t, left)
    buffers.hits[guard, HIT_TIME] = -math.inf
    note(s, t, ACCUMULATION, guard, mode, past, left, buffers)
    for j in range(y.size):
        y[j] = left[j]
    return t


def what_is_left(
    engine: Any, s: Any, t: float, y: Any, guard: int, layout: Any, buffers: Any
) -> tuple[float, float]:
    """Note the impact at `t`; return how long its sequence still lasts, and the last flight.

    Infinity if there is no sequence, or none that may be completed yet.
    """
    m = layout.order.size
    hits, g = buffers.hits[guard], buffers.work[G]
    arc.margins(engine, s.mode, t, y, g)
    speed = g[m + guard]
    since, earlier, before = hits[HIT_TIME], hits[HIT_INTERVAL], hits[HIT_SPEED]
    hits[HIT_TIME], hits[HIT_INTERVAL], hits[HIT_SPEED] = t, t - since, speed
    interval = t - since
    if interval == math.inf or before <= 0.0 or (interval == 0.0 and s.instant > 1):
        return math.inf, interval
    ratio = speed / before
    # Three impacts make a sequence, so that a run taken up before them knows as much.
    shrinking = interval < earlier < math.inf and 0.0 <= ratio < 1.0
    height = 0.25 * before * interval
    resolution(engine, s, s.mode, t, y, layout, buffers)
    size, gain = buffers.work[SIZE][guard], buffers.work[GAIN][guard]
    reach = max(hits[HIT_REACH], height) if interval < earlier < math.inf else height
    hits[HIT_REACH] = reach
    if height >= max(WEAK * (size + reach), s.atol * gain):
        return math.inf, interval
    # A flight that acceleration turns round lasts 2 u/a. A body that another one throws back
    # arrives far too soon for its speed. With friction the acceleration changes during the flight.
    flight = max(interval, EPS * abs(t))
    a = acceleration(engine, s, s.mode, t, y, guard, 0.125 * flight, layout, buffers)
    if 2.0 * before > ABRUPT * abs(a) * flight:
        return math.inf, interval
    for k in range(m):
        other = k != guard and layout.impact[k] == 1 and buffers.hits[k, HIT_TIME] > since
        if other and shares(engine, s, t, y, guard, k, buffers):
            return math.inf, interval  # two gaps in alternation
    if shrinking:
        return interval * ratio / (1.0 - ratio), interval
    # Flights that drown in the rounding of the gap, or of time, need not shrink.
    if height < 16.0 * EPS * size or interval < 64.0 * EPS * abs(t):
        return 0.0, interval
    return math.inf, interval


def acceleration(
    engine: Any,
    s: Any,
    mode: int,
    t: float,
    y: Any,
    guard: int,
    h: float,
    layout: Any,
    buffers: Any,
) -> float:
    """Return how fast the rate of `guard` changes along the flow of `mode`, over the time `h`."""
    g, ahead = buffers.work[G], buffers.work[AHEAD]
    m = layout.order.size
    h = min(h, 0.5 * (next_switch(s, t, layout) - t))
    arc.margins(engine, mode, t, y, g)
    rate = g[m + guard]
    follow(engine, mode, t, y, h, ahead, buffers)
    arc.margins(engine, mode, t + h, ahead, g)
    result: float = (g[m + guard] - rate) / h
    return result


def carry(
    engine: Any, s: Any, t: float, remaining: float, guard: int, layout: Any, buffers: Any
) -> bool:
    """Carry the state in ENTERED over `remaining` into LEFT, with ``s.mode``.

    A guard that fires on the way is handled if it belongs to what is in contact at `guard`, as the
    end of a slip that its impacts have caused. Returns False if the sequence cannot be completed
    yet: what fires is another impact, or has nothing to do with it, or is not alone.
    """
    work = buffers.work
    entered, left, g = work[ENTERED], work[LEFT], work[G]
    mode = s.mode
    follow(engine, mode, t, entered, remaining, left, buffers)
    for j in range(buffers.offset.size):
        if not math.isfinite(left[j]):
            return False
    ended = violated(engine, s, mode, t + remaining, left, layout, buffers, guard, NONE)
    if ended == NONE:
        return True
    if layout.impact[ended] == 1 or not concerns(engine, mode, t, ended, guard, layout, buffers):
        return False
    low, high = 0.0, remaining
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        follow(engine, mode, t, entered, middle, left, buffers)
        arc.margins(engine, mode, t + middle, left, g)
        if g[ended] > 0.0:
            low = middle
        else:
            high = middle
    follow(engine, mode, t, entered, high, left, buffers)
    s.mode = arc.transition(engine, mode, ended, t + high, left)
    follow(engine, s.mode, t + high, left, remaining - high, left, buffers)
    return violated(engine, s, s.mode, t + remaining, left, layout, buffers, guard, NONE) == NONE


def concerns(
    engine: Any, mode: int, t: float, other: int, guard: int, layout: Any, buffers: Any
) -> bool:
    """Return whether an impact without rebound at `guard`, PAST to ENTERED, moves `other`."""
    g = buffers.work[G]
    past, entered = buffers.work[PAST], buffers.work[ENTERED]
    arc.margins(engine, mode, t, past, g)
    margin, rate = g[other], g[layout.order.size + other]
    arc.margins(engine, mode, t, entered, g)
    return bool(g[other] != margin or g[layout.order.size + other] != rate)


def shares(engine: Any, s: Any, t: float, y: Any, guard: int, other: int, buffers: Any) -> bool:
    """Return whether the margins of two guards depend on the same component of the state."""
    g, moved = buffers.work[G], buffers.work[MOVED]
    arc.margins(engine, s.mode, t, y, g)
    one, two = g[guard], g[other]
    for j in range(y.size):
        moved[j] = y[j]
    for j in range(y.size):
        moved[j] += 2.0**-26 * abs(y[j]) + s.atol
        arc.margins(engine, s.mode, t, moved, g)
        if g[guard] != one and g[other] != two:
            return True
        moved[j] = y[j]
    return False
