"""Chatter: completion of accumulating impacts.

Under a constant closing acceleration the speeds of separation, and with them the flights, shrink by
a constant ratio. What remains after a flight of length T is T ratio/(1 - ratio); then the contact
persists, which is an impact without rebound. On average over the flights it does so from the first:
two bodies that slide on meanwhile keep their momentum, and the gap between them comes back to zero.
Functions over the engine's contract, as in `detection`.
"""

from __future__ import annotations

import math
from typing import Any

from mems_impact.hybrid.event_loop.event_detection import first_violated_guard, rk4_probe
from mems_impact.hybrid.event_loop.workspace import (
    ACCUMULATION,
    ENTERED,
    EPS,
    GAIN,
    HIT_BEGIN,
    HIT_INTERVAL,
    HIT_MODE,
    HIT_OTHERS,
    HIT_REACH,
    HIT_SPEED,
    HIT_TIME,
    IMPACT,
    LEFT,
    MARGINS_AT,
    NONE,
    PAST,
    SIZE,
    STATE_AHEAD,
    STATE_SHIFTED,
    G,
    log_event,
    next_switch,
    table_row,
)
from mems_impact.integrators import interface

# A flight is weak if it is lower than this part of what makes up the gap, or of the highest flight
# of its sequence, or than the absolute tolerance: below that its impacts are not counted one by
# one, while the gap still has digits.
NEGLIGIBLE_FLIGHT_HEIGHT = 5e-11
ABRUPT = 1e3  # flights this much shorter than the acceleration says are none
LATE = 100.0  # those this much longer are told no better
CHATTER_END_RTOL = 1e-4  # the end of a sequence is known to about this part of its last flight
CHATTER_BISECTIONS = 60


def complete_chatter(engine: Any, s: Any, y: Any, guard: int) -> bool:
    """Complete a sequence of impacts at `guard` once its flights are weak.

    After `margin_error_scales` of the state after the impact, `y` at ``s.t``. They become those at
    the end of the sequence, all that moves having moved on until then; or stay, and the sequence
    goes on. Returns False if it plainly goes on: then what `margin_error_scales` left still stands.
    """
    past, entered, left = table_row(s, PAST), table_row(s, ENTERED), table_row(s, LEFT)
    mode, t, code = s.mode, s.t, s.m + guard
    remaining, interval = remaining_chatter_time(engine, s, t, y, guard)
    end = min((s.end_cycle - s.cycle) * s.period + s.end_phase, next_switch(s, t))
    if t + remaining >= end:
        return False
    for j in range(s.n):
        past[j] = y[j]
        entered[j] = y[j]
    touch = interface.transition(engine, mode, code, t, entered)
    if not finite(s, entered):
        remaining = 0.0  # no way to go on from there, as the caller finds
    if remaining > 0.0:
        # Every flight leaves the gap as it was. So on average the bodies move as if they were in
        # touch already, where there is a mode in which they are.
        together = touch != mode and 0 <= touch < s.modes
        s.mode = touch if together else mode
        # The closing acceleration changes a little, and has done so in the last flight: that is
        # in its length and in the ratio of its speeds. To first order, all of it together is this.
        rk4_probe(engine, s, s.mode, t, entered, remaining, left)
        h = 0.125 * interval
        first = acceleration(engine, s, mode, t, entered, guard, h)
        last = acceleration(engine, s, mode, t + remaining, left, guard, h)
        change = (last - first) / first if first != 0.0 else math.inf
        steady = change * change * remaining <= CHATTER_END_RTOL * interval
        remaining = max(0.0, remaining - 2.0 / 3.0 * change * (interval + remaining))
        if not (steady and carry_to_accumulation(engine, s, t, remaining, guard)):
            s.mode = mode
            return True
        t += remaining
        if not together:
            s.mode = interface.transition(engine, s.mode, code, t, left)
    else:
        s.mode = touch
        for j in range(s.n):
            left[j] = entered[j]
    table_row(s, HIT_TIME)[guard] = table_row(s, HIT_BEGIN)[guard] = -math.inf
    log_event(s, t, ACCUMULATION, guard, mode, past, left)
    for j in range(s.n):
        y[j] = left[j]
    if t > s.t:
        s.transitions_now = 0
    s.t = t
    return True


def finite(s: Any, y: Any) -> bool:
    """Return whether all of a state are finite numbers."""
    all_are = True
    for j in range(s.n):
        all_are = all_are and math.isfinite(y[j])
    return all_are


def remaining_chatter_time(
    engine: Any, s: Any, t: float, y: Any, guard: int
) -> tuple[float, float]:
    """Note the impact at `t`; return how long its sequence still lasts, and the last flight.

    Or the last flights, from the impact that led into the same mode.

    After `margin_error_scales`. Infinity if there is no sequence, or none that may be completed
    yet.
    """
    m, speed = s.m, table_row(s, MARGINS_AT)[s.m + guard]
    hit_time, hit_begin, hit_interval = (
        table_row(s, HIT_TIME),
        table_row(s, HIT_BEGIN),
        table_row(s, HIT_INTERVAL),
    )
    hit_speed, hit_reach = table_row(s, HIT_SPEED), table_row(s, HIT_REACH)
    hit_mode, hit_others = table_row(s, HIT_MODE), table_row(s, HIT_OTHERS)
    hit_time[guard] = t
    # Flights in different modes shrink by different ratios: what repeats is the way back to a mode.
    # One to which nothing leads back is given up for the mode of now.
    elsewhere = hit_begin[guard] > -math.inf and s.mode != hit_mode[guard]
    if elsewhere:
        hit_others[guard] += 1.0
        if hit_others[guard] < s.modes:
            return math.inf, math.inf
    hit_others[guard] = 0.0
    since = -math.inf if elsewhere else hit_begin[guard]
    earlier, before = hit_interval[guard], hit_speed[guard]
    interval = t - since
    hit_begin[guard], hit_interval[guard], hit_speed[guard] = t, interval, speed
    hit_mode[guard] = s.mode
    if interval == math.inf or before <= 0.0 or (interval == 0.0 and s.transitions_now > 1):
        return math.inf, interval
    ratio = speed / before
    # Three impacts make a sequence, so that a run taken up before them knows as much.
    shrinking = interval < earlier < math.inf and 0.0 <= ratio < 1.0
    height = 0.25 * before * interval
    size, gain = table_row(s, SIZE)[guard], table_row(s, GAIN)[guard]
    reach = max(hit_reach[guard], height) if interval < earlier < math.inf else height
    hit_reach[guard] = reach
    if height >= max(NEGLIGIBLE_FLIGHT_HEIGHT * (size + reach), s.atol * gain):
        return math.inf, interval
    # A flight that acceleration turns round lasts 2 u/a. A body that another one throws back
    # arrives far too soon for its speed. With friction the acceleration changes during the flight.
    flight = max(interval, EPS * abs(t))
    a = acceleration(engine, s, s.mode, t, y, guard, 0.125 * flight)
    if 2.0 * before > ABRUPT * abs(a) * flight:
        return math.inf, interval
    for k in range(m):
        other = k != guard and table_row(s, IMPACT)[k] == 1 and hit_time[k] > since
        if other and share_state(engine, s, t, y, guard, k):
            return math.inf, interval  # two gaps in alternation
    if shrinking:
        return interval * ratio / (1.0 - ratio), interval
    # Flights that drown in the rounding of the gap, or of time, need not shrink.
    if height < 16.0 * EPS * size or interval < 64.0 * EPS * abs(t):
        return 0.0, interval
    # Nor one that lasts far longer than speed and acceleration say: no step sees the end of such a
    # low flight in time.
    if 2.0 * LATE * before < -a * interval:
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
) -> float:
    """Return how fast the rate of `guard` changes along the flow of `mode`, over the time `h`."""
    g, ahead = table_row(s, G), table_row(s, STATE_AHEAD)
    m = s.m
    h = min(h, 0.5 * (next_switch(s, t) - t))
    interface.margins(engine, mode, t, y, g)
    rate = g[m + guard]
    rk4_probe(engine, s, mode, t, y, h, ahead)
    interface.margins(engine, mode, t + h, ahead, g)
    result: float = (g[m + guard] - rate) / h
    return result


def carry_to_accumulation(engine: Any, s: Any, t: float, remaining: float, guard: int) -> bool:
    """Carry the state in ENTERED over `remaining` into LEFT, with ``s.mode``.

    A guard that fires on the way is handled if it belongs to what is in contact at `guard`, as the
    end of a slip that its impacts have caused. Returns False if the sequence cannot be completed
    yet: one step does not follow the flow so far, as in a stiff system, or what fires is another
    impact, or has nothing to do with it, or is not alone. Overwrites STATE_AHEAD.
    """
    entered, left, g = table_row(s, ENTERED), table_row(s, LEFT), table_row(s, G)
    mode = s.mode
    rk4_probe(engine, s, mode, t, entered, remaining, left)
    # What follows faster than the sequence ends, as a charge behind a resistance, would be lost.
    halves = table_row(s, STATE_AHEAD)
    rk4_probe(engine, s, mode, t, entered, 0.5 * remaining, halves)
    rk4_probe(engine, s, mode, t + 0.5 * remaining, halves, 0.5 * remaining, halves)
    for j in range(s.n):
        if not abs(left[j] - halves[j]) <= s.atol + s.rtol * abs(halves[j]):
            return False
    ended = first_violated_guard(engine, s, mode, t + remaining, left, guard, NONE)
    if ended == NONE:
        return True
    if table_row(s, IMPACT)[ended] == 1 or not affects(engine, s, mode, t, ended, guard):
        return False
    low, high = 0.0, remaining
    for _ in range(CHATTER_BISECTIONS):
        middle = 0.5 * (low + high)
        rk4_probe(engine, s, mode, t, entered, middle, left)
        interface.margins(engine, mode, t + middle, left, g)
        if g[ended] > 0.0:
            low = middle
        else:
            high = middle
    rk4_probe(engine, s, mode, t, entered, high, left)
    s.mode = interface.transition(engine, mode, ended, t + high, left)
    rk4_probe(engine, s, s.mode, t + high, left, remaining - high, left)
    return first_violated_guard(engine, s, s.mode, t + remaining, left, guard, NONE) == NONE


def affects(engine: Any, s: Any, mode: int, t: float, other: int, guard: int) -> bool:
    """Return whether an impact without rebound at `guard`, PAST to ENTERED, moves `other`."""
    g = table_row(s, G)
    past, entered = table_row(s, PAST), table_row(s, ENTERED)
    interface.margins(engine, mode, t, past, g)
    margin, rate = g[other], g[s.m + other]
    interface.margins(engine, mode, t, entered, g)
    return bool(g[other] != margin or g[s.m + other] != rate)


def share_state(engine: Any, s: Any, t: float, y: Any, guard: int, other: int) -> bool:
    """Return whether the margins of two guards depend on the same component of the state."""
    g, moved = table_row(s, G), table_row(s, STATE_SHIFTED)
    interface.margins(engine, s.mode, t, y, g)
    one, two = g[guard], g[other]
    for j in range(s.n):
        moved[j] = y[j]
    for j in range(s.n):
        moved[j] += 2.0**-26 * abs(y[j]) + s.atol
        interface.margins(engine, s.mode, t, moved, g)
        if g[guard] != one and g[other] != two:
            return True
        moved[j] = y[j]
    return False
