"""Ranges of numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Limits:
    """The range of a number; a bound itself is allowed unless excluded."""

    low: float = -math.inf
    high: float = math.inf
    low_excluded: bool = False
    high_excluded: bool = False

    @property
    def allowed(self) -> str:
        """The range, worded to follow "must be"."""
        bounds = (
            (">" if self.low_excluded else ">=", self.low),
            ("<" if self.high_excluded else "<=", self.high),
        )
        shown = [f"{sign} {bound:.9g}" for sign, bound in bounds if math.isfinite(bound)]
        return f"a finite number {' and '.join(shown)}".rstrip()


BOUND_RTOL = 1e-9  # relative rounding by which a number may be beyond a bound that is allowed

UNLIMITED = Limits()
"""Any number."""


@dataclass(frozen=True, kw_only=True)
class Bound:
    """A bound of a number that depends on other numbers."""

    name: str  # of the bounded number
    value: Callable[[Any], float]  # ``value(p)``, of the parameter array
    upper: bool = False  # whether the number is below the bound
    excluded: bool = True  # whether the bound itself is not allowed
    meaning: str  # what the bound is

    @property
    def sign(self) -> str:
        """The sign between the number and its bound."""
        return ("<" if self.upper else ">") + ("" if self.excluded else "=")

    def holds(self, number: float, p: Any) -> bool:
        """Return whether a number is on its side of the bound."""
        bound = self.value(p)
        room = bound - number if self.upper else number - bound
        return room > 0.0 if self.excluded else room >= -BOUND_RTOL * abs(bound)
