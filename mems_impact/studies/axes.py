"""Axes of a study: a parameter and its values."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from mems_impact.analysis.system import System
from mems_impact.errors import InvalidParameter

__all__ = ["Axis", "axis"]


class Axis(NamedTuple):
    """A parameter and its values, in the units of the system."""

    name: str
    values: tuple[float, ...]


def axis(field: str, given: tuple[str, ArrayLike], names: tuple[str, ...]) -> Axis:
    """Return an axis as it was given.

    Raises
    ------
    InvalidParameter
        If it is no pair, the name none of `names`, or the values not numbers that differ.
    """
    allowed = 'a name and its values: ("amplitude", [0.2, 0.21])'
    try:
        name, values = given
        numbers = np.atleast_1d(np.asarray(values, dtype=float))
    except (TypeError, ValueError):
        raise InvalidParameter(field, given, allowed) from None
    if not isinstance(name, str) or name not in names:
        raise InvalidParameter(field, name, f"one of {', '.join(names)}")
    fine = numbers.ndim == 1 and numbers.size > 0 and bool(np.isfinite(numbers).all())
    if not fine or len(np.unique(numbers)) != numbers.size:
        raise InvalidParameter(field, values, "one or more finite numbers that differ")
    return Axis(name, tuple(numbers.tolist()))


def identity_of_axis(given: Axis) -> dict[str, Any]:
    """Return what tells an axis from others."""
    return {"name": given.name, "values": list(given.values)}


def check_apart(x: Axis, y: Axis, system: System) -> None:
    """Raise InvalidParameter if two axes are one."""
    if x.name == y.name:
        others = ", ".join(name for name in system.parameters if name != x.name)
        raise InvalidParameter("y", y.name, f"another one than x: one of {others}")
