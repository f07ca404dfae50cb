"""Observables of runs, quantities of orbits, and accumulators over a window of a run."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.simulation import Events, Trajectory

# --- Observables

Reduction = Literal["sum", "mean", "min", "max", "gain"]
AT_EVENTS = ("sum", "mean", "min", "max")


@dataclass(frozen=True)
class Observable:
    """A named quantity of a system, shown in tables and studies.

    A plain scalar function, like the other functions of a system. ``function(mode, t, before,
    after, p)`` receives the states just before and after an event; its values form a column of the
    table of the events. Without events, ``function(y, p)`` receives the state, and studies show the
    gain per period.

    Parameters
    ----------
    name : str
        Heading of its column.
    function : callable
    at : tuple of str, optional
        Names of the guards at whose events the function is evaluated; empty for a quantity of the
        state.
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


# --- Quantities of orbits


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
        Whether the function requires converged orbits rather than first-order approximations,
        because it depends on derivatives, as `Orbit.multipliers` do.
    costly : bool, optional
        Whether to compute the quantity only if requested by name.

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
    """Return the largest modulus of a multiplier; infinite at a touch."""
    return math.inf if orbit.numeric.touches else float(abs(orbit.multipliers[0]))


def closest_approach(orbit: Any) -> float:
    """Return the smallest gap at which bodies turned back without an impact."""
    return orbit.closest_approach


def impact_speed(orbit: Any) -> float:
    """Return the largest impact speed, NaN without an impact."""
    return max(orbit.impact_speeds, default=math.nan)


def period(orbit: Any) -> float:
    """Return the period."""
    return orbit.period


def gain(orbit: Any, *, state: str) -> float:
    """Return the gain of a cyclic state per period."""
    return orbit.gains[state] / orbit.periods


def observable(orbit: Any, *, name: str) -> float:
    """Return an observable over the orbit."""
    return orbit.observables[name]


MULTIPLIER = Quantity("largest multiplier", largest_multiplier, solved=True)


# --- Observers of runs


class EventObserver:
    """Observes the events of a run; its methods do nothing by default."""

    def __call__(self, events: Events) -> None:
        """Take the next chunk of events."""

    def warn(self, trajectory: Trajectory) -> None:
        """Warn about the run, which may have failed."""

    def check(self) -> None:
        """Raise FunctionError if a function is wrong along the run, which is complete."""


class EventRecorder(EventObserver):
    """The events of a run, as chunks."""

    def __init__(self) -> None:
        self.chunks: list[Events] = []

    def __call__(self, events: Events) -> None:
        """Take the next chunk of events."""
        self.chunks.append(events)
