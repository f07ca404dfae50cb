"""Ranges of numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["UNLIMITED", "Limits"]


@dataclass(frozen=True, kw_only=True)
class Limits:
    """The range of a number.

    Attributes
    ----------
    low, high : float
    low_excluded, high_excluded : bool
        Whether the bound itself is not allowed.
    """

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


UNLIMITED = Limits()
"""Any number."""
