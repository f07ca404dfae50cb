"""The numbers of an actuator's orbit that its designers want to move."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from mems_impact.analysis.quantity import MULTIPLIER, Quantity

__all__ = ["actuator_quantities"]


def _per_period(orbit: Any) -> float:
    return float(orbit.step / orbit.periods)


def _per_impact(orbit: Any) -> float:
    impacts = len(orbit.impact_speeds)
    return float(orbit.step / impacts) if impacts else math.nan


def _mean_speed(orbit: Any) -> float:
    return float(orbit.step / (orbit.periods * orbit.period))


def _impact_speed(orbit: Any) -> float:
    return float(max(orbit.impact_speeds, default=math.nan))


def _closest_approach(orbit: Any) -> float:
    return float(orbit.closest_approach)


def _energy_lost(orbit: Any) -> float:
    return float(orbit.observables["energy lost"] / orbit.periods)


def _energy_given(orbit: Any) -> float:
    from mems_impact.actuator.design.energy import energy  # which needs the system itself

    return energy(orbit).given / orbit.periods


FUNCTIONS = {
    "displacement per period": _per_period,
    "mean speed": _mean_speed,
    "displacement per impact": _per_impact,
    "impact speed": _impact_speed,
    "closest approach": _closest_approach,
    "energy lost per period": _energy_lost,
}
"""By the names that tables and statistics have for them."""


def actuator_quantities(units: Mapping[str, str]) -> tuple[Quantity, ...]:
    """Return the quantities of an actuator's orbits.

    Of the energy, what impacts lose; asked for, what the drive gives too, which takes an
    integration of the orbit's arcs.
    """
    known = [Quantity(name, each, units.get(name, "")) for name, each in FUNCTIONS.items()]
    joule = units.get("energy lost per period", "")
    given = Quantity("energy given per period", _energy_given, joule, costly=True)
    return (*known, given, MULTIPLIER)
