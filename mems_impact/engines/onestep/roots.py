"""The first sign change of the root functions within a step.

A row of the table holds the 2 m + 1 root functions at one instant: the margins as they are, their
rates, the section. A margin fires where it (with its bias) falls to zero or below, a rate where it
rises to zero or above; so a function that starts at zero does not fire by staying there.
"""

from __future__ import annotations

import math
from typing import Any

from mems_impact.engines import contract
from mems_impact.engines.onestep.method import (
    ARGUMENT,
    HIGH,
    LOW,
    SPARE,
    dense_at,
    row,
    set_fired,
)

NONE = -1
ULP = 2.0**-52


def root_functions(engine: Any, t: float, y: Any, out: Any) -> bool:
    """Write all root functions at (t, y) into `out`; return whether they are numbers."""
    m = engine.m
    contract.margins(engine, engine.mode, min(t, engine.last_instant), y, out)
    out[2 * m] = y[engine.section] - engine.level if engine.section >= 0 else 1.0
    for i in range(2 * m):  # noqa: SIM110 - numba compiles no generator, here and below
        if math.isnan(out[i]):
            return False
    return True


def value(engine: Any, i: int, values: Any) -> float:
    """Return function `i`, a margin with its bias."""
    return values[i] + contract.bias(engine, i) if i < engine.m else values[i]


def crossed(engine: Any, i: int, low: Any, high: Any) -> int:
    """Return how function `i` crosses zero between rows: -1 falling, +1 rising, 0 not at all.

    Directions that are not looked for do not count.
    """
    m = engine.m
    if i < m:
        bias = contract.bias(engine, i)
        return -1 if low[i] + bias > 0.0 and high[i] + bias <= 0.0 else 0
    if i < 2 * m:
        return 1 if low[i] < 0.0 and high[i] >= 0.0 else 0
    if low[i] > 0.0 and high[i] <= 0.0 and engine.direction <= 0:
        return -1
    return 1 if low[i] < 0.0 and high[i] >= 0.0 and engine.direction >= 0 else 0


def any_crossed(engine: Any, low: Any, high: Any) -> bool:
    """Return whether any function crosses zero between rows."""
    for i in range(2 * engine.m + 1):  # noqa: SIM110
        if crossed(engine, i, low, high) != 0:
            return True
    return False


def first_crossed(engine: Any, low: Any, high: Any) -> tuple[int, float]:
    """Return the function whose zero is first if all of them are straight, and where between.

    NONE if none crosses zero.
    """
    first, place = NONE, 1.0
    for i in range(2 * engine.m + 1):
        if crossed(engine, i, low, high) != 0:
            before = value(engine, i, low)
            there = before / (before - value(engine, i, high))
            if first == NONE or there < place:
                first, place = i, there
    return first, place


def close_in(engine: Any, begin: float, end: float) -> float:
    """Return the first root after `begin`, where LOW stands; NaN if a function is not a number.

    HIGH stands at `end`, and some function crosses zero between the two. The answer is on the far
    side of the root, within two units of its last place. LOW then holds the functions there, and
    what crosses zero with it is told as fired.

    The method works on all functions at once: the far end of the bracket is where any of them has
    crossed zero. It goes where a parabola through the last three points has its root (or the
    straight line, where they do not lie on a monotonous one), and a little to the middle of the
    bracket, so that both its ends close in. It never leaves the middle by more than leaves
    bisection one step behind: the projection of ITP (Oliveira and Takahashi, ACM Trans. Math.
    Softw. 47, 2020).
    """
    count = 2 * engine.m + 1
    near, far, last, trial = LOW, SPARE, SPARE + 1, SPARE + 2  # rows
    for i in range(count):
        row(engine, far)[i] = row(engine, HIGH)[i]
    a, b, c = begin, end, end
    moved_far, points = False, 2
    radius = b - a
    shift = 0.2 / radius
    i, place = first_crossed(engine, row(engine, near), row(engine, far))
    while True:
        limit = ULP * max(abs(b), 1e-3 * (end - begin))
        width = b - a
        if width <= 2.0 * limit:
            break
        middle = a + 0.5 * width
        t = a + width * place
        side = 1.0 if middle >= t else -1.0
        push = shift * width * width
        if points == 3:
            f_a, f_b = value(engine, i, row(engine, near)), value(engine, i, row(engine, far))
            f_c = value(engine, i, row(engine, last))
            new, old = (b, a) if moved_far else (a, b)
            f_new, f_old = (f_b, f_a) if moved_far else (f_a, f_b)
            if (f_new - f_old) * (f_c - f_old) > 0.0:
                x, f = (new - old) / (c - old), (f_new - f_old) / (f_c - f_old)
                if f * f < x and (1.0 - f) * (1.0 - f) < 1.0 - x:
                    straight = t
                    t = a + f_a / (f_b - f_a) * f_c / (f_b - f_c) * width
                    t += f_a / (f_c - f_a) * f_b / (f_c - f_b) * (c - a)
                    side = 1.0 if middle >= t else -1.0
                    push = 0.01 * abs(t - straight)
        t = t + side * push if push <= abs(middle - t) else middle
        slack = radius - 0.5 * width
        if abs(t - middle) > slack:
            t = middle - side * slack
        t = min(max(t, a + limit), b - limit)
        if t <= a or t >= b:
            break
        dense_at(engine, t, row(engine, ARGUMENT))
        if not root_functions(engine, t, row(engine, ARGUMENT), row(engine, trial)):
            return math.nan
        i, place = first_crossed(engine, row(engine, near), row(engine, trial))
        moved_far = i != NONE
        if moved_far:
            c, b = b, t
            last, far, trial = far, trial, last
        else:
            c, a = a, t
            last, near, trial = near, trial, last
            i, place = first_crossed(engine, row(engine, near), row(engine, far))
        points = 3
        radius *= 0.5
    for i in range(count):
        set_fired(engine, i, crossed(engine, i, row(engine, near), row(engine, far)))
    for i in range(count):
        row(engine, LOW)[i] = row(engine, far)[i]
    return b
