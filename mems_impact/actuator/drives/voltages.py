"""Separate voltages at both electrodes of the block, and at a clamp."""

from __future__ import annotations

from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from mems_impact._util.formatting import shown
from mems_impact.actuator.drives.base import CHANNELS, Drive, Waveform
from mems_impact.actuator.drives.timeline import (
    TimelineSegment,
    array_of,
    repeated,
    retime,
    with_offset,
)
from mems_impact.errors import InvalidParameter

MOST_PERIODS = 64
EQUAL_PERIODS_RTOL = 1e-12


class Voltages(Drive):
    """Separate voltages at the right and the left electrode of the block, and at a clamp.

    The force on the block is alpha right^2/(d - x2)^2 - alpha left^2/(d + x2)^2.

    Parameters
    ----------
    right : Drive
        The voltage of the right electrode.
    left : Drive, optional
        The voltage of the left electrode; no such electrode by default.
    clamp : Drive, optional
        The voltage of a `ClampElectrode` that follows it.

    Raises
    ------
    InvalidParameter
        If a parameter is missing or unknown, a drive has several voltages itself, or the periods
        have no common multiple: their ratios must be ratios of integers up to 64.

    See Also
    --------
    Pulse, ClampElectrode, plot_drive

    Notes
    -----
    The relative phases are arbitrary. The forcing period is the least common multiple of all
    periods. It is not halved if the left side repeats the right side half a period later, since the
    block then moves in the mirror image.

    Examples
    --------
    >>> import mems_impact as mi
    >>> pulse = mi.Pulse(amplitude=0.35, period=12, width=3.8)
    >>> pair = mi.Voltages(right=pulse, left=pulse.replace(amplitude=0.25, phase=3.14))
    >>> pair.varied({"right.amplitude": 0.3}).right.amplitude
    0.3
    """

    right: Drive = Field(description="a drive")
    left: Drive | None = Field(default=None, description="a drive")
    clamp: Drive | None = Field(default=None, description="a drive")

    @property
    def _waves(self) -> dict[str, Drive]:
        """The drives by channel."""
        waves = ((name, getattr(self, name)) for name in CHANNELS)
        return {name: wave for name, wave in waves if wave is not None}

    @model_validator(mode="after")
    def _check_waves(self) -> Self:
        for name, wave in self._waves.items():
            if wave.left_voltage is not None or wave.clamp_voltage is not None:
                problem = "must be a drive for one side"
                raise InvalidParameter(name, type(wave).__name__, "", problem=problem)
            if self._multiple((self.right, wave)) is None:
                allowed = (
                    f"in a ratio of whole numbers up to {MOST_PERIODS} to the forcing period of "
                    f"the right side, {shown(self.right.period)}"
                )
                name = f"forcing period of the {name}{' side' if name == 'left' else ''}"
                raise InvalidParameter(name, wave.period, allowed)
        if self._counts is None:
            problem = f"the periods have no common multiple of up to {MOST_PERIODS} periods each"
            raise InvalidParameter("clamp", None, "", problem=problem)
        return self

    @staticmethod
    def _multiple(waves: tuple[Drive, ...]) -> tuple[int, ...] | None:
        """Return the counts of periods in the least common period; None if there is none."""
        first = waves[0].period
        for count in range(1, MOST_PERIODS + 1):
            counts = tuple(round(count * first / wave.period) for wave in waves)
            if all(
                1 <= own <= MOST_PERIODS
                and abs(own * wave.period - count * first) <= EQUAL_PERIODS_RTOL * wave.period
                for own, wave in zip(counts, waves, strict=True)
            ):
                return counts
        return None

    @property
    def _counts(self) -> tuple[int, ...] | None:
        return self._multiple(tuple(self._waves.values()))

    @property
    def period(self) -> float:
        """Forcing period: the least common multiple of all periods."""
        counts = self._counts
        assert counts is not None
        return counts[0] * self.right.period

    @property
    def time_scale(self) -> float:
        """The shortest characteristic time."""
        return min(wave.time_scale for wave in self._waves.values())

    @property
    def changes_sign(self) -> bool:
        """True if a voltage with an odd number of repeats per common period changes its sign."""
        waves = zip(self._waves.values(), self._counts or (), strict=True)
        return any(wave.changes_sign and count % 2 == 1 for wave, count in waves)

    @property
    def stretches(self) -> list[list[TimelineSegment]]:
        """The timelines of all voltages over a forcing period."""
        found: list[list[TimelineSegment]] = []
        for wave in self._waves.values():
            own = []
            times = np.array([stretch.start for line in found for stretch in line])
            for stretch in repeated(wave, self.period):
                # Switches at the same time, to rounding, are one switch.
                apart = np.abs(times - stretch.start)
                near = times[apart <= 10.0 * EQUAL_PERIODS_RTOL * self.period]
                own.append(stretch._replace(start=float(near[0])) if near.size else stretch)
            found.append(own)
        return found

    @property
    def switches(self) -> tuple[float, ...]:
        """The switches of all voltages."""
        starts = {stretch.start for line in self.stretches for stretch in line}
        ends = any(wave.switches[-1:] == (wave.period,) for wave in self._waves.values())
        return (*sorted(starts - {0.0}), *([self.period] if ends else []))

    def parameters(self) -> NDArray[np.float64]:
        """Return, for each voltage, the length of its block, its timeline and its own array."""
        blocks = []
        voltage_period = 2.0 * self.period if self.changes_sign else self.period
        for wave, stretches in zip(self._waves.values(), self.stretches, strict=True):
            timeline = self._continued_timeline(wave, stretches) if self.changes_sign else stretches
            block = array_of(voltage_period, timeline, wave.parameters())
            blocks += [np.array([block.size], dtype=np.float64), block]
        return np.concatenate(blocks)

    def _continued_timeline(
        self, wave: Drive, stretches: list[TimelineSegment]
    ) -> list[TimelineSegment]:
        """Return the timeline of a voltage over two forcing periods, which continues the first.

        A switch of the second is exactly one forcing period after that of the first.
        """
        period = self.period
        two_periods = repeated(wave, 2.0 * period)
        starts = [period + stretch.start for stretch in stretches]
        if len(two_periods) < 2 * len(stretches):  # none begins where the first period ends
            starts = starts[1:]
        second_period = two_periods[len(stretches) :]
        pairs = zip(second_period, starts, strict=True)
        return stretches + [stretch._replace(start=start) for stretch, start in pairs]

    def scaled(self, voltage: float, time: float) -> Self:
        """Return the same waveforms in other units of voltage and time."""
        return self.replace(
            **{name: wave.scaled(voltage, time) for name, wave in self._waves.items()}
        )

    def _waveform(self, channel: str) -> Waveform | None:
        """Return the waveform of a channel, which reads its block of the array."""
        wave = self._waves.get(channel)
        if wave is None:
            return None
        return with_offset(retime(wave.voltage), list(self._waves).index(channel))

    @property
    def voltage(self) -> Waveform:  # type: ignore[override]
        """The waveform at the right electrode as a function of t and q."""
        waveform = self._waveform("right")
        assert waveform is not None
        return waveform

    @property
    def left_voltage(self) -> Waveform | None:
        """The waveform at the left electrode."""
        return self._waveform("left")

    @property
    def clamp_voltage(self) -> Waveform | None:
        """The waveform at the clamp."""
        return self._waveform("clamp")
