"""Whether the functions of a system depend on time as they may."""

from __future__ import annotations

from collections.abc import Sequence

from mems_impact.hybrid.blaming import Function
from mems_impact.hybrid.tried import Point, Tried

__all__ = ["check_times"]

LATER = 0.6180339887498949  # of the time scale: a time that is none of a period's parts
PARTS = (0.13, 0.29, 0.41, 0.59, 0.83)  # of the time scale, at which else the flow is looked at
HAIR = 1e-9  # of the time scale
SLACK = 1e-6  # of the largest rate that is met


def check_times(
    tried: Tried, at: Point, slope: Sequence[float], period: float | None, unit: float
) -> None:
    """Raise FunctionError unless the flow is that of a period later, or of any time without one."""
    later = at.t + (LATER * unit if period is None else period)
    again = tried.flow(Point(at.mode, later, at.y))
    # Where forces cancel, or a sine begins, the flow is nothing but rounding of what makes it up.
    around = (tried.flow(Point(at.mode, at.t + part * unit, at.y)) for part in PARTS)
    seen = (abs(rate) for rates in (slope, again, *around) for rate in rates)
    size = max(*seen, *(abs(value) / unit for value in at.y))
    if not differ(slope, again, size):
        return
    # A forcing that jumps may do so a rounding before or after this time.
    for hair in (-HAIR * unit, HAIR * unit):
        if not differ(slope, tried.flow(Point(at.mode, later + hair, at.y)), size):
            return
    for name, now, then in zip(tried.states, slope, again, strict=True):
        if differ([now], [then], size):
            change = f"{now:.6g} at t = {at.t:.6g} and {then:.6g} at t = {later:.6g}"
            problem = (
                f"depends on time, but the system has no period (for {name} it gives {change})"
            )
            remedy = "give the forcing period"
            if period is not None:
                problem = f"differs a period later (for {name} it gives {change})"
                remedy = "give the period of the forcing"
            remedy += "; what depends on time in another way is a state of its own"
            raise Function("flow", tried.definition.flow).error(problem, remedy)


def differ(one: Sequence[float], other: Sequence[float], size: float) -> bool:
    """Return whether two slopes differ by more than rounding and a hair of time make of it."""
    return any(abs(a - b) > SLACK * size for a, b in zip(one, other, strict=True))
