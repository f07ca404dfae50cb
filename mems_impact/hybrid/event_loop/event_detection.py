"""Event detection: margins of guards, hidden crossings, the Poincaré section.

Functions over `integrators.interface`, called by the loop. Scratch rows are rows of `workspace`: a
function may overwrite ``G``, and the rows that its docstring lists.

The engine detects margins that change sign over a step. A double crossing, beside a grazing, is
detected from the values and rates at both ends and, if these are inconclusive, by a scan of the
step.

Crossings of the section are treated in the same way.
"""

from __future__ import annotations

import math
from typing import Any

from mems_impact.hybrid.event_loop.long_steps import STEPS_PER_PERIOD, is_long, resolution
from mems_impact.hybrid.event_loop.workspace import (
    CONDITION,
    EPS,
    GAIN,
    IMPACT,
    MARGINS_AFTER,
    MARGINS_AT,
    MARGINS_BEFORE,
    NONE,
    ORDER,
    RATE_CHANGE,
    RECORDS,
    SECTION_CROSSING,
    SIZE,
    SLOPE,
    STAGE,
    STATE,
    STATE_AHEAD,
    STATE_BEFORE,
    STATE_SHIFTED,
    SUM,
    SUSPECT_SIDE,
    TIME_SIZE,
    TIMED,
    WAITING,
    G,
    log_event,
    next_switch,
    table_row,
    time_base,
)
from mems_impact.integrators import interface

# --- Signs of margins and rates beyond rounding

ROUNDINGS = 64.0  # rounding errors within which a value counts as zero
CERTAINTY = 1e3  # errors below zero at which a rate is negative without another check
TOLERANCES = 1e3  # integration errors below zero at which a margin is truly negative
STENCIL_RATIO = 3e-3  # reach of the differences for a rate, relative to the time scale
FLAT_MARGIN_RATIO = 1e-3  # of a margin to the margin a step before, below which it may be flat
FLAT_RATE_RATIO = 1e-6  # of a rate at a flat zero to the mean rate over this reach
TINY_BIAS = 1e-300  # bias of a margin that starts at zero


def margin_error_scales(engine: Any, s: Any, mode: int, t: float, y: Any) -> None:
    """Estimate the conditioning of margins and rates: for each its size and its gain.

    The size is the sum of |dg/dy_j| |y_j|, the gain that of |dg/dy_j|: roundings of the state move
    a margin by EPS * size, the tolerances by rtol * size + atol * gain. Roundings of time move it
    by EPS |dg/dt| t, with the time that it receives. The results are in SIZE, GAIN and TIME_SIZE
    (the last product without EPS), the margins in MARGINS_AT. Overwrites STATE_SHIFTED.
    """
    n, count = s.n, 2 * s.m
    base, g, y_shifted = table_row(s, MARGINS_AT), table_row(s, G), table_row(s, STATE_SHIFTED)
    size, gain, time_size = table_row(s, SIZE), table_row(s, GAIN), table_row(s, TIME_SIZE)
    interface.margins(engine, mode, t, y, base)
    largest = 0.0
    for i in range(s.m):
        largest = max(largest, time_magnitude(s, i, t))
    shift = min(2.0**-26 * largest, 0.25 * (next_switch(s, t) - t))
    interface.margins(engine, mode, t + shift, y, g)
    for k in range(count):
        size[k] = 0.0
        gain[k] = 0.0
        time = time_magnitude(s, k % s.m, t)
        time_size[k] = abs(g[k] - base[k]) / shift * time if shift > 0.0 else 0.0
    for j in range(n):
        y_shifted[j] = y[j]
    for j in range(n):
        shift = 2.0**-26 * abs(y[j]) + s.atol
        y_shifted[j] = y[j] + shift
        interface.margins(engine, mode, t, y_shifted, g)
        y_shifted[j] = y[j]
        for k in range(count):
            slope = abs(g[k] - base[k]) / shift
            gain[k] += slope
            size[k] += slope * abs(y[j])


def time_magnitude(s: Any, i: int, t: float) -> float:
    """Return the magnitude of the time that margin `i` receives at `t`."""
    return abs(time_base(s) + t) if table_row(s, TIMED)[i] == 1 else abs(t)


def time_rounding(s: Any, i: int, t: float) -> float:
    """Return a few rounding errors of the time that margin `i` receives at `t`."""
    return 8.0 * EPS * time_magnitude(s, i, t)


def rounding_error(s: Any, k: int) -> float:
    """Return the rounding error of margin or rate `k`, with a safety factor.

    Requires `margin_error_scales`.
    """
    rounding: float = ROUNDINGS * EPS * (table_row(s, SIZE)[k] + table_row(s, TIME_SIZE)[k])
    return rounding


def integration_error(s: Any, k: int) -> float:
    """Return the integration error of margin or rate `k`; requires `margin_error_scales`."""
    size, gain = table_row(s, SIZE)[k], table_row(s, GAIN)[k]
    error: float = s.rtol * size + s.atol * gain
    return error


def rk4_probe(engine: Any, s: Any, mode: int, t: float, y: Any, h: float, out: Any) -> None:
    """Integrate `mode` from (t, y) over `h` by one classical Runge-Kutta step, into `out`.

    For times so short that its error, of fifth order, is below rounding or irrelevant. Overwrites
    STAGE, SLOPE, SUM; `y` and `out` may be the same.
    """
    n = s.n
    stage, slope, total = table_row(s, STAGE), table_row(s, SLOPE), table_row(s, SUM)
    interface.flow(engine, mode, t, y, slope)
    for j in range(n):
        total[j] = slope[j]
        stage[j] = y[j] + 0.5 * h * slope[j]
    interface.flow(engine, mode, t + 0.5 * h, stage, slope)
    for j in range(n):
        total[j] += 2.0 * slope[j]
        stage[j] = y[j] + 0.5 * h * slope[j]
    interface.flow(engine, mode, t + 0.5 * h, stage, slope)
    for j in range(n):
        total[j] += 2.0 * slope[j]
        stage[j] = y[j] + h * slope[j]
    interface.flow(engine, mode, t + h, stage, slope)
    for j in range(n):
        out[j] = y[j] + h / 6.0 * (total[j] + slope[j])


def changes_ahead(engine: Any, s: Any, mode: int, i: int, t: float, y: Any) -> int:
    """Return the sign of the change of margin `i` along the flow ahead, 0 if it does not change.

    Requires `margin_error_scales`. The time ahead grows until the margin has changed by more than
    rounding. This decides gaps that open with zero speed and acceleration, for example when a
    moving wall releases a body. Overwrites STATE_AHEAD, STAGE, SLOPE, SUM.
    """
    g, y_ahead = table_row(s, G), table_row(s, STATE_AHEAD)
    margin_rounding, rate_rounding = rounding_error(s, i), rounding_error(s, s.m + i)
    interface.margins(engine, mode, t, y, g)
    margin = g[i]
    horizon = min(s.scale / STEPS_PER_PERIOD, 0.5 * (next_switch(s, t) - t))
    h = max(2.0**-45 * horizon, EPS * abs(t))
    while h < horizon:
        h = min(8.0 * h, horizon)
        rk4_probe(engine, s, mode, t, y, h, y_ahead)
        interface.margins(engine, mode, t + h, y_ahead, g)
        change = g[i] - margin
        if abs(change) > margin_rounding + h * rate_rounding:
            return -1 if change < 0.0 else 1
    return 0


def is_decreasing(engine: Any, s: Any, mode: int, i: int, t: float, y: Any) -> bool:
    """Return whether margin `i` truly decreases at (t, y); requires `margin_error_scales`.

    Within the integration error of the interpolant, and within rounding, a margin may falsely
    appear to cross zero. A clearly negative rate is accepted; otherwise the flow decides. At a flat
    zero, as of a cube, the rate is a difference of far larger margins ahead. Overwrites the rows of
    `changes_ahead`.
    """
    m, g = s.m, table_row(s, G)
    margin, rate = table_row(s, MARGINS_AT)[i], table_row(s, MARGINS_AT)[m + i]
    if rate < -rounding_error(s, m + i) - integration_error(s, m + i):
        h = min(STENCIL_RATIO * s.scale, 0.5 * (next_switch(s, t) - t))
        y_ahead, is_flat = table_row(s, STATE_AHEAD), False
        for _ in range(2):  # the margin may be at its next zero at one of two times
            rk4_probe(engine, s, mode, t, y, h, y_ahead)
            interface.margins(engine, mode, t + h, y_ahead, g)
            is_flat = is_flat or -rate * h <= FLAT_RATE_RATIO * abs(g[i] - margin)
            h *= 0.25
        if not is_flat:
            return True
    return changes_ahead(engine, s, mode, i, t, y) < 0


def first_violated_guard(
    engine: Any,
    s: Any,
    mode: int,
    t: float,
    y: Any,
    excluded_guard: int,
    last_impact: int,
) -> int:
    """Return the first guard, by order, that fires at (t, y); or NONE.

    A guard fires if its margin is zero or negative, to rounding, and decreases; or if it is clearly
    negative and not a gap; unless it waits. The guard `excluded_guard` does not count; then guards
    that only record do not either, since the state is tentative. If only impacts fire, those up to
    `last_impact`, in order, come last. Overwrites the rows of `margin_error_scales` and
    `changes_ahead`.
    """
    order, waiting = table_row(s, ORDER), table_row(s, WAITING)
    margin_error_scales(engine, s, mode, t, y)
    first = next_impact = NONE
    for i in range(s.m):
        if table_row(s, RECORDS)[i] == 1 and excluded_guard != NONE:
            continue
        if table_row(s, CONDITION)[i] == 0:
            was_waiting = waiting[i]
            is_waiting = waits(engine, s, mode, i, t, y)
            if excluded_guard != NONE:
                waiting[i] = was_waiting
            if is_waiting:
                continue
        if i != excluded_guard and fires(engine, s, mode, i, t, y):
            if first == NONE or order[i] < order[first]:
                first = i
            is_later = (
                last_impact != NONE
                and table_row(s, IMPACT)[i] == 1
                and order[i] > order[last_impact]
            )
            if is_later and (next_impact == NONE or order[i] < order[next_impact]):
                next_impact = i
    return next_impact if next_impact != NONE and table_row(s, IMPACT)[first] == 1 else first


def waits(engine: Any, s: Any, mode: int, i: int, t: float, y: Any) -> bool:
    """Return whether guard `i`, whose margin is no condition, waits for it to be positive.

    A transition that makes the margin negative lets the guard fire. It waits if the mode begins
    below its zero: the mode before did not watch it, and the state before was not above zero.
    Where the new mode has the opposite margin, as a comparator has, the guard does not wait.
    Requires `margin_error_scales`; STATE_BEFORE is the state before the latest transition.
    Overwrites the rows of `rk4_probe`, and STATE_AHEAD.
    """
    margin, waiting, g = table_row(s, MARGINS_AT)[i], table_row(s, WAITING), table_row(s, G)
    before, rounding = table_row(s, STATE_BEFORE), rounding_error(s, i)
    if margin > violation_threshold(s, i):
        waiting[i] = 0.0
    elif margin > rounding and waiting[i] == 1:
        interface.margins(engine, s.mode_before, t, before, g)
        if margin - g[i] > rounding:
            waiting[i] = 0.0  # the transition lifted it, by less than the threshold
    elif waiting[i] == 1 and s.mode_before != mode:
        h = min(STENCIL_RATIO * s.scale, 0.5 * (next_switch(s, t) - t))
        y_ahead = table_row(s, STATE_AHEAD)
        rk4_probe(engine, s, mode, t, y, h, y_ahead)
        interface.margins(engine, mode, t + h, y_ahead, g)
        margin_ahead = g[i]
        interface.margins(engine, s.mode_before, t + h, y_ahead, g)
        if margin >= -violation_threshold(s, i) and margin_ahead < 0.0 < g[i]:
            waiting[i] = 0.0
    elif waiting[i] == 0 and margin < -violation_threshold(s, i) and s.mode_before != mode:
        interface.margins(engine, s.mode_before, t, before, g)
        if g[i] == 1.0 and g[s.m + i] == 1.0:  # inactive
            interface.margins(engine, mode, t, before, g)
            waiting[i] = 0.0 if g[i] > rounding else 1.0
    return bool(waiting[i] == 1)


def fires(engine: Any, s: Any, mode: int, i: int, t: float, y: Any) -> bool:
    """Return whether guard `i` fires at (t, y); requires `margin_error_scales`."""
    m, margins = s.m, table_row(s, MARGINS_AT)
    rate = margins[m + i]
    # A margin that reaches zero within the rounding of time fires now; nan never fires.
    if not margins[i] <= rounding_error(s, i) + ROUNDINGS * EPS * abs(
        rate * time_magnitude(s, i, t)
    ):
        return False
    if table_row(s, IMPACT)[i] == 0 and margins[i] < -violation_threshold(s, i):
        return True
    if rate > rounding_error(s, m + i) + integration_error(s, m + i):
        return False
    return is_decreasing(engine, s, mode, i, t, y)


def violation_threshold(s: Any, i: int) -> float:
    """Return the depth below zero that integration errors of margin `i` cannot explain.

    Requires `margin_error_scales`.
    """
    rate = table_row(s, MARGINS_AT)[s.m + i]
    depth: float = TOLERANCES * integration_error(s, i) + 1e-6 * abs(rate) * s.scale
    return depth


def inadmissible_gap(engine: Any, s: Any, t: float, y: Any) -> int:
    """Return a gap that is clearly negative and does not open, possible at a start only; or NONE.

    At the start of a run let guards wait that are negative and only record, or whose event another
    run has had.
    """
    m = s.m
    margins = table_row(s, MARGINS_AT)
    margin_error_scales(engine, s, s.mode, t, y)
    s.mode_before = s.mode
    for j in range(s.n):
        table_row(s, STATE_BEFORE)[j] = y[j]
    for i in range(m):
        may_wait = s.arcs == 0 and (table_row(s, RECORDS)[i] == 1 or s.initial == 0)
        if may_wait and margins[i] < -violation_threshold(s, i):
            table_row(s, WAITING)[i] = 1.0
        is_closing = table_row(s, IMPACT)[i] == 1 and margins[m + i] <= 0.0
        if is_closing and margins[i] < -violation_threshold(s, i):
            return i
    return NONE


def certainly_decreasing(s: Any, k: int, rate: float) -> bool:
    """Return whether a rate is so far below zero that no further check is needed.

    The scales of the latest `margin_error_scales` suffice, with a large safety factor.
    """
    return bool(rate < -CERTAINTY * (rounding_error(s, k) + integration_error(s, k)))


# --- First event within a step

MIN_SUBSTEP_RATIO = 2.0**-10  # shortest part of a step in a scan
# Factor per step by which the observed change of a rate decays. At 1/2, a margin that oscillates
# several times within a step, and changes less over the next one, was certified too early.
RATE_CHANGE_DECAY = 0.9


def update_margins(engine: Any, s: Any, status: int, t_start: float, t: float) -> bool:
    """Read the margins at the end of a step; return whether a guard may have fired in it.

    SUSPECT_SIDE is nonzero for each margin that may have an undetected zero, by values and rates at
    both ends: the side of zero, 1 or -1, on which it began.
    """
    margins_before, margins_after, rate_changes, suspect_sides = (
        table_row(s, MARGINS_BEFORE),
        table_row(s, MARGINS_AFTER),
        table_row(s, RATE_CHANGE),
        table_row(s, SUSPECT_SIDE),
    )
    waiting = table_row(s, WAITING)
    m, h = s.m, t - t_start
    for k in range(2 * m):
        margins_before[k] = margins_after[k]
    interface.end_margins(engine, margins_after)
    is_suspect, is_scanned = status == interface.ROOT, is_long(s, t_start, t)
    if is_scanned:
        scan_margins(engine, s, t_start, t)
    for i in range(m):
        is_clear = is_scanned and suspect_sides[i] >= 0.0
        suspect_sides[i] = 0.0
        is_root = status == interface.ROOT and interface.root_directions(engine, i) < 0
        bias = interface.bias(engine, i)
        # An inactive margin is constant; a margin with a bias is checked elsewhere.
        is_active = (
            is_root
            or margins_after[i] != margins_before[i]
            or margins_after[m + i] != margins_before[m + i]
            or (is_scanned and (margins_after[i] != 1.0 or margins_after[m + i] != 1.0))
        )
        if is_active and h > 0.0 and bias <= TINY_BIAS:
            # Rounding of the time that the margin receives dominates a shorter step.
            rate_changes[i] = max(
                abs(margins_after[m + i] - margins_before[m + i]) / max(h, time_rounding(s, i, t)),
                RATE_CHANGE_DECAY * rate_changes[i],
            )
            # At a root the margin is zero within the root tolerance of the engine.
            start_margin, end_margin = (
                margins_before[i] + bias,
                0.0 if is_root else margins_after[i] + bias,
            )
            side = -1.0 if waiting[i] == 1 else 1.0
            start_margin, end_margin = side * start_margin, side * end_margin
            is_certified = certify_no_crossing(
                start_margin,
                side * margins_before[m + i],
                end_margin,
                side * margins_after[m + i],
                h,
                rate_changes[i],
            )
            # A margin on the negative side may have become positive and fallen again.
            ends_positive = start_margin >= 0.0 and end_margin >= 0.0
            is_certified = is_clear if is_scanned else is_certified
            if not is_certified and (ends_positive or side < 0.0):
                suspect_sides[i] = side
                is_suspect = True
        if margins_after[i] + bias > 0.0:
            waiting[i] = 0.0
    return is_suspect


def scan_margins(engine: Any, s: Any, t_start: float, t: float) -> None:
    """Bound all margins within a long step, at the intervals of the resolution.

    SUSPECT_SIDE is -1 for each margin that may have a zero. Overwrites STATE, G and MARGINS_AT.
    """
    m, y, g, before = s.m, table_row(s, STATE), table_row(s, G), table_row(s, MARGINS_AT)
    curvatures, waiting = table_row(s, SUSPECT_SIDE), table_row(s, WAITING)
    count = math.ceil((t - t_start) / resolution(s, t))
    h = (t - t_start) / count
    for k in range(count + 1):
        time = t_start + k * h if k < count else t
        interface.interpolate(engine, time, y)
        interface.margins(engine, s.mode, time, y, g)
        for i in range(m):
            side = -1.0 if waiting[i] == 1 else 1.0
            g[i], g[m + i] = side * (g[i] + interface.bias(engine, i)), side * g[m + i]
            if k == 0:
                curvatures[i] = table_row(s, RATE_CHANGE)[i]
            elif curvatures[i] >= 0.0:
                bend = max(curvatures[i], abs(g[m + i] - before[m + i]) / h)
                is_clear = certify_no_crossing(before[i], before[m + i], g[i], g[m + i], h, bend)
                curvatures[i] = bend if is_clear else -1.0
            before[i], before[m + i] = g[i], g[m + i]


def first_event_in_step(
    engine: Any, s: Any, status: int, t_start: float, t: float
) -> tuple[int, float]:
    """Return the guard that fires first in the step from `t_start` to `t`, or NONE, and the time.

    Guards fire at roots that the engine found, before a negative closest approach (a root of the
    rate), and at hidden crossings that a scan of the step finds. Overwrites STATE and the rows of
    `first_violated_guard`.
    """
    m = s.m
    order = table_row(s, ORDER)
    y = table_row(s, STATE)
    margins_after, suspect_sides = table_row(s, MARGINS_AFTER), table_row(s, SUSPECT_SIDE)
    guard, t_event = NONE, t
    root_count = 0
    for i in range(m):
        if status == interface.ROOT and interface.root_directions(engine, i) < 0:
            root_count += 1
    for i in range(m):
        is_root = status == interface.ROOT and interface.root_directions(engine, i) < 0
        t_crossing = math.inf
        bias = interface.bias(engine, i)
        if suspect_sides[i] != 0.0:
            end_margin = 0.0 if is_root else margins_after[i] + bias
            t_crossing = find_hidden_crossing(
                engine, s, i, t_start, t, end_margin, suspect_sides[i]
            )
        rate = 0.0
        if t_crossing == math.inf:
            if is_root:
                rate = margins_after[m + i]
                t_crossing = t - refine_root(engine, s, i, t_start, t) if root_count == 1 else t
            elif (
                status == interface.ROOT
                and interface.root_directions(engine, m + i) > 0
                # Zero as well: CVODE stops where a margin and its rate are zero together.
                and margins_after[i] + bias <= 0.0
                and table_row(s, WAITING)[i] != 1
            ):
                # An earlier crossing within the step is possible.
                end_margin = margins_after[i] + bias
                t_crossing = find_hidden_crossing(engine, s, i, t_start, t, end_margin, 1.0)
                if t_crossing == math.inf:
                    t_crossing = bisect_margin(engine, s, i, t_start, t)
        if t_crossing < math.inf and (
            guard == NONE
            or t_crossing < t_event
            or (t_crossing == t_event and order[i] < order[guard])
        ):
            is_certain = certainly_decreasing(s, m + i, rate)
            if not is_certain:
                interface.interpolate(engine, t_crossing, y)
                margin_error_scales(engine, s, s.mode, t_crossing, y)
                is_certain = is_decreasing(engine, s, s.mode, i, t_crossing, y)
            if is_certain:
                guard, t_event = i, t_crossing
            else:
                # Ignore the margin until it has risen, or decreases at the end of a step.
                s.negative_by_error = 1
                s.biased = 1
                depth = abs(table_row(s, MARGINS_AT)[i])
                interface.set_bias(engine, i, bias + depth + 2.0 * rounding_error(s, i))
    return guard, t_event


def hide_rounding(engine: Any, s: Any, i: int, t: float, y: Any) -> bool:
    """Return whether rate `i` is zero at (t, y) by rounding: its margin decreases further.

    Near a flat zero, rounding errors of a rate by differences change its sign many times, and the
    root search would stop at each. A bias hides them from it until the arc ends. Overwrites the
    rows of `margin_error_scales` and `changes_ahead`.
    """
    k, before = s.m + i, table_row(s, MARGINS_BEFORE)
    margin, bias = table_row(s, MARGINS_AFTER)[i], interface.bias(engine, k)
    if bias == 0.0 and before[k] < 0.0 and margin > FLAT_MARGIN_RATIO * before[i]:
        return False
    margin_error_scales(engine, s, s.mode, t, y)
    if changes_ahead(engine, s, s.mode, i, t, y) >= 0:
        return False
    g, y_ahead = table_row(s, G), table_row(s, STATE_AHEAD)
    h = min(STENCIL_RATIO * s.scale, 0.5 * (next_switch(s, t) - t))
    rk4_probe(engine, s, s.mode, t, y, h, y_ahead)
    interface.margins(engine, s.mode, t + h, y_ahead, g)
    interface.set_bias(engine, k, min(2.0 * bias, -ROUNDINGS * EPS * abs(g[i] - margin) / h))
    return True


def refine_root(engine: Any, s: Any, i: int, t_start: float, t: float) -> float:
    """Return the time between the zero of margin `i` and `t`, where it fired.

    CVODE stops late by about a hundred roundings of time, which adds up over many impacts. If a
    margin remains zero, CVODE may report any instant of that interval. Overwrites STATE and G.
    """
    margins_after, g, y = table_row(s, MARGINS_AFTER), table_row(s, G), table_row(s, STATE)
    margin, rate = margins_after[i] + interface.bias(engine, i), margins_after[s.m + i]
    longest = 1e-6 * min(t - t_start, resolution(s, t))
    if margin == 0.0 and longest > 8.0 * EPS * abs(t):
        t_earlier = t - longest
        interface.interpolate(engine, t_earlier, y)
        interface.margins(engine, s.mode, t_earlier, y, g)
        if g[i] == margins_after[i]:
            return t - bisect_margin(engine, s, i, t_start, t_earlier)
    if not rate < 0.0:
        return 0.0
    delay: float = margin / rate
    return delay if 8.0 * EPS * abs(t) < delay < longest else 0.0


def bisect_margin(engine: Any, s: Any, i: int, inside: float, outside: float) -> float:
    """Bisect margin `i` on the last step: positive at `inside`, negative at `outside`.

    Overwrites STATE.
    """
    g, y = table_row(s, G), table_row(s, STATE)
    bias = interface.bias(engine, i)
    for _ in range(80):
        middle = 0.5 * (inside + outside)
        if middle <= inside or middle >= outside:
            break
        interface.interpolate(engine, middle, y)
        interface.margins(engine, s.mode, middle, y, g)
        if g[i] + bias > 0.0:
            inside = middle
        else:
            outside = middle
    return outside


def find_hidden_crossing(
    engine: Any,
    s: Any,
    i: int,
    t_start: float,
    t: float,
    end_margin: float,
    side: float,
) -> float:
    """Return when margin `i` first becomes negative inside the last step; else infinity.

    A step of a nearly polynomial flow may contain several minima of a margin. Values and rates at
    two instants, and the change of the rates, bound the margin between them
    (`certify_no_crossing`), which suffices for most steps. Any other step is scanned in parts so
    short that the bound holds. `end_margin` is that at the end of the step. A margin that begins
    negative (`side` -1) must become positive first; until then its negative is scanned. Overwrites
    STATE and, after a crossing, the rows of `margin_error_scales`.
    """
    m = s.m
    margins_before, margins_after = table_row(s, MARGINS_BEFORE), table_row(s, MARGINS_AFTER)
    bias = interface.bias(engine, i)
    a, g_a, r_a = t_start, margins_before[i] + bias, margins_before[m + i]
    curvature = table_row(s, RATE_CHANGE)[i]
    g, y = table_row(s, G), table_row(s, STATE)
    span = t - t_start
    if is_long(s, t_start, t):
        span = min(span, 2.0 * resolution(s, t))
    min_width = max(MIN_SUBSTEP_RATIO * span, time_rounding(s, i, t))
    width = 0.5 * span
    while a < t:
        b = a + width if a + 1.5 * width < t else t
        g_b, r_b = end_margin, margins_after[m + i]
        if b < t:
            interface.interpolate(engine, b, y)
            interface.margins(engine, s.mode, b, y, g)
            g_b, r_b = g[i] + bias, g[m + i]
        curvature = max(curvature, abs(r_b - r_a) / (b - a))
        is_certain = certify_no_crossing(
            side * g_a, side * r_a, abs(g_b), side * r_b, b - a, curvature
        )
        if b - a > min_width and not is_certain:
            width *= 0.5
            continue
        if not is_certain and side * r_a < 0.0 < side * r_b:
            # By the rates there is one closest approach; its margin decides.
            t_closest = bisect_rate(engine, s.mode, m + i, a, b, side, y, g)
            interface.interpolate(engine, t_closest, y)
            interface.margins(engine, s.mode, t_closest, y, g)
            if side * (g[i] + bias) < min(0.0, side * g_b):
                b, g_b, r_b = t_closest, g[i] + bias, 0.0
        if side * g_b < 0.0:
            interface.interpolate(engine, b, y)
            margin_error_scales(engine, s, s.mode, b, y)
            is_crossing = side * g_b < -rounding_error(s, i)
            if is_crossing and side > 0.0:
                return bisect_margin(engine, s, i, a, b)
            side = 1.0 if is_crossing else side
            a, g_a, r_a = b, g_b if is_crossing else 0.0, r_b
        else:
            a, g_a, r_a = b, g_b, r_b
            width = min(2.0 * width, 0.5 * span)
    return math.inf


def bisect_rate(
    engine: Any, mode: int, k: int, a: float, b: float, side: float, y: Any, g: Any
) -> float:
    """Bisect rate `k` on the last step: negative at `a`, positive at `b`.

    Bisect its negative if `side` is -1. Overwrites the state `y` and the margins and rates `g`.
    """
    for _ in range(80):
        middle = 0.5 * (a + b)
        if middle <= a or middle >= b:
            break
        interface.interpolate(engine, middle, y)
        interface.margins(engine, mode, middle, y, g)
        if side * g[k] < 0.0:
            a = middle
        else:
            b = middle
    return b


def certify_no_crossing(
    g_a: float, r_a: float, g_b: float, r_b: float, h: float, curvature: float
) -> bool:
    """Return whether a margin with these values and rates at both ends of `h` remains positive.

    From either end its lower bound is a parabola with twice the curvature that its rates have
    shown, or that the discrepancy between rates and values implies.
    """
    defect = abs(g_b - g_a - 0.5 * h * (r_a + r_b))
    drop = 0.25 * curvature * h * h + 3.0 * defect
    return g_a + 0.5 * h * r_a > drop and g_b - 0.5 * h * r_b > drop


# --- Pairs of section crossings within a step

CURVATURE_SAFETY = 8.0  # factor on the recent curvature
MAX_CROSSINGS_PER_STEP = 16  # no method's interpolant has more


def init_section(engine: Any, s: Any, y: Any) -> None:
    """Record distance, rate and side of the section where an arc begins at (``s.t``, `y`).

    Overwrites SLOPE.
    """
    if s.section < 0:
        return
    s.section_distance = y[s.section] - s.level
    s.section_speed = rate_at(engine, s, s.t, y)
    s.section_step = s.section_curvature = 0.0
    s.section_side = sign(s.section_distance if s.section_distance != 0.0 else s.section_speed)


def detect_crossings(engine: Any, s: Any, t_start: float, y: Any, direction: int) -> None:
    """Record the crossings between `t_start` and ``s.t``, where the state is `y`.

    `direction` is the sign of a crossing at ``s.t`` that the engine found, or 0; that crossing is
    not recorded here. Rates would cost one evaluation of the flow per step, so the first check uses
    values only: the mean rates of the last two steps give a parabola. A component that remains
    clear of the section with a much larger curvature has not crossed it, and one without curvature
    cannot cross it twice. Overwrites STATE and SLOPE.
    """
    h = s.t - t_start
    if s.section < 0 or not h > 0.0:
        return
    distance = y[s.section] - s.level
    mean_rate = (distance - s.section_distance) / h
    # The mean rate of a step is the rate at its midpoint; at the start of an arc, the rate there.
    rate_change = mean_rate - s.section_speed
    # The first steps of an arc may be so short that rounding dominates their mean rates.
    if abs(rate_change) * h <= ROUNDINGS * EPS * (abs(s.level) + abs(distance)):
        rate_change = 0.0
    curvature = rate_change / (0.5 * (h + s.section_step))
    s.section_curvature = max(abs(curvature), 0.5 * s.section_curvature)
    end_distance = 0.0 if direction != 0 else distance
    if s.section_side == 0:
        s.section_side = sign(distance)
    elif curvature != 0.0 and not certify_no_crossing(
        s.section_side * s.section_distance,
        s.section_side * (mean_rate - 0.5 * h * curvature),
        s.section_side * end_distance,
        s.section_side * (mean_rate + 0.5 * h * curvature),
        h,
        CURVATURE_SAFETY * s.section_curvature,
    ):
        scan_step(engine, s, t_start, end_distance)
    s.section_distance, s.section_speed, s.section_step = end_distance, mean_rate, h
    if direction != 0 or distance != 0.0:
        s.section_side = direction if direction != 0 else sign(distance)


def scan_step(engine: Any, s: Any, t_start: float, end_distance: float) -> None:
    """Record the crossings between `t_start` and ``s.t``, at the distance `end_distance`.

    Parts of the step are so short that by its rates the component stays clear of the section, or
    crosses it once. Crossings in the other direction are not located. Overwrites STATE and SLOPE.
    """
    t, y = s.t, table_row(s, STATE)
    interface.interpolate(engine, t_start, y)
    a, g_a, r_a = t_start, s.section_distance, rate_at(engine, s, t_start, y)
    rounding = ROUNDINGS * EPS * (abs(s.level) + max(abs(g_a), abs(end_distance)))
    min_width = max(MIN_SUBSTEP_RATIO * (t - t_start), 8.0 * EPS * abs(t))
    width, curvature, capacity = t - t_start, 0.0, MAX_CROSSINGS_PER_STEP
    while a < t and capacity > 0:
        b = a + width if a + 1.5 * width < t else t
        interface.interpolate(engine, b, y)
        g_b, r_b = y[s.section] - s.level if b < t else end_distance, rate_at(engine, s, b, y)
        h, side = b - a, s.section_side
        curvature = max(curvature, abs(r_b - r_a) / h)
        is_crossing = side * g_b < -rounding
        if is_crossing:
            is_certain = max(side * r_a, side * r_b) < -curvature * h
        else:
            is_certain = certify_no_crossing(
                side * g_a, side * r_a, max(side * g_b, 0.0), side * r_b, h, curvature
            )
        if h > min_width and not is_certain:
            width *= 0.5
            continue
        if not is_crossing and not is_certain and side * r_a < 0.0 < side * r_b:
            t_nearest = bisect_section_rate(engine, s, a, b)
            interface.interpolate(engine, t_nearest, y)
            distance = y[s.section] - s.level
            if side * distance < -rounding:
                b, g_b, r_b, is_crossing = t_nearest, distance, 0.0, True
        if is_crossing and s.direction * side <= 0:
            b = bisect_section(engine, s, a, b)
            interface.interpolate(engine, b, y)
            g_b, r_b = 0.0, rate_at(engine, s, b, y)
            log_event(s, b, SECTION_CROSSING, -side, s.mode, y, y)
            capacity -= 1
        else:
            width *= 2.0
        if is_crossing:
            s.section_side = -side
        a, g_a, r_a = b, g_b, r_b


def bisect_section(engine: Any, s: Any, inside: float, outside: float) -> float:
    """Bisect the section on the last step, between its two sides at `inside` and `outside`.

    Overwrites STATE.
    """
    y = table_row(s, STATE)
    for _ in range(80):
        middle = 0.5 * (inside + outside)
        if middle <= inside or middle >= outside:
            break
        interface.interpolate(engine, middle, y)
        if s.section_side * (y[s.section] - s.level) > 0.0:
            inside = middle
        else:
            outside = middle
    return outside


def bisect_section_rate(engine: Any, s: Any, a: float, b: float) -> float:
    """Bisect the rate on the last step: towards the section at `a`, away from it at `b`.

    Overwrites STATE and SLOPE.
    """
    y = table_row(s, STATE)
    for _ in range(80):
        middle = 0.5 * (a + b)
        if middle <= a or middle >= b:
            break
        interface.interpolate(engine, middle, y)
        if s.section_side * rate_at(engine, s, middle, y) < 0.0:
            a = middle
        else:
            b = middle
    return b


def rate_at(engine: Any, s: Any, t: float, y: Any) -> float:
    """Return the rate of the section's component; at a switch, its limit from the left.

    Overwrites SLOPE.
    """
    slope = table_row(s, SLOPE)
    interface.flow(engine, s.mode, t if t < s.stop else s.stop - EPS * s.stop, y, slope)
    rate: float = slope[s.section]
    return rate


def sign(distance: float) -> int:
    """Return 1 above, -1 below, 0 at the section."""
    return 1 if distance > 0.0 else (-1 if distance < 0.0 else 0)
