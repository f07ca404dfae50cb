"""Pulse-and-hold voltages, which close a contact softly."""

from __future__ import annotations

import math
from typing import Annotated, Self

from pydantic import model_validator

from mems_impact._util.formatting import shown
from mems_impact.actuator.drives.aperiodic import AperiodicDrive
from mems_impact.actuator.drives.piecewise import Piece
from mems_impact.actuator.parameter_base import (
    NonNegative,
    Number,
    OptionalPositive,
    Positive,
    Unit,
)
from mems_impact.errors import InvalidParameter


class PulseAndHold(AperiodicDrive):
    """A pulse that accelerates the block, a pause in which it coasts, and a voltage that holds it.

    Parameters
    ----------
    amplitude : float
        Voltage of the pulse [V], >= 0.
    width : float
        Time from the beginning of the pulse, at t = 0, to the beginning of its fall [s], > 0.
    hold : float
        Voltage after the pause [V], >= 0.
    pause : float, optional
        Time from the beginning of the fall to the beginning of the rise to `hold` [s], >= 0. With
        the default 0 the voltage changes from `amplitude` to `hold` directly.
    low : float, optional
        Voltage in the pause [V].
    rise : float, optional
        Duration of each flank [s], >= 0 and no longer than the pulse, and than the pause unless the
        pause is 0.
    duration : float, optional
        Time after which the voltage is switched off for as long [s], to start again; never by
        default. The forcing period is twice the duration.

    Raises
    ------
    InvalidParameter
        If a parameter is out of range, missing or unknown.

    See Also
    --------
    soft_landing, closing, VoltageStep

    Examples
    --------
    >>> import mems_impact as mi
    >>> drive = mi.PulseAndHold(amplitude=0.6, width=1.2, pause=0.5, hold=0.4, duration=20)
    >>> [float(drive.value(t)) for t in (1.0, 1.5, 2.0)]
    [0.6, 0.0, 0.4]
    """

    amplitude: Annotated[NonNegative, Unit("V")]
    width: Annotated[Positive, Unit("s")]
    hold: Annotated[NonNegative, Unit("V")]
    pause: Annotated[NonNegative, Unit("s")] = 0.0
    low: Annotated[Number, Unit("V")] = 0.0
    rise: Annotated[NonNegative, Unit("s")] = 0.0
    duration: Annotated[OptionalPositive, Unit("s")] = None

    @model_validator(mode="after")
    def _check_times(self) -> Self:
        if not self.rise <= self.width:
            allowed = f"between 0 and the width = {shown(self.width)}"
            raise InvalidParameter("rise", self.rise, allowed)
        if self.pause > 0.0 and not self.rise <= self.pause:
            allowed = f"0, or at least the rise = {shown(self.rise)}"
            raise InvalidParameter("pause", self.pause, allowed)
        self._check_duration()
        return self

    @property
    def switching_time(self) -> float:
        """Time from which on the voltage is `hold`."""
        return self.width + self.pause + self.rise

    def levels(self) -> list[Piece]:
        """Return pulse, pause and the voltage that holds, with their flanks."""
        levels = [(0.0, self.amplitude)]
        if self.pause > 0.0:
            levels.append((self.width, self.low))
        levels.append((self.width + self.pause, self.hold))
        pieces, previous = [], 0.0
        for start, level in levels:
            begin = start
            if self.rise > 0.0:
                pieces.append(Piece(start, previous, (level - previous) / self.rise))
                begin = start + self.rise
            pieces.append(Piece(begin, level))
            previous = level
        # A flank as long as its part leaves no time at the level.
        ends = [piece.start for piece in pieces[1:]] + [math.inf]
        return [piece for piece, end in zip(pieces, ends, strict=True) if piece.start < end]
