"""Event detection: margins of guards, hidden crossings, the Poincaré section.

Functions over the engine's contract, like the loop itself, which calls them. Scratch rows that a
function overwrites are those of `workspace`: ``G`` always, others as its docstring says.

An engine tells margins that have changed their sign over a step. Those that came to zero and went
back are found by a look at their values and rates at both ends, and where these leave doubt, by
walking through the step.

An engine sees that a step ends on the other side of the section. Where it may have been there and
come back in between, the step is walked through, as for margins.
"""

from __future__ import annotations

import math
from typing import Any

from mems_impact.hybrid.event_loop.workspace import (
    BELOW_ZERO,
    EPS,
    GAIN,
    IMPACT,
    MARGINS_AFTER,
    MARGINS_AT,
    MARGINS_BEFORE,
    NONE,
    ORDER,
    PAST,
    RATE_CHANGE,
    RECORDS,
    SECTION_CROSSING,
    SIZE,
    SLOPE,
    STAGE,
    STATE,
    STATE_AHEAD,
    STATE_SHIFTED,
    SUM,
    SUSPECT_SIDE,
    TIMED,
    G,
    log_event,
    next_switch,
    table_row,
)
from mems_impact.integrators import interface

# --- What fires, and when: margins and rates read so that no decision hangs on rounding.

ROUNDINGS = 64.0  # what lies within so many roundings of zero has no sign
SURELY = 1e3  # what is so many times its error below zero is so wherever that is measured
TOLERANCES = 1e3  # a margin so many tolerances below zero is no error of the integration
TINY_BIAS = 1e-300  # by which a margin that starts at zero is lifted


def margin_error_scales(engine: Any, s: Any, mode: int, t: float, y: Any) -> None:
    """Write what the margins and their rates are made up of, for each its size and its gain.

    The size is the sum of |dg/dy_j| |y_j|, the gain that of |dg/dy_j|: roundings of the state move
    a margin by EPS * size, the tolerances by rtol * size + atol * gain. Roundings of time move it
    by EPS |dg/dt| t. Left in SIZE, GAIN and, the last product, TIMED; LOOKED holds the margins.
    Overwrites MOVED.
    """
    n, count = s.n, 2 * s.m
    base, g, moved = table_row(s, MARGINS_AT), table_row(s, G), table_row(s, STATE_SHIFTED)
    size, gain, timed = table_row(s, SIZE), table_row(s, GAIN), table_row(s, TIMED)
    interface.margins(engine, mode, t, y, base)
    shift = min(2.0**-26 * abs(t), 0.25 * (next_switch(s, t) - t))
    interface.margins(engine, mode, t + shift, y, g)
    for k in range(count):
        size[k] = 0.0
        gain[k] = 0.0
        timed[k] = abs(g[k] - base[k]) / shift * abs(t) if shift > 0.0 else 0.0
    for j in range(n):
        moved[j] = y[j]
    for j in range(n):
        shift = 2.0**-26 * abs(y[j]) + s.atol
        moved[j] = y[j] + shift
        interface.margins(engine, mode, t, moved, g)
        moved[j] = y[j]
        for k in range(count):
            slope = abs(g[k] - base[k]) / shift
            gain[k] += slope
            size[k] += slope * abs(y[j])


def rounding_error(s: Any, k: int) -> float:
    """Return within how much of zero margin or rate `k` has no sign.

    After `margin_error_scales`.
    """
    rounding: float = ROUNDINGS * EPS * (table_row(s, SIZE)[k] + table_row(s, TIMED)[k])
    return rounding


def integration_error(s: Any, k: int) -> float:
    """Return what the integration may make of margin or rate `k`; after `margin_error_scales`."""
    size, gain = table_row(s, SIZE)[k], table_row(s, GAIN)[k]
    error: float = s.rtol * size + s.atol * gain
    return error


def rk4_probe(engine: Any, s: Any, mode: int, t: float, y: Any, h: float, out: Any) -> None:
    """Follow the flow of `mode` from (t, y) over `h` by one step of Runge and Kutta, into `out`.

    Over times so short that its error, of the fifth power, is below rounding or does not matter.
    Overwrites STAGE, SLOPE, SUM; `y` and `out` may be the same.
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


def decreases_ahead(engine: Any, s: Any, mode: int, i: int, t: float, y: Any) -> bool:
    """Return whether margin `i` is about to fall, by what comes next.

    After `margin_error_scales`. The flow is followed for longer and longer until the margin has
    moved by more than rounding: a gap that opens with no speed and no acceleration, as that of a
    body which a moving wall lets go, is told by what comes next. Overwrites AHEAD, STAGE, SLOPE,
    SUM.
    """
    g, ahead = table_row(s, G), table_row(s, STATE_AHEAD)
    seen, drift = rounding_error(s, i), rounding_error(s, s.m + i)
    interface.margins(engine, mode, t, y, g)
    margin = g[i]
    farthest = min(s.scale / 16.0, 0.5 * (next_switch(s, t) - t))
    h = max(2.0**-45 * farthest, EPS * abs(t))
    while h < farthest:
        h = min(8.0 * h, farthest)
        rk4_probe(engine, s, mode, t, y, h, ahead)
        interface.margins(engine, mode, t + h, ahead, g)
        moved = g[i] - margin
        if abs(moved) > seen + h * drift:
            return bool(moved < 0.0)
    return False


def is_decreasing(engine: Any, s: Any, mode: int, i: int, t: float, y: Any) -> bool:
    """Return whether margin `i` really falls at (t, y); after `margin_error_scales`.

    The polynomial of a step has the integration error, and a difference of large numbers its
    rounding; below them a margin seems to fall through zero where it does not, again and again.
    A rate that is clearly negative is believed, else the flow is asked. Overwrites what
    `decreases_ahead` does.
    """
    m = s.m
    rate = table_row(s, MARGINS_AT)[m + i]
    if rate < -rounding_error(s, m + i) - integration_error(s, m + i):
        return True
    return decreases_ahead(engine, s, mode, i, t, y)


def first_violated_guard(
    engine: Any,
    s: Any,
    mode: int,
    t: float,
    y: Any,
    but: int,
    after: int,
) -> int:
    """Return the first guard, by order, that fires where the state is put; or NONE.

    Its margin is zero or below, to rounding, and falls; or it is clearly negative, and no gap. Of
    guards that only record, those fire whose margin has come there now. The guard `but` is left
    out, and with it, since then a state is only tried, those that only record. Of impacts alone,
    those up to `after`, in order, come last. Overwrites what `margin_error_scales` and
    `decreases_ahead` do.
    """
    order = table_row(s, ORDER)
    margin_error_scales(engine, s, mode, t, y)
    first = behind = NONE
    for i in range(s.m):
        if table_row(s, RECORDS)[i] == 1 and (
            but != NONE or recorded_already(engine, s, mode, i, t)
        ):
            continue
        if i != but and fires_here(engine, s, mode, i, t, y):
            if first == NONE or order[i] < order[first]:
                first = i
            behind_it = after != NONE and table_row(s, IMPACT)[i] == 1 and order[i] > order[after]
            if behind_it and (behind == NONE or order[i] < order[behind]):
                behind = i
    return behind if behind != NONE and table_row(s, IMPACT)[first] == 1 else first


def recorded_already(engine: Any, s: Any, mode: int, i: int, t: float) -> bool:
    """Return whether the margin of guard `i`, which only records, has not fallen to zero now.

    After `margin_error_scales` of a state that a transition has left, PAST being the one before it,
    or that is looked at again because of a margin in doubt.
    """
    looked, passed, g = table_row(s, MARGINS_AT)[i], table_row(s, BELOW_ZERO), table_row(s, G)
    rounding = rounding_error(s, i)
    if looked > violation_threshold(s, i):
        passed[i] = 0.0
    elif looked > rounding and passed[i] == 1:
        interface.margins(engine, mode, t, table_row(s, PAST), g)
        if g[i] < -rounding:
            passed[i] = 0.0  # thrown up, if not far; else it is where its fall was told
    elif (
        looked < -violation_threshold(s, i)
        and passed[i] == 0
        and interface.bias(engine, i) <= TINY_BIAS
    ):
        # Another mode may begin to watch it where it is negative already: that is no fall.
        interface.margins(engine, mode, t, table_row(s, PAST), g)
        passed[i] = 2.0 if g[i] > 0.0 else 1.0
    return bool(passed[i] == 1)


def fires_here(engine: Any, s: Any, mode: int, i: int, t: float, y: Any) -> bool:
    """Return whether guard `i` fires where the state is put; after `margin_error_scales`."""
    m, looked = s.m, table_row(s, MARGINS_AT)
    rate = looked[m + i]
    # What closes within the rounding of time does so now; what is no number never does.
    if not looked[i] <= rounding_error(s, i) + ROUNDINGS * EPS * abs(rate * t):
        return False
    if table_row(s, IMPACT)[i] == 0 and looked[i] < -violation_threshold(s, i):
        return True
    if rate > rounding_error(s, m + i) + integration_error(s, m + i):
        return False
    return is_decreasing(engine, s, mode, i, t, y)


def violation_threshold(s: Any, i: int) -> float:
    """Return how far below zero margin `i` must be to be there for no error's sake.

    After `margin_error_scales`.
    """
    rate = table_row(s, MARGINS_AT)[s.m + i]
    far: float = TOLERANCES * integration_error(s, i) + 1e-6 * abs(rate) * s.scale
    return far


def inadmissible_gap(engine: Any, s: Any, t: float, y: Any) -> int:
    """Return a gap that is clearly negative and does not open, as a start may be; or NONE.

    Where a run begins, guards that only record and are negative have PASSED.
    """
    m = s.m
    looked = table_row(s, MARGINS_AT)
    margin_error_scales(engine, s, s.mode, t, y)
    for i in range(m):
        if s.arcs == 0 and table_row(s, RECORDS)[i] == 1 and looked[i] < -violation_threshold(s, i):
            table_row(s, BELOW_ZERO)[i] = 1.0
        closed = table_row(s, IMPACT)[i] == 1 and looked[m + i] <= 0.0
        if closed and looked[i] < -violation_threshold(s, i):
            return i
    return NONE


def certainly_decreasing(s: Any, k: int, rate: float) -> bool:
    """Return whether a rate is so far below zero that nobody needs to look again.

    Measured by the `margin_error_scales` at the start of the arc, or later, with much room.
    """
    return bool(rate < -SURELY * (rounding_error(s, k) + integration_error(s, k)))


# --- The search within a step: which guard fires first in it, and when.

MIN_SUBSTEP_RATIO = 2.0**-10  # part of a step below which nothing is looked for inside it
# By which what rates have been seen to change fades from step to step. At 1/2, a margin that swings
# several times within a step, and changes less over the next one, was believed too soon.
FADING = 0.9


def update_margins(engine: Any, s: Any, status: int, before: float, t: float) -> bool:
    """Take down the margins where a step has ended; return whether anything may have fired in it.

    Which margins may have been at zero unseen, by values and rates at both ends, is left in
    SUSPECT, with the side of zero on which they began.
    """
    then, now, bend, suspect = (
        table_row(s, MARGINS_BEFORE),
        table_row(s, MARGINS_AFTER),
        table_row(s, RATE_CHANGE),
        table_row(s, SUSPECT_SIDE),
    )
    passed = table_row(s, BELOW_ZERO)
    m, h = s.m, t - before
    for k in range(2 * m):
        then[k] = now[k]
    interface.end_margins(engine, now)
    something = status == interface.ROOT
    for i in range(m):
        suspect[i] = 0.0
        fired = status == interface.ROOT and interface.root_directions(engine, i) < 0
        bias = interface.bias(engine, i)
        # A margin that does not apply is constant; one that is lifted is in doubt.
        moves = fired or now[i] != then[i] or now[m + i] != then[m + i]
        if moves and h > 0.0 and bias <= TINY_BIAS:
            bend[i] = max(abs(now[m + i] - then[m + i]) / h, FADING * bend[i])
            # A root is where the margin is zero but for what the engine tells roots apart.
            start, end = then[i] + bias, 0.0 if fired else now[i] + bias
            side = -1.0 if passed[i] == 1 else 1.0
            start, end = side * start, side * end
            stays_there = certify_no_crossing(
                start, side * then[m + i], end, side * now[m + i], h, bend[i]
            )
            # One that may be below zero has come above it, and fallen, if it has not stayed there.
            above = start >= 0.0 and end >= 0.0
            if not stays_there and (above or side < 0.0):
                suspect[i] = side
                something = True
        if now[i] + bias > 0.0:
            passed[i] = 0.0
    return something


def first_event_in_step(
    engine: Any, s: Any, status: int, before: float, t: float
) -> tuple[int, float]:
    """Return the guard that fires first in the step from `before` to `t`, and when; or NONE.

    A margin fires where the engine says so; where it has dipped below zero at its closest
    approach, a root of its rate; and where a look inside the step finds it. Overwrites STATE and
    what `first_violated_guard` does.
    """
    m = s.m
    order = table_row(s, ORDER)
    y = table_row(s, STATE)
    now, suspect = table_row(s, MARGINS_AFTER), table_row(s, SUSPECT_SIDE)
    guard, t_event = NONE, t
    together = 0
    for i in range(m):
        if status == interface.ROOT and interface.root_directions(engine, i) < 0:
            together += 1
    for i in range(m):
        fired = status == interface.ROOT and interface.root_directions(engine, i) < 0
        t_crossing = math.inf
        bias = interface.bias(engine, i)
        if suspect[i] != 0.0:
            end = 0.0 if fired else now[i] + bias
            t_crossing = find_hidden_crossing(engine, s, i, before, t, end, suspect[i])
        rate = 0.0
        if t_crossing == math.inf:
            if fired:
                rate = now[m + i]
                t_crossing = t - refine_root(engine, s, i, before, t) if together == 1 else t
            elif (
                status == interface.ROOT
                and interface.root_directions(engine, m + i) > 0
                # Zero as well: CVODE stops where a margin and its rate are zero together.
                and now[i] + bias <= 0.0
                and table_row(s, BELOW_ZERO)[i] != 1
            ):
                # There may be another dip before this one.
                end = now[i] + bias
                t_crossing = find_hidden_crossing(engine, s, i, before, t, end, 1.0)
                if t_crossing == math.inf:
                    t_crossing = bisect_margin(engine, s, i, before, t)
        if t_crossing < math.inf and (
            guard == NONE
            or t_crossing < t_event
            or (t_crossing == t_event and order[i] < order[guard])
        ):
            certain = certainly_decreasing(s, m + i, rate)
            if not certain:
                interface.interpolate(engine, t_crossing, y)
                margin_error_scales(engine, s, s.mode, t_crossing, y)
                certain = is_decreasing(engine, s, s.mode, i, t_crossing, y)
            if certain:
                guard, t_event = i, t_crossing
            else:
                # It is left alone until it has risen, or a step ends where it falls.
                s.negative_by_error = 1
                s.starts_negative = 1
                depth = abs(table_row(s, MARGINS_AT)[i])
                interface.set_bias(engine, i, bias + depth + 2.0 * rounding_error(s, i))
    return guard, t_event


def refine_root(engine: Any, s: Any, i: int, before: float, t: float) -> float:
    """Return how long before `t`, where margin `i` has fired, it was zero.

    CVODE stops a little late, by some hundred roundings of time: impact after impact that adds up.
    A margin that stays at zero it may tell anywhere there. Overwrites STATE and G.
    """
    now, g, y = table_row(s, MARGINS_AFTER), table_row(s, G), table_row(s, STATE)
    margin, rate = now[i] + interface.bias(engine, i), now[s.m + i]
    if margin == 0.0 and 1e-6 * (t - before) > 8.0 * EPS * abs(t):
        earlier = t - 1e-6 * (t - before)
        interface.interpolate(engine, earlier, y)
        interface.margins(engine, s.mode, earlier, y, g)
        if g[i] == now[i]:
            return t - bisect_margin(engine, s, i, before, earlier)
    if not rate < 0.0:
        return 0.0
    by: float = margin / rate
    return by if 8.0 * EPS * abs(t) < by < 1e-6 * (t - before) else 0.0


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
    before: float,
    t: float,
    end: float,
    side: float,
) -> float:
    """Return when margin `i` first falls below zero inside the last step; infinity if it does not.

    A step of a flow that is nearly a polynomial may be long enough for two minima of a margin. What
    the margin may do between two instants is bounded by its values and rates there and by how much
    the rates change (`certify_no_crossing`): for most steps that says enough. This step is walked
    through, in parts so short that the bound holds; its margin is `end` where it ends. One that
    begins below zero (`side` -1) must come above it first: until then the same is asked of its
    negative. Overwrites STATE and, where it finds something, what `margin_error_scales` does.
    """
    m = s.m
    then, now = table_row(s, MARGINS_BEFORE), table_row(s, MARGINS_AFTER)
    bias = interface.bias(engine, i)
    a, g_a, r_a = before, then[i] + bias, then[m + i]
    curved = table_row(s, RATE_CHANGE)[i]
    g, y = table_row(s, G), table_row(s, STATE)
    finest = max(MIN_SUBSTEP_RATIO * (t - before), 8.0 * EPS * abs(t))
    width = 0.5 * (t - before)
    while a < t:
        b = a + width if a + 1.5 * width < t else t
        g_b, r_b = end, now[m + i]
        if b < t:
            interface.interpolate(engine, b, y)
            interface.margins(engine, s.mode, b, y, g)
            g_b, r_b = g[i] + bias, g[m + i]
        curved = max(curved, abs(r_b - r_a) / (b - a))
        sure = certify_no_crossing(side * g_a, side * r_a, abs(g_b), side * r_b, b - a, curved)
        if b - a > finest and not sure:
            width *= 0.5
            continue
        if not sure and side * r_a < 0.0 < side * r_b:
            # One closest approach, by the rates: the margin there decides.
            closest = bisect_rate(engine, s.mode, m + i, a, b, side, y, g)
            interface.interpolate(engine, closest, y)
            interface.margins(engine, s.mode, closest, y, g)
            if side * (g[i] + bias) < min(0.0, side * g_b):
                b, g_b, r_b = closest, g[i] + bias, 0.0
        if side * g_b < 0.0:
            interface.interpolate(engine, b, y)
            margin_error_scales(engine, s, s.mode, b, y)
            crossed = side * g_b < -rounding_error(s, i)
            if crossed and side > 0.0:
                return bisect_margin(engine, s, i, a, b)
            side = 1.0 if crossed else side
            a, g_a, r_a = b, g_b if crossed else 0.0, r_b
        else:
            a, g_a, r_a = b, g_b, r_b
            width *= 2.0
    return math.inf


def bisect_rate(
    engine: Any, mode: int, k: int, a: float, b: float, side: float, y: Any, g: Any
) -> float:
    """Bisect rate `k` on the last step, from falling at `a` to rising at `b`.

    With `side` -1 its negative. Overwrites the state `y` and the margins and rates `g`.
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
    g_a: float, r_a: float, g_b: float, r_b: float, h: float, curved: float
) -> bool:
    """Return whether a margin with these values and rates stays positive over `h` in between.

    From either end it keeps above a parabola that bends down twice as much as its rates have been
    seen to change, or as rates and values contradict each other.
    """
    defect = abs(g_b - g_a - 0.5 * h * (r_a + r_b))
    drop = 0.25 * curved * h * h + 3.0 * defect
    return g_a + 0.5 * h * r_a > drop and g_b - 0.5 * h * r_b > drop


# --- Crossings of the section that engines do not tell: those that come in pairs within a step.

CAUTION = 8.0  # times the bend seen of late is reckoned with
MAX_CROSSINGS_PER_STEP = 16  # crossings of one step that are noted: no method's polynomial has more


def init_section(engine: Any, s: Any, y: Any) -> None:
    """Take down where an arc begins at (``s.t``, `y`): the side of the section, and the way on.

    Overwrites SLOPE.
    """
    if s.section < 0:
        return
    s.section_distance = y[s.section] - s.level
    s.section_speed = rate_at(engine, s, s.t, y)
    s.section_step = s.section_bend = 0.0
    s.section_side = sign(s.section_distance if s.section_distance != 0.0 else s.section_speed)


def detect_crossings(engine: Any, s: Any, before: float, y: Any, told: int) -> None:
    """Note the crossings between `before` and ``s.t``, where the state is `y`.

    `told` is the sign of one there that the engine tells, or 0: that one is not noted. Rates would
    cost a flow a step, so values alone are asked at first: a parabola follows from the paces of the
    last two steps, and what keeps clear of the section even if it bends far more has not crossed
    it. What does not bend cannot have done so twice. Overwrites STATE and SLOPE.
    """
    h = s.t - before
    if s.section < 0 or not h > 0.0:
        return
    apart = y[s.section] - s.level
    pace = (apart - s.section_distance) / h
    # The pace of a step is the rate in its middle; where an arc begins it is the rate there.
    turned = pace - s.section_speed
    # The first steps of an arc may be so short that rounding alone makes their paces.
    if abs(turned) * h <= ROUNDINGS * EPS * (abs(s.level) + abs(apart)):
        turned = 0.0
    bend = turned / (0.5 * (h + s.section_step))
    s.section_bend = max(abs(bend), 0.5 * s.section_bend)
    end = 0.0 if told != 0 else apart
    if s.section_side == 0:
        s.section_side = sign(apart)
    elif bend != 0.0 and not certify_no_crossing(
        s.section_side * s.section_distance,
        s.section_side * (pace - 0.5 * h * bend),
        s.section_side * end,
        s.section_side * (pace + 0.5 * h * bend),
        h,
        CAUTION * s.section_bend,
    ):
        scan_step(engine, s, before, end)
    s.section_distance, s.section_speed, s.section_step = end, pace, h
    if told != 0 or apart != 0.0:
        s.section_side = told if told != 0 else sign(apart)


def scan_step(engine: Any, s: Any, before: float, end: float) -> None:
    """Note the crossings between `before` and ``s.t``, where the section is `end` away.

    In parts so short that by its rates the component keeps clear of the section, or crosses it but
    once. Overwrites STATE and SLOPE.
    """
    t, y = s.t, table_row(s, STATE)
    interface.interpolate(engine, before, y)
    a, g_a, r_a = before, s.section_distance, rate_at(engine, s, before, y)
    rounding = ROUNDINGS * EPS * (abs(s.level) + max(abs(g_a), abs(end)))
    finest = max(MIN_SUBSTEP_RATIO * (t - before), 8.0 * EPS * abs(t))
    width, curved, left = t - before, 0.0, MAX_CROSSINGS_PER_STEP
    while a < t and left > 0:
        b = a + width if a + 1.5 * width < t else t
        interface.interpolate(engine, b, y)
        g_b, r_b = y[s.section] - s.level if b < t else end, rate_at(engine, s, b, y)
        h, side = b - a, s.section_side
        curved = max(curved, abs(r_b - r_a) / h)
        over = side * g_b < -rounding
        if over:
            sure = max(side * r_a, side * r_b) < -curved * h
        else:
            sure = certify_no_crossing(
                side * g_a, side * r_a, max(side * g_b, 0.0), side * r_b, h, curved
            )
        if h > finest and not sure:
            width *= 0.5
            continue
        if not over and not sure and side * r_a < 0.0 < side * r_b:
            nearest = bisect_section_rate(engine, s, a, b)
            interface.interpolate(engine, nearest, y)
            if side * (y[s.section] - s.level) < -rounding:
                b, over = nearest, True
        if over:
            b = bisect_section(engine, s, a, b)
            interface.interpolate(engine, b, y)
            s.section_side = -side
            g_b, r_b = 0.0, rate_at(engine, s, b, y)
            if s.direction * s.section_side >= 0:
                log_event(s, b, SECTION_CROSSING, s.section_side, s.mode, y, y)
                left -= 1
        else:
            width *= 2.0
        a, g_a, r_a = b, g_b, r_b


def bisect_section(engine: Any, s: Any, inside: float, outside: float) -> float:
    """Bisect the section on the last step: on its side at `inside`, beyond it at `outside`.

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
    """Bisect the rate on the last step, from towards the section at `a` to away from it at `b`.

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
    """Return the rate of the section's component; up to a switch that of the arc before it.

    Overwrites SLOPE.
    """
    slope = table_row(s, SLOPE)
    interface.flow(engine, s.mode, t if t < s.stop else t - EPS * t, y, slope)
    rate: float = slope[s.section]
    return rate


def sign(apart: float) -> int:
    """Return 1 above, -1 below, 0 at the section."""
    return 1 if apart > 0.0 else (-1 if apart < 0.0 else 0)
