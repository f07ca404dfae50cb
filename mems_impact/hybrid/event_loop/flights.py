"""Tolerances of the flights between impacts of a sequence.

A margin that begins near zero, rises and falls again makes a flight. An error d of the position
moves the impact at its end by d/u, u being the speed there: of a flight that is itself hardly
higher than the tolerance it would spoil all digits, and the next flight inherits that. So what a
flight is integrated to is the relative tolerance of its height. Functions over the engine's
contract, as in `detection`.
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
    IMPACT,
    MARGINS_AFTER,
    SLOPE,
    STATE_AHEAD,
    G,
    next_switch,
    table_row,
)
from mems_impact.integrators import interface

GLANCE = 2.0**-20  # over this part of the time scale accelerations are measured
EARLY = 0.25  # part of a flight after which the arc may end before the flight does
BRIEF = 1e4  # flights shorter than so many roundings of time have no digits left


def sharpen(engine: Any, s: Any, y: Any) -> None:
    """Set the tolerances of the arc that begins at ``s.t`` with the margins and rates in NOW.

    Of all impacts that it may end with, the lowest flight counts. One at whose beginning another
    margin comes to zero is none: its acceleration changes there, as with the end of a slip.
    Overwrites SLOPE, AHEAD and what `margin_error_scales` does.
    """
    m, t, now = s.m, s.t, table_row(s, MARGINS_AFTER)
    watched = False
    for i in range(m):  # a margin that does not apply is 1, with the rate 1
        watched = watched or (table_row(s, IMPACT)[i] == 1 and (now[i] != 1.0 or now[m + i] != 1.0))
    share, lasts = 1.0, math.inf
    if watched:
        slope, ahead, g = table_row(s, SLOPE), table_row(s, STATE_AHEAD), table_row(s, G)
        h = min(GLANCE * s.scale, 0.5 * (next_switch(s, t) - t))
        interface.flow(engine, s.mode, t, y, slope)
        for j in range(s.n):
            ahead[j] = y[j] + h * slope[j]
        interface.margins(engine, s.mode, t + h, ahead, g)
        measured = False
        for i in range(m):
            falls = now[m + i] - g[m + i]
            if table_row(s, IMPACT)[i] == 1 and falls > 0.0:
                margin, rate, a = max(now[i], 0.0), now[m + i], falls / h
                height = margin + 0.5 * rate * rate / a
                flight = (rate + math.sqrt(2.0 * a * height)) / a
                if flight > BRIEF * EPS * abs(t) and not cut_off(s, i, EARLY * flight):
                    if not measured:
                        margin_error_scales(engine, s, s.mode, t, y)
                        interface.margins(engine, s.mode, t + h, ahead, g)
                        measured = True
                    rounding, error = rounding_error(s, i), integration_error(s, i)
                    if height > rounding and s.rtol * height < share * error:
                        share = s.rtol * max(height, rounding) / error
                        lasts = flight
    interface.sharpen(engine, share, lasts)


def cut_off(s: Any, i: int, time: float) -> bool:
    """Return whether another margin than `i`, as it falls now, comes to zero within `time`."""
    now = table_row(s, MARGINS_AFTER)
    sooner = False
    for k in range(s.m):
        falls = k != i and now[k] > 0.0 and now[k] + now[s.m + k] * time < 0.0
        sooner = sooner or falls
    return sooner
