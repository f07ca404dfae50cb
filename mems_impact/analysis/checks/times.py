"""Whether the functions of a system depend on time as they may."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mems_impact.hybrid.blaming import Function
from mems_impact.hybrid.tried import Place, Tried

__all__ = ["Clock", "check_times"]

PARTS = (0.1459, 0.3820, 0.6180)  # of the time scale: times that are no common parts of a period
HAIR = 1e-9  # of the time scale
SLACK = 1e-6  # of the largest component of the flow, or of what time changes in it


class Clock:
    """The times of a system: its forcing period if it has one, time scale and switches."""

    def __init__(self, period: float | None, unit: float, switches: Sequence[float]) -> None:
        self.period, self.unit, self.switches = period, unit, tuple(switches)

    def stop(self, t: float) -> float:
        """Return the next switch after `t`."""
        return next((time for time in self.switches if time > t), math.inf)


def check_times(
    tried: Tried, at: Place, slope: Sequence[float], period: float | None, unit: float
) -> None:
    """Raise FunctionError unless the flow is that of a period later, or of any time without one.

    Parameters
    ----------
    tried : Tried
    at : Place
    slope : sequence of float
        The flow there.
    period : float or None
    unit : float
        The time scale.
    """

    def ahead(time: float) -> list[float]:
        return tried.flow(Place(at.mode, at.t + time, at.y))

    others = [ahead(part * (period or unit)) for part in PARTS]
    # Where terms of the flow cancel, their rounding is far larger than what is left.
    size = max(abs(value) for each in (slope, *others) for value in each)
    size = max(size, *(abs(value) / unit for value in at.y))
    if period is None:
        wrong = [differ(slope, each, size) for each in others]
        if not any(wrong):
            return
        later, again = PARTS[wrong.index(True)] * unit, others[wrong.index(True)]
        problem, remedy = "depends on time, but the system has no period", "give the forcing period"
    else:
        # A forcing that jumps may do so a rounding before or after this time.
        for time in (period, period - HAIR * unit, period + HAIR * unit):
            if not differ(slope, ahead(time), size):
                return
        later, again = period, ahead(period)
        problem, remedy = "differs a period later", "give the period of the forcing"
    changes = [abs(a - b) for a, b in zip(slope, again, strict=True)]
    i = changes.index(max(changes))
    values = f"{slope[i]:.6g} at t = {at.t:.6g} and {again[i]:.6g} at t = {at.t + later:.6g}"
    problem += f" (for {tried.states[i]} it gives {values})"
    remedy += "; what depends on time in another way is a state of its own"
    raise Function("flow", tried.definition.flow).error(problem, remedy)


def differ(one: Sequence[float], other: Sequence[float], size: float) -> bool:
    """Return whether two slopes differ by more than rounding and a hair of time make of it."""
    return any(abs(a - b) > SLACK * size for a, b in zip(one, other, strict=True))
