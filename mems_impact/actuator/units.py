"""Units of a device's parameters and columns, and conversion between SI and scaled units.

The numerics use the scales of the device: mass m2, stiffness k, length d and alpha, with the time
sqrt(m2/k) and the voltage sqrt(k d^3/alpha). In these units m2 = k = d = alpha = 1, as in the
paper. Every conversion is one multiplication or division, with one rounding error.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, Self

from mems_impact._util.units import Scales

KNOWN_UNITS = ("kg", "N/m", "N s/m", "m", "F m", "m/s^2", "s", "V", "rad/s", "Hz", "m/s", "J", "N")
"""SI units of fields and columns, besides products of these and of `DERIVED_UNITS`, such as
"N/m^3". A field without a unit is a pure number."""

DERIVED_UNITS = {
    "rad": "",
    "Pa": "N/m^2",
    "W": "J/s",
    "C": "J/V",
    "A": "C/s",
    "ohm": "V/A",
    "F": "C/V",
}
"""Derived units."""

PARAMETER_UNITS = {
    "m1": "kg",
    "m2": "kg",
    "k": "N/m",
    "c": "N s/m",
    "d": "m",
    "delta": "m",
    "alpha": "F m",
    "g": "m/s^2",
}
"""SI units of the parameters of an `Actuator` that are not dimensionless."""

ENERGY_PER = (
    "energy lost per period", "energy in per period", "energy in per impact", "energy in per blow",
    "friction loss per period",
)  # fmt: skip
COLUMN_UNITS = {
    **dict.fromkeys(["time", "contact", "flight", "life"], "s"),
    **dict.fromkeys(
        [
            "height",
            "x1",
            "x2",
            "step",
            "displacement",
            "formula",
            "closest approach",
            "deflection",
            "slip per period",
            "distance",
        ],
        "m",
    ),
    **dict.fromkeys(["v1", "v2", "impact speed", "mean speed"], "m/s"),
    **dict.fromkeys(["energy lost", "energy in", *ENERGY_PER], "J"),
    **dict.fromkeys([f"displacement per {each}" for each in ("period", "impact", "blow")], "m"),
    **dict.fromkeys(["voltage", "node voltage", "left node voltage"], "V"),
    **dict.fromkeys(["load", "stall force"], "N"),
    **dict.fromkeys(["power", "power in"], "W"),
}
"""The SI unit of every column and statistic that is not dimensionless."""


SCALES = ("mass", "stiffness", "length", "alpha", "time", "voltage")
"""The fields of `DeviceScales`."""


class _Factors(dict[str, float]):
    """Scales by SI unit, including products of units."""

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and self.get(name) is not None

    def __missing__(self, name: str) -> float:
        found = self.get(name)
        if found is None:
            raise KeyError(name)
        return found

    def get(self, name: str, default: Any = None) -> Any:
        """Return the scale of a unit; `default` if the name is not a unit."""
        if super().__contains__(name):
            return super().__getitem__(name)
        try:
            return self._product(name) if name else default
        except (KeyError, ValueError):
            return default

    def _product(self, name: str) -> float:
        """Return the scale of a product like "N s/m^2"; factors after each slash are divisors."""
        factor, (over, *under) = 1.0, name.split("/")
        for sign, group in ((1.0, over), *((-1.0, each) for each in under)):
            for token in group.split():
                base, _, power = token.partition("^")
                if base == "1":
                    continue
                known = super().get(base)
                factor *= (known or self._product(DERIVED_UNITS[base])) ** (
                    sign * float(power or 1)
                )
        return factor


@dataclass(frozen=True, kw_only=True)
class DeviceScales(Scales):
    """The scales of a device, in SI."""

    mass: float = 1.0  # [kg]
    stiffness: float = 1.0  # [N/m]
    length: float = 1.0  # [m]
    alpha: float = 1.0  # [F m]
    time: float = 1.0  # [s]
    voltage: float = 1.0  # [V]

    def __post_init__(self) -> None:
        speed = self.length / self.time
        factors = {
            "kg": self.mass,
            "N/m": self.stiffness,
            "N s/m": self.stiffness * self.time,
            "m": self.length,
            "F m": self.alpha,
            "m/s^2": self.length / self.time / self.time,
            "s": self.time,
            "V": self.voltage,
            "rad/s": 1.0 / self.time,
            "Hz": 1.0 / self.time,
            "m/s": speed,
            "J": self.stiffness * self.length * self.length,
            "N": self.stiffness * self.length,
        }
        object.__setattr__(self, "factors", MappingProxyType(_Factors(factors)))

    def __reduce__(self) -> Any:
        """Pickle the fields, which determine the factors."""
        return partial(DeviceScales, **{name: getattr(self, name) for name in SCALES}), ()

    def unit(self, name: str) -> float:
        """Return the scale of the SI unit `name`, one of `KNOWN_UNITS` or a product of them."""
        if name not in self.factors:
            raise ValueError(
                f"{name!r} is no product of {', '.join((*KNOWN_UNITS, *DERIVED_UNITS))}"
            )
        return self.factors[name]

    @classmethod
    def of_device(cls, m2: float, k: float, d: float, alpha: float) -> Self:
        """Return the scales in which m2 = k = d = alpha = 1."""
        time, voltage = math.sqrt(m2 / k), math.sqrt(k * d / alpha) * d
        return cls(mass=m2, stiffness=k, length=d, alpha=alpha, time=time, voltage=voltage)

    @classmethod
    def of_drive(cls, voltage: float, time: float) -> Self:
        """Return scales of voltage and time alone."""
        return cls(voltage=voltage, time=time)


def scaled_fields(model: Any, units: Mapping[str, str], scales: Scales) -> dict[str, Any]:
    """Return the fields of `model` that have a unit, in scaled units."""
    return {name: _to_scaled(getattr(model, name), unit, scales) for name, unit in units.items()}


def unscaled_fields(model: Any, units: Mapping[str, str], scales: Scales) -> dict[str, Any]:
    """Return the fields of a scaled `model` that have a unit, in the units of the device."""
    return {name: _from_scaled(getattr(model, name), unit, scales) for name, unit in units.items()}


def _to_scaled(value: Any, unit: str, scales: Scales) -> Any:
    if isinstance(value, tuple):
        return tuple(_to_scaled(part, unit, scales) for part in value)
    return None if value is None else scales.into(value, unit)


def _from_scaled(value: Any, unit: str, scales: Scales) -> Any:
    if isinstance(value, tuple):
        return tuple(_from_scaled(part, unit, scales) for part in value)
    return None if value is None else scales.out(value, unit)
