"""Square waves."""

from __future__ import annotations

import math
from typing import Annotated, Self

from annotated_types import Gt, Lt
from pydantic import model_validator

from mems_impact.actuator.drives.piecewise import MIN_PIECE_PERIODS, Piece, PiecewiseDrive
from mems_impact.actuator.drives.pulse import pulse, warn_of_constant_force
from mems_impact.actuator.parameter_base import NonNegative, Number, Positive, Unit
from mems_impact.errors import InvalidParameter


class Square(PiecewiseDrive):
    """A square wave: `amplitude` for a fraction of the period, then `low`.

    Without a phase the wave begins to rise at t = 0.

    Parameters
    ----------
    amplitude : float
        Upper voltage [V], >= 0.
    omega : float
        Angular frequency [rad/s], > 0.
    duty : float, optional
        Duty cycle: the fraction of the period from the beginning of the rise to the beginning of
        the fall [-], 0 < duty < 1, equal to the fraction at half height or above.
    rise : float, optional
        Duration of both flanks [s], >= 0 and no longer than the upper or the lower part.
    low : float, optional
        Lower voltage [V], 0 by default.
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
    Pulse, Trapezoid, Sine

    Notes
    -----
    The forcing period is 2 pi/omega, and pi/omega if the lower half mirrors the upper half (low =
    -amplitude and duty = 1/2), since the force is the same. Without a rise time a wave with low =
    -amplitude or low = amplitude exerts a constant force; a warning is issued.

    Examples
    --------
    >>> import mems_impact as mi
    >>> drive = mi.Square(amplitude=0.24, omega=0.5, duty=0.3)
    >>> float(drive.value(1.0)), float(drive.value(5.0))
    (0.24, 0.0)
    """

    amplitude: Annotated[NonNegative, Unit("V")]
    omega: Annotated[Positive, Unit("rad/s")] = math.nan  # or a frequency
    duty: Annotated[Number, Gt(0), Lt(1)] = 0.5
    rise: Annotated[NonNegative, Unit("s")] = 0.0
    low: Annotated[Number, Unit("V")] = 0.0
    phase: Number = 0.0
    frequency: Annotated[Positive | None, Unit("Hz")] = None

    @model_validator(mode="after")
    def _check_times(self) -> Self:
        wave_period = 2.0 * math.pi / self.omega
        if not min(self.duty, 1.0 - self.duty) > MIN_PIECE_PERIODS:
            raise InvalidParameter("duty", self.duty, "a finite number > 0 and < 1")
        max_rise = min(self.duty, 1.0 - self.duty) * wave_period
        if not self.rise <= max_rise + MIN_PIECE_PERIODS * wave_period:
            allowed = f"between 0 and {max_rise:.9g}, the shorter part of the period"
            raise InvalidParameter("rise", self.rise, allowed)
        warn_of_constant_force("this square wave", self.amplitude, self.low, self.rise)
        return self

    @property
    def period(self) -> float:
        """Forcing period: 2 pi/omega, or half of it if v^2 repeats in the second half."""
        return (1.0 if self.changes_sign else 2.0) * math.pi / self.omega

    @property
    def changes_sign(self) -> bool:
        """True if the lower half mirrors the upper half."""
        return self.duty == 0.5 and self.low == -self.amplitude

    @property
    def lead(self) -> float:
        """Phase of the wave, as a time."""
        return self.phase / self.omega

    def pieces(self) -> list[Piece]:
        """Return rise, top, fall and bottom; rise and top alone if v^2 repeats after them."""
        low, top, rise, period = self.low, self.amplitude, self.rise, self.period
        if not self.changes_sign:
            return pulse(low, top, period, width=self.duty * period, rise=rise, fall=rise)
        slack = MIN_PIECE_PERIODS * period
        pieces = [Piece(0.0, low, (top - low) / rise)] if rise > slack else []
        if rise < period - slack:
            pieces.append(Piece(rise if pieces else 0.0, top))
        return pieces
