"""Number, mean, scatter and extremes of values that come in portions."""

from __future__ import annotations

import math

from mems_impact.hybrid.trajectory import Floats

__all__ = ["Moments"]


class Moments:
    """Number, mean, scatter and extremes of values that come in portions.

    Attributes
    ----------
    count : int
    mean : float
    low, high : float
        Smallest and largest value.
    """

    def __init__(self) -> None:
        self.count = 0
        self.mean = self._squares = 0.0
        self.low, self.high = math.inf, -math.inf

    def add(self, values: Floats) -> None:
        """Take the next portion."""
        if values.size == 0:
            return
        # Chan, Golub and LeVeque's update: sums of squares would lose the scatter of steps that
        # are nearly equal.
        mean = float(values.mean())
        squares = float(((values - mean) ** 2).sum())
        total = self.count + values.size
        apart = mean - self.mean
        self._squares += squares + apart * apart * self.count * values.size / total
        self.mean += apart * values.size / total
        self.count = total
        self.low, self.high = (
            min(self.low, float(values.min())),
            max(self.high, float(values.max())),
        )

    def deviation(self) -> float:
        """Return the standard deviation of the values over their number; NaN without any."""
        return math.sqrt(self._squares / self.count) if self.count else math.nan
