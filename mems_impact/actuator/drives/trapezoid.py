"""Trapezoidal waves, triangles among them."""

from __future__ import annotations

import math
from typing import Annotated

from annotated_types import Ge, Lt

from mems_impact.actuator.drives.piecewise import MIN_PIECE_PERIODS, Piece, PiecewiseDrive
from mems_impact.actuator.parameter_base import NonNegative, Number, Positive, Unit


class Trapezoid(PiecewiseDrive):
    """A sine with straight flanks and flat crests, between bias + amplitude and bias - amplitude.

    Without a phase the middle of the upper crest is at t = 0, as for `Sine`.

    Parameters
    ----------
    amplitude : float
        Amplitude [V], >= 0.
    omega : float
        Angular frequency [rad/s], > 0.
    flat : float, optional
        Fraction of the period on both crests together [-], 0 <= flat < 1; 0 is a triangle wave.
    bias : float, optional
        Constant part [V].
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
    Sine, Square

    Examples
    --------
    >>> import mems_impact as mi
    >>> drive = mi.Trapezoid(amplitude=0.24, omega=0.5, flat=0.6)
    >>> float(drive.value(0.0))
    0.24
    """

    amplitude: Annotated[NonNegative, Unit("V")]
    omega: Annotated[Positive, Unit("rad/s")] = math.nan  # or a frequency
    flat: Annotated[Number, Ge(0), Lt(1)] = 0.5
    bias: Annotated[Number, Unit("V")] = 0.0
    phase: Number = 0.0
    frequency: Annotated[Positive | None, Unit("Hz")] = None

    @property
    def period(self) -> float:
        """Forcing period: pi/omega without bias, 2 pi/omega with."""
        return (math.pi if self.bias == 0.0 else 2.0 * math.pi) / self.omega

    @property
    def changes_sign(self) -> bool:
        """Whether the bias is zero."""
        return self.bias == 0.0

    @property
    def lead(self) -> float:
        """Phase of the wave, as a time."""
        # The pieces begin with the upper crest.
        return self.phase / self.omega + 0.25 * self.flat * 2.0 * math.pi / self.omega

    def pieces(self) -> list[Piece]:
        """Return crest and fall, and their mirror images if there is a bias."""
        wave_period = 2.0 * math.pi / self.omega
        slack = MIN_PIECE_PERIODS * wave_period
        crest, flank = 0.5 * self.flat * wave_period, 0.5 * (1.0 - self.flat) * wave_period
        top, bottom = self.bias + self.amplitude, self.bias - self.amplitude
        pieces = []
        halves = [(0.0, top, bottom), (0.5 * wave_period, bottom, top)]
        for start, level, next_level in halves if self.bias != 0.0 else halves[:1]:
            if crest > slack:
                pieces.append(Piece(start, level))
            if flank > slack:
                begin = start + crest if crest > slack else start
                pieces.append(Piece(begin, level, (next_level - level) / flank))
        return pieces
