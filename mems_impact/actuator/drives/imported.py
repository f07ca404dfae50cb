"""Voltages that another tool computes, as inputs of an exported model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mems_impact.actuator.drives.base import Drive, Waveform
from mems_impact.actuator.parameter_base import Number, Positive

__all__ = ["ImportedVoltage", "ImportedVoltages"]

# The parameters of an imported voltage: its value, its rate, and the time of both.
LEVEL, RATE, TIME, COUNT = range(4)


def _right(t: float, q: NDArray[np.float64]) -> float:
    return q[LEVEL] + q[RATE] * (t - q[TIME])


def _left(t: float, q: NDArray[np.float64]) -> float:
    return q[COUNT + LEVEL] + q[COUNT + RATE] * (t - q[COUNT + TIME])


def _right_rate(t: float, q: NDArray[np.float64]) -> float:
    return q[RATE]


def _left_rate(t: float, q: NDArray[np.float64]) -> float:
    return q[COUNT + RATE]


class ImportedVoltage(Drive):
    """A voltage at the right electrode that the importer of a model sets at any time.

    Parameters
    ----------
    level : float
        Initial voltage [V].
    period : float
        A time that resolves it [s].
    """

    level: Number
    period: Positive
    left_level: Number = 0.0

    units = {"level": "V", "left_level": "V", "period": "s"}  # noqa: RUF012 - ClassVar in Drive

    voltage = staticmethod(_right)
    voltage_rate = staticmethod(_right_rate)

    @property
    def switches(self) -> tuple[float, ...]:
        """Empty: the importer knows the switching times."""
        return ()

    @property
    def changes_sign(self) -> bool:
        """False: it has no period."""
        return False

    def check_signed(self) -> None:
        """Accept every voltage."""

    def parameters(self) -> NDArray[np.float64]:
        """Return voltages, rates and their times of both electrodes."""
        return np.array([self.level, 0.0, 0.0, self.left_level, 0.0, 0.0])

    @property
    def inputs(self) -> dict[str, tuple[int, int, float]]:
        """Indices in the parameters of a voltage and its rate, and its initial value, by input."""
        return {"voltage": (LEVEL, RATE, self.level)}


class ImportedVoltages(ImportedVoltage):
    """Voltages at both electrodes that the importer of a model sets at any time."""

    @property
    def left_voltage(self) -> Waveform:
        """The voltage at the left electrode."""
        return _left

    @property
    def left_rate(self) -> Waveform:
        """Time derivative of the voltage at the left electrode."""
        return _left_rate

    @property
    def inputs(self) -> dict[str, tuple[int, int, float]]:
        """The same for both electrodes."""
        return {**super().inputs, "left_voltage": (COUNT + LEVEL, COUNT + RATE, self.left_level)}
