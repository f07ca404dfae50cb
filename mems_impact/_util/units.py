"""Conversion between internal units and the user's units.

The numerics use units in which the values of a system are of order one. Every conversion is one
multiplication or division, so that the round trip is exact to one rounding.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

SI_PREFIXES = {
    -24: "y", -21: "z", -18: "a", -15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k",
    6: "M", 9: "G",
}  # fmt: skip
"""SI prefixes by their powers of ten."""
PREFIXED = ("m", "s", "V", "Hz", "J", "N", "F", "W", "C", "A", "Pa", "ohm")
"""Units that take prefixes, alone or as the first factor; not the kilogram, which has one."""


def si_prefixed(unit: str, size: float) -> tuple[int, str]:
    """Return the power of ten of the prefix for numbers of a size, and the unit with the prefix.

    The first factor of a unit takes the prefix; 0 and the unit itself if it takes none.

    >>> si_prefixed("m", 5e-6), si_prefixed("kg", 2e-6), si_prefixed("rad/s", 750.0)
    ((-6, 'µm'), (-6, 'mg'), (0, 'rad/s'))
    """
    first = re.split("[ /]", unit)[0]
    kilo = 3 if first == "kg" else 0  # the prefix that the kilogram has
    if not (kilo or first in PREFIXED) or not 0.0 < size < math.inf:
        return 0, unit
    power = 3 * math.floor((math.log10(size) + kilo) / 3.0 + 1e-9)
    power = min(max(power, min(SI_PREFIXES)), max(SI_PREFIXES))
    return power - kilo, SI_PREFIXES[power] + unit.removeprefix("k" if kilo else "")


def si_amount(value: float, unit: str) -> str:
    """Return a number with its SI unit, with a prefix, as text of messages and files.

    >>> si_amount(2.5e-7, "m"), si_amount(48.8, "V"), si_amount(0.24, "")
    ('250 nm', '48.8 V', '0.24')
    """
    power, name = si_prefixed(unit, abs(value))
    return f"{value / 10.0**power:.4g} {name}".rstrip().replace("µ", "u")


@dataclass(frozen=True, kw_only=True)
class Scales:
    """The units of the numerics, in those of the user."""

    # In each unit of the user ("m/s"); 1 for all others.
    factors: Mapping[str, float] = field(default_factory=dict)
    named: bool = True  # False if all quantities are pure numbers

    def __post_init__(self) -> None:
        object.__setattr__(self, "factors", MappingProxyType(dict(self.factors)))

    def __reduce__(self) -> Any:
        """Pickle the factors as a dict, since a mapping proxy cannot be pickled."""
        return Scales.of, (dict(self.factors), self.named)

    @staticmethod
    def of(factors: Mapping[str, float], named: bool) -> Scales:
        """Return scales with these factors; `DIMENSIONLESS` if nothing has a unit."""
        return Scales(factors=factors, named=named) if factors or named else DIMENSIONLESS

    def unit(self, name: str) -> float:
        """Return the unit of the numerics, in the unit `name`."""
        return self.factors.get(name, 1.0)

    def out(self, value: Any, name: str) -> Any:
        """Return a value of the numerics (number or array) in the unit `name`."""
        return value * self.unit(name) if name in self.factors else value

    def into(self, value: Any, name: str) -> Any:
        """Return a value in the unit `name` in the units of the numerics."""
        return value / self.unit(name) if name in self.factors else value

    def label(self, heading: str, name: str) -> str:
        """Return a heading with its unit, if it has one."""
        return f"{heading} [{name}]" if self.named and name else heading


DIMENSIONLESS = Scales(named=False)
"""Scales of a dimensionless system, without conversion."""
