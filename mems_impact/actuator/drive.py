"""Voltage waveforms: value, rate, forcing period and switching times."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import model_validator

from mems_impact.actuator.units import Scales, scaled_fields
from mems_impact.actuator.validation import NonNegative, Number, Positive, ValidatedModel
from mems_impact.errors import InvalidParameter

__all__ = ["Drive", "Sine"]


class Drive(ValidatedModel, ABC):
    """Base of voltage waveforms v(t).

    A new waveform is a subclass that declares its parameters as pydantic fields (with the number
    types of `mems_impact.actuator.validation`) and gives the five things below. Nothing else in
    the package needs to know of it.

    The waveform itself is a pair of module-level functions of plain Python that the equations
    call, interpreted or compiled by numba unchanged. They take floats and one float64 array, use
    `math` alone, carry no decorator, and become part of the class by `staticmethod`::

        def _ramp_voltage(t, q):
            return q[0] * t

        class Ramp(Drive):
            voltage = staticmethod(_ramp_voltage)

    Attributes
    ----------
    period : float
        The forcing period, > 0: the period of v(t)^2, with which the electrostatic force goes.
        The drive owns it because it may be shorter than the period of v(t).
    switches : tuple of float
        The times in (0, period], ascending, at which v or its rate jumps; empty where v is
        smooth. Integration stops and restarts there.
    units : mapping of str to str
        The SI unit of every field that is not a pure number: "V", "s", "rad/s" or "Hz" (see
        `mems_impact.actuator.units.UNITS`). From it `scaled` follows, and what a table calls the
        field of a device in SI. A field may hold a tuple (of tuples) of numbers in that unit.

    Methods
    -------
    parameters()
        The array q, shape (n,), float64, that `voltage` and `voltage_rate` read.
    voltage(t, q)
        v at time t. For every t, v(t + period)^2 = v(t)^2 must hold, since a long run asks only
        for times within the current forcing period. At a switching time, the value after it.
    voltage_rate(t, q)
        The time derivative of `voltage`; at a switching time, from the right.

    Raises
    ------
    InvalidParameter
        If a parameter is out of range, missing or unknown.
    """

    units: ClassVar[Mapping[str, str]] = {}

    @property
    @abstractmethod
    def period(self) -> float:
        """Forcing period, in the unit of time of the actuator."""

    @property
    @abstractmethod
    def switches(self) -> tuple[float, ...]:
        """Times in (0, period] at which the voltage or its rate jumps."""

    @abstractmethod
    def parameters(self) -> NDArray[np.float64]:
        """Return the array q that `voltage` and `voltage_rate` read."""

    @staticmethod
    @abstractmethod
    def voltage(t: float, q: NDArray[np.float64]) -> float:
        """Return v(t)."""

    @staticmethod
    @abstractmethod
    def voltage_rate(t: float, q: NDArray[np.float64]) -> float:
        """Return the time derivative of v at t."""

    def scaled(self, voltage: float, time: float) -> Self:
        """Return the same waveform in other units of voltage and time.

        Parameters
        ----------
        voltage, time : float
            The new units in the old ones, > 0: voltages are divided by the one and times by the
            other, so that v_new(t) = v(time t) / voltage.

        Notes
        -----
        Works from `units`. Override it only if a field is not simply a voltage, a time, a
        frequency or a pure number.
        """
        return self.replace(**scaled_fields(self, self.units, Scales.of_drive(voltage, time)))

    def value(self, t: ArrayLike) -> NDArray[np.float64]:
        """Return the voltage at many times, for plots.

        Parameters
        ----------
        t : array_like
            Times.

        Returns
        -------
        ndarray
            Voltages, in the shape of `t`.
        """
        q = self.parameters()
        times = np.asarray(t, dtype=np.float64)
        voltages = [self.voltage(time, q) for time in times.ravel().tolist()]
        return np.array(voltages, dtype=np.float64).reshape(times.shape)


def _sine_voltage(t: float, q: NDArray[np.float64]) -> float:
    return q[2] + q[0] * math.cos(q[1] * t)


def _sine_voltage_rate(t: float, q: NDArray[np.float64]) -> float:
    return -q[0] * q[1] * math.sin(q[1] * t)


class Sine(Drive):
    """A sinusoidal voltage, v(t) = bias + amplitude cos(omega t).

    Parameters
    ----------
    amplitude : float
        Amplitude, f in the paper [V], >= 0.
    omega : float
        Angular frequency [rad/s], > 0.
    bias : float, optional
        Constant part [V]; 0 in the paper.

    Raises
    ------
    InvalidParameter
        If a parameter is out of range, missing or unknown.
    """

    amplitude: NonNegative
    omega: Positive
    bias: Number = 0.0

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
        """Return the array (amplitude, omega, bias)."""
        return np.array([self.amplitude, self.omega, self.bias], dtype=np.float64)
