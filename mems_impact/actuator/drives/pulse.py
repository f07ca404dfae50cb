"""Trains of pulses."""

from __future__ import annotations

import math
from typing import Annotated, Self

from pydantic import model_validator

from mems_impact._util.formatting import shown
from mems_impact._util.warning_scopes import warn
from mems_impact.actuator.drives.piecewise import MIN_PIECE_PERIODS, Piece, PiecewiseDrive
from mems_impact.actuator.parameter_base import NonNegative, Number, Positive, Unit
from mems_impact.errors import InvalidParameter


class Pulse(PiecewiseDrive):
    """A pulse train: once per period it rises from `low` to `amplitude`, stays, and falls again.

    Without a phase the pulse begins to rise at t = 0. The voltage is discontinuous at a flank
    without duration, its rate at a finite flank. Both are switches.

    Parameters
    ----------
    amplitude : float
        Voltage at the top [V], >= 0.
    period : float
        Time from one pulse to the next [s], > 0; the forcing period.
    width : float
        Time from the beginning of the rise to the beginning of the fall [s], > 0. With equal flanks
        `width` is the width at half height.
    rise, fall : float, optional
        Duration of the flanks [s], >= 0; rise <= width and width + fall <= period.
    low : float, optional
        Voltage between the pulses [V].
    phase : float, optional
        Phase of the pulse train [rad]; 2 pi is a period.

    Raises
    ------
    InvalidParameter
        If a parameter is out of range, missing or unknown.

    See Also
    --------
    Square, Burst, Voltages

    Examples
    --------
    >>> import mems_impact as mi
    >>> drive = mi.Pulse(amplitude=0.35, period=12, width=3.8, rise=0.2)
    >>> float(drive.value(0.1)), len(drive.switches)
    (0.175, 3)
    """

    amplitude: Annotated[NonNegative, Unit("V")]
    period: Annotated[Positive, Unit("s")]
    width: Annotated[Positive, Unit("s")]
    rise: Annotated[NonNegative, Unit("s")] = 0.0
    fall: Annotated[NonNegative, Unit("s")] = 0.0
    low: Annotated[Number, Unit("V")] = 0.0
    phase: Number = 0.0

    @model_validator(mode="after")
    def _check_times(self) -> Self:
        slack = MIN_PIECE_PERIODS * self.period
        if not slack < self.width < self.period:
            allowed = f"> 0 and below the period = {shown(self.period)}"
            raise InvalidParameter("width", self.width, allowed)
        if not self.rise <= self.width + slack:
            allowed = f"between 0 and the width = {shown(self.width)}"
            raise InvalidParameter("rise", self.rise, allowed)
        if not self.width + self.fall <= self.period + slack:
            max_fall = f"{self.period - self.width:.9g}"
            raise InvalidParameter("fall", self.fall, f"between 0 and period - width = {max_fall}")
        warn_of_constant_force("these pulses", self.amplitude, self.low, max(self.rise, self.fall))
        return self

    @property
    def lead(self) -> float:
        """Phase of the pulse train, as a time."""
        return self.phase / (2.0 * math.pi) * self.period

    def pieces(self) -> list[Piece]:
        """Return rise, top, fall and the part between pulses."""
        return pulse(
            self.low, self.amplitude, self.period, width=self.width, rise=self.rise, fall=self.fall
        )


def pulse(
    low: float, top: float, period: float, *, width: float, rise: float, fall: float
) -> list[Piece]:
    """Return the pieces of one pulse, without parts of zero duration up to rounding."""
    slack = MIN_PIECE_PERIODS * period
    pieces = []
    if rise > slack:
        pieces.append(Piece(0.0, low, (top - low) / rise))
    if rise < width - slack:
        pieces.append(Piece(rise if rise > slack else 0.0, top))
    if fall > slack:
        pieces.append(Piece(width, top, (low - top) / fall))
    if width + fall < period - slack:
        pieces.append(Piece(width + fall if fall > slack else width, low))
    return pieces


def warn_of_constant_force(wave: str, amplitude: float, low: float, flank: float) -> None:
    """Warn if a waveform between two voltages exerts a constant force, except on its flanks."""
    if amplitude > 0.0 and abs(low) == amplitude and (low == amplitude or flank == 0.0):
        warn(
            f"the force of {wave} is constant: it depends on the square of the voltage, and "
            f"low = {low:g} is as strong as amplitude = {amplitude:g}; take another low, such as 0",
            UserWarning,
            wave,
        )
