"""Bursts of another waveform."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from annotated_types import Gt, Le
from numpy.typing import NDArray
from pydantic import Field, model_validator

from mems_impact.actuator.drives.base import Drive, Waveform
from mems_impact.actuator.drives.timeline import (
    NO_VOLTAGE,
    TimelineSegment,
    array_of,
    repeated,
    retime,
)
from mems_impact.actuator.parameter_base import Number, OptionalPositive, Unit
from mems_impact.errors import InvalidParameter

MAX_BURST_PERIODS = 10_000


class Burst(Drive):
    """Another waveform for some of its forcing periods, then no voltage for a while.

    Parameters
    ----------
    wave : Drive
        The waveform that is switched on and off; each burst starts at t = 0 of the waveform, which
        the phase of the waveform shifts.
    on : float
        Length of the burst in forcing periods of `wave`, > 0, not necessarily an integer. A period
        of a sine without bias has two forcing periods.
    off : float, optional
        Length of the pause in forcing periods of `wave`, > 0.
    pause : float, optional
        Length of the pause as a time [s], > 0, in place of `off`.

    Raises
    ------
    InvalidParameter
        If a parameter is out of range, missing or unknown.

    See Also
    --------
    Pulse, Sine

    Notes
    -----
    The forcing period is burst and pause together. Beginning and end of the burst are switches, as
    are the switching times of `wave` within it.

    Examples
    --------
    >>> import math
    >>> import mems_impact as mi
    >>> wave = mi.Sine(amplitude=0.3, omega=0.5, phase=-math.pi / 2)
    >>> burst = mi.Burst(wave=wave, on=6, off=10)
    >>> round(burst.period / wave.period, 9)
    16.0
    """

    wave: Drive = Field(description="a drive")
    on: Annotated[Number, Gt(0), Le(MAX_BURST_PERIODS)]
    off: OptionalPositive = None
    pause: Annotated[OptionalPositive, Unit("s")] = None

    @model_validator(mode="after")
    def _check_pause(self) -> Self:
        if (self.off is None) == (self.pause is None):
            problem = "give the pause either as off (forcing periods) or as pause (a time)"
            raise InvalidParameter("off", self.off, "", problem=problem)
        return self

    @property
    def length(self) -> float:
        """Length of the burst as a time."""
        return self.on * self.wave.period

    @property
    def period(self) -> float:
        """Forcing period: burst and pause."""
        pause = self.pause if self.off is None else self.off * self.wave.period
        assert pause is not None
        return self.length + pause

    @property
    def changes_sign(self) -> bool:
        """False: all bursts are equal."""
        return False

    @property
    def time_scale(self) -> float:
        """Characteristic time of the nested waveform."""
        return self.wave.time_scale

    @property
    def stretches(self) -> list[TimelineSegment]:
        """The timeline of one period."""
        return [*repeated(self.wave, self.length), TimelineSegment(self.length, 0.0, NO_VOLTAGE)]

    @property
    def switches(self) -> tuple[float, ...]:
        """Switches of the burst, its end and the start of the next."""
        return (*(stretch.start for stretch in self.stretches[1:]), self.period)

    def parameters(self) -> NDArray[np.float64]:
        """Return the timeline, then the array of the nested waveform."""
        return array_of(self.period, self.stretches, self.wave.parameters())

    def scaled(self, voltage: float, time: float) -> Self:
        """Return the same waveform in other units of voltage and time."""
        pause = None if self.pause is None else self.pause / time
        return self.replace(wave=self.wave.scaled(voltage, time), pause=pause)

    @property
    def voltage(self) -> Waveform:  # type: ignore[override]
        """The waveform as a function of t and q."""
        return retime(self.wave.voltage)

    @property
    def left_voltage(self) -> Waveform | None:
        """The waveform at the left electrode, if the nested waveform has one."""
        waveform = self.wave.left_voltage
        return None if waveform is None else retime(waveform)

    @property
    def clamp_voltage(self) -> Waveform | None:
        """The waveform at the clamp, if the nested waveform has one."""
        waveform = self.wave.clamp_voltage
        return None if waveform is None else retime(waveform)
