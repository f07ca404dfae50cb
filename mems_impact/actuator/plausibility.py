"""Plausible ranges of parameters of devices in SI units, and warnings outside them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from mems_impact._util.warning_scopes import warn
from mems_impact.actuator.design.data_sheet_quantities import OF_PARAMETER
from mems_impact.actuator.design.static_forces import static_contact
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.geometry.base import Finding
from mems_impact.actuator.geometry.breakdown import breakdown
from mems_impact.actuator.parameters import ActuatorParameters
from mems_impact.actuator.plausible_ranges import LENGTH, MASS, STIFFNESS, Range
from mems_impact.actuator.terms.base import Term, drive_unit
from mems_impact.actuator.units import PARAMETER_UNITS
from mems_impact.errors import UnitsWarning, ValidityWarning

DEVICE_RANGES = {
    "m1": MASS,
    "m2": MASS,
    "k": STIFFNESS,
    "c": Range(0.0, 1e-4, 1.0),
    "d": LENGTH,
    "delta": LENGTH,
    "mu_s": Range(0.0, 0.4, 5.0),
    "mu_d": Range(0.0, 0.3, 5.0),
    "alpha": Range(1e-25, 1e-19, 1e-14),
    "g": Range(0.0, 10.0, 300.0),
}
VOLTAGE, CHARGE = Range(0.0, 30.0, 1e4), Range(1e-19, 1e-12, 1e-7)
PERIOD = Range(1e-8, 1e-3, 300.0)
TARGET_RANGES = {
    "m": Range(1e-13, 1e-7, 1e-3),
    "m/s": Range(1e-13, 1e-4, 100.0),
    "V": Range(1e-3, 30.0, 1e4),
    "rad/s": Range(10.0, 1e4, 1e9),
}
LIKELY_PREFIXES = {"m": 1e-3, "u": 1e-6, "n": 1e-9, "k": 1e3}
ALTERNATIVE_UNITS = {
    "kg": {"g": 1e-3, "mg": 1e-6, "ug": 1e-9, "ng": 1e-12},
    "m": {"mm": 1e-3, "um": 1e-6, "nm": 1e-9},
    "s": {"ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "rad": {"deg": math.pi / 180.0},
    "ohm": {"kohm": 1e3, "Mohm": 1e6, "Gohm": 1e9},
    "V/s": {"V/ms": 1e3, "V/us": 1e6},
    "A": {"uA": 1e-6, "nA": 1e-9},
    "C": {"nC": 1e-9, "pC": 1e-12, "fC": 1e-15},
    "F": {"uF": 1e-6, "nF": 1e-9, "pF": 1e-12, "fF": 1e-15},
    "": {"%": 1e-2},
}
"""Likely alternatives of units that have more than the common prefixes."""

LENGTH_UNITS = {"mm": 1e3, "um": 1e6}  # factors of a number per millimetre or micrometre
VOLTAGE_SAMPLES = 256  # of a period, for its largest voltage
HALF_PERMITTIVITY = 4.427e-12  # of vacuum [F/m]
QUASI_STATIC_RATIO = 300.0  # of resonance and frequency, beyond which the resonance plays no part
RESONANCE_RATIO = 30.0  # largest ratio of a plausible frequency to the resonance
EQUAL_RESONANCE_RATIO = 1.3  # largest ratio of resonances that count as equal


def check_plausible_device(actuator: ActuatorParameters) -> None:
    """Warn once of parameters that seem to be given in other units."""
    if actuator.units != "SI":
        return
    for name, within in DEVICE_RANGES.items():
        value, unit = getattr(actuator, name), PARAMETER_UNITS.get(name, "")
        label = f"{OF_PARAMETER[name]} {name}"  # as in a data sheet and in the paper
        if name == "alpha" and value > within.high:
            if not LENGTH.low <= actuator.d <= LENGTH.high:
                continue  # computed from pull-in voltage and gap, it is wrong as the gap is
            alpha = HALF_PERMITTIVITY * value
            message = _range_message(label, value, unit, within)
            _warn_once(f"{message}; an area of {value:g} m^2, for which alpha is {alpha:.4g} F m?")
        else:
            _check(label, value, unit, within)
    for term in actuator.terms:
        _check_term(term)
    for each in _drawn(actuator):
        if each.value > each.limit:
            amounts = f"{each.value:.3g} {each.unit}".rstrip(), f"{each.limit:g} {each.unit}"
            message = f"{each.quantity} = {amounts[0]}, above {amounts[1].rstrip()}: {each.formula}"
            _warn_once(f"{message} ({each.source})", ValidityWarning)


def _drawn(actuator: ActuatorParameters) -> Sequence[Finding]:
    """Return the quantities computed from the drawing of a device, if there is one."""
    return () if actuator.geometry is None else actuator.geometry.findings()


def check_plausible_drive(actuator: ActuatorParameters, drive: Drive) -> None:
    """Warn once of voltages and times that seem to be given in other units."""
    if actuator.units != "SI":
        return
    for name in drive.names:
        if drive.unit(name) == "V":
            unit = drive_unit(actuator.terms)
            _check(name, drive.number(name), unit, CHARGE if unit == "C" else VOLTAGE)
    _check_times(actuator, drive, "")
    if drive_unit(actuator.terms) == "V":
        _check_voltage(actuator, _peak(drive))


def voltage_limits(actuator: ActuatorParameters) -> Sequence[Finding]:
    """Return the voltages in SI at which the electrodes fail, such as the breakdown of a gap."""
    limits = [each for each in _drawn(actuator) if each.unit == "V"]
    if not limits and all(term.plates for term in actuator.terms):
        limits = [breakdown(actuator.d - actuator.delta)]
    return limits


def _check_voltage(actuator: ActuatorParameters, peak: float) -> None:
    """Warn of a voltage at which the electrodes fail."""
    for each in voltage_limits(actuator):
        if peak > each.value:
            limit = f"{each.quantity}, {each.value:.3g} V"
            message = f"the drive reaches {peak:.4g} V, above the {limit}: {each.formula}"
            _warn_once(f"{message} ({each.source})", ValidityWarning)


def _check_times(actuator: ActuatorParameters, drive: Drive, prefix: str) -> None:
    """Warn of periods and frequencies, also of nested drives."""
    resonance = math.sqrt(actuator.k / actuator.m2) / (2.0 * math.pi)
    _check(f"{prefix}period", drive.period, "s", PERIOD._replace(usual=1.0 / resonance))
    omega = getattr(drive, "omega", None)
    frequency = omega / (2.0 * math.pi) if omega else math.inf
    if QUASI_STATIC_RATIO * resonance < frequency < math.inf:
        _warn_once(
            f"{prefix}frequency = {frequency:.4g} Hz lies far above the resonance, "
            f"{resonance:.4g} Hz, where the block hardly moves"
        )
    near = (
        drive_unit(actuator.terms) == "V"
        and resonance / RESONANCE_RATIO < 1e3 * frequency < resonance * RESONANCE_RATIO
    )
    if (
        near
        and frequency * QUASI_STATIC_RATIO < resonance
        and 0.0 < _peak(drive) < (contact := static_contact(actuator))
    ):
        _warn_once(
            f"{prefix}frequency = {frequency:.4g} Hz lies far below the resonance, "
            f"{resonance:.4g} Hz, where the block needs {contact:.4g} V to "
            f"reach a stopper; {frequency:.4g} kHz?"
        )
    for name in type(drive).model_fields:
        if isinstance(within := getattr(drive, name), Drive):
            _check_times(actuator, within, f"{prefix}{name}.")


def _peak(drive: Drive) -> float:
    """Return the largest sampled voltage."""
    times = np.linspace(0.0, drive.period, VOLTAGE_SAMPLES, endpoint=False)
    return float(max(np.abs(drive.value(times, channel=side)).max() for side in drive.sides))


def _check_term(term: Term) -> None:
    """Warn of implausible numbers of a term, except for defaults."""
    for field, info in type(term).model_fields.items():
        name, value = f"{term.name()}.{field}", getattr(term, field)
        within = term.plausible.get(field)
        if within is None or value is None or value == info.default:
            continue
        if name == "compliant_stopper.stiffness" and not _is_stiffness(term):
            continue
        unit = "rad" if field == "angle" else term.units.get(field, "")
        size = max(value) if isinstance(value, tuple) else value
        if name == "squeeze_film.free_path_pressure" and 0.0 < size < within.low:
            far = _range_message(name, size, unit, within)
            _warn_once(f"{far}; {size:g} m, the mean free path alone?")
        else:
            _check(name, size, unit, within)


def _is_stiffness(term: Any) -> bool:
    """Return whether the stiffness of a stopper is in N/m, not the factor of a power law."""
    return bool(term.exponent == 1.0 or term.depth != type(term).model_fields["depth"].default)


def check_plausible_target(
    actuator: ActuatorParameters, quantity: str, value: float, unit: str
) -> None:
    """Warn once of a measured number that seems to be given in another unit."""
    if actuator.units != "SI":
        return
    if unit in TARGET_RANGES:
        _check(quantity, value, unit, TARGET_RANGES[unit])
    if quantity == "resonance" and value > 0.0:
        resonance = math.sqrt(actuator.k / actuator.m2)
        angular = 2.0 * math.pi * value
        if 1.0 / EQUAL_RESONANCE_RATIO < angular / resonance < EQUAL_RESONANCE_RATIO:
            _warn_once(f"resonance = {value:g} rad/s, but {resonance:.4g} rad/s for the device; "
                  f"{value:g} Hz, {angular:.6g} rad/s?")  # fmt: skip


def _check(name: str, value: float, unit: str, within: Range) -> None:
    size = abs(value)
    if size == 0.0 or within.low <= size <= within.high:
        return
    message = _range_message(name, value, unit, within)
    units = sorted(_plausible_units(size, unit, within), key=lambda each: each[0])
    _warn_once(f"{message}; {_amount(value, units[0][1], unit)}?" if units else message)


def _amount(value: float, other: str, unit: str) -> str:
    """Return a number in another unit than `unit`; below 1, with a smaller prefix if there is one.

    Larger numbers are left as they were typed.
    """
    factors = {unit: 1.0, **_alternative_units(unit)}
    for name, factor in factors.items():
        number = value * factors[other] / factor
        if abs(value) < 1.0 <= round(abs(number), 9) < 1e3 and name[1:] == other[1:]:
            return f"{number:g} {name}"
    return f"{value:g} {other}"


def _range_message(name: str, value: float, unit: str, within: Range) -> str:
    amount = f"{value:g} {unit}".rstrip()
    limits = f"{within.low:g} to {within.high:g} {unit}".rstrip()
    return f"{name} = {amount}, outside the range of such devices, {limits}"


def _plausible_units(size: float, unit: str, within: Range) -> Iterator[tuple[float, str]]:
    """Yield units in which a number would be plausible, with its log distance from the usual."""
    for other, factor in _alternative_units(unit).items():
        if within.low <= size * factor <= within.high:
            yield abs(math.log(size * factor / within.usual)), other


def _alternative_units(unit: str) -> Mapping[str, float]:
    """Return likely other units, as multiples of `unit`."""
    if unit in ALTERNATIVE_UNITS:
        return ALTERNATIVE_UNITS[unit]
    others = {f"{prefix}{unit}": factor for prefix, factor in LIKELY_PREFIXES.items()}
    per_length = re.fullmatch(r"(.*/)m(\^(\d))?", unit)
    if per_length is not None:
        for length, factor in LENGTH_UNITS.items():
            power = per_length[2] or ""
            others[f"{per_length[1]}{length}{power}"] = factor ** int(per_length[3] or 1)
    return others


@cache
def _warn_once(message: str, category: type[Warning] = UnitsWarning) -> None:
    """Issue a warning once."""
    warn(message, category, message)
