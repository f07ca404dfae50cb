"""Observables of runs, quantities of orbits, and accumulators over a window of a run."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.simulation import Events
from mems_impact.hybrid.state import HybridState

__all__ = [
    "MULTIPLIER",
    "EventObserver",
    "Observable",
    "Quantity",
    "StatisticsAccumulator",
    "TimeWindow",
]

# --- Observables.

Reduction = Literal["sum", "mean", "min", "max", "gain"]
AT_EVENTS = ("sum", "mean", "min", "max")


@dataclass(frozen=True)
class Observable:
    """A named quantity of a system, shown in tables and studies.

    It is a plain scalar function, like the other functions of a system. At events it is
    ``function(mode, t, before, after, p)``, with the states just before and after; its values form
    a column of the table of these events. Without events it is ``function(y, p)`` of the state, and
    studies show its gain per period.

    Parameters
    ----------
    name : str
        Heading of its column.
    function : callable
    at : tuple of str, optional
        Names of the guards at whose events it is evaluated; empty for a quantity of the state.
    reduce : {"sum", "mean", "min", "max", "gain"}, optional
        Reduction in studies: for values at events the sum per period, or the mean, smallest or
        largest value; "gain" is the change per period of a quantity of the state.
    unit : str, optional

    See Also
    --------
    System, Quantity, sweep

    Examples
    --------
    >>> import mems_impact as mi
    >>> speed = mi.Observable(
    ...     "impact speed", lambda mode, t, before, after, p: -before.v, at=("floor",), reduce="max"
    ... )
    """

    name: str
    function: Callable[..., Any]
    at: tuple[str, ...] = ()
    reduce: Reduction = "gain"
    unit: str = ""

    def __post_init__(self) -> None:
        allowed = AT_EVENTS if self.at else ("gain",)
        if self.reduce not in allowed:
            raise InvalidParameter("reduce", self.reduce, f"one of {', '.join(allowed)}")


# --- Quantities of orbits.


@dataclass(frozen=True)
class Quantity:
    """A scalar quantity of a periodic orbit.

    Parameters
    ----------
    name : str
    function : callable
        ``function(orbit)`` returns the quantity in the units of the system, computed from
        attributes such as `Orbit.gains`, `Orbit.impacts` or `Orbit.period`.
    unit : str, optional
    solved : bool, optional
        Whether it requires converged orbits rather than first-order approximations, because it
        depends on derivatives, as `Orbit.multipliers` do.
    costly : bool, optional
        Whether to compute it only if it is requested by name.

    See Also
    --------
    sensitivity, optimize, Observable

    Examples
    --------
    >>> import mems_impact as mi
    >>> hardest = mi.Quantity("largest loss", lambda orbit: orbit.impacts["energy lost"].max())
    """

    name: str
    function: Callable[[Any], float]
    unit: str = ""
    solved: bool = False
    costly: bool = False

    def __call__(self, orbit: Any) -> float:
        """Return its value for an orbit."""
        return float(self.function(orbit))


def largest_multiplier(orbit: Any) -> float:
    return math.inf if orbit.found.touches else float(abs(orbit.multipliers[0]))


def closest_approach(orbit: Any) -> float:
    return orbit.closest_approach


def impact_speed(orbit: Any) -> float:
    return max(orbit.impact_speeds, default=math.nan)


def period(orbit: Any) -> float:
    return orbit.period


def gain(orbit: Any, *, state: str) -> float:
    return orbit.gains[state] / orbit.periods


def observable(orbit: Any, *, name: str) -> float:
    return orbit.observables[name]


MULTIPLIER = Quantity("largest multiplier", largest_multiplier, solved=True)


class StatisticsAccumulator(Protocol):
    """Accumulates statistics over the events of a run."""

    def __call__(self, events: Events) -> None:
        """Take the next chunk of events."""

    def anchor(self, border: int) -> HybridState:
        """Return the start of the arc that contains the start (0) or end (1) of the window."""

    def result(self, final: HybridState, borders: Sequence[Floats]) -> Mapping[str, float]:
        """Return the statistics of a run that ended at `final`.

        `borders` are the states at the start and end of the window.
        """


class EventObserver(Protocol):
    """Observes the events of a run and warns the user at its end."""

    def __call__(self, events: Events) -> None:
        """Take the next chunk of events."""

    def tell(self, final: HybridState) -> None:
        """Warn about a run that ended at `final`."""


@dataclass(frozen=True)
class TimeWindow:
    """The part of a run over which statistics are computed.

    Attributes
    ----------
    first, last : float
        In periods; half-open: an event at its end is outside.
    period : float
    """

    first: float
    last: float
    period: float

    def instant(self, border: int) -> tuple[int, float]:
        """Return the start (0) or end (1) as whole periods and the time within the next one."""
        periods = (self.first, self.last)[border]
        whole = math.floor(periods)
        return whole, (periods - whole) * self.period

    def since(self, border: int, cycle: NDArray[np.int64], time: Floats) -> Floats:
        """Return the times since the start (0) or end (1) of the window."""
        at_cycle, at_time = self.instant(border)
        # Subtract whole periods as integers first, so that late instants lose no digits.
        result: Floats = (cycle - at_cycle) * self.period + (time - at_time)
        return result

    def contains(self, events: Events) -> NDArray[np.bool_]:
        """Return which events lie within."""
        inside: NDArray[np.bool_] = self.since(0, events.cycle, events.time) >= 0.0
        return inside & (self.since(1, events.cycle, events.time) < 0.0)

    def until(self, final: HybridState) -> TimeWindow:
        """Return the part before `final`: a failed run may end within the window, or before."""
        reached = final.cycle + final.time / self.period
        return TimeWindow(self.first, max(self.first, min(self.last, reached)), self.period)
