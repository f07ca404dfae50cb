"""Numbers in the SI prefix that fits them: micrometres for 5e-6 m."""

from __future__ import annotations

import math

from mems_impact.units import PREFIXED, PREFIXES

__all__ = ["told_in"]


def told_in(unit: str, size: float) -> tuple[float, str]:
    """Return the unit in which numbers of that size are told, and what it is called.

    Parameters
    ----------
    unit : str
        SI, such as "N s/m"; the first of its factors takes the prefix, if it can.
    size : float
        The largest of the numbers, in `unit`.

    Returns
    -------
    tuple of float and str
        What a number in `unit` is to be divided by, and the name of the unit then.

    Examples
    --------
    >>> told_in("m", 5e-6), told_in("kg", 2e-6), told_in("rad/s", 750.0)
    ((1e-06, 'µm'), (1e-06, 'mg'), (1.0, 'rad/s'))
    """
    first, rest = unit, ""
    for place, letter in enumerate(unit):
        if letter in " /":
            first, rest = unit[:place], unit[place:]
            break
    gram = first == "kg"
    known = gram or first in PREFIXED
    if not known or not (abs(size) > 0.0 and math.isfinite(size)):
        return 1.0, unit
    power = math.log10(abs(size))
    if not gram and -1.0 <= power < 4.0:  # 0.24 V and 1500 Hz are read as they stand
        return 1.0, unit
    thousands = 3 * math.floor((power + (3 if gram else 0)) / 3.0 + 1e-9)
    thousands = min(max(thousands, min(PREFIXES)), max(PREFIXES))
    factor = 10.0 ** (thousands - (3 if gram else 0))
    return factor, f"{PREFIXES[thousands]}{'g' if gram else first}{rest}"
