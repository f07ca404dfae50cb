"""What values such devices have, by quantity, and what one far outside was meant to be.

All of it concerns devices in SI; a dimensionless one may have any numbers.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

from mems_impact.warnings import UnitsWarning

if TYPE_CHECKING:
    from mems_impact.actuator.drives import Drive
    from mems_impact.actuator.parameters import Actuator

__all__ = ["look_at_device", "look_at_drive", "look_at_target"]


class Range(NamedTuple):
    """Between what a quantity may lie, and where it usually does; 0 is always in it."""

    low: float
    usual: float
    high: float


# More than an order beyond what is published of such devices, on either side.
MASS, LENGTH = Range(1e-13, 1e-7, 1e-3), Range(1e-9, 5e-6, 1e-3)
DEVICE = {
    "m1": MASS,
    "m2": MASS,
    "k": Range(1e-4, 10.0, 1e6),
    "c": Range(0.0, 1e-4, 1.0),
    "d": LENGTH,
    "delta": LENGTH,
    "mu_s": Range(0.0, 0.4, 5.0),
    "mu_d": Range(0.0, 0.3, 5.0),
    "alpha": Range(1e-25, 1e-19, 1e-14),
    "g": Range(0.0, 10.0, 300.0),
}
VOLTAGE = Range(0.0, 30.0, 1e4)
PERIOD = Range(1e-8, 1e-3, 300.0)
TARGETS = {
    "m": Range(1e-13, 1e-7, 1e-3),
    "m/s": Range(1e-13, 1e-4, 100.0),
    "V": Range(1e-3, 30.0, 1e4),
    "rad/s": Range(10.0, 1e4, 1e9),
}
PREFIXES = {"m": 1e-3, "u": 1e-6, "n": 1e-9, "k": 1e3}
GRAMS = {"g": 1e-3, "mg": 1e-6, "ug": 1e-9, "ng": 1e-12}
HALF_PERMITTIVITY = 4.427e-12  # of vacuum [F/m]
SLOW = 1500.0  # ratio of resonance and frequency from which kilohertz may be meant
NEAR = 30.0  # ratio of both within which they are
HERTZ = 1.3  # ratio of two resonances that are the same


def look_at_device(actuator: Actuator) -> None:
    """Warn, once, of parameters that look like ones in other units."""
    from mems_impact.actuator.parameters import PARAMETER_UNITS

    if actuator.units != "SI":
        return
    for name, within in DEVICE.items():
        value, unit = getattr(actuator, name), PARAMETER_UNITS.get(name, "")
        if name == "alpha" and value > within.high:
            alpha = HALF_PERMITTIVITY * value
            _tell(f"{_far(name, value, unit, within)}; an area of {value:g} m^2, of which alpha is "
                  f"{alpha:.4g} F m?")  # fmt: skip
        else:
            _look(name, value, unit, within)


def look_at_drive(actuator: Actuator, drive: Drive) -> None:
    """Warn, once, of voltages and times that look like ones in other units."""
    if actuator.units != "SI":
        return
    for name in drive.names:
        if drive.unit(name) == "V":
            _look(name, drive.number(name), "V", VOLTAGE)
    resonance = math.sqrt(actuator.k / actuator.m2) / (2.0 * math.pi)
    _look("period", drive.period, "s", PERIOD._replace(usual=1.0 / resonance))
    omega = getattr(drive, "omega", None)
    frequency = omega / (2.0 * math.pi) if omega else math.inf
    in_kilohertz = 1e3 * frequency
    if frequency * SLOW < resonance and resonance / NEAR < in_kilohertz < resonance * NEAR:
        _tell(f"frequency = {frequency:.4g} Hz lies far below the resonance, {resonance:.4g} Hz; "
              f"{frequency:.4g} kHz?")  # fmt: skip


def look_at_target(actuator: Actuator, quantity: str, value: float, unit: str) -> None:
    """Warn, once, of a measured number that looks like one in another unit."""
    if actuator.units != "SI":
        return
    if unit in TARGETS:
        _look(quantity, value, unit, TARGETS[unit])
    if quantity == "resonance" and value > 0.0:
        own = math.sqrt(actuator.k / actuator.m2)
        turned = 2.0 * math.pi * value
        if 1.0 / HERTZ < turned / own < HERTZ:
            _tell(f"resonance = {value:g} rad/s, where the device has {own:.4g}; "
                  f"{value:g} Hz, {turned:.6g} rad/s?")  # fmt: skip


def _look(name: str, value: float, unit: str, within: Range) -> None:
    size = abs(value)
    if size == 0.0 or within.low <= size <= within.high:
        return
    told = _far(name, value, unit, within)
    meant = sorted(_meant(size, unit, within), key=lambda each: each[0])
    _tell(f"{told}; {value:g} {meant[0][1]}?" if meant else told)


def _far(name: str, value: float, unit: str, within: Range) -> str:
    amount = f"{value:g} {unit}".rstrip()
    limits = f"{within.low:g} to {within.high:g} {unit}".rstrip()
    return f"{name} = {amount}, where such devices have {limits}"


def _meant(size: float, unit: str, within: Range) -> Iterator[tuple[float, str]]:
    """Yield units in which a number would be a usual one, and how far from that it is."""
    if unit == "kg":
        others = GRAMS
    elif unit:
        others = {f"{prefix}{unit}": factor for prefix, factor in PREFIXES.items()}
    else:
        others = {"%": 1e-2}
    for other, factor in others.items():
        if within.low <= size * factor <= within.high:
            yield abs(math.log(size * factor / within.usual)), other


@cache
def _tell(message: str) -> None:
    """Warn of it the first time."""
    warnings.warn(message, UnitsWarning, stacklevel=5)
