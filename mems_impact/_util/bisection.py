"""Bisection of an interval in which a condition ceases to hold."""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["bisect"]


def bisect(
    holds: Callable[[float], bool], inside: float, outside: float, tolerance: float = 0.0
) -> tuple[float, float]:
    """Return the last number where a condition holds and the first where it does not.

    Parameters
    ----------
    holds : callable
        The condition: true at `inside`, false at `outside`.
    inside, outside : float
        In either order.
    tolerance : float, optional
        Largest distance between the two numbers; 0: no number lies between them.
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
