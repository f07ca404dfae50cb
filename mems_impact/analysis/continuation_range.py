"""Ranges of the parameter of a continuation."""

from __future__ import annotations

import math
from typing import Any

from mems_impact.errors import InvalidParameter
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.state import interval, is_number


def checked_ends(
    system: HybridSystem, parameter: str, stop: Any, back: Any
) -> tuple[tuple[float, float], float]:
    """Return the bounds of a continuation and its direction, 1 or -1.

    Raises InvalidParameter if the bounds leave no interval.
    """
    system.check_parameter(parameter)
    ends = {"stop": stop, "back": back}
    stop, back = (system.units.parse(parameter, value, name) for name, value in ends.items())
    system.checks.continuation(parameter)
    current = system.parameters[parameter]
    check_value(system, parameter, "stop", stop)
    if stop == current:
        allowed = f"another value than {amount(system, parameter, current)}, where the orbit is"
        raise InvalidParameter("stop", stop, allowed)
    if back is None:
        back = current
    check_value(system, parameter, "back", back)
    if (back - current) * (stop - current) > 0.0:
        allowed = f"{amount(system, parameter, current)}, or on the other side of it than stop"
        raise InvalidParameter("back", back, allowed)
    return (min(stop, back), max(stop, back)), math.copysign(1.0, stop - current)


def amount(system: HybridSystem, parameter: str, value: float) -> str:
    """Return a value with its unit."""
    return f"{value:g} {system.units.get(parameter, '')}".rstrip()


def checked_range(
    system: HybridSystem, parameter: str, bounds: tuple[float | str, float | str]
) -> tuple[float, float]:
    """Return the bounds of a parameter as numbers, the lower one first."""
    ends = interval("bounds", bounds, system.units.parse(parameter, bounds, "bounds"))
    for value in ends:
        system.changed(**{parameter: value})
    return ends


def check_value(system: HybridSystem, parameter: str, field: str, value: Any) -> None:
    """Raise InvalidParameter unless the system allows this value of the parameter."""
    if not is_number(value):
        raise InvalidParameter(field, value, f"a finite value of {parameter}")
    system.changed(**{parameter: value})
