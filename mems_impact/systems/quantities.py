"""Arguments that may have units: "70 V", "0.6 kHz", quantities of pint."""

from __future__ import annotations

from typing import Any

import numpy as np

from mems_impact._util.quantities import QuantityError, has_unit, magnitude
from mems_impact.errors import InvalidParameter

__all__ = ["quantities", "quantity"]


def quantity(field: str, value: Any, unit: str | None, subject: str = "system") -> Any:
    """Return a text with a unit as a number in `unit`; any other value unchanged.

    Parameters
    ----------
    field : str
        Name of the argument, for the error.
    value : object
    unit : str or None
        An SI unit; empty for a pure number. None if `subject` is dimensionless.
    subject : str, optional
        "system" or "device".

    Raises
    ------
    InvalidParameter
        If the text has a unit of another kind, or the subject is dimensionless.
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
    """Return values as `quantity` does: one, a sequence of them, or an array of pint."""
    if isinstance(values, str) or (has_unit(values) and np.ndim(values.magnitude) == 0):
        return quantity(field, values, unit, subject)
    if has_unit(values) or (
        isinstance(values, list | tuple | np.ndarray) and any(map(has_unit, values))
    ):
        return [quantity(field, value, unit, subject) for value in values]
    return values
