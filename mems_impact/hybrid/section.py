"""Crossings of the section that engines do not tell: those that come in pairs within a step.

An engine sees that a step ends on the other side of the section. Where it may have been there and
come back in between, the step is walked through, as `search` does for margins. Functions over the
engine's contract.
"""

from __future__ import annotations

from typing import Any

from mems_impact.engines import contract
from mems_impact.hybrid.guards import ROUNDINGS
from mems_impact.hybrid.record import EPS, SECTION_CROSSING, SLOPE, STATE, note, row
from mems_impact.hybrid.search import FINEST, stays

CAUTION = 8.0  # times the bend seen of late is reckoned with
MOST = 16  # crossings of one step that are noted: no method's polynomial has more


def enter(engine: Any, s: Any, y: Any) -> None:
    """Take down where an arc begins at (``s.t``, `y`): the side of the section, and the way on.

    Overwrites SLOPE.
    """
    if s.section < 0:
        return
    s.apart = y[s.section] - s.level
    s.pace = rate_at(engine, s, s.t, y)
    s.paced = s.turning = 0.0
    s.side = side_of(s.apart if s.apart != 0.0 else s.pace)


def pass_section(engine: Any, s: Any, before: float, y: Any, told: int) -> None:
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
    pace = (apart - s.apart) / h
    # The pace of a step is the rate in its middle; where an arc begins it is the rate there.
    turned = pace - s.pace
    # The first steps of an arc may be so short that rounding alone makes their paces.
    if abs(turned) * h <= ROUNDINGS * EPS * (abs(s.level) + abs(apart)):
        turned = 0.0
    bend = turned / (0.5 * (h + s.paced))
    s.turning = max(abs(bend), 0.5 * s.turning)
    end = 0.0 if told != 0 else apart
    if s.side == 0:
        s.side = side_of(apart)
    elif bend != 0.0 and not stays(
        s.side * s.apart,
        s.side * (pace - 0.5 * h * bend),
        s.side * end,
        s.side * (pace + 0.5 * h * bend),
        h,
        CAUTION * s.turning,
    ):
        walk(engine, s, before, end)
    s.apart, s.pace, s.paced = end, pace, h
    if told != 0 or apart != 0.0:
        s.side = told if told != 0 else side_of(apart)


def walk(engine: Any, s: Any, before: float, end: float) -> None:
    """Note the crossings between `before` and ``s.t``, where the section is `end` away.

    In parts so short that by its rates the component keeps clear of the section, or crosses it but
    once. Overwrites STATE and SLOPE.
    """
    t, y = s.t, row(s, STATE)
    contract.interpolate(engine, before, y)
    a, g_a, r_a = before, s.apart, rate_at(engine, s, before, y)
    rounding = ROUNDINGS * EPS * (abs(s.level) + max(abs(g_a), abs(end)))
    finest = max(FINEST * (t - before), 8.0 * EPS * abs(t))
    width, curved, left = t - before, 0.0, MOST
    while a < t and left > 0:
        b = a + width if a + 1.5 * width < t else t
        contract.interpolate(engine, b, y)
        g_b, r_b = y[s.section] - s.level if b < t else end, rate_at(engine, s, b, y)
        h, side = b - a, s.side
        curved = max(curved, abs(r_b - r_a) / h)
        over = side * g_b < -rounding
        if over:
            sure = max(side * r_a, side * r_b) < -curved * h
        else:
            sure = stays(side * g_a, side * r_a, max(side * g_b, 0.0), side * r_b, h, curved)
        if h > finest and not sure:
            width *= 0.5
            continue
        if not over and not sure and side * r_a < 0.0 < side * r_b:
            nearest = turn(engine, s, a, b)
            contract.interpolate(engine, nearest, y)
            if side * (y[s.section] - s.level) < -rounding:
                b, over = nearest, True
        if over:
            b = crossing(engine, s, a, b)
            contract.interpolate(engine, b, y)
            s.side = -side
            g_b, r_b = 0.0, rate_at(engine, s, b, y)
            if s.direction * s.side >= 0:
                note(s, b, SECTION_CROSSING, s.side, s.mode, y, y)
                left -= 1
        else:
            width *= 2.0
        a, g_a, r_a = b, g_b, r_b


def crossing(engine: Any, s: Any, inside: float, outside: float) -> float:
    """Bisect the section on the last step: on its side at `inside`, beyond it at `outside`.

    Overwrites STATE.
    """
    y = row(s, STATE)
    for _ in range(80):
        middle = 0.5 * (inside + outside)
        if middle <= inside or middle >= outside:
            break
        contract.interpolate(engine, middle, y)
        if s.side * (y[s.section] - s.level) > 0.0:
            inside = middle
        else:
            outside = middle
    return outside


def turn(engine: Any, s: Any, a: float, b: float) -> float:
    """Bisect the rate on the last step, from towards the section at `a` to away from it at `b`.

    Overwrites STATE and SLOPE.
    """
    y = row(s, STATE)
    for _ in range(80):
        middle = 0.5 * (a + b)
        if middle <= a or middle >= b:
            break
        contract.interpolate(engine, middle, y)
        if s.side * rate_at(engine, s, middle, y) < 0.0:
            a = middle
        else:
            b = middle
    return b


def rate_at(engine: Any, s: Any, t: float, y: Any) -> float:
    """Return the rate of the section's component; up to a switch that of the arc before it.

    Overwrites SLOPE.
    """
    slope = row(s, SLOPE)
    contract.flow(engine, s.mode, t if t < s.stop else t - EPS * t, y, slope)
    rate: float = slope[s.section]
    return rate


def side_of(apart: float) -> int:
    """Return 1 above, -1 below, 0 at the section."""
    return 1 if apart > 0.0 else (-1 if apart < 0.0 else 0)
