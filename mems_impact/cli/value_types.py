"""Types of the values of options: quantities, assignments, ranges, distributions."""

from __future__ import annotations

import contextlib
import math
from typing import Any, Literal

import click

from mems_impact._util.quantities import QuantityError, has_unit, magnitude
from mems_impact.actuator.design.data_sheet_quantities import QUANTITIES

Context = click.Context | None
Parameter = click.Parameter | None

NUMBER_UNITS = {
    "amplitude": "V", "omega": "rad/s", "frequency": "Hz", "bias": "V", "phase": "rad",
    "rise": "s", "fall": "s", "low": "V", "width": "s", "period": "s",
    "pause": "s", "hold": "V", "duration": "s",
}  # fmt: skip
"""SI units of the numbers of a drive."""

WITH_UNIT = "mems_impact.with_unit"  # the first text with a unit, in the context of click

Initial = dict[str, float] | Literal["kicked"]
KICKED: Literal["kicked"] = "kicked"


def number_of(text: str, unit: str) -> float:
    """Return a text such as 70 or "70 V" as a number in `unit`; ValueError for others."""
    if not has_unit(text):
        return float(text)
    context = click.get_current_context(silent=True)
    if context is not None:
        context.meta.setdefault(WITH_UNIT, text)
    return magnitude(text, unit)


def parameter_unit(name: str) -> str:
    """Return the SI unit of a parameter of device, drive or term, or of a state of the device."""
    from mems_impact.actuator.terms.files import term_names, term_type
    from mems_impact.actuator.units import PARAMETER_UNITS

    owner, dot, attribute = name.partition(".")
    if dot and owner in term_names():
        return term_type(owner).units.get(attribute, "")
    if name in QUANTITIES:
        return QUANTITIES[name].unit
    states = {"x1": "m", "x2": "m", "v1": "m/s", "v2": "m/s", "time": "s"}
    units = {**states, **PARAMETER_UNITS, **NUMBER_UNITS}
    return units.get(attribute if dot else name, "")


def symbol_of(name: str) -> str:
    """Return the symbol of a parameter of a device that a data sheet names; others unchanged.

    The frequency is the frequency of the drive.
    """
    from mems_impact.actuator.parameters import parameter_named

    return name if name in NUMBER_UNITS else parameter_named(name)


def assignment(text: str) -> tuple[str, Any]:
    """Return name and number of a text such as e=0.7."""
    name, _, number = (part.strip() for part in text.partition("="))
    unit = parameter_unit(name)
    try:
        value = number_of(number, unit)
    except QuantityError as error:
        if unit or not name:
            raise click.BadParameter(f"{text!r}: {name} must be {error}") from None
        return name, number  # a parameter of a system, whose unit is known later
    except ValueError:
        name = ""
    if not name:
        example = "such as e=0.7 or k='11 N/m'"
        raise click.BadParameter(f"{text!r} must be NAME=NUMBER, {example}")
    return name, value


class QuantityType(click.ParamType):
    """A number, or a text with a unit such as "0.6 kHz", of a parameter with this unit.

    Without a unit, texts stay texts, for parameters known later.
    """

    name = "quantity"  # in help

    def __init__(self, unit: str | None = None) -> None:
        self.unit = unit

    def convert(self, value: Any, param: Parameter, ctx: Context) -> float | str:
        """Return the number, or the text if the unit of the parameter is unknown."""
        if not isinstance(value, str):
            return float(value)
        if self.unit is None and has_unit(value):
            return value
        try:
            if self.unit == "V" and has_unit(value):
                _check_voltage_or_charge(value)
                return value  # the device determines which
            return number_of(value, self.unit or "")
        except QuantityError as error:
            self.fail(f"{value!r} must be {error}", param, ctx)
        except ValueError:
            self.fail(f"{value!r} must be a number, or a number with a unit", param, ctx)


def _check_voltage_or_charge(value: str) -> None:
    """Refuse a text whose unit is neither that of a voltage nor that of a charge."""
    try:
        number_of(value, "V")
    except QuantityError as error:
        try:
            number_of(value, "C")
        except QuantityError:
            raise error from None


class NumberType(click.ParamType):
    """A number, as in TOML: whole if its text is."""

    name = "number"

    def convert(self, value: Any, param: Parameter, ctx: Context) -> float:
        """Return the number."""
        for kind in (int, float):
            with contextlib.suppress(ValueError):
                return kind(value) if isinstance(value, str) else value
        self.fail(f"{value!r} must be a number", param, ctx)


class AssignmentType(click.ParamType):
    """A name and a number: e=0.7."""

    name = "NAME=NUMBER"

    def convert(self, value: str, _param: Parameter, _ctx: Context) -> tuple[str, Any]:
        """Return name and number."""
        return assignment(value)


class InitialType(AssignmentType):
    """A component of a state, or kicked."""

    hint = (
        "A component, such as x2=0.1 (x1, x2 [m], v1, v2 [m/s], or time [s] since the forcing "
        "period began); or kicked: the block starts at the middle, fast enough to strike a stopper."
    )

    def convert(self, value: str, param: Parameter, ctx: Context) -> tuple[str, Any]:
        """Return name and number; of kicked the word alone."""
        return (KICKED, None) if value == KICKED else super().convert(value, param, ctx)


class ToleranceType(AssignmentType):
    """A name and a standard deviation, or one in per cent of the value: e=2%."""

    hint = "Such as delta=0.005, or delta=2% of its value."

    name = "NAME=NUMBER[%]"

    def convert(self, value: str, param: Parameter, ctx: Context) -> tuple[str, Any]:
        """Return name and number; the text of per cent."""
        name, _, number = (part.strip() for part in value.partition("="))
        if not (name and number.endswith("%")):
            name, number = super().convert(value, param, ctx)
        return name, number


class RangeType(click.ParamType):
    """A range: [NAME=]LOW:HIGH, or [NAME=]START:STOP:POINTS.

    With `named` the name of a parameter precedes it, with `points` a number of points follows, with
    `half_open` one end may be omitted; `ends` names the ends.
    """

    def __init__(
        self,
        *,
        named: bool = True,
        points: bool = False,
        half_open: bool = False,
        ends: str = "LOW:HIGH",
    ) -> None:
        self.named, self.points, self.half_open = named, points, half_open
        self.name = f"{'NAME=' * named}{'START:STOP:POINTS' if points else ends}"

    def convert(self, value: Any, param: Parameter, ctx: Context) -> tuple[Any, ...]:
        """Return the name if there is one, both ends, and the number of points if there is one."""
        name, equals, rest = value.rpartition("=")
        name, parts = name.strip(), [part.strip() for part in rest.split(":")]
        try:
            if bool(equals and name) != self.named or len(parts) != 2 + self.points:
                raise ValueError
            ends = [self._end(text) for text in parts[:2]]
            points = [int(text) for text in parts[2:]]
            if ends == [None, None] or any(number < 1 for number in points):
                raise ValueError
        except ValueError:
            example = f"{'e=' * self.named}0.7:0.8{':11' * self.points}"
            self.fail(f"{value!r} must be {self.name}, such as {example}", param, ctx)
        return (*([name] if self.named else []), *ends, *points)

    def _end(self, text: str) -> float | str | None:
        """Return an end; a text with a unit unchanged, which the function converts."""
        if not text and self.half_open:
            return None
        if not has_unit(text) and not math.isfinite(float(text)):
            raise ValueError
        return text if has_unit(text) else float(text)


class DistributionType(click.ParamType):
    """A parameter and its distribution: e=norm:0.8:0.02, or a standard deviation d=5%."""

    name = "NAME=DISTRIBUTION"
    hint = (
        "The name of the distribution in scipy.stats and its numbers, such as e=norm:0.8:0.02 or "
        "delta=uniform:0.35:0.01; or about the value of the device: d=5% or d='0.1 um' is normal "
        "with this standard deviation, d=uniform:5% is uniform within plus or minus 5 %."
    )

    def convert(self, value: str, param: Parameter, ctx: Context) -> tuple[str, Any]:
        """Return the parameter, and name and numbers of its distribution, or the text."""
        name, _, description = value.partition("=")
        kind, *numbers = (part.strip() for part in description.split(":"))
        width = numbers[-1] if numbers else kind
        if name.strip() and len(numbers) <= 1 and has_unit(width):
            return name.strip(), description
        try:
            amounts = [each if has_unit(each) else float(each) for each in numbers]
            if not (name.strip() and kind and numbers):
                raise ValueError
        except ValueError:
            problem = f"{value!r} must be NAME=DISTRIBUTION:NUMBERS, such as e=norm:0.8:0.02, or "
            self.fail(f"{problem}NAME=PER CENT, such as d=5%", param, ctx)
        return name.strip(), [kind, *amounts]
