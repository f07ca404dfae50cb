"""Chatter: completion of accumulating impacts.

Under a constant closing acceleration the separation speeds, and with them the flights, shrink by a
constant ratio. After a flight of length T the sequence lasts for another T ratio/(1 - ratio); then
the contact persists, as after an impact without rebound. On average over the flights the bodies
move as if in contact from the first impact: momentum is conserved, and the gap returns to zero.
Functions over `integrators.interface`, as in `event_detection`.
"""

from __future__ import annotations

import math
from typing import Any

from mems_impact.hybrid.event_loop.event_detection import (
    TINY_BIAS,
    first_violated_guard,
    margin_error_scales,
    rk4_probe,
    rounding_error,
)
from mems_impact.hybrid.event_loop.workspace import (
    ACCUMULATION,
    ACCUMULATION_STATE,
    CONTACT_STATE,
    EPS,
    GAIN,
    HIT_BEGIN,
    HIT_HEIGHT,
    HIT_INTERVAL,
    HIT_MODE,
    HIT_OTHERS,
    HIT_REMAINING,
    HIT_SPEED,
    HIT_TIME,
    IMPACT,
    MARGINS_AT,
    MARGINS_BEFORE,
    NO_ZERO,
    NONE,
    SIZE,
    STATE_AHEAD,
    STATE_BEFORE,
    STATE_SHIFTED,
    G,
    log_event,
    next_switch,
    table_row,
)
from mems_impact.integrators import interface

# A flight is weak if its height is below this part of the sum of the size of the gap (see
# `margin_error_scales`) and the highest flight of its sequence, or below the absolute tolerance.
# The sequence is then completed, while the gap still has significant digits.
NEGLIGIBLE_FLIGHT_HEIGHT = 5e-11
# A margin is flat at zero if early in a flight it is higher by the first factor than its rate
# shows. Otherwise a rate above the second part of that one step before shows a simple zero. The
# lengths of the flights then give their ratio, and their squares the heights. Such a flight is
# weak, too, if its early height is below the last factor times the rounding errors.
FLAT_RATIO, SLOW_RATIO, EARLY_PART, ROUNDING_FACTOR = 10.0, 3e-2, 2.0**-5, 1e2
FIRST_PART = 2.0**-6  # of a time, in which a margin rises in proportion at a simple zero
FLATTEST = 2.0**-48  # of margins at times that differ by a factor of 8: the power 16
LOOKS, SHORTEST_LOOK = 20, 1e3 * EPS  # at times that decrease by this factor
# At a flat zero two predictions of the accumulation point make a sequence if they agree within the
# first part of the last flight. Within the second one the earlier of them is kept, since flights
# lose digits as they become short.
SEQUENCE_RTOL, PREDICTION_RTOL = 0.1, 1e-4
SHORT_FLIGHT_FACTOR = 1e3  # flights shorter than predicted by this factor belong to no sequence
LONG_FLIGHT_FACTOR = 100.0  # flights longer than predicted by this factor end a sequence
CHATTER_END_RTOL = 1e-4  # error of the accumulation point relative to the last flight
CHATTER_BISECTIONS = 60


def complete_chatter(engine: Any, s: Any, y: Any, guard: int) -> bool:
    """Complete a sequence of impacts at `guard` once its flights are weak.

    Requires `margin_error_scales` of the state after the impact, `y` at ``s.t``. Both become time
    and state at the accumulation point, with all motion until then; or they are unchanged, and the
    sequence continues. Returns False if it continues and the scratch rows of `margin_error_scales`
    are still valid.
    """
    y_before, y_contact, y_end = (
        table_row(s, STATE_BEFORE),
        table_row(s, CONTACT_STATE),
        table_row(s, ACCUMULATION_STATE),
    )
    mode, t, code = s.mode, s.t, s.m + guard
    remaining, interval = remaining_chatter_time(engine, s, t, y, guard)
    t_end = min((s.end_cycle - s.cycle) * s.period + s.end_phase, next_switch(s, t))
    if t + remaining >= t_end:
        return False
    s.mode_before = mode
    for j in range(s.n):
        y_before[j] = y[j]
        y_contact[j] = y[j]
    contact_mode = interface.transition(engine, mode, code, t, y_contact)
    if remaining == -math.inf:
        contact_mode = NO_ZERO
    if not is_finite(s, y_contact):
        remaining = 0.0  # the caller reports the failure
    if remaining > 0.0:
        # Every flight restores the gap. So on average the bodies move as if in contact, if there is
        # a mode for the contact.
        has_contact_mode = contact_mode != mode and 0 <= contact_mode < s.modes
        s.mode = contact_mode if has_contact_mode else mode
        # First-order correction for a slowly varying closing acceleration, which also affects the
        # length of the last flight and the ratio of its speeds.
        rk4_probe(engine, s, s.mode, t, y_contact, remaining, y_end)
        h = 0.125 * interval
        a_start = acceleration(engine, s, mode, t, y_contact, guard, h)
        a_end = acceleration(engine, s, mode, t + remaining, y_end, guard, h)
        relative_change = (a_end - a_start) / a_start if a_start != 0.0 else math.inf
        if table_row(s, HIT_REMAINING)[guard] > 0.0:
            relative_change = 0.0  # the flights show it, and the rates of a flat margin do not
        is_steady = relative_change * relative_change * remaining <= CHATTER_END_RTOL * interval
        remaining = max(0.0, remaining - 2.0 / 3.0 * relative_change * (interval + remaining))
        if not (is_steady and carry_to_accumulation(engine, s, t, remaining, guard)):
            s.mode = mode
            return True
        t += remaining
        if not has_contact_mode:
            s.mode = interface.transition(engine, s.mode, code, t, y_end)
    else:
        s.mode = contact_mode
        for j in range(s.n):
            y_end[j] = y_contact[j]
    table_row(s, HIT_TIME)[guard] = table_row(s, HIT_BEGIN)[guard] = -math.inf
    log_event(s, t, ACCUMULATION, guard, mode, y_before, y_end)
    for j in range(s.n):
        y[j] = y_end[j]
    if t > s.t:
        s.transitions_now = 0
    s.t = t
    return True


def is_finite(s: Any, y: Any) -> bool:
    """Return whether all components of a state are finite."""
    result = True
    for j in range(s.n):
        result = result and math.isfinite(y[j])
    return result


def remaining_chatter_time(
    engine: Any, s: Any, t: float, y: Any, guard: int
) -> tuple[float, float]:
    """Record the impact at `t`; return the remaining time of its sequence, and the last flight.

    If impacts lead to several modes in turn, the last flight is the time since the previous impact
    that led to the same mode.

    Requires `margin_error_scales`. The time is infinite if there is no sequence that can be
    completed yet, and negative infinity if rounding errors of the margin hide the next impacts.
    """
    m, speed = s.m, table_row(s, MARGINS_AT)[s.m + guard]
    hit_time, hit_begin, hit_interval = (
        table_row(s, HIT_TIME),
        table_row(s, HIT_BEGIN),
        table_row(s, HIT_INTERVAL),
    )
    hit_speed, hit_height = table_row(s, HIT_SPEED), table_row(s, HIT_HEIGHT)
    hit_mode, hit_others = table_row(s, HIT_MODE), table_row(s, HIT_OTHERS)
    hit_remaining = table_row(s, HIT_REMAINING)
    hit_time[guard] = t
    # Flights in different modes shrink by different ratios: compare impacts that lead to the same
    # mode. A mode that does not recur is replaced by the present one.
    is_other_mode = hit_begin[guard] > -math.inf and s.mode != hit_mode[guard]
    if is_other_mode:
        hit_others[guard] += 1.0
        if hit_others[guard] < s.modes:
            return math.inf, math.inf
    hit_others[guard] = 0.0
    t_previous = -math.inf if is_other_mode else hit_begin[guard]
    previous_interval, previous_speed = hit_interval[guard], hit_speed[guard]
    interval = t - t_previous
    hit_begin[guard], hit_interval[guard], hit_speed[guard] = t, interval, speed
    hit_mode[guard] = s.mode
    is_steep = speed > SLOW_RATIO * abs(table_row(s, MARGINS_BEFORE)[m + guard])
    if interval == math.inf and not is_steep:
        early = min(EARLY_PART * s.scale, 0.5 * (next_switch(s, t) - t))
        is_flat = is_flat_zero(engine, s, t, y, guard, early)
        hit_remaining[guard] = math.inf if is_flat else 0.0
        if is_flat and is_hidden(engine, s, t, y, guard, early):
            return -math.inf, interval
    if interval == math.inf or (interval == 0.0 and s.transitions_now > 1):
        return math.inf, interval
    is_shorter = interval < previous_interval < math.inf
    height = 0.25 * previous_speed * interval
    size, gain = table_row(s, SIZE)[guard], table_row(s, GAIN)[guard]
    max_height = max(hit_height[guard], height) if is_shorter else height
    is_strong = height >= max(NEGLIGIBLE_FLIGHT_HEIGHT * (size + max_height), s.atol * gain)
    if is_strong and is_steep and hit_remaining[guard] == 0.0:
        hit_height[guard] = max_height
        return math.inf, interval
    early = EARLY_PART * interval
    is_known = is_shorter and hit_remaining[guard] > 0.0
    if is_known or is_flat_zero(engine, s, t, y, guard, early):
        if is_hidden(engine, s, t, y, guard, early):
            return -math.inf, interval
        ratio = interval / previous_interval if is_shorter else 0.0
        return remaining_flat_time(engine, s, t, y, guard, ratio, previous_speed), interval
    hit_remaining[guard] = 0.0
    hit_height[guard] = max_height
    if is_strong or previous_speed <= 0.0:
        return math.inf, interval
    ratio = speed / previous_speed
    # A sequence needs three impacts, so that a run restarted before them detects it too.
    is_shrinking = is_shorter and 0.0 <= ratio < 1.0
    # A flight under acceleration a lasts 2 u/a. A body that another body throws back arrives much
    # sooner. With friction the acceleration changes during the flight.
    flight = max(interval, EPS * abs(t))
    a = acceleration(engine, s, s.mode, t, y, guard, 0.125 * flight)
    if 2.0 * previous_speed > SHORT_FLIGHT_FACTOR * abs(a) * flight:
        return math.inf, interval
    for k in range(m):
        is_other_impact = k != guard and table_row(s, IMPACT)[k] == 1 and hit_time[k] > t_previous
        if is_other_impact and share_state(engine, s, t, y, guard, k):
            return math.inf, interval  # impacts alternate between two gaps
    if is_shrinking:
        return interval * ratio / (1.0 - ratio), interval
    # Flights below the rounding of the gap, or of time, need not shrink.
    if height < 16.0 * EPS * size or interval < 64.0 * EPS * abs(t):
        return 0.0, interval
    # Steps detect the end of a low flight late, which then lasts far longer than speed and
    # acceleration predict: such flights need not shrink either.
    if 2.0 * LONG_FLIGHT_FACTOR * previous_speed < -a * interval:
        return 0.0, interval
    return math.inf, interval


def remaining_flat_time(
    engine: Any, s: Any, t: float, y: Any, guard: int, ratio: float, previous_ratio: float
) -> float:
    """Return the remaining time of a sequence at a flat zero, as `remaining_chatter_time` does.

    `ratio` is that of the last two flights, 0 if the last one is not shorter. Under a slowly
    varying acceleration the ratios q of flights T change as q = r (1 - k T).
    """
    longest, remaining = table_row(s, HIT_HEIGHT), table_row(s, HIT_REMAINING)
    interval = table_row(s, HIT_INTERVAL)[guard]
    is_predicted = 0.0 < remaining[guard] < math.inf and ratio > 0.0
    predicted = remaining[guard] - interval
    longest[guard] = max(longest[guard], interval) if is_predicted else interval
    table_row(s, HIT_SPEED)[guard] = ratio
    remaining[guard] = math.inf
    if ratio > 0.0:
        before = interval / ratio
        change = 0.0
        if is_predicted and previous_ratio > 0.0:
            shortening = max(before / previous_ratio - before, EPS * before)
            change = (ratio / previous_ratio - 1.0) / shortening
        limit = min(ratio * (1.0 + change * before), 1.0 - EPS)
        correction = 1.0 - change * interval / (1.0 - limit * limit)
        remaining[guard] = max(interval * limit / (1.0 - limit) * correction, TINY_BIAS)
    difference = abs(remaining[guard] - predicted) if is_predicted else math.inf
    is_sequence = difference < SEQUENCE_RTOL * interval
    if difference <= PREDICTION_RTOL * interval:
        remaining[guard] = predicted
    # The next impact must not be below the rounding errors.
    early = EARLY_PART * interval * (ratio * ratio if is_sequence else 1.0)
    height = margin_ahead(engine, s, t, y, guard, early)
    margin_error_scales(engine, s, s.mode, t + early, table_row(s, STATE_AHEAD))
    is_weak = height < ROUNDING_FACTOR * rounding_error(s, guard)
    margin_error_scales(engine, s, s.mode, t, y)
    is_short = interval * interval < NEGLIGIBLE_FLIGHT_HEIGHT * longest[guard] * longest[guard]
    if is_sequence and (is_weak or is_short):
        return float(remaining[guard])
    return 0.0 if is_weak else math.inf


def is_flat_zero(engine: Any, s: Any, t: float, y: Any, guard: int, h: float) -> bool:
    """Return whether the margin of `guard` rises over `h` much more than at first.

    Its rate shows the rise at first, or its value after a part of `h` where the difference for the
    rate reaches further. Requires `margin_error_scales`.
    """
    speed = table_row(s, MARGINS_AT)[s.m + guard]
    height = margin_ahead(engine, s, t, y, guard, h)
    if height > FLAT_RATIO * max(0.0, speed) * h:
        return True
    first = margin_ahead(engine, s, t, y, guard, FIRST_PART * h)
    is_visible = first > ROUNDING_FACTOR * rounding_error(s, guard)
    return is_visible and FIRST_PART * height > FLAT_RATIO * first


def is_hidden(engine: Any, s: Any, t: float, y: Any, guard: int, h: float) -> bool:
    """Return whether the margin of `guard`, flat at zero, loses its sign in its own operations.

    Look at times that decrease from `h`, until rounding errors of state or time reach the margin.
    The sixth difference shows errors of the operations, since a smooth margin hardly has one.
    Overwrites STATE_AHEAD; requires and restores `margin_error_scales`, in ``s.mode``.
    """
    g, y_ahead, y_near = table_row(s, G), table_row(s, STATE_AHEAD), table_row(s, STATE_SHIFTED)
    result, height = False, margin_ahead(engine, s, t, y, guard, h)
    for _ in range(LOOKS):
        h *= 0.125
        last, height = height, margin_ahead(engine, s, t, y, guard, h)
        difference, coefficient = 0.0, 1.0
        for k in range(7):
            part = 1.0 - k / 64.0
            for j in range(s.n):
                y_near[j] = y[j] + part * (y_ahead[j] - y[j])
            interface.margins(engine, s.mode, t + part * h, y_near, g)
            difference += coefficient * g[guard]
            coefficient *= (k - 6.0) / (k + 1.0)
        margin_error_scales(engine, s, s.mode, t + h, y_ahead)
        rounding = rounding_error(s, guard)
        noise = abs(difference)
        if abs(height) < ROUNDING_FACTOR * rounding or h < SHORTEST_LOOK * (abs(t) + s.scale):
            break
        is_flattest = 0.0 <= height < FLATTEST * abs(last)
        is_lost = noise > rounding and -ROUNDING_FACTOR * noise < height < noise
        result = result or is_flattest or is_lost
    margin_error_scales(engine, s, s.mode, t, y)
    return result


def margin_ahead(engine: Any, s: Any, t: float, y: Any, guard: int, h: float) -> float:
    """Return the margin of `guard` after the time `h`; overwrites STATE_AHEAD."""
    g, y_ahead = table_row(s, G), table_row(s, STATE_AHEAD)
    rk4_probe(engine, s, s.mode, t, y, h, y_ahead)
    interface.margins(engine, s.mode, t + h, y_ahead, g)
    margin: float = g[guard]
    return margin


def acceleration(
    engine: Any,
    s: Any,
    mode: int,
    t: float,
    y: Any,
    guard: int,
    h: float,
) -> float:
    """Return the mean derivative of the rate of `guard` along the flow over the time `h`."""
    g, y_ahead = table_row(s, G), table_row(s, STATE_AHEAD)
    m = s.m
    h = min(h, 0.5 * (next_switch(s, t) - t))
    interface.margins(engine, mode, t, y, g)
    rate = g[m + guard]
    rk4_probe(engine, s, mode, t, y, h, y_ahead)
    interface.margins(engine, mode, t + h, y_ahead, g)
    result: float = (g[m + guard] - rate) / h
    return result


def carry_to_accumulation(engine: Any, s: Any, t: float, remaining: float, guard: int) -> bool:
    """Propagate CONTACT_STATE over the time `remaining` into ACCUMULATION_STATE, in ``s.mode``.

    A guard that fires before the end is handled if the impacts at `guard` affect it, for example a
    slip end. Returns False if the sequence cannot be completed yet: one step is too inaccurate, as
    in a stiff system, or the guard that fires is an impact, is unaffected, or is not the only one.
    Overwrites STATE_AHEAD.
    """
    y_contact, y_end, g = (
        table_row(s, CONTACT_STATE),
        table_row(s, ACCUMULATION_STATE),
        table_row(s, G),
    )
    mode = s.mode
    rk4_probe(engine, s, mode, t, y_contact, remaining, y_end)
    # Compare with two half steps, which detects components faster than the sequence, such as a
    # charge behind a resistance.
    y_half_steps = table_row(s, STATE_AHEAD)
    rk4_probe(engine, s, mode, t, y_contact, 0.5 * remaining, y_half_steps)
    rk4_probe(engine, s, mode, t + 0.5 * remaining, y_half_steps, 0.5 * remaining, y_half_steps)
    for j in range(s.n):
        if not abs(y_end[j] - y_half_steps[j]) <= s.atol + s.rtol * abs(y_half_steps[j]):
            return False
    end_guard = first_violated_guard(engine, s, mode, t + remaining, y_end, guard, NONE)
    if end_guard == NONE:
        return True
    if table_row(s, IMPACT)[end_guard] == 1 or not affects(engine, s, mode, t, end_guard):
        return False
    low, high = 0.0, remaining
    for _ in range(CHATTER_BISECTIONS):
        middle = 0.5 * (low + high)
        rk4_probe(engine, s, mode, t, y_contact, middle, y_end)
        interface.margins(engine, mode, t + middle, y_end, g)
        if g[end_guard] > 0.0:
            low = middle
        else:
            high = middle
    rk4_probe(engine, s, mode, t, y_contact, high, y_end)
    s.mode = interface.transition(engine, mode, end_guard, t + high, y_end)
    rk4_probe(engine, s, s.mode, t + high, y_end, remaining - high, y_end)
    return first_violated_guard(engine, s, s.mode, t + remaining, y_end, guard, NONE) == NONE


def affects(engine: Any, s: Any, mode: int, t: float, other: int) -> bool:
    """Return whether the impact without rebound changes the margin of the guard `other`.

    The step leads from STATE_BEFORE to CONTACT_STATE.
    """
    g = table_row(s, G)
    y_before, y_contact = table_row(s, STATE_BEFORE), table_row(s, CONTACT_STATE)
    interface.margins(engine, mode, t, y_before, g)
    margin, rate = g[other], g[s.m + other]
    interface.margins(engine, mode, t, y_contact, g)
    return bool(g[other] != margin or g[s.m + other] != rate)


def share_state(engine: Any, s: Any, t: float, y: Any, guard: int, other: int) -> bool:
    """Return whether the margins of two guards depend on the same component of the state."""
    g, y_shifted = table_row(s, G), table_row(s, STATE_SHIFTED)
    interface.margins(engine, s.mode, t, y, g)
    margin, other_margin = g[guard], g[other]
    for j in range(s.n):
        y_shifted[j] = y[j]
    for j in range(s.n):
        y_shifted[j] += 2.0**-26 * abs(y[j]) + s.atol
        interface.margins(engine, s.mode, t, y_shifted, g)
        if g[guard] != margin and g[other] != other_margin:
            return True
        y_shifted[j] = y[j]
    return False
