"""Units: the one place where a device in SI becomes dimensionless, and its results SI again.

Inside, everything is integrated in the device's own units: mass m2, stiffness k, length d and
alpha, from which time sqrt(m2/k) and voltage sqrt(k d^3/alpha) follow. In them m2 = k = d = alpha
= 1, as in the paper. Every conversion is one multiplication or division, so that there and back is
exact to one rounding.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

__all__ = ["DIMENSIONLESS", "UNITS", "Scales", "inner", "scaled_fields", "unscaled_fields"]

UNITS = ("kg", "N/m", "N s/m", "m", "F m", "m/s^2", "s", "V", "rad/s", "Hz", "m/s", "J", "N")
"""The SI units that fields and columns may declare; whatever declares none is a pure number."""


@dataclass(frozen=True, kw_only=True)
class Scales:
    """The inner units, in SI.

    Parameters
    ----------
    mass : float
        [kg]
    stiffness : float
        [N/m]
    length : float
        [m]
    alpha : float
        [F m]
    time : float
        [s]
    voltage : float
        [V]
    named : bool
        Whether results carry the name of their unit; False where the device is dimensionless.
    """

    mass: float = 1.0
    stiffness: float = 1.0
    length: float = 1.0
    alpha: float = 1.0
    time: float = 1.0
    voltage: float = 1.0
    named: bool = True

    @classmethod
    def of_device(cls, m2: float, k: float, d: float, alpha: float) -> Self:
        """Return the scales in which m2 = k = d = alpha = 1."""
        time, voltage = math.sqrt(m2 / k), math.sqrt(k * d / alpha) * d
        return cls(mass=m2, stiffness=k, length=d, alpha=alpha, time=time, voltage=voltage)

    @classmethod
    def of_drive(cls, voltage: float, time: float) -> Self:
        """Return scales of voltage and time alone."""
        return cls(voltage=voltage, time=time)

    def unit(self, name: str) -> float:
        """Return the inner unit of what has the SI unit `name`, one of `UNITS`."""
        match name:
            case "kg":
                return self.mass
            case "N/m":
                return self.stiffness
            case "N s/m":
                return self.stiffness * self.time
            case "m":
                return self.length
            case "F m":
                return self.alpha
            case "m/s^2":
                return self.length / self.time / self.time
            case "s":
                return self.time
            case "V":
                return self.voltage
            case "rad/s" | "Hz":
                return 1.0 / self.time
            case "m/s":
                return self.length / self.time
            case "J":
                return self.stiffness * self.length * self.length
            case "N":
                return self.stiffness * self.length
        raise ValueError(f"{name!r} is not one of {', '.join(UNITS)}")

    def out(self, value: Any, name: str) -> Any:
        """Return an inner value (number or array) in the unit `name` of the device."""
        return value * self.unit(name)

    def into(self, value: Any, name: str) -> Any:
        """Return a value of the device, in the unit `name`, in inner units."""
        return value / self.unit(name)

    def label(self, heading: str, name: str) -> str:
        """Return the heading of a column with its unit, or alone for a dimensionless device."""
        return f"{heading} [{name}]" if self.named and name else heading


DIMENSIONLESS = Scales(named=False)
"""Of a dimensionless device: what goes in comes out."""


def scaled_fields(model: Any, units: Mapping[str, str], scales: Scales) -> dict[str, Any]:
    """Return the fields of `model` that have a unit, in inner units."""
    return {name: _into(getattr(model, name), unit, scales) for name, unit in units.items()}


def unscaled_fields(model: Any, units: Mapping[str, str], scales: Scales) -> dict[str, Any]:
    """Return the fields of an inner `model` that have a unit, in the units of the device."""
    return {name: _out(getattr(model, name), unit, scales) for name, unit in units.items()}


def inner(actuator: Any, drive: Any) -> tuple[Any, Any]:
    """Return the dimensionless actuator and drive that are integrated in place of the given."""
    scales = actuator.scales
    if scales is DIMENSIONLESS:
        return actuator, drive
    return actuator.to_dimensionless(), drive.scaled(scales.voltage, scales.time)


def _into(value: Any, unit: str, scales: Scales) -> Any:
    if isinstance(value, tuple):
        return tuple(_into(part, unit, scales) for part in value)
    return None if value is None else scales.into(value, unit)


def _out(value: Any, unit: str, scales: Scales) -> Any:
    if isinstance(value, tuple):
        return tuple(_out(part, unit, scales) for part in value)
    return None if value is None else scales.out(value, unit)
