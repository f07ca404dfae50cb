"""Observables of runs and quantities of orbits."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

from mems_impact.errors import InvalidParameter
from mems_impact.tables import unit_of

if TYPE_CHECKING:
    from mems_impact.systems.system import System

__all__ = ["MULTIPLIER", "Observable", "Quantity", "general_quantities"]

# --- Observables: quantities that a model adds to tables and studies.

Reduction = Literal["sum", "mean", "min", "max", "gain"]
AT_EVENTS = ("sum", "mean", "min", "max")


@dataclass(frozen=True)
class Observable:
    """A named quantity of a system.

    Written as plain scalar functions, as all of a system is. At events it is
    ``function(mode, t, before, after, p)``, with the states just before and after; its values stand
    in a column of the table of these events. Without events it is ``function(y, p)`` of the state,
    of which studies tell the gain per period.

    Parameters
    ----------
    name : str
        Heading of its column.
    function : callable
    at : tuple of str, optional
        Names of the guards at whose events it is taken; none for a quantity of the state.
    reduce : {"sum", "mean", "min", "max", "gain"}, optional
        What studies tell of many values: of those at events the sum per period, or the mean,
        smallest or largest; "gain" is the change of a quantity of the state per period.
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


# --- Quantities: numbers that an orbit has, whose derivatives are wanted.


@dataclass(frozen=True)
class Quantity:
    """A number that an orbit has.

    Parameters
    ----------
    name : str
    function : callable
        ``function(orbit)`` returns it, in the units of the system, from what the orbit tells:
        `Orbit.gains`, `Orbit.impacts`, `Orbit.period`, …
    unit : str, optional
    solved : bool, optional
        Whether it needs orbits that solve their equations, and not to first order alone, because
        it depends on derivatives, as `Orbit.multipliers` do.
    costly : bool, optional
        Whether to tell it only where it is asked for by name.

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
        """Return its value on an orbit."""
        return float(self.function(orbit))


def _largest_multiplier(orbit: Any) -> float:
    return math.inf if orbit.found.touches else float(abs(orbit.multipliers[0]))


def _closest_approach(orbit: Any) -> float:
    return orbit.closest_approach


def _impact_speed(orbit: Any) -> float:
    return max(orbit.impact_speeds, default=math.nan)


def _period(orbit: Any) -> float:
    return orbit.period


def _gain(orbit: Any, *, state: str) -> float:
    return orbit.gains[state] / orbit.periods


def _observable(orbit: Any, *, name: str) -> float:
    return orbit.observables[name]


MULTIPLIER = Quantity("largest multiplier", _largest_multiplier, solved=True)


def general_quantities(system: System) -> tuple[Quantity, ...]:
    """Return the quantities of the orbits of any system.

    What each cyclic state gains per period, its observables (over the orbit, as in the tables of
    branches), the period of a limit cycle, the largest impact speed, the closest approach, and the
    largest modulus of a multiplier.
    """
    units, states = system.units, system.states
    cyclic = [states[i] for i in system.automaton.cyclic]
    each = "period" if system.forced else "cycle"
    found: list[Any] = [
        Quantity(f"{state} per {each}", partial(_gain, state=state), unit_of(state, units))
        for state in cyclic
    ]
    found += [
        Quantity(other.name, partial(_observable, name=other.name), unit_of(other.name, units))
        for other in system.observables
    ]
    if not system.forced:
        found.append(Quantity("period", _period, unit_of("time", units)))
    if any(guard.impact for guard in system.automaton.guards):
        found.append(Quantity("impact speed", _impact_speed, unit_of("impact speed", units)))
        closest = "closest approach"
        found.append(Quantity(closest, _closest_approach, unit_of(closest, units)))
    return (*found, MULTIPLIER)
