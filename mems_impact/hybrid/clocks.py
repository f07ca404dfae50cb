"""Guards whose margin depends on time alone: no transition ends its fall."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from mems_impact.errors import FunctionError

__all__ = ["AT_TIMES", "is_clock"]

AT_TIMES = (
    "the margin depends on time alone, which no transition changes: give the times as switches= "
    "of the System, and what happens there as settle="
)


def is_clock(margin: Callable[[Sequence[float]], float], y: Sequence[float]) -> bool:
    """Return whether a margin is the same about a state, whichever component is moved."""
    try:
        here = margin(y)
        for c, value in enumerate(y):
            for far in (-1.0 - abs(value), 1.0 + abs(value)):
                if margin([*y[:c], value + far, *y[c + 1 :]]) != here:
                    return False
    except (FunctionError, ArithmeticError, ValueError):
        return False
    return True
