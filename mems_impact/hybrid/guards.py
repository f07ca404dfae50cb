"""What fires, and when: margins and rates read so that no decision hangs on rounding.

Functions over the engine's contract, like the loop itself, which calls them. Scratch rows that a
function overwrites are those of `record`: ``G`` always, others as its docstring says.
"""

from __future__ import annotations

from typing import Any

from mems_impact.engines import contract
from mems_impact.hybrid.record import (
    AHEAD,
    EPS,
    GAIN,
    IMPACT,
    LOOKED,
    MOVED,
    NONE,
    ORDER,
    PASSED,
    PAST,
    RECORDS,
    SIZE,
    SLOPE,
    STAGE,
    SUM,
    TIMED,
    G,
    next_switch,
    row,
)

ROUNDINGS = 64.0  # what lies within so many roundings of zero has no sign
SURELY = 1e3  # what is so many times its error below zero is so wherever that is measured
TOLERANCES = 1e3  # a margin so many tolerances below zero is no error of the integration
HAIR = 1e-300  # by which a margin that starts at zero is lifted


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
    contract.margins(engine, mode, t, y, base)
    shift = min(2.0**-26 * abs(t), 0.25 * (next_switch(s, t) - t))
    contract.margins(engine, mode, t + shift, y, g)
    for k in range(count):
        size[k] = 0.0
        gain[k] = 0.0
        timed[k] = abs(g[k] - base[k]) / shift * abs(t) if shift > 0.0 else 0.0
    for j in range(n):
        moved[j] = y[j]
    for j in range(n):
        shift = 2.0**-26 * abs(y[j]) + s.atol
        moved[j] = y[j] + shift
        contract.margins(engine, mode, t, moved, g)
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
    contract.flow(engine, mode, t, y, slope)
    for j in range(n):
        total[j] = slope[j]
        stage[j] = y[j] + 0.5 * h * slope[j]
    contract.flow(engine, mode, t + 0.5 * h, stage, slope)
    for j in range(n):
        total[j] += 2.0 * slope[j]
        stage[j] = y[j] + 0.5 * h * slope[j]
    contract.flow(engine, mode, t + 0.5 * h, stage, slope)
    for j in range(n):
        total[j] += 2.0 * slope[j]
        stage[j] = y[j] + h * slope[j]
    contract.flow(engine, mode, t + h, stage, slope)
    for j in range(n):
        out[j] = y[j] + h / 6.0 * (total[j] + slope[j])


def about_to_fall(engine: Any, s: Any, mode: int, i: int, t: float, y: Any) -> bool:
    """Return whether margin `i` is about to fall, by what comes next.

    After `resolution`. The flow is followed for longer and longer until the margin has moved by
    more than rounding: a gap that opens with no speed and no acceleration, as that of a body which
    a moving wall lets go, is told by what comes next. Overwrites AHEAD, STAGE, SLOPE, SUM.
    """
    g, ahead = row(s, G), row(s, AHEAD)
    seen, drift = rounding_of(s, i), rounding_of(s, s.m + i)
    contract.margins(engine, mode, t, y, g)
    margin = g[i]
    farthest = min(s.scale / 16.0, 0.5 * (next_switch(s, t) - t))
    h = max(2.0**-45 * farthest, EPS * abs(t))
    while h < farthest:
        h = min(8.0 * h, farthest)
        follow(engine, s, mode, t, y, h, ahead)
        contract.margins(engine, mode, t + h, ahead, g)
        moved = g[i] - margin
        if abs(moved) > seen + h * drift:
            return bool(moved < 0.0)
    return False


def falling(engine: Any, s: Any, mode: int, i: int, t: float, y: Any) -> bool:
    """Return whether margin `i` really falls at (t, y); after `resolution`.

    The polynomial of a step has the integration error, and a difference of large numbers its
    rounding; below them a margin seems to fall through zero where it does not, again and again.
    A rate that is clearly negative is believed, else the flow is asked. Overwrites what
    `about_to_fall` does.
    """
    m = s.m
    rate = row(s, LOOKED)[m + i]
    if rate < -rounding_of(s, m + i) - error_of(s, m + i):
        return True
    return about_to_fall(engine, s, mode, i, t, y)


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

    Its margin is zero or below, to rounding, and falls; or it is clearly negative, and no gap. Of
    guards that only record, those fire whose margin has come there now. The guard `but` is left
    out, and with it, since then a state is only tried, those that only record. Of impacts alone,
    those up to `after`, in order, come last. Overwrites what `resolution` and `about_to_fall` do.
    """
    order = row(s, ORDER)
    resolution(engine, s, mode, t, y)
    first = behind = NONE
    for i in range(s.m):
        if row(s, RECORDS)[i] == 1 and (but != NONE or has_passed(engine, s, mode, i, t)):
            continue
        if i != but and fires(engine, s, mode, i, t, y):
            if first == NONE or order[i] < order[first]:
                first = i
            behind_it = after != NONE and row(s, IMPACT)[i] == 1 and order[i] > order[after]
            if behind_it and (behind == NONE or order[i] < order[behind]):
                behind = i
    return behind if behind != NONE and row(s, IMPACT)[first] == 1 else first


def has_passed(engine: Any, s: Any, mode: int, i: int, t: float) -> bool:
    """Return whether the margin of guard `i`, which only records, has not fallen to zero now.

    After `resolution` of a state that a transition has left, PAST being the one before it, or that
    is looked at again because of a margin in doubt.
    """
    looked, passed, g = row(s, LOOKED)[i], row(s, PASSED), row(s, G)
    rounding = rounding_of(s, i)
    if looked > clearly(s, i):
        passed[i] = 0.0
    elif looked > rounding and passed[i] == 1:
        contract.margins(engine, mode, t, row(s, PAST), g)
        if g[i] < -rounding:
            passed[i] = 0.0  # thrown up, if not far; else it is where its fall was told
    elif looked < -clearly(s, i) and passed[i] == 0 and contract.bias(engine, i) <= HAIR:
        # Another mode may begin to watch it where it is negative already: that is no fall.
        contract.margins(engine, mode, t, row(s, PAST), g)
        passed[i] = 2.0 if g[i] > 0.0 else 1.0
    return bool(passed[i] == 1)


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
    """Return a gap that is clearly negative and does not open, as a start may be; or NONE.

    Where a run begins, guards that only record and are negative have PASSED.
    """
    m = s.m
    looked = row(s, LOOKED)
    resolution(engine, s, s.mode, t, y)
    for i in range(m):
        if s.arcs == 0 and row(s, RECORDS)[i] == 1 and looked[i] < -clearly(s, i):
            row(s, PASSED)[i] = 1.0
        closed = row(s, IMPACT)[i] == 1 and looked[m + i] <= 0.0
        if closed and looked[i] < -clearly(s, i):
            return i
    return NONE


def surely_falling(s: Any, k: int, rate: float) -> bool:
    """Return whether a rate is so far below zero that nobody needs to look again.

    Measured by the `resolution` at the start of the arc, or later, with much room.
    """
    return bool(rate < -SURELY * (rounding_of(s, k) + error_of(s, k)))
