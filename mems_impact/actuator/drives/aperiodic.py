"""Base of voltages that are switched on once, without a forcing period."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Self

from mems_impact.actuator.drives.piecewise import MIN_PIECE_PERIODS, Piece, PiecewiseDrive
from mems_impact.errors import InvalidParameter

WAVEFORM_PERIODS = 2.0  # of the switching: length on which a drive without a duration is checked


class AperiodicDrive(PiecewiseDrive):
    """Base of voltages that are switched on at t = 0 and constant from some time on.

    A subclass has the field ``duration``, None or the time after which the voltage is switched off
    for as long; it then starts again.
    """

    if TYPE_CHECKING:
        # Not at run time: it would become the first field of every subclass.
        duration: float | None

    @property
    @abstractmethod
    def switching_time(self) -> float:
        """Time from which on the voltage is constant."""

    @property
    def period(self) -> float:
        """Forcing period: twice the duration.

        Raises
        ------
        InvalidParameter
            If there is no duration.
        """
        self.check_period()
        assert self.duration is not None
        return 2.0 * self.duration

    def check_period(self) -> None:
        """Raise InvalidParameter if the drive has no duration, and so no forcing period."""
        if self.duration is None:
            problem = (
                "missing: without a duration, this voltage has no forcing period; "
                "compute its closing, or give the duration after which the voltage is switched off"
            )
            raise InvalidParameter("duration", None, "", problem=problem)

    def check(self) -> None:
        """Raise InvalidParameter if floating-point numbers cannot represent the waveform."""
        drive = self
        if self.duration is None:
            drive = self.lasting(WAVEFORM_PERIODS * self.switching_time or 1.0)
        super(AperiodicDrive, drive).check()

    def lasting(self, duration: float) -> Self:
        """Return the same voltage with a duration."""
        return self.replace(duration=duration)

    @abstractmethod
    def levels(self) -> list[Piece]:
        """Return the pieces up to the constant voltage, which is the last."""

    def pieces(self) -> list[Piece]:
        """Return the pieces of one forcing period."""
        self.check_period()
        assert self.duration is not None
        return [*self.levels(), Piece(self.duration, 0.0)]

    @property
    def lead(self) -> float:
        """Zero: the voltage is switched on at t = 0."""
        return 0.0

    def _check_duration(self) -> None:
        """Raise InvalidParameter if the duration ends before the voltage is constant."""
        if self.duration is None:
            return
        switching_time = self.switching_time
        if not self.duration * (1.0 - MIN_PIECE_PERIODS) > switching_time:
            allowed = f"above {switching_time:g}, from which on the voltage is constant"
            raise InvalidParameter("duration", self.duration, allowed)
