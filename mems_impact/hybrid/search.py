"""The search within a step: which guard fires first in it, and when.

An engine tells margins that have changed their sign over a step. Those that came to zero and went
back are found by a look at their values and rates at both ends, and where these leave doubt, by
walking through the step. Functions over the engine's contract, as in `guards`.
"""

from __future__ import annotations

import math
from typing import Any

from mems_impact.engines import contract
from mems_impact.hybrid.guards import (
    HAIR,
    falling,
    resolution,
    rounding_of,
    surely_falling,
)
from mems_impact.hybrid.record import (
    BEND,
    EPS,
    LOOKED,
    NONE,
    NOW,
    ORDER,
    PASSED,
    STATE,
    SUSPECT,
    THEN,
    G,
    row,
)

FINEST = 2.0**-10  # part of a step below which nothing is looked for inside it
# By which what rates have been seen to change fades from step to step. At 1/2, a margin that swings
# several times within a step, and changes less over the next one, was believed too soon.
FADING = 0.9


def look(engine: Any, s: Any, status: int, before: float, t: float) -> bool:
    """Take down the margins where a step has ended; return whether anything may have fired in it.

    Which margins may have been at zero unseen, by values and rates at both ends, is left in
    SUSPECT, with the side of zero on which they began.
    """
    then, now, bend, suspect = row(s, THEN), row(s, NOW), row(s, BEND), row(s, SUSPECT)
    passed = row(s, PASSED)
    m, h = s.m, t - before
    for k in range(2 * m):
        then[k] = now[k]
    contract.ended(engine, now)
    something = status == contract.ROOT
    for i in range(m):
        suspect[i] = 0.0
        fired = status == contract.ROOT and contract.fired(engine, i) < 0
        bias = contract.bias(engine, i)
        # A margin that does not apply is constant; one that is lifted is in doubt.
        moves = fired or now[i] != then[i] or now[m + i] != then[m + i]
        if moves and h > 0.0 and bias <= HAIR:
            bend[i] = max(abs(now[m + i] - then[m + i]) / h, FADING * bend[i])
            # A root is where the margin is zero but for what the engine tells roots apart.
            start, end = then[i] + bias, 0.0 if fired else now[i] + bias
            side = -1.0 if passed[i] == 1 else 1.0
            start, end = side * start, side * end
            stays_there = stays(start, side * then[m + i], end, side * now[m + i], h, bend[i])
            # One that may be below zero has come above it, and fallen, if it has not stayed there.
            above = start >= 0.0 and end >= 0.0
            if not stays_there and (above or side < 0.0):
                suspect[i] = side
                something = True
        if now[i] + bias > 0.0:
            passed[i] = 0.0
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
        if status == contract.ROOT and contract.fired(engine, i) < 0:
            together += 1
    for i in range(m):
        fired = status == contract.ROOT and contract.fired(engine, i) < 0
        t_crossing = math.inf
        bias = contract.bias(engine, i)
        if suspect[i] != 0.0:
            end = 0.0 if fired else now[i] + bias
            t_crossing = hidden(engine, s, i, before, t, end, suspect[i])
        rate = 0.0
        if t_crossing == math.inf:
            if fired:
                rate = now[m + i]
                t_crossing = t - late(engine, s, i, before, t) if together == 1 else t
            elif (
                status == contract.ROOT
                and contract.fired(engine, m + i) > 0
                # Zero as well: CVODE stops where a margin and its rate are zero together.
                and now[i] + bias <= 0.0
                and row(s, PASSED)[i] != 1
            ):
                # There may be another dip before this one.
                end = now[i] + bias
                t_crossing = hidden(engine, s, i, before, t, end, 1.0)
                if t_crossing == math.inf:
                    t_crossing = crossing(engine, s, i, before, t)
        if t_crossing < math.inf and (
            guard == NONE
            or t_crossing < t_event
            or (t_crossing == t_event and order[i] < order[guard])
        ):
            certain = surely_falling(s, m + i, rate)
            if not certain:
                contract.interpolate(engine, t_crossing, y)
                resolution(engine, s, s.mode, t_crossing, y)
                certain = falling(engine, s, s.mode, i, t_crossing, y)
            if certain:
                guard, t_event = i, t_crossing
            else:
                # It is left alone until it has risen, or a step ends where it falls.
                s.doubt = 1
                s.lifted = 1
                depth = abs(row(s, LOOKED)[i])
                contract.set_bias(engine, i, bias + depth + 2.0 * rounding_of(s, i))
    return guard, t_event


def late(engine: Any, s: Any, i: int, before: float, t: float) -> float:
    """Return how long before `t`, where margin `i` has fired, it was zero.

    CVODE stops a little late, by some hundred roundings of time: impact after impact that adds up.
    A margin that stays at zero it may tell anywhere there. Overwrites STATE and G.
    """
    now, g, y = row(s, NOW), row(s, G), row(s, STATE)
    margin, rate = now[i] + contract.bias(engine, i), now[s.m + i]
    if margin == 0.0 and 1e-6 * (t - before) > 8.0 * EPS * abs(t):
        earlier = t - 1e-6 * (t - before)
        contract.interpolate(engine, earlier, y)
        contract.margins(engine, s.mode, earlier, y, g)
        if g[i] == now[i]:
            return t - crossing(engine, s, i, before, earlier)
    if not rate < 0.0:
        return 0.0
    by: float = margin / rate
    return by if 8.0 * EPS * abs(t) < by < 1e-6 * (t - before) else 0.0


def crossing(engine: Any, s: Any, i: int, inside: float, outside: float) -> float:
    """Bisect margin `i` on the last step: positive at `inside`, negative at `outside`.

    Overwrites STATE.
    """
    g, y = row(s, G), row(s, STATE)
    bias = contract.bias(engine, i)
    for _ in range(80):
        middle = 0.5 * (inside + outside)
        if middle <= inside or middle >= outside:
            break
        contract.interpolate(engine, middle, y)
        contract.margins(engine, s.mode, middle, y, g)
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
    side: float,
) -> float:
    """Return when margin `i` first falls below zero inside the last step; infinity if it does not.

    A step of a flow that is nearly a polynomial may be long enough for two minima of a margin.
    What the margin may do between two instants is bounded by its values and rates there and by
    how much the rates change (`stays`): for most steps that says enough. This step is walked
    through, in parts so short that the bound holds; its margin is `end` where it ends. One that
    begins below zero (`side` -1) must come above it first: until then the same is asked of its
    negative. Overwrites STATE and, where it finds something, what `resolution` does.
    """
    m = s.m
    then, now = row(s, THEN), row(s, NOW)
    bias = contract.bias(engine, i)
    a, g_a, r_a = before, then[i] + bias, then[m + i]
    curved = row(s, BEND)[i]
    g, y = row(s, G), row(s, STATE)
    finest = max(FINEST * (t - before), 8.0 * EPS * abs(t))
    width = 0.5 * (t - before)
    while a < t:
        b = a + width if a + 1.5 * width < t else t
        g_b, r_b = end, now[m + i]
        if b < t:
            contract.interpolate(engine, b, y)
            contract.margins(engine, s.mode, b, y, g)
            g_b, r_b = g[i] + bias, g[m + i]
        curved = max(curved, abs(r_b - r_a) / (b - a))
        sure = stays(side * g_a, side * r_a, abs(g_b), side * r_b, b - a, curved)
        if b - a > finest and not sure:
            width *= 0.5
            continue
        if not sure and side * r_a < 0.0 < side * r_b:
            # One closest approach, by the rates: the margin there decides.
            closest = closest_approach(engine, s, i, a, b, side)
            contract.interpolate(engine, closest, y)
            contract.margins(engine, s.mode, closest, y, g)
            if side * (g[i] + bias) < min(0.0, side * g_b):
                b, g_b, r_b = closest, g[i] + bias, 0.0
        if side * g_b < 0.0:
            contract.interpolate(engine, b, y)
            resolution(engine, s, s.mode, b, y)
            crossed = side * g_b < -rounding_of(s, i)
            if crossed and side > 0.0:
                return crossing(engine, s, i, a, b)
            side = 1.0 if crossed else side
            a, g_a, r_a = b, g_b if crossed else 0.0, r_b
        else:
            a, g_a, r_a = b, g_b, r_b
            width *= 2.0
    return math.inf


def closest_approach(engine: Any, s: Any, i: int, a: float, b: float, side: float) -> float:
    """Bisect the rate of margin `i` on the last step, from falling at `a` to rising at `b`.

    With `side` -1 that of its negative. Overwrites STATE.
    """
    g, y = row(s, G), row(s, STATE)
    for _ in range(80):
        middle = 0.5 * (a + b)
        if middle <= a or middle >= b:
            break
        contract.interpolate(engine, middle, y)
        contract.margins(engine, s.mode, middle, y, g)
        if side * g[s.m + i] < 0.0:
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
