"""Impacts of a block in a frame that is held, by SciPy."""

import math

from scipy.integrate import solve_ivp


def impacts(rates, y, ends, max_step):
    """Return times of impacts, and the state at the last of `ends`, where the rates may jump."""

    def right(t, y):
        return 0.5 - y[0]

    def left(t, y):
        return 0.5 + y[0]

    for event in (right, left):
        event.terminal, event.direction = True, -1
    t, hits = 0.0, []
    for end in ends:
        while t < end:
            arc = solve_ivp(
                rates, (t, end), y, "DOP853", rtol=1e-11, atol=1e-13, max_step=max_step,
                events=(right, left),
            )  # fmt: skip
            t, y = arc.t[-1], arc.y[:, -1]
            if arc.status == 1:
                hits.append(t)
                y = [math.copysign(0.5, y[0]), -0.8 * y[1]]
    return hits, y
