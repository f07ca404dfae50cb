"""Quantities with units as text: "600 Hz", "4 um", "5 %".

A small table serves better than a units library here: libraries treat 1 Hz as 1 rad/s, while here
a frequency of 600 Hz given for an angular frequency is 3770 rad/s.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from decimal import Decimal
from typing import Any, NamedTuple

from mems_impact._util.units import PREFIXED, SI_PREFIXES
from mems_impact.errors import InvalidParameter


class QuantityError(ValueError):
    """A text that is not a quantity of the expected kind."""


class UnitProduct(NamedTuple):
    """A unit: its factor to base units, and the powers of kg, m, s, A and rad."""

    factor: float
    powers: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)


NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")
FACTOR = re.compile(r"([^\d\s*/^.-]+)(?:\^|\*\*)?([-+]?\d+(?:\.\d+)?)?")
PREFIX_FACTORS = {letter: 10.0**power for power, letter in SI_PREFIXES.items() if letter}
PREFIX_FACTORS |= {"u": 1e-6, "\N{GREEK SMALL LETTER MU}": 1e-6}

BASE = {
    "kg": UnitProduct(1.0, (1, 0, 0, 0, 0)),
    "g": UnitProduct(1e-3, (1, 0, 0, 0, 0)),
    "m": UnitProduct(1.0, (0, 1, 0, 0, 0)),
    "s": UnitProduct(1.0, (0, 0, 1, 0, 0)),
    "A": UnitProduct(1.0, (0, 0, 0, 1, 0)),
    "rad": UnitProduct(1.0, (0, 0, 0, 0, 1)),
    "Hz": UnitProduct(2.0 * math.pi, (0, 0, -1, 0, 1)),
    "V": UnitProduct(1.0, (1, 2, -3, -1, 0)),
    "N": UnitProduct(1.0, (1, 1, -2, 0, 0)),
    "J": UnitProduct(1.0, (1, 2, -2, 0, 0)),
    "W": UnitProduct(1.0, (1, 2, -3, 0, 0)),
    "Pa": UnitProduct(1.0, (1, -1, -2, 0, 0)),
    "F": UnitProduct(1.0, (-1, -2, 4, 2, 0)),
    "C": UnitProduct(1.0, (0, 0, 1, 1, 0)),
    "ohm": UnitProduct(1.0, (1, 2, -3, -2, 0)),
    "H": UnitProduct(1.0, (1, 2, -2, -2, 0)),
    "T": UnitProduct(1.0, (1, 0, -2, -1, 0)),
    "Wb": UnitProduct(1.0, (1, 2, -2, -1, 0)),
}
OTHERS = {
    "%": UnitProduct(1e-2),
    "cm": UnitProduct(1e-2, (0, 1, 0, 0, 0)),
    "deg": UnitProduct(math.pi / 180.0, (0, 0, 0, 0, 1)),
    "°": UnitProduct(math.pi / 180.0, (0, 0, 0, 0, 1)),
    "rpm": UnitProduct(2.0 * math.pi / 60.0, (0, 0, -1, 0, 1)),
    "min": UnitProduct(60.0, (0, 0, 1, 0, 0)),
    "h": UnitProduct(3600.0, (0, 0, 1, 0, 0)),
    "bar": UnitProduct(1e5, (1, -1, -2, 0, 0)),
    "mbar": UnitProduct(1e2, (1, -1, -2, 0, 0)),
    "atm": UnitProduct(101325.0, (1, -1, -2, 0, 0)),
    "Torr": UnitProduct(101325.0 / 760.0, (1, -1, -2, 0, 0)),
    "\N{OHM SIGN}": BASE["ohm"],
    "\N{GREEK CAPITAL LETTER OMEGA}": BASE["ohm"],
}
"""Units without prefixes, or with other prefixes."""

OHMS = ("\N{OHM SIGN}", "\N{GREEK CAPITAL LETTER OMEGA}")
ALLOWED_PREFIXES = (*PREFIXED, "g", *OHMS)


def has_unit(value: Any) -> bool:
    """Return whether `value` is a text of a number and a unit, or a quantity of pint."""
    if isinstance(value, str):
        found = NUMBER.fullmatch(value)
        return found is not None and found[2] != ""
    return _is_pint(value)


def magnitude(value: Any, unit: str) -> float:
    """Return a quantity, such as "4 um" or pint's, as a number in an SI unit, "" for a pure number.

    Raises QuantityError if it is no number with a unit, or the unit measures something else.

    >>> magnitude("4 um", "m"), magnitude("0.5 kHz", "Hz"), magnitude("5 %", "")
    (4e-06, 500.0, 0.05)
    """
    if _is_pint(value):
        number, own = Decimal(repr(float(value.magnitude))), f"{value.units:~C}"
    else:
        found = NUMBER.fullmatch(value)
        if found is None:
            raise QuantityError(_expected(unit))
        number, own = Decimal(found[1]), found[2]
    try:
        given = _product(own)
    except KeyError:
        raise QuantityError(_expected(unit)) from None
    wanted = _product(unit)
    # An angle is a pure number where no angle is expected.
    if given.powers != wanted.powers and (unit or given.powers[:-1] != wanted.powers[:-1]):
        raise QuantityError(_expected(unit))
    ratio = given.factor / wanted.factor
    power = round(math.log10(ratio))
    if math.isclose(ratio, 10.0**power, rel_tol=1e-12):
        return float(number.scaleb(power))  # rounded once: 0.2 mg are 2e-7 kg to the last digit
    return float(number) * ratio


def quantity(field: str, value: Any, unit: str | None, subject: str = "system") -> Any:
    """Return a text with a unit as a number in an SI `unit`; any other value unchanged.

    `unit` is empty for a pure number, None if the `subject`, "system" or "device", is
    dimensionless; `field` names the argument in the error. Raises InvalidParameter if the text has
    a unit of another kind, or the subject is dimensionless.
    """
    if not has_unit(value):
        return value
    try:
        return magnitude(value, unit or "")
    except QuantityError as error:
        if unit is not None:
            raise InvalidParameter(field, value, str(error)) from None
        problem = f"has a unit, but the {subject} is dimensionless; give a number"
        raise InvalidParameter(field, value, "", problem=problem) from None


def quantities(field: str, values: Any, unit: str | None, subject: str = "system") -> Any:
    """Convert a value, a sequence of values or an array of pint as `quantity` does."""
    import numpy as np  # imported on first use, which --help need not wait for

    if isinstance(values, str) or (has_unit(values) and np.ndim(values.magnitude) == 0):
        return quantity(field, values, unit, subject)
    if has_unit(values) or (
        isinstance(values, list | tuple | np.ndarray) and any(map(has_unit, values))
    ):
        return [quantity(field, value, unit, subject) for value in values]
    return values


def percentage(text: Any) -> float | None:
    """Return a text such as "5 %" as a fraction >= 0; None for anything else."""
    if not isinstance(text, str) or not text.rstrip().endswith("%"):
        return None
    try:
        part = float(text.rstrip().removesuffix("%")) / 100.0
    except ValueError:
        return None
    return part if math.isfinite(part) and part >= 0.0 else None


def _expected(unit: str) -> str:
    """Return the expected value in words that follow "must be"."""
    if not unit:
        return 'a number, or a percentage such as "5 %"'
    return f"a number [{unit}], or a text with a unit of that kind, such as {_example(unit)}"


def _example(unit: str) -> str:
    prefixed = {"m": "4 um", "s": "2 ms", "V": "70 V", "Hz": "1.2 kHz", "rad/s": "1.2 kHz"}
    prefixed |= {"kg": "0.2 mg", "N": "3 uN", "F": "1 pF", "ohm": "1 kohm", "m^2": "0.1 mm^2"}
    return f'"{prefixed.get(unit, f"1 {unit}")}"'


def base_powers(unit: str) -> dict[str, int]:
    """Return the powers of kg, m, s, A and rad in a unit of SI; KeyError for other units."""
    powers = zip(("kg", "m", "s", "A", "rad"), _product(unit).powers, strict=True)
    return {name: int(power) for name, power in powers if power}


def factors(text: str) -> Iterator[tuple[str, float]]:
    """Yield the units in a product such as "N s/m^2", with powers; KeyError for other text."""
    for i, group in enumerate(text.replace("·", " ").replace("**", "^").split("/")):
        sign = 1.0 if i == 0 else -1.0
        for token in re.split(r"[\s*]+", group.strip()):
            if token in ("", "1"):
                continue
            found = FACTOR.fullmatch(token.replace("²", "^2").replace("³", "^3"))
            if found is None:
                raise KeyError(token)
            yield found[1], sign * float(found[2] or 1.0)


def _product(text: str) -> UnitProduct:
    """Return a product of units; KeyError for other text."""
    factor, powers = 1.0, [0.0] * 5
    for name, power in factors(text):
        own = _unit(name)
        factor *= own.factor**power
        powers = [a + power * b for a, b in zip(powers, own.powers, strict=True)]
    return UnitProduct(factor, tuple(powers))


def _unit(name: str) -> UnitProduct:
    """Return a unit, with or without a prefix."""
    if name in BASE:
        return BASE[name]
    if name in OTHERS:
        return OTHERS[name]
    prefix, base = name[:1], name[1:]
    own = OTHERS[base] if base in OHMS else BASE[base]
    if prefix not in PREFIX_FACTORS or base not in ALLOWED_PREFIXES:
        raise KeyError(name)
    return UnitProduct(own.factor * PREFIX_FACTORS[prefix], own.powers)


def _is_pint(value: Any) -> bool:
    return hasattr(value, "magnitude") and hasattr(value, "units")
