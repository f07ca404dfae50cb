"""The first sign change of the root functions within a step.

A row of the table holds the 2 m + 1 root functions at one instant: the margins as they are, their
rates, the section. A margin fires where it (with its bias) falls to zero or below, a rate where it
rises to zero or above; so a function that starts at zero does not fire by staying there.
"""

from __future__ import annotations

import math
from typing import Any

from mems_impact.engines import contract as arc
from mems_impact.engines.onestep.method import (
    ARGUMENT,
    HIGH,
    LOW,
    TRIAL,
    UPPER,
    dense_at,
)

NONE = -1
ULP = 2.0**-52


def root_functions(engine: Any, t: float, y: Any, out: Any) -> bool:
    """Write all root functions at (t, y) into `out`; return whether they are numbers."""
    m = engine.m
    arc.margins(engine, engine.mode, min(t, engine.last_instant), y, out)
    out[2 * m] = y[engine.section] - engine.level if engine.section >= 0 else 1.0
    total = 0.0
    for i in range(2 * m):
        total += abs(out[i])
    return not math.isnan(total)


def crossed(engine: Any, i: int, low: Any, high: Any) -> int:
    """Return how function `i` crosses zero between rows: -1 falling, +1 rising, 0 not at all.

    Directions that are not looked for do not count.
    """
    m = engine.m
    if i < m:
        bias = arc.bias(engine, i)
        return -1 if low[i] + bias > 0.0 and high[i] + bias <= 0.0 else 0
    if low[i] < 0.0 and high[i] >= 0.0:
        return 1 if i < 2 * m or engine.direction >= 0 else 0
    if i == 2 * m and low[i] > 0.0 and high[i] <= 0.0:
        return -1 if engine.direction <= 0 else 0
    return 0


def any_crossed(engine: Any, low: Any, high: Any) -> bool:
    """Return whether any function crosses zero between rows."""
    for i in range(2 * engine.m + 1):  # noqa: SIM110 - numba compiles no generators here
        if crossed(engine, i, low, high) != 0:
            return True
    return False


def fraction(engine: Any, low: Any, high: Any) -> float:
    """Return where between the rows the first zero would be if all functions were straight."""
    first = 1.0
    m = engine.m
    for i in range(2 * m + 1):
        if crossed(engine, i, low, high) != 0:
            value = low[i] + arc.bias(engine, i) if i < m else low[i]
            first = min(first, value / (low[i] - high[i]))
    return first


def close_in(engine: Any, w: Any, begin: float, end: float) -> float:
    """Return the first root after `begin`, where LOW stands; NaN if a function is not a number.

    HIGH stands at `end`, and some function crosses zero between the two. The answer is on the far
    side of the root, within two units of its last place, and UPPER holds the functions there. The
    method is ITP (Oliveira and Takahashi, ACM Trans. Math. Softw. 47, 2020): a secant step,
    shifted towards the middle, and never so far from it that bisection would be much faster. It
    works on all functions at once: the far end of the bracket is where any has crossed.
    """
    low, upper, trial, y = w[LOW], w[UPPER], w[TRIAL], w[ARGUMENT]
    count = 2 * engine.m + 1
    for i in range(count):
        upper[i] = w[HIGH][i]
    a, b = begin, end
    radius = width = b - a
    shift = 0.2 / width
    while True:
        limit = ULP * max(abs(b), 1e-3 * (end - begin))
        width = b - a
        if width <= 2.0 * limit:
            return b
        middle = a + 0.5 * width
        t = a + width * fraction(engine, low, upper)
        side = 1.0 if middle >= t else -1.0
        delta = shift * width * width
        t = t + side * delta if delta <= abs(middle - t) else middle
        slack = radius - 0.5 * width
        if abs(t - middle) > slack:
            t = middle - side * slack
        t = min(max(t, a + limit), b - limit)
        if t <= a or t >= b:
            return b
        dense_at(engine, w, t, y)
        if not root_functions(engine, t, y, trial):
            return math.nan
        if any_crossed(engine, low, trial):
            b = t
            for i in range(count):
                upper[i] = trial[i]
        else:
            a = t
            for i in range(count):
                low[i] = trial[i]
        radius *= 0.5
