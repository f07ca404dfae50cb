"""Bisection of an interval in which a condition ceases to hold, or a function jumps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mems_impact._util.arrays import Floats

BISECTIONS = 40
MIN_JUMP = 1e-4  # least jump, relative to the change over the interval, or to 1 if that is larger


def bisect(
    holds: Callable[[float], bool], inside: float, outside: float, tolerance: float = 0.0
) -> tuple[float, float]:
    """Return the last number where a condition holds and the first where it does not.

    The condition is true at `inside`, false at `outside`, in either order; with a `tolerance` of 0
    no number lies between the two.
    """
    while abs(outside - inside) > tolerance:
        middle = 0.5 * (inside + outside)
        if middle in (inside, outside):
            break
        if holds(middle):
            inside = middle
        else:
            outside = middle
    return inside, outside


def discontinuity(function: Callable[[float], Floats], begin: float, end: float) -> float | None:
    """Return a number between two others at which a function is discontinuous; None without one.

    Each bisection keeps the half over which the function, with values of order one, changes more.
    Over an interval of that length a continuous function changes by far less than a jump.
    """
    first, last = function(begin), function(end)
    whole = np.abs(last - first).max(initial=1.0)
    for _ in range(BISECTIONS):
        middle = 0.5 * (begin + end)
        between = function(middle)
        if np.abs(between - first).max(initial=0.0) > np.abs(last - between).max(initial=0.0):
            end, last = middle, between
        else:
            begin, first = middle, between
    return end if np.abs(last - first).max(initial=0.0) > MIN_JUMP * whole else None
