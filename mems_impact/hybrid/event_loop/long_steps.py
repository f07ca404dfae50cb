"""Long steps of systems without forcing.

The time scale bounds the steps of a system, so that no crossing is hidden within one. Where a
system without a period moves slowly beside it, steps may become longer: after several steps at the
limit it doubles, until the next event. Such a step is resolved as before: its interpolant is
scanned at intervals of the former limit, for zeros of all margins, for closest approaches, and for
changes of the flow that the step has missed (their integral is not its change of the state). Then
the step is discarded, and a new arc begins at its start with the former limit. Intervals grow with
the time since the last event, so that the cost of a run depends little on its length: a dip shorter
than `RESOLVED_SHARE` of this time may be missed.
"""

from __future__ import annotations

import math
from typing import Any

from mems_impact.hybrid.event_loop.workspace import (
    IMPACT,
    SLOPE,
    STAGE,
    STATE,
    STATE_AHEAD,
    SUM,
    G,
    table_row,
)
from mems_impact.integrators import interface

# The longest step is this part of a period (or time scale), so that no step contains two extrema of
# a margin. At useful tolerances steps are several times shorter.
STEPS_PER_PERIOD = 16.0
RESOLVED_SHARE = 2.0**-20  # of the time since the last event
LIMITED_STEPS = 16  # successive steps at the limit, after which it doubles
LIMITED_RATIO = 0.8  # part of the limit above which a step is at the limit
LONG_RATIO = 1.5  # of step and resolution, above which a step is scanned
MISSED_RTOL = 1e-4  # relative error of the integral of the flow over a resolved step
MISSED_TOLERANCES = 100.0  # the same in tolerances of the state


def resolution(s: Any, t: float) -> float:
    """Return the interval at which steps are scanned at `t`."""
    return max(s.scale / STEPS_PER_PERIOD, RESOLVED_SHARE * (t - s.arc_start))


def is_long(s: Any, t_start: float, t: float) -> bool:
    """Return whether a step has to be scanned."""
    return bool(s.longest > 0.0 and t - t_start > LONG_RATIO * resolution(s, t))


def lengthen_steps(engine: Any, s: Any, h: float) -> None:
    """Double the limit after several steps at it; `h` is the last step."""
    if s.forced == 1 or s.section >= 0:
        return
    limit = max(s.longest, s.scale / STEPS_PER_PERIOD)
    s.limited_steps = s.limited_steps + 1 if h > LIMITED_RATIO * limit else 0
    if s.limited_steps >= LIMITED_STEPS:
        s.limited_steps = 0
        s.longest = 2.0 * limit
        interface.lengthen(engine, s.longest)


def is_resolved(engine: Any, s: Any, t_start: float, t: float) -> bool:
    """Return whether the step from `t_start` to `t` has missed no change of the flow.

    By Simpson's rule at the intervals of the resolution. Nor may an impact have a closest approach
    that the engine has not found. Overwrites STATE, STATE_AHEAD, SLOPE, STAGE, SUM and G.
    """
    n, m, y, slope = s.n, s.m, table_row(s, STATE), table_row(s, SLOPE)
    total, size, begin = table_row(s, SUM), table_row(s, STAGE), table_row(s, STATE_AHEAD)
    g = table_row(s, G)
    count = 2 * math.ceil((t - t_start) / (2.0 * resolution(s, t)))
    h = (t - t_start) / count
    for j in range(n):
        total[j] = 0.0
        size[j] = 0.0
    impacts, approaching = 0, False
    for i in range(m):
        impacts += int(table_row(s, IMPACT)[i] == 1)
    for k in range(count + 1):
        time = t_start + k * h if k < count else t
        interface.interpolate(engine, time, y)
        interface.flow(engine, s.mode, time, y, slope)
        weight = 1.0 if k == 0 or k == count else 2.0 + 2.0 * (k % 2)
        for j in range(n):
            total[j] += weight * slope[j] * h / 3.0
            size[j] += weight * abs(slope[j]) * h / 3.0
            if k == 0:
                begin[j] = y[j]
        if impacts > 0 and k < count:
            interface.margins(engine, s.mode, time, y, g)
            approaches = False
            for i in range(m):
                approaches = approaches or (table_row(s, IMPACT)[i] == 1 and g[m + i] < 0.0)
            if approaching and not approaches:
                return False
            approaching = approaches
    for j in range(n):
        error = abs(y[j] - begin[j] - total[j])
        tolerance = s.atol + s.rtol * max(abs(y[j]), abs(begin[j]))
        if not error <= MISSED_RTOL * size[j] + MISSED_TOLERANCES * tolerance:
            return False
    return True
