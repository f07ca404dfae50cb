"""Two electrodes with separate voltages."""

from __future__ import annotations

from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from mems_impact._util.formatting import shown
from mems_impact.actuator.drives.base import Drive, Waveform
from mems_impact.actuator.drives.timeline import (
    TimelineSegment,
    array_of,
    repeated,
    retime,
    with_offset,
)
from mems_impact.errors import InvalidParameter

__all__ = ["TwoSided"]

MOST_PERIODS = 64
EQUAL_PERIODS_RTOL = 1e-12


class TwoSided(Drive):
    """Separate voltages at the right and the left electrode.

    The force on the block is alpha right^2/(d - x2)^2 - alpha left^2/(d + x2)^2.

    Parameters
    ----------
    right, left : Drive
        The two voltages, each one-sided, with an arbitrary relative phase. The ratio of their
        forcing periods must be a ratio of two integers up to 64.

    Raises
    ------
    InvalidParameter
        If a parameter is missing or unknown, or the periods have no common multiple.

    See Also
    --------
    Pulse, plot_drive

    Notes
    -----
    The forcing period is the least common multiple of both. The period is not halved if the left
    side repeats the right side half a period later, since the block then moves in the mirror image.

    Examples
    --------
    >>> import mems_impact as mi
    >>> pulse = mi.Pulse(amplitude=0.35, period=12, width=3.8)
    >>> pair = mi.TwoSided(right=pulse, left=pulse.replace(amplitude=0.25, phase=3.14))
    >>> pair.varied({"right.amplitude": 0.3}).right.amplitude
    0.3
    """

    right: Drive = Field(description="a drive")
    left: Drive = Field(description="a drive")

    @model_validator(mode="after")
    def _check_sides(self) -> Self:
        for name in ("right", "left"):
            side = getattr(self, name)
            if side.left_voltage is not None:
                problem = "must be a drive for one side"
                raise InvalidParameter(name, type(side).__name__, "", problem=problem)
        if self._counts is None:
            allowed = (
                f"in a ratio of whole numbers up to {MOST_PERIODS} to the forcing period of the "
                f"right side, {shown(self.right.period)}"
            )
            raise InvalidParameter("forcing period of the left side", self.left.period, allowed)
        return self

    @property
    def _counts(self) -> tuple[int, int] | None:
        """Forcing periods of right and left side in a common period."""
        right, left = self.right.period, self.left.period
        for count in range(1, MOST_PERIODS + 1):
            left_count = round(count * right / left)
            if (
                1 <= left_count <= MOST_PERIODS
                and abs(left_count * left - count * right) <= EQUAL_PERIODS_RTOL * left
            ):
                return count, left_count
        return None

    @property
    def period(self) -> float:
        """Forcing period: the least common multiple of the periods of both sides."""
        count = self._counts
        assert count is not None
        return count[0] * self.right.period

    @property
    def time_scale(self) -> float:
        """The shorter characteristic time of both sides."""
        return min(self.right.time_scale, self.left.time_scale)

    @property
    def changes_sign(self) -> bool:
        """True if a side with an odd number of repeats per common period changes its sign."""
        counts = self._counts or (0, 0)
        sides = zip((self.right, self.left), counts, strict=True)
        return any(side.changes_sign and count % 2 == 1 for side, count in sides)

    @property
    def stretches(self) -> tuple[list[TimelineSegment], list[TimelineSegment]]:
        """The timelines of right and left side over a forcing period."""
        right, left = repeated(self.right, self.period), repeated(self.left, self.period)
        # Switches at the same time, to rounding, are one switch.
        times = np.array([stretch.start for stretch in right])
        left_stretches = []
        for stretch in left:
            nearest = float(times[np.argmin(np.abs(times - stretch.start))])
            is_same = abs(nearest - stretch.start) <= 10.0 * EQUAL_PERIODS_RTOL * self.period
            left_stretches.append(stretch._replace(start=nearest) if is_same else stretch)
        return right, left_stretches

    @property
    def switches(self) -> tuple[float, ...]:
        """The switches of both sides."""
        starts = {stretch.start for side in self.stretches for stretch in side}
        has_end_switch = any(
            side.switches and side.switches[-1] == side.period for side in (self.right, self.left)
        )
        return (*sorted(starts - {0.0}), *([self.period] if has_end_switch else []))

    def parameters(self) -> NDArray[np.float64]:
        """Return, for each side, the length of its block, its timeline and its own array."""
        blocks = []
        voltage_period = 2.0 * self.period if self.changes_sign else self.period
        for side, stretches in zip((self.right, self.left), self.stretches, strict=True):
            timeline = self._continued_timeline(side, stretches) if self.changes_sign else stretches
            block = array_of(voltage_period, timeline, side.parameters())
            blocks += [np.array([block.size], dtype=np.float64), block]
        return np.concatenate(blocks)

    def _continued_timeline(
        self, side: Drive, stretches: list[TimelineSegment]
    ) -> list[TimelineSegment]:
        """Return the timeline of a side over two forcing periods, which continues the first.

        A switch of the second is exactly one forcing period after that of the first.
        """
        period = self.period
        two_periods = repeated(side, 2.0 * period)
        starts = [period + stretch.start for stretch in stretches]
        if len(two_periods) < 2 * len(stretches):  # none begins where the first period ends
            starts = starts[1:]
        second_period = two_periods[len(stretches) :]
        pairs = zip(second_period, starts, strict=True)
        return stretches + [stretch._replace(start=start) for stretch, start in pairs]

    def scaled(self, voltage: float, time: float) -> Self:
        """Return the same waveforms in other units of voltage and time."""
        sides = {name: getattr(self, name).scaled(voltage, time) for name in ("right", "left")}
        return self.replace(**sides)

    @property
    def voltage(self) -> Waveform:  # type: ignore[override]
        """The waveform at the right electrode as a function of t and q."""
        return with_offset(retime(self.right.voltage), 0)

    @property
    def voltage_rate(self) -> Waveform:  # type: ignore[override]
        """Time derivative of the waveform."""
        return with_offset(retime(self.right.voltage_rate), 0)

    @property
    def left_voltage(self) -> Waveform | None:
        """The waveform at the left electrode."""
        return with_offset(retime(self.left.voltage), 1)

    @property
    def left_rate(self) -> Waveform | None:
        """Time derivative of the waveform at the left electrode."""
        return with_offset(retime(self.left.voltage_rate), 1)
