"""The sine of the paper."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.units import DIMENSIONLESS, Scales
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.parameter_base import NonNegative, Number, Positive, Unit
from mems_impact.hybrid.problem import ProblemParameters


def _sine_voltage(t: float, q: NDArray[np.float64]) -> float:
    return q[2] + q[0] * math.cos(q[1] * t + q[3])


def _period(omega: float, bias: float) -> float:
    # cos^2 has half the period of cos; with a bias, v^2 keeps the term in cos.
    return (math.pi if bias == 0.0 else 2.0 * math.pi) / omega


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
        Phase [rad].
    frequency : float, optional
        Frequency [Hz], > 0, in place of omega: parameter, tables and figures are then in hertz.

    Raises
    ------
    InvalidParameter
        If a parameter is out of range, missing or unknown.

    See Also
    --------
    Square, Trapezoid, Sampled

    Examples
    --------
    >>> import math
    >>> import mems_impact as mi
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> drive.period == math.pi / 0.5  # the force is proportional to the square of the voltage
    True
    >>> drive.replace(bias=0.1).period == 2 * math.pi / 0.5
    True
    """

    amplitude: Annotated[NonNegative, Unit("V")]
    omega: Annotated[Positive, Unit("rad/s")] = math.nan  # or a frequency
    bias: Annotated[Number, Unit("V")] = 0.0
    phase: Number = 0.0
    frequency: Annotated[Positive | None, Unit("Hz")] = None

    voltage = staticmethod(_sine_voltage)

    @property
    def period(self) -> float:
        """Forcing period: pi/omega without bias, 2 pi/omega with."""
        return _period(self.omega, self.bias)

    @property
    def changes_sign(self) -> bool:
        """Whether the bias is zero."""
        return self.bias == 0.0

    @property
    def switches(self) -> tuple[float, ...]:
        """Empty: a sine is smooth."""
        return ()

    def parameters(self) -> NDArray[np.float64]:
        """Return the array (amplitude, omega, bias, phase)."""
        return np.array([self.amplitude, self.omega, self.bias, self.phase], dtype=np.float64)

    def numbers(self, changes: Mapping[str, float], scales: Scales) -> ProblemParameters:
        """Return q, period and time scale in `scales`, at other values; there are no switches."""
        amplitude = changes.get("amplitude", self.amplitude)
        omega = changes.get("omega", self.omega)
        if "frequency" in changes:
            omega = 2.0 * math.pi * changes["frequency"]
        bias = changes.get("bias", self.bias)
        phase = changes.get("phase", self.phase)
        if scales is not DIMENSIONLESS:
            amplitude, bias = scales.into(amplitude, "V"), scales.into(bias, "V")
            omega = scales.into(omega, "rad/s")
        period = _period(omega, bias)
        return ProblemParameters(np.array([amplitude, omega, bias, phase]), period, (), period)
