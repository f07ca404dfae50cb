"""A state of the actuator, as users give it and get it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

from mems_impact.actuator.modes import STATES
from mems_impact.actuator.units import DIMENSIONLESS, Scales, scaled_fields
from mems_impact.errors import InvalidParameter

__all__ = ["STATE_UNITS", "State"]

STATE_UNITS = {"x1": "m", "v1": "m/s", "x2": "m", "v2": "m/s", "time": "s"}


@dataclass(frozen=True, kw_only=True)
class State:
    """A state of the actuator and the phase of the drive at which it holds.

    In the units of the actuator that it is used with.

    Parameters
    ----------
    x1, v1 : float
        Position [m] and velocity [m/s] of the frame. A frame with v1 != 0 slides.
    x2, v2 : float
        Position [m] and velocity [m/s] of the block relative to the frame.
    time : float
        Time [s] since the start of the forcing period, 0 <= time < period.

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

    def inner(self, scales: Scales) -> State:
        """Return the state in the units in which the package integrates."""
        if scales is DIMENSIONLESS:
            return self
        return replace(self, **scaled_fields(self, STATE_UNITS, scales))


def is_number(value: Any) -> bool:
    """Return whether `value` is one finite real number."""
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
