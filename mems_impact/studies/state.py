"""A state of the actuator, as users give it and get it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real
from typing import Any

from mems_impact.actuator.modes import STATES
from mems_impact.errors import InvalidParameter

__all__ = ["State"]


@dataclass(frozen=True, kw_only=True)
class State:
    """A state of the actuator and the phase of the drive at which it holds.

    Parameters
    ----------
    x1, v1 : float
        Position and velocity of the frame. A frame with v1 != 0 slides.
    x2, v2 : float
        Position and velocity of the block relative to the frame.
    time : float
        Time since the start of the forcing period, 0 <= time < period.

    Raises
    ------
    InvalidParameter
        If a number is not finite, or `time` is negative.
    """

    x1: float = 0.0
    v1: float = 0.0
    x2: float = 0.0
    v2: float = 0.0
    time: float = 0.0

    def __post_init__(self) -> None:
        for name in (*STATES, "time"):
            value = getattr(self, name)
            if not is_number(value):
                raise InvalidParameter(name, value, "a finite number")
        if self.time < 0.0:
            raise InvalidParameter("time", self.time, ">= 0 and below the forcing period")


def is_number(value: Any) -> bool:
    """Return whether `value` is one finite real number."""
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
