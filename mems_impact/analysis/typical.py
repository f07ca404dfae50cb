"""Typical sizes: from what a user says of names or units to the units of the numerics."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.scaling import Typical, power_of_two
from mems_impact.hybrid.written import Definition, named, writes_into_arrays

__all__ = ["of_units", "typical_of"]

# Derived units of the SI in its base units: powers of them by name.
DERIVED: dict[str, dict[str, int]] = {
    "rad": {},
    "Hz": {"s": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "C": {"A": 1, "s": 1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "F": {"kg": -1, "m": -2, "s": 4, "A": 2},
    "H": {"kg": 1, "m": 2, "s": -2, "A": -2},
    "T": {"kg": 1, "s": -2, "A": -1},
    "Wb": {"kg": 1, "m": 2, "s": -2, "A": -1},
}


def of_units(unit: str, sizes: Mapping[str, float]) -> float | None:
    """Return the typical size of what has a unit, from those of other units.

    Parameters
    ----------
    unit : str
        Such as "m/s^2", "N s/m"; all that follows a stroke divides.
    sizes : mapping of str to float
        By unit, base or derived.

    Returns
    -------
    float or None
        None if the sizes say nothing about it.
    """
    if unit in sizes:
        return sizes[unit]
    size, known = 1.0, False
    for k, side in enumerate(unit.split("/")):
        for name, exponent in re.findall(r"([A-Za-z]+)(?:\^(-?\d+))?", side):
            power = (1 if k == 0 else -1) * int(exponent or 1)
            base = {name: 1} if name in sizes else DERIVED.get(name, {name: 1})
            for each, times in base.items():
                known = known or each in sizes
                size *= sizes.get(each, 1.0) ** (power * times)
    return size if known else None


def typical_of(
    typical: Mapping[str, float],
    *,
    definition: Definition,
    values: Mapping[str, float],
    initial: Mapping[str, float],
    units: Mapping[str, str],
    time: float,
) -> Typical:
    """Return the units of the numerics.

    Parameters
    ----------
    typical : mapping of str to float
        By the names of states and parameters, "time", or units.
    definition : Definition
    values : mapping of str to float
        Of the parameters.
    initial : mapping of str to float
        Where runs start.
    units : mapping of str to str
    time : float
        Typical time where nothing is said.

    Raises
    ------
    InvalidParameter
        If a size belongs to nothing.
    """
    names = {*definition.states, *definition.parameters, "time"}
    parts = {part for unit in units.values() for part in re.findall(r"[A-Za-z]+", unit)}
    base = {name for part in parts for name in (part, *DERIVED.get(part, ()))}
    for name in typical:
        if name not in names | base | set(units.values()):
            allowed = f"typical sizes of {', '.join(sorted(names))}, or of units"
            raise InvalidParameter("typical", name, allowed)

    sizes = {name: size for name, size in typical.items() if name not in names}

    def size_of(name: str, otherwise: float) -> float:
        given = typical.get(name)
        if given is None and sizes and name in units:
            given = of_units(units[name], sizes)
        return power_of_two(otherwise if given is None else given)

    result = Typical(
        states=tuple(size_of(name, initial.get(name, 1.0)) for name in definition.states),
        # Over a parameter orbits are followed: where nothing is said, its own size is typical.
        parameters=tuple(size_of(name, value) for name, value in values.items()),
        time=size_of("time", time),
    )
    start = [initial.get(name, 0.0) for name in definition.states]
    margins = {
        guard.name: _size_of_margin(definition, guard, result.states, start, values)
        for guard in definition.guards
    }
    return Typical(
        states=result.states,
        parameters=result.parameters,
        time=result.time,
        margins=tuple(margins.items()),
    )


def _size_of_margin(
    definition: Definition,
    guard: Any,
    sizes: tuple[float, ...],
    start: list[float],
    values: Mapping[str, float],
) -> float:
    """Return by how much a margin changes where all states do by what is typical of them.

    Near the start of runs; 1 where the margin does not say.
    """
    p = named("Parameters", tuple(values))(*values.values())
    mode = int(guard.modes[0]) if guard.modes else 0
    total = 0.0
    for j, size in enumerate(sizes):
        found = []
        for sign in (-0.5, 0.5):
            y = [value + sign * size * (i == j) for i, value in enumerate(start)]
            state = np.array(y) if writes_into_arrays(definition.flow) else None
            try:
                found.append(
                    guard.margin(
                        mode,
                        0.0,
                        named("State", definition.states)(*y) if state is None else state,
                        p,
                    )
                )
            except (ArithmeticError, ValueError):
                return 1.0
        total += abs(found[1] - found[0])
    return power_of_two(total) if math.isfinite(total) else 1.0
