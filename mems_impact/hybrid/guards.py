"""What fires, and when: margins and rates read so that no decision hangs on rounding.

Functions over the engine's contract, like the loop itself, which calls them. Scratch rows that a
function overwrites are those of `record`: ``G`` always, others as its docstring says.
"""

from __future__ import annotations

import math
from typing import Any

from mems_impact.engines import contract as arc
from mems_impact.hybrid.record import (
    AHEAD,
    BEND,
    EPS,
    GAIN,
    IMPACT,
    LOOKED,
    MOVED,
    NONE,
    NOW,
    ORDER,
    PASSED,
    SIZE,
    SLOPE,
    STAGE,
    STATE,
    SUM,
    SUSPECT,
    THEN,
    TIMED,
    G,
    next_switch,
    row,
)

ROUNDINGS = 64.0  # what lies within so many roundings of zero has no sign
SURELY = 1e3  # what is so many times its error below zero is so wherever that is measured
TOLERANCES = 1e3  # a margin so many tolerances below zero is no error of the integration
HAIR = 1e-300  # by which a margin that starts at zero is lifted
FINEST = 2.0**-10  # part of a step below which nothing is looked for inside it


def resolution(engine: Any, s: Any, mode: int, t: float, y: Any) -> None:
    """Write what the margins and their rates are made up of, for each its size and its gain.

    The size is the sum of |dg/dy_j| |y_j|, the gain that of |dg/dy_j|: roundings of the state move
    a margin by EPS * size, the tolerances by rtol * size + atol * gain. Roundings of time move it
    by EPS |dg/dt| t. Left in SIZE, GAIN and, the last product, TIMED; LOOKED holds the margins.
    Overwrites MOVED.
    """
    n, count = s.n, 2 * s.m
    base, g, moved = row(s, LOOKED), row(s, G), row(s, MOVED)
    size, gain, timed = row(s, SIZE), row(s, GAIN), row(s, TIMED)
    arc.margins(engine, mode, t, y, base)
    shift = min(2.0**-26 * abs(t), 0.25 * (next_switch(s, t) - t))
    arc.margins(engine, mode, t + shift, y, g)
    for k in range(count):
        size[k] = 0.0
        gain[k] = 0.0
        timed[k] = abs(g[k] - base[k]) / shift * abs(t) if shift > 0.0 else 0.0
    for j in range(n):
        moved[j] = y[j]
    for j in range(n):
        shift = 2.0**-26 * abs(y[j]) + s.atol
        moved[j] = y[j] + shift
        arc.margins(engine, mode, t, moved, g)
        moved[j] = y[j]
        for k in range(count):
            slope = abs(g[k] - base[k]) / shift
            gain[k] += slope
            size[k] += slope * abs(y[j])


def rounding_of(s: Any, k: int) -> float:
    """Return within how much of zero margin or rate `k` has no sign; after `resolution`."""
    rounding: float = ROUNDINGS * EPS * (row(s, SIZE)[k] + row(s, TIMED)[k])
    return rounding


def error_of(s: Any, k: int) -> float:
    """Return what the integration may make of margin or rate `k`; after `resolution`."""
    size, gain = row(s, SIZE)[k], row(s, GAIN)[k]
    error: float = s.rtol * size + s.atol * gain
    return error


def follow(engine: Any, s: Any, mode: int, t: float, y: Any, h: float, out: Any) -> None:
    """Follow the flow of `mode` from (t, y) over `h` by one step of Runge and Kutta, into `out`.

    Over times so short that its error, of the fifth power, is below rounding or does not matter.
    Overwrites STAGE, SLOPE, SUM; `y` and `out` may be the same.
    """
    n = s.n
    stage, slope, total = row(s, STAGE), row(s, SLOPE), row(s, SUM)
    arc.flow(engine, mode, t, y, slope)
    for j in range(n):
        total[j] = slope[j]
        stage[j] = y[j] + 0.5 * h * slope[j]
    arc.flow(engine, mode, t + 0.5 * h, stage, slope)
    for j in range(n):
        total[j] += 2.0 * slope[j]
        stage[j] = y[j] + 0.5 * h * slope[j]
    arc.flow(engine, mode, t + 0.5 * h, stage, slope)
    for j in range(n):
        total[j] += 2.0 * slope[j]
        stage[j] = y[j] + h * slope[j]
    arc.flow(engine, mode, t + h, stage, slope)
    for j in range(n):
        out[j] = y[j] + h / 6.0 * (total[j] + slope[j])


def trend(engine: Any, s: Any, mode: int, i: int, t: float, y: Any) -> int:
    """Return whether margin `i` is about to rise (1), to fall (-1), or neither (0).

    After `resolution`. The flow is followed for longer and longer until the margin has moved by
    more than rounding: a gap that opens with no speed and no acceleration, as that of a body which
    a moving wall lets go, is told by what comes next. Overwrites AHEAD, STAGE, SLOPE, SUM.
    """
    g, ahead = row(s, G), row(s, AHEAD)
    seen, drift = rounding_of(s, i), rounding_of(s, s.m + i)
    arc.margins(engine, mode, t, y, g)
    margin = g[i]
    farthest = min(s.scale / 16.0, 0.5 * (next_switch(s, t) - t))
    h = max(2.0**-45 * farthest, EPS * abs(t))
    while h < farthest:
        h = min(8.0 * h, farthest)
        follow(engine, s, mode, t, y, h, ahead)
        arc.margins(engine, mode, t + h, ahead, g)
        moved = g[i] - margin
        if abs(moved) > seen + h * drift:
            return 1 if moved > 0.0 else -1
    return 0


def falling(engine: Any, s: Any, mode: int, i: int, t: float, y: Any) -> bool:
    """Return whether margin `i` really falls at (t, y); after `resolution`.

    The polynomial of a step has the integration error, and a difference of large numbers its
    rounding; below them a margin seems to fall through zero where it does not, again and again.
    A rate that is clearly negative is believed, else the flow is asked. Overwrites what `trend`
    does.
    """
    m = s.m
    rate = row(s, LOOKED)[m + i]
    if rate < -rounding_of(s, m + i) - error_of(s, m + i):
        return True
    return trend(engine, s, mode, i, t, y) < 0


def violated(
    engine: Any,
    s: Any,
    mode: int,
    t: float,
    y: Any,
    but: int,
    after: int,
) -> int:
    """Return the first guard, by order, that fires where the state is put; or NONE.

    Its margin is zero or below, to rounding, and falls; or it is clearly negative, and no gap. The
    guard `but` is left out, and those that have PASSED. Of impacts alone, those up to `after`, in
    order, come last. Overwrites what `resolution` and `trend` do.
    """
    order = row(s, ORDER)
    resolution(engine, s, mode, t, y)
    first = behind = NONE
    for i in range(s.m):
        if i != but and row(s, PASSED)[i] == 0 and fires(engine, s, mode, i, t, y):
            if first == NONE or order[i] < order[first]:
                first = i
            behind_it = after != NONE and row(s, IMPACT)[i] == 1 and order[i] > order[after]
            if behind_it and (behind == NONE or order[i] < order[behind]):
                behind = i
    return behind if behind != NONE and row(s, IMPACT)[first] == 1 else first


def fires(engine: Any, s: Any, mode: int, i: int, t: float, y: Any) -> bool:
    """Return whether guard `i` fires where the state is put; after `resolution`."""
    m, looked = s.m, row(s, LOOKED)
    rate = looked[m + i]
    # What closes within the rounding of time does so now; what is no number never does.
    if not looked[i] <= rounding_of(s, i) + ROUNDINGS * EPS * abs(rate * t):
        return False
    if row(s, IMPACT)[i] == 0 and looked[i] < -clearly(s, i):
        return True
    if rate > rounding_of(s, m + i) + error_of(s, m + i):
        return False
    return falling(engine, s, mode, i, t, y)


def clearly(s: Any, i: int) -> float:
    """Return how far below zero margin `i` must be to be there for no error's sake.

    After `resolution`.
    """
    rate = row(s, LOOKED)[s.m + i]
    far: float = TOLERANCES * error_of(s, i) + 1e-6 * abs(rate) * s.scale
    return far


def inside(engine: Any, s: Any, t: float, y: Any) -> int:
    """Return a gap that is clearly negative and does not open, as a start may be; or NONE."""
    m = s.m
    looked = row(s, LOOKED)
    resolution(engine, s, s.mode, t, y)
    for i in range(m):
        closed = row(s, IMPACT)[i] == 1 and looked[m + i] <= 0.0
        if closed and looked[i] < -clearly(s, i):
            return i
    return NONE


def look(engine: Any, s: Any, status: int, before: float, t: float) -> bool:
    """Take down the margins where a step has ended; return whether anything may have fired in it.

    Which margins may have been at zero unseen, by values and rates at both ends, is left in
    SUSPECT.
    """
    then, now, bend, suspect = row(s, THEN), row(s, NOW), row(s, BEND), row(s, SUSPECT)
    m, h = s.m, t - before
    for k in range(2 * m):
        then[k] = now[k]
    arc.ended(engine, now)
    something = status == arc.ROOT
    for i in range(m):
        suspect[i] = 0.0
        fired = status == arc.ROOT and arc.fired(engine, i) < 0
        bias = arc.bias(engine, i)
        # A margin that does not apply is constant; one that is lifted is in doubt.
        moves = fired or now[i] != then[i] or now[m + i] != then[m + i]
        if moves and h > 0.0 and bias <= HAIR:
            bend[i] = max(abs(now[m + i] - then[m + i]) / h, 0.5 * bend[i])
            # A root is where the margin is zero but for what the engine tells roots apart.
            start, end = then[i] + bias, 0.0 if fired else now[i] + bias
            stays_up = stays(start, then[m + i], end, now[m + i], h, bend[i])
            if start >= 0.0 and end >= 0.0 and not stays_up:
                suspect[i] = 1.0
                something = True
    return something


def first_guard(engine: Any, s: Any, status: int, before: float, t: float) -> tuple[int, float]:
    """Return the guard that fires first in the step from `before` to `t`, and when; or NONE.

    A margin fires where the engine says so; where it has dipped below zero at its closest
    approach, a root of its rate; and where a look inside the step finds it. Overwrites STATE and
    what `violated` does.
    """
    m = s.m
    order = row(s, ORDER)
    y = row(s, STATE)
    now, suspect = row(s, NOW), row(s, SUSPECT)
    guard, t_event = NONE, t
    together = 0
    for i in range(m):
        if status == arc.ROOT and arc.fired(engine, i) < 0:
            together += 1
    for i in range(m):
        fired = status == arc.ROOT and arc.fired(engine, i) < 0
        t_crossing = math.inf
        bias = arc.bias(engine, i)
        if suspect[i] == 1.0:
            end = 0.0 if fired else now[i] + bias
            t_crossing = hidden(engine, s, i, before, t, end)
        rate = 0.0
        if t_crossing == math.inf:
            if fired:
                rate = now[m + i]
                t_crossing = t - late(engine, s, i, before, t) if together == 1 else t
            elif (
                status == arc.ROOT
                and arc.fired(engine, m + i) > 0
                # Zero as well: CVODE stops where a margin and its rate are zero together.
                and now[i] + bias <= 0.0
            ):
                # There may be another dip before this one.
                end = now[i] + bias
                t_crossing = hidden(engine, s, i, before, t, end)
                if t_crossing == math.inf:
                    t_crossing = crossing(engine, s, i, before, t)
        if t_crossing < math.inf and (
            guard == NONE
            or t_crossing < t_event
            or (t_crossing == t_event and order[i] < order[guard])
        ):
            certain = surely_falling(s, m + i, rate)
            if not certain:
                arc.interpolate(engine, t_crossing, y)
                resolution(engine, s, s.mode, t_crossing, y)
                certain = falling(engine, s, s.mode, i, t_crossing, y)
            if certain:
                guard, t_event = i, t_crossing
            else:
                # It is left alone until it has risen, or a step ends where it falls.
                s.doubt = 1
                s.lifted = 1
                depth = abs(row(s, LOOKED)[i])
                arc.set_bias(engine, i, bias + depth + 2.0 * rounding_of(s, i))
    return guard, t_event


def late(engine: Any, s: Any, i: int, before: float, t: float) -> float:
    """Return how long before `t`, where margin `i` has fired, it was zero.

    CVODE stops a little late, by some hundred roundings of time: impact after impact that adds up.
    """
    now = row(s, NOW)
    rate = now[s.m + i]
    if not rate < 0.0:
        return 0.0
    by: float = (now[i] + arc.bias(engine, i)) / rate
    return by if 8.0 * EPS * abs(t) < by < 1e-6 * (t - before) else 0.0


def surely_falling(s: Any, k: int, rate: float) -> bool:
    """Return whether a rate is so far below zero that nobody needs to look again.

    Measured by the `resolution` at the start of the arc, or later, with much room.
    """
    return bool(rate < -SURELY * (rounding_of(s, k) + error_of(s, k)))


def crossing(engine: Any, s: Any, i: int, inside: float, outside: float) -> float:
    """Bisect margin `i` on the last step: positive at `inside`, negative at `outside`.

    Overwrites STATE.
    """
    g, y = row(s, G), row(s, STATE)
    bias = arc.bias(engine, i)
    for _ in range(80):
        middle = 0.5 * (inside + outside)
        if middle <= inside or middle >= outside:
            break
        arc.interpolate(engine, middle, y)
        arc.margins(engine, s.mode, middle, y, g)
        if g[i] + bias > 0.0:
            inside = middle
        else:
            outside = middle
    return outside


def hidden(
    engine: Any,
    s: Any,
    i: int,
    before: float,
    t: float,
    end: float,
) -> float:
    """Return when margin `i` first falls below zero inside the last step; infinity if it does not.

    A step of a flow that is nearly a polynomial may be long enough for two minima of a margin.
    What the margin may do between two instants is bounded by its values and rates there and by
    how much the rates change (`stays`): for most steps that says enough. This step is walked
    through, in parts so short that the bound holds; its margin is `end` where it ends. Overwrites
    STATE and, where it finds something, what `resolution` does.
    """
    m = s.m
    then, now = row(s, THEN), row(s, NOW)
    bias = arc.bias(engine, i)
    a, g_a, r_a = before, then[i] + bias, then[m + i]
    curved = row(s, BEND)[i]
    g, y = row(s, G), row(s, STATE)
    finest = max(FINEST * (t - before), 8.0 * EPS * abs(t))
    width = 0.5 * (t - before)
    while a < t:
        b = a + width if a + 1.5 * width < t else t
        g_b, r_b = end, now[m + i]
        if b < t:
            arc.interpolate(engine, b, y)
            arc.margins(engine, s.mode, b, y, g)
            g_b, r_b = g[i] + bias, g[m + i]
        curved = max(curved, abs(r_b - r_a) / (b - a))
        sure = stays(g_a, r_a, abs(g_b), r_b, b - a, curved)
        if b - a > finest and not sure:
            width *= 0.5
            continue
        if not sure and r_a < 0.0 < r_b:
            # One closest approach, by the rates: the margin there decides.
            low = lowest(engine, s, i, a, b)
            arc.interpolate(engine, low, y)
            arc.margins(engine, s.mode, low, y, g)
            if g[i] + bias < min(0.0, g_b):
                b, g_b, r_b = low, g[i] + bias, 0.0
        if g_b < 0.0:
            arc.interpolate(engine, b, y)
            resolution(engine, s, s.mode, b, y)
            if g_b < -rounding_of(s, i):
                return crossing(engine, s, i, a, b)
            a, g_a, r_a = b, 0.0, r_b
        else:
            a, g_a, r_a = b, g_b, r_b
            width *= 2.0
    return math.inf


def lowest(engine: Any, s: Any, i: int, a: float, b: float) -> float:
    """Bisect the rate of margin `i` on the last step, from falling at `a` to rising at `b`.

    Overwrites STATE.
    """
    g, y = row(s, G), row(s, STATE)
    for _ in range(80):
        middle = 0.5 * (a + b)
        if middle <= a or middle >= b:
            break
        arc.interpolate(engine, middle, y)
        arc.margins(engine, s.mode, middle, y, g)
        if g[s.m + i] < 0.0:
            a = middle
        else:
            b = middle
    return b


def stays(g_a: float, r_a: float, g_b: float, r_b: float, h: float, curved: float) -> bool:
    """Return whether a margin with these values and rates stays positive over `h` in between.

    From either end it keeps above a parabola that bends down twice as much as its rates have been
    seen to change, or as rates and values contradict each other.
    """
    defect = abs(g_b - g_a - 0.5 * h * (r_a + r_b))
    drop = 0.25 * curved * h * h + 3.0 * defect
    return g_a + 0.5 * h * r_a > drop and g_b - 0.5 * h * r_b > drop
