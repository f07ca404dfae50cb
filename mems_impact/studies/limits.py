"""Limits on what an orbit may be, as margins that must not become negative."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mems_impact.analysis.orbit import Orbit
from mems_impact.analysis.quantity import MULTIPLIER
from mems_impact.analysis.state import is_number
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.trajectory import Floats

__all__ = ["Constraint", "limits_of"]

STABLE = 0.95  # largest modulus of a multiplier, where nothing else is said: folds are near one
CLOSEST = "closest approach"


@dataclass(frozen=True)
class Constraint:
    """Between which values a quantity must stay.

    Attributes
    ----------
    name : str
        Of the quantity.
    low, high : float
        Infinite where there is none.
    scale : float
        In parts of which a margin counts.
    """

    name: str
    low: float
    high: float
    scale: float

    @property
    def sides(self) -> list[tuple[float, float]]:
        """Sign of the margin and value of each limit that there is."""
        pairs = [(1.0, self.low), (-1.0, self.high)]
        return [(sign, bound) for sign, bound in pairs if math.isfinite(bound)]

    def margins(self, value: float, gradient: Floats) -> tuple[Floats, Floats]:
        """Return how far a value is from each limit, and the derivatives of that.

        What an orbit does not have does not limit it.
        """
        signs = np.array([sign for sign, _ in self.sides])
        bounds = np.array([bound for _, bound in self.sides])
        if math.isnan(value):
            return np.ones(signs.size), np.zeros((signs.size, gradient.size))
        return signs * (value - bounds) / self.scale, np.outer(signs, gradient) / self.scale

    def words(self, unit: str) -> list[str]:
        """Return what each limit demands, in words."""
        word = {1.0: "least", -1.0: "most"}
        return [
            f"{self.name} at {word[sign]} {bound:.6g} {unit}".rstrip() for sign, bound in self.sides
        ]


def limits_of(
    orbit: Orbit, subject_to: Mapping[str, tuple[float | None, float | None]]
) -> tuple[Constraint, ...]:
    """Return the limits on an orbit: those that are given, stability, and no penetration.

    A pair of None limits nothing; the quantity is only shown.

    Raises
    ------
    InvalidParameter
        If a pair is none of numbers or None, in order.
    """
    known = {each.name: each for each in orbit.system.orbit_quantities}
    given: dict[str, tuple[float | None, float | None]] = {MULTIPLIER.name: (None, STABLE)}
    if CLOSEST in known:
        given[CLOSEST] = (0.0, None)
    found = []
    for name, pair in {**given, **subject_to}.items():
        low, high = _checked(name, pair)
        size = max((abs(bound) for bound in (low, high) if math.isfinite(bound)), default=0.0)
        if size == 0.0 and name in known:
            size = abs(known[name](orbit))
        found.append(Constraint(name, low, high, size if 0.0 < size < math.inf else 1.0))
    return tuple(found)


def _checked(name: str, pair: tuple[float | None, float | None]) -> tuple[float, float]:
    """Return a pair of limits, infinite where there is none."""
    try:
        low, high = pair
    except (TypeError, ValueError):
        low, high = math.nan, math.nan
    if not all(each is None or is_number(each) for each in (low, high)):
        raise InvalidParameter(f"subject_to {name}", pair, "(lowest, highest), None for none")
    bounds = -math.inf if low is None else float(low), math.inf if high is None else float(high)
    if not bounds[0] < bounds[1]:
        raise InvalidParameter(f"subject_to {name}", pair, "(lowest, highest), in this order")
    return bounds
