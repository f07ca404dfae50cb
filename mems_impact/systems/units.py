"""Units of the quantities of a system, and conversion from and to its scaled variables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from mems_impact._util.quantities import quantities
from mems_impact._util.units import Scales
from mems_impact.hybrid.definition import Typical
from mems_impact.tables import name_of, unit_of

Conversion = Callable[[str, Any], Any]
"""Conversion of a number or a column of that heading to the units of tables."""


class Units(Mapping[str, str]):
    """Units by name, without dimensionless quantities, and the scales of variables.

    A heading is a name, "time", or the heading of a column, such as ``v2 before``. `names` has
    units of states, parameters, observables and ``"time"``, `margin_names` of the margins of
    guards. Variables are scaled by `typical` magnitudes if `is_scaled`; `sizes` has such magnitudes
    of states, parameters and ``"time"`` by name, in place of scales by unit. `symbols` are of
    parameters in figures, where they differ from the names.
    """

    def __init__(
        self,
        names: Mapping[str, str],
        scales: Scales,
        *,
        typical: Typical | None = None,
        sizes: Mapping[str, float] | None = None,
        margin_names: Mapping[str, str] | None = None,
        symbols: Mapping[str, str] | None = None,
        is_scaled: bool = True,
    ) -> None:
        self._names, self.scales, self.is_scaled = dict(names), scales, is_scaled
        self.typical, self._sizes = typical, sizes
        self._margins = dict(typical.margins) if typical else {}
        self._margin_names, self.symbols = margin_names or {}, symbols or {}

    def __getitem__(self, name: str) -> str:
        return self._names[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    @property
    def shown(self) -> Mapping[str, str]:
        """The units by name; none of a dimensionless system."""
        return self._names if self.scales.named else {}

    def parse(self, name: str, values: Any, field: str = "") -> Any:
        """Return values of a parameter, a state or the time, with texts as numbers in the unit.

        Texts with units ("70 V") and quantities of pint are converted, other values are returned
        unchanged. `field` is the name of the argument in errors, by default `name`. Raises
        InvalidParameter if a text has a unit of another kind, or the system is dimensionless.
        """
        return quantities(field or name, values, unit_of(name, self) if self else None)

    def factor(self, heading: str) -> float:
        """Return the scale of the quantity with a heading."""
        if self._sizes is not None:
            return self._sizes.get(name_of(heading, self._sizes), 1.0)
        factors = self.scales.factors
        return factors.get(unit_of(heading, self), 1.0) if factors else 1.0

    def into(self, name: str, value: float) -> float:
        """Return a value of a parameter, a state or the time in scaled units."""
        return value / self.factor(name)

    def out(self, heading: str, value: Any) -> Any:
        """Return a scaled value, or an array, in the system's units."""
        factor = self.factor(heading)
        return value if factor == 1.0 else value * factor

    def amount(self, heading: str, value: float) -> str:
        """Return a scaled number in the system's units, as text."""
        return f"{self.out(heading, value):.9g} {unit_of(heading, self)}".rstrip()

    def label(self, name: str) -> str:
        """Return a name with its unit."""
        return self.scales.label(name, self.get(name, ""))

    def margin_factor(self, guard: str) -> float:
        """Return the scale of the margin of a guard."""
        return self._margins.get(guard, 1.0)

    def margin_amount(self, guard: str, value: float, *, rate: bool = False) -> str:
        """Return the margin of a guard, or its rate, in the system's units, as text."""
        unit = self._margin_names.get(guard, "")
        factor = self.scales.unit(unit) if unit else self.margin_factor(guard)
        factor /= self.factor("time") if rate else 1.0
        unit += "/s" if rate and unit else ""
        return f"{value * factor:.3g} {unit if self.scales.named else ''}".rstrip()
