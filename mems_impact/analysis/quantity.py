"""Quantities: numbers that an orbit has, whose derivatives are wanted."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from mems_impact.tables.common import unit_of

if TYPE_CHECKING:
    from mems_impact.analysis.orbit import Orbit
    from mems_impact.analysis.system import System

__all__ = ["MULTIPLIER", "Quantity", "general_quantities"]


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
    function: Callable[[Orbit], float]
    unit: str = ""
    solved: bool = False
    costly: bool = False

    def __call__(self, orbit: Orbit) -> float:
        """Return its value on an orbit."""
        return float(self.function(orbit))


def _largest_multiplier(orbit: Orbit) -> float:
    return math.inf if orbit.found.touches else float(abs(orbit.multipliers[0]))


def _closest_approach(orbit: Orbit) -> float:
    return orbit.closest_approach


def _impact_speed(orbit: Orbit) -> float:
    return max(orbit.impact_speeds, default=math.nan)


def _period(orbit: Orbit) -> float:
    return orbit.period


def _gain(orbit: Orbit, *, state: str) -> float:
    return orbit.gains[state] / orbit.periods


def _observable(orbit: Orbit, *, name: str) -> float:
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
