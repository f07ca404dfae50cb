"""Voltages that another tool computes, as inputs of an exported model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.parameter_base import Number, Positive, Unit
from mems_impact.errors import InvalidParameter

VOLTAGES = ("voltage", "left_voltage")
"""The inputs that replace a drive."""

# The parameters of an imported voltage: its value, its rate, and the time of both.
LEVEL, RATE, TIME, COUNT = range(4)


def _right(t: float, q: NDArray[np.float64]) -> float:
    return q[LEVEL] + q[RATE] * (t - q[TIME])


def _left(t: float, q: NDArray[np.float64]) -> float:
    return q[COUNT + LEVEL] + q[COUNT + RATE] * (t - q[COUNT + TIME])


class ImportedVoltage(Drive):
    """Voltages at the electrodes that the importer of a model sets at any time."""

    level: Annotated[Number, Unit("V")]  # initial voltage at the right electrode [V]
    period: Annotated[Positive, Unit("s")]  # a time that resolves the voltage [s]
    left_level: Annotated[Number, Unit("V")] = 0.0  # voltage at the left electrode [V]

    voltage = staticmethod(_right)

    @property
    def names(self) -> tuple[str, ...]:
        """Empty: the importer sets its numbers."""
        return ()

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
        """Indices in the parameters of each voltage and of its rate, and its initial value."""
        found = {"voltage": (LEVEL, RATE, self.level)}
        if self.left_voltage is not None:
            found["left_voltage"] = (COUNT + LEVEL, COUNT + RATE, self.left_level)
        return found


class ImportedVoltages(ImportedVoltage):
    """Voltages at both electrodes that the importer of a model sets at any time."""

    left_voltage = staticmethod(_left)


def imported(drive: Drive, inputs: Sequence[str], own_period: float) -> ImportedVoltage:
    """Return the voltages that replace a drive of a device with a period of its own."""
    if drive.clamp_voltage is not None:
        problem = "the drive has a voltage for a clamp, which cannot be an input; omit it"
        raise InvalidParameter("inputs", tuple(inputs), "", problem=problem)
    left = drive.left_voltage is not None
    if not left and "left_voltage" in inputs:
        allowed = "voltage: this drive has no electrode on the left"
        raise InvalidParameter("inputs", "left_voltage", allowed)
    if left and not set(VOLTAGES) <= set(inputs):
        allowed = "both voltage and left_voltage: this drive has two electrodes"
        raise InvalidParameter("inputs", tuple(inputs), allowed)
    return (ImportedVoltages if left else ImportedVoltage)(
        level=float(drive.value(0.0)),
        left_level=float(drive.value(0.0, channel="left")),
        period=min(own_period, drive.time_scale),
    )
