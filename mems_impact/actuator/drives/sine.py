"""The sine of the paper."""

from __future__ import annotations

import math
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from mems_impact.actuator.checked import NonNegative, Number, Positive
from mems_impact.actuator.drives.base import Drive
from mems_impact.errors import InvalidParameter

__all__ = ["Sine"]


def _sine_voltage(t: float, q: NDArray[np.float64]) -> float:
    return q[2] + q[0] * math.cos(q[1] * t + q[3])


def _sine_voltage_rate(t: float, q: NDArray[np.float64]) -> float:
    return -q[0] * q[1] * math.sin(q[1] * t + q[3])


class Sine(Drive):
    """A sinusoidal voltage, v(t) = bias + amplitude cos(omega t + phase).

    Parameters
    ----------
    amplitude : float
        Amplitude, f in the paper [V], >= 0.
    omega : float
        Angular frequency [rad/s], > 0.
    bias : float, optional
        Constant part [V]; 0 in the paper.
    phase : float, optional
        How far the waveform is ahead [rad].

    Raises
    ------
    InvalidParameter
        If a parameter is out of range, missing or unknown.
    """

    amplitude: NonNegative
    omega: Positive
    bias: Number = 0.0
    phase: Number = 0.0

    units = {"amplitude": "V", "omega": "rad/s", "bias": "V"}  # noqa: RUF012 - ClassVar above

    voltage = staticmethod(_sine_voltage)
    voltage_rate = staticmethod(_sine_voltage_rate)

    @model_validator(mode="after")
    def _check_period(self) -> Self:
        if not math.isfinite(self.period):
            allowed = "large enough for a finite period"
            raise InvalidParameter("omega", self.omega, allowed)
        return self

    @property
    def period(self) -> float:
        """Forcing period: pi/omega without bias, 2 pi/omega with."""
        # cos^2 has half the period of cos; with a bias, v^2 keeps the term in cos.
        return (math.pi if self.bias == 0.0 else 2.0 * math.pi) / self.omega

    @property
    def switches(self) -> tuple[float, ...]:
        """Empty: a sine is smooth."""
        return ()

    def parameters(self) -> NDArray[np.float64]:
        """Return the array (amplitude, omega, bias, phase)."""
        return np.array([self.amplitude, self.omega, self.bias, self.phase], dtype=np.float64)
