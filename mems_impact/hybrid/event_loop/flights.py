"""Tolerances of flights within a chatter sequence.

A flight is an arc between two impacts: a margin begins near zero, rises and falls again. An error d
of the position shifts the impact at its end by d/u, where u is the impact speed. If the flight is
hardly higher than the tolerance, this error is of the order of the flight itself, and propagates to
the next flight. So flights are integrated to the relative tolerance of their height. At a flat zero
the flights before predict it. Functions over
`integrators.interface`, as in `event_detection`.
"""

from __future__ import annotations

import math
from typing import Any

from mems_impact.hybrid.event_loop.event_detection import (
    integration_error,
    margin_error_scales,
    rounding_error,
)
from mems_impact.hybrid.event_loop.workspace import (
    EPS,
    HIT_BEGIN,
    HIT_HEIGHT,
    HIT_INTERVAL,
    HIT_REMAINING,
    IMPACT,
    MARGINS_AFTER,
    SLOPE,
    STATE_AHEAD,
    WAITING,
    G,
    next_switch,
    table_row,
)
from mems_impact.integrators import interface

ACCELERATION_STEP = 2.0**-20  # step of the differences for accelerations, in time scales
EARLY_SHARE = 0.25  # first part of a flight, in which no other margin may reach zero
MIN_FLIGHT_ROUNDINGS = 1e4  # flights shorter than so many roundings of time are not resolved


def sharpen(engine: Any, s: Any, y: Any) -> None:
    """Set the tolerances of the arc that begins at ``s.t`` with the margins in MARGINS_AFTER.

    The lowest flight among the possible impacts counts. A flight in whose first part another margin
    reaches zero, such as a slip end, is ignored, since its acceleration changes there. Overwrites
    SLOPE, STATE_AHEAD and the rows of `margin_error_scales`.
    """
    m, t, margins = s.m, s.t, table_row(s, MARGINS_AFTER)
    has_impacts = False
    for i in range(m):  # an inactive margin and its rate are 1
        has_impacts = has_impacts or (
            table_row(s, IMPACT)[i] == 1 and (margins[i] != 1.0 or margins[m + i] != 1.0)
        )
    share, flight_time = 1.0, math.inf
    if has_impacts:
        slope, y_ahead, g = table_row(s, SLOPE), table_row(s, STATE_AHEAD), table_row(s, G)
        h = min(ACCELERATION_STEP * s.scale, 0.5 * (next_switch(s, t) - t))
        interface.flow(engine, s.mode, t, y, slope)
        for j in range(s.n):
            y_ahead[j] = y[j] + h * slope[j]
        interface.margins(engine, s.mode, t + h, y_ahead, g)
        has_scales = False
        for i in range(m):
            rate_drop = margins[m + i] - g[m + i]
            remaining = table_row(s, HIT_REMAINING)[i]
            if 0.0 < remaining < math.inf and table_row(s, HIT_BEGIN)[i] == t:
                interval = table_row(s, HIT_INTERVAL)[i]
                flight = interval * remaining / (interval + remaining)
                height = (flight / table_row(s, HIT_HEIGHT)[i]) ** 2  # part of the highest flight
                if height < share:
                    share, flight_time = height, flight
            elif table_row(s, IMPACT)[i] == 1 and rate_drop > 0.0 and remaining == 0.0:
                margin, rate, a = max(margins[i], 0.0), margins[m + i], rate_drop / h
                height = margin + 0.5 * rate * rate / a
                flight = (rate + math.sqrt(2.0 * a * height)) / a
                if flight > MIN_FLIGHT_ROUNDINGS * EPS * abs(t) and not is_cut_off(
                    s, i, EARLY_SHARE * flight
                ):
                    if not has_scales:
                        margin_error_scales(engine, s, s.mode, t, y)
                        interface.margins(engine, s.mode, t + h, y_ahead, g)
                        has_scales = True
                    rounding, error = rounding_error(s, i), integration_error(s, i)
                    if height > rounding and s.rtol * height < share * error:
                        share = s.rtol * max(height, rounding) / error
                        flight_time = flight
    interface.sharpen(engine, share, flight_time)


def is_cut_off(s: Any, i: int, time: float) -> bool:
    """Return whether a guard other than `i` fires within `time` at its present rate."""
    margins, waiting = table_row(s, MARGINS_AFTER), table_row(s, WAITING)
    result = False
    for k in range(s.m):
        is_later = margins[k] <= 0.0 or margins[k] + margins[s.m + k] * time >= 0.0
        result = result or not (k == i or waiting[k] == 1 or is_later)
    return result
