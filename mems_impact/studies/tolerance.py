"""Tolerances of parameters: in their units, or as a part of their values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from mems_impact.analysis.state import is_number
from mems_impact.analysis.system import System
from mems_impact.errors import InvalidParameter

__all__ = ["deviations", "part_of", "relative_distribution"]

RELATIVE = '"5%", or "uniform: 5%" to either side'
KINDS = ("norm", "uniform")


def part_of(text: Any) -> float | None:
    """Return what a text such as "5%" is as a part; None of anything else."""
    if not isinstance(text, str) or not text.rstrip().endswith("%"):
        return None
    try:
        part = float(text.rstrip().removesuffix("%")) / 100.0
    except ValueError:
        return None
    return part if math.isfinite(part) and part >= 0.0 else None


def deviations(
    tolerances: Mapping[str, float | str], system: System, known: Sequence[str] | None = None
) -> dict[str, float]:
    """Return standard deviations in the units of the parameters.

    Raises InvalidParameter unless each is one of a known parameter, of the system by default.
    """
    names = tuple(system.parameters) if known is None else known
    found = {}
    for name, given in tolerances.items():
        if name not in names:
            raise InvalidParameter("tolerances", name, f"of one of {', '.join(names)}")
        part = part_of(given)
        value = given if part is None else part * _size("tolerance of", name, system)
        if not (is_number(value) and float(value) >= 0.0):
            allowed = 'a finite number >= 0, or a part of the value such as "5%"'
            raise InvalidParameter(f"tolerance of {name}", given, allowed)
        found[name] = float(value)
    return found


def relative_distribution(name: str, text: str, system: System) -> Any:
    """Return a distribution about the system's own value of a parameter, frozen.

    Of "5%" the normal one of that standard deviation, of "uniform: 5%" as much to either side.
    """
    from scipy import stats

    kind, _, width = text.rpartition(":")
    part, kind = part_of(width), kind.strip() or KINDS[0]
    if part is None or kind not in KINDS or not part > 0.0:
        raise InvalidParameter(f"over.{name}", text, f"a distribution, or {RELATIVE}")
    system.check_parameter(name, "over")
    value, spread = system.value(name), part * _size("over", name, system)
    if kind == "uniform":
        return stats.uniform(value - spread, 2.0 * spread)
    return stats.norm(value, spread)


def _size(field: str, name: str, system: System) -> float:
    size = abs(system.value(name))
    if size == 0.0:
        problem = f"{name} is 0, of which no part can be taken; give the tolerance in its unit"
        raise InvalidParameter(f"{field} {name}", None, "", problem=problem)
    return size
