"""Voltage steps."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import model_validator

from mems_impact.actuator.drives.aperiodic import AperiodicDrive
from mems_impact.actuator.drives.piecewise import Piece
from mems_impact.actuator.parameter_base import NonNegative, OptionalPositive, Unit


class VoltageStep(AperiodicDrive):
    """A voltage that is switched on at t = 0 and stays.

    A step has no forcing period. Functions that need a forcing period, such as `find_orbit`, take a
    step with a duration.

    Parameters
    ----------
    amplitude : float
        Voltage after the rise [V], >= 0.
    rise : float, optional
        Duration of the rise from 0 [s], >= 0.
    duration : float, optional
        Time after which the voltage is switched off for as long [s], > rise, to start again; never
        by default. The forcing period is twice the duration.

    Raises
    ------
    InvalidParameter
        If a parameter is out of range, missing or unknown.

    See Also
    --------
    closing, PulseAndHold, Pulse

    Examples
    --------
    >>> import mems_impact as mi
    >>> drive = mi.VoltageStep(amplitude=0.6, rise=0.2, duration=20)
    >>> float(drive.value(0.1)), float(drive.value(10.0))
    (0.3, 0.6)
    """

    amplitude: Annotated[NonNegative, Unit("V")]
    rise: Annotated[NonNegative, Unit("s")] = 0.0
    duration: Annotated[OptionalPositive, Unit("s")] = None

    @model_validator(mode="after")
    def _check_times(self) -> Self:
        self._check_duration()
        return self

    @property
    def switching_time(self) -> float:
        """End of the rise."""
        return self.rise

    def levels(self) -> list[Piece]:
        """Return the rise and the constant voltage."""
        if self.rise == 0.0:
            return [Piece(0.0, self.amplitude)]
        return [Piece(0.0, 0.0, self.amplitude / self.rise), Piece(self.rise, self.amplitude)]
