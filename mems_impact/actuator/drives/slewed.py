"""The output of a source whose rate of change is limited.

The source follows the demanded voltage while its rate is within the limit, and changes at the limit
until it reaches the demanded voltage again. Since this does not depend on the actuator, the times
of all transitions are known in advance: they are switching times of the output.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, lru_cache
from itertools import pairwise
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.optimize import brentq, minimize_scalar

from mems_impact._util.bisection import bisect
from mems_impact.actuator.drives.base import Drive, Waveform
from mems_impact.actuator.drives.piecewise import COUNT, FIRST, PERIOD, fold, piece_at
from mems_impact.actuator.parameter_base import Positive, Unit

PIECE_NUMBERS = 4  # of a piece in q: start, whether it is a ramp, value at the start, rate
POINTS_PER_TIME_SCALE = 256  # at which voltage and rate are compared with the ramp
POINTS_PER_NUMBER = 2  # at least, per number of the waveform: a piece of a record has five
MIN_POINTS, MAX_POINTS = 32, 20_000
VOLTAGE_RTOL = 1e-13  # of the range of the voltage
SLOPE_STEP = 1e-5  # of the time scale, over which the voltage gives its rate
RATE_RTOL = 1e-9  # by which a rate must exceed the limit
PERIODS = 3  # of iteration before the periodic output is solved for
FIRST_POINTS = 24  # halvings of the distance of two points, after the start of a ramp


class OutputPiece(NamedTuple):
    """A piece of the output: a ramp, or the demanded voltage."""

    start: float
    ramp: bool
    value: float = 0.0
    rate: float = 0.0


class SlewedDrive(Drive):
    """The periodic output of a source with a slew rate."""

    wave: Drive = Field(description="a drive")  # the demanded voltage
    rate: Annotated[Positive, Unit("V/s")]  # largest absolute rate of the output [V/s]

    @property
    def period(self) -> float:
        """Forcing period of the demanded voltage."""
        return self.wave.period

    @property
    def time_scale(self) -> float:
        """Time scale of the demanded voltage."""
        return self.wave.time_scale

    @property
    def changes_sign(self) -> bool:
        """Whether the demanded voltage changes its sign."""
        return self.wave.changes_sign

    @property
    def switches(self) -> tuple[float, ...]:
        """Times of jumps of voltage or rate of either side."""
        return _output(self).switches

    def parameters(self) -> NDArray[np.float64]:
        """Return the pieces of each side, headed by their size, and the array of the wave."""
        return _output(self).q.copy()

    def scaled(self, voltage: float, time: float) -> Self:
        """Return the same output in other units of voltage and time."""
        return self.replace_unchecked(
            wave=self.wave.scaled(voltage, time), rate=self.rate / voltage * time
        )

    @property
    def voltage(self) -> Waveform:  # type: ignore[override]
        """The output at the right electrode."""
        return with_ramps(self.wave.voltage, 0)

    @property
    def left_voltage(self) -> Waveform | None:
        """The output at the left electrode, if there is one."""
        demand = self.wave.left_voltage
        return None if demand is None else with_ramps(demand, 1)


@cache
def with_ramps(demand: Waveform, side: int) -> Waveform:
    """Return a waveform with the ramps of a side."""

    def waveform(t, q):  # type: ignore[no-untyped-def]
        start = side * (1 + int(q[0]))
        pieces = q[start + 1 :]
        u = fold(t, pieces[PERIOD])
        i = piece_at(u, pieces, PIECE_NUMBERS)
        if pieces[i + 1] > 0.0:
            return pieces[i + 2] + pieces[i + 3] * (u - pieces[i])
        second_start = 1 + int(q[0])
        return demand(u, q[second_start + 1 + int(q[second_start]) :])

    return waveform


# --- The pieces of the output


class SlewedOutput(NamedTuple):
    """Parameter array and switching times of an output."""

    q: NDArray[np.float64]
    switches: tuple[float, ...]


@lru_cache(maxsize=64)
def _output(drive: SlewedDrive) -> SlewedOutput:
    wave, period = drive.wave, drive.period
    sign = -1.0 if wave.changes_sign else 1.0
    voltage_period = 2.0 * period if wave.changes_sign else period
    blocks: list[NDArray[np.float64]] = []
    times: set[float] = set()
    for voltage in (wave.voltage, wave.left_voltage):
        if voltage is None:
            blocks.append(np.zeros(1))
            continue
        side = SlewedSide(voltage, wave, drive.rate, sign)
        pieces = side.pieces()
        times |= side.switches(pieces)
        rows = [tuple(map(float, piece)) for piece in pieces]
        if voltage_period > period:
            rows += [(period + a, ramp, -value, -slope) for a, ramp, value, slope in rows]
        block = np.concatenate([[voltage_period, len(rows)], np.ravel(rows)])
        blocks += [np.array([float(block.size)]), block]
    assert PERIOD == 0
    assert COUNT == 1
    assert FIRST == 2
    return SlewedOutput(np.concatenate([*blocks, wave.parameters()]), tuple(sorted(times)))


class SlewedSide:
    """The output of one side over a forcing period.

    `voltage`, a function of t and q, is the demanded voltage; `limit` is the slew rate. `sign` is
    -1 if the voltage changes its sign from each forcing period to the next, else 1.
    """

    def __init__(self, voltage: Waveform, wave: Drive, limit: float, sign: float) -> None:
        q = wave.parameters()
        self.period, self.limit, self.sign = wave.period, limit, sign
        self.wave_switches, self.time_scale = wave.switches, wave.time_scale
        switches = [time for time in wave.switches if 0.0 < time < self.period]
        self.intervals = list(pairwise([0.0, *switches, self.period]))
        self.density = max(
            POINTS_PER_TIME_SCALE / wave.time_scale, POINTS_PER_NUMBER * q.size / self.period
        )
        numbers: Any = q.tolist()  # faster than an array, element by element
        self.value: Callable[[float], float] = lambda t: float(voltage(t, numbers))
        values = [self.value(t) for begin, end in self.intervals for t in self._grid(begin, end)]
        self.scale = max(max(map(abs, values)), 1e-300)

    def pieces(self) -> list[OutputPiece]:
        """Return the pieces of the periodic output.

        If there are several, the node has the voltage that a source reaches from 0.
        """
        start = 0.0
        for _ in range(PERIODS):
            end = self.sign * self._end_value(start)
            if abs(end - start) <= VOLTAGE_RTOL * self.scale:
                return self._period_output(start)[0]
            start = end
        # The value at the end grows with that at the start, by no more than it.
        tolerance = VOLTAGE_RTOL * self.scale

        def gain(value: float) -> float:
            return self.sign * self._end_value(value) - value

        if self.sign < 0.0:  # a single solution
            start = float(brentq(gain, -self.scale, self.scale, xtol=tolerance))
            return self._period_output(start)[0]
        is_rising = gain(start) > 0.0
        far = self.scale if is_rising else -self.scale

        def moves(value: float) -> bool:
            change = gain(value)
            return abs(change) > tolerance and (change > 0.0) == is_rising

        return self._period_output(bisect(moves, start, far, tolerance)[1])[0]

    def slope(self, t: float) -> float:
        """Return the rate of the demanded voltage, by values between the same two switches."""
        begin, end = next(each for each in reversed(self.intervals) if each[0] <= t)
        h = min(SLOPE_STEP * self.time_scale, 0.25 * (end - begin))
        centre = min(max(t, begin + h), math.nextafter(end, 0.0) - h)
        below, middle, above = map(self.value, (centre - h, centre, centre + h))
        bend = (above - 2.0 * middle + below) / (h * h)
        return (above - below) / (2.0 * h) + (t - centre) * bend

    def switches(self, pieces: list[OutputPiece]) -> set[float]:
        """Return the switching times of these pieces."""
        ends = [piece.start for piece in pieces[1:]] + [self.period]
        times = {piece.start for piece in pieces if piece.start > 0.0}
        for piece, end in zip(pieces, ends, strict=True):
            if not piece.ramp:
                times |= {time for time in self.wave_switches if piece.start < time < end}
        first, last = pieces[0], pieces[-1]
        has_end_switch = first.ramp != last.ramp or (
            self.wave_switches[-1:] == (self.period,)
            if not first.ramp
            else first.rate != self.sign * last.rate
        )
        return times | {self.period} if has_end_switch else times

    def _end_value(self, start: float) -> float:
        return self._period_output(start)[1]

    def _period_output(self, start: float) -> tuple[list[OutputPiece], float]:
        """Return the pieces from an output `start` at time 0, and the output at the end."""
        output, pieces = start, []
        ramp_rate = math.nan  # rate of the current ramp; NaN while following
        is_following = False
        for begin, end in self.intervals:
            time = begin
            difference = self.value(begin) - output
            if abs(difference) <= VOLTAGE_RTOL * self.scale:
                if not is_following:
                    pieces.append(OutputPiece(begin, False))
                is_following, ramp_rate = True, math.nan
            else:
                rate = math.copysign(self.limit, difference)
                if is_following or rate != ramp_rate:
                    pieces.append(OutputPiece(begin, True, output, rate))
                is_following, ramp_rate = False, rate
            while time < end:
                if is_following:
                    time = self._exceedance_time(time, end)
                    if time < end:
                        output = self.value(time)
                        ramp_rate = math.copysign(self.limit, self.slope(time))
                        pieces = _with_piece(pieces, OutputPiece(time, True, output, ramp_rate))
                        is_following = False
                    else:
                        output = self.value(math.nextafter(end, 0.0))
                else:
                    piece = pieces[-1]
                    time = self._arrival_time(piece, time, end)
                    if time < end:
                        output, slope = self.value(time), self.slope(time)
                        if abs(slope) <= self.limit:
                            pieces = _with_piece(pieces, OutputPiece(time, False))
                            is_following, ramp_rate = True, math.nan
                        else:
                            ramp_rate = math.copysign(self.limit, slope)
                            pieces = _with_piece(pieces, OutputPiece(time, True, output, ramp_rate))
                    else:
                        output = piece.value + piece.rate * (end - piece.start)
        return pieces, output

    def _grid(self, begin: float, end: float) -> list[float]:
        """Return times from `begin` to just before `end`."""
        count = min(max(round(self.density * (end - begin)), MIN_POINTS), MAX_POINTS)
        return np.linspace(begin, math.nextafter(end, 0.0), count).tolist()

    def _exceedance_time(self, begin: float, end: float) -> float:
        """Return the first time at which the demanded rate exceeds the limit; `end` if none."""
        max_rate = self.limit * (1.0 + RATE_RTOL)
        time = _first_positive(lambda t: abs(self.slope(t)) - max_rate, self._grid(begin, end))
        return end if time is None else time

    def _arrival_time(self, piece: OutputPiece, begin: float, end: float) -> float:
        """Return the first time at which a ramp reaches the demanded voltage; `end` if none."""
        sign = math.copysign(1.0, piece.rate)

        def excess(t: float) -> float:
            return sign * (piece.value + piece.rate * (t - piece.start) - self.value(t))

        times = self._grid(begin, end)
        tolerance = VOLTAGE_RTOL * self.scale
        if piece.start == begin and excess(begin) >= -tolerance:
            # The ramp starts from the demanded voltage, perhaps for a short time.
            early_times = [begin + (times[1] - begin) * 0.5**k for k in range(FIRST_POINTS, 0, -1)]
            start = next((t for t in [*early_times, times[1]] if excess(t) < -tolerance), None)
            if start is None:
                return times[1]
            times = [t for t in [*early_times, *times[1:]] if t >= start]
        time = _first_positive(excess, times)
        return end if time is None else time


def _with_piece(pieces: list[OutputPiece], piece: OutputPiece) -> list[OutputPiece]:
    """Return the pieces before the start of a piece, and the piece."""
    return [each for each in pieces if each.start < piece.start] + [piece]


def _first_positive(function: Callable[[float], float], times: list[float]) -> float | None:
    """Return the first time at which a function becomes positive; None if it stays negative.

    Maxima between the times are located.
    """
    values = [function(t) for t in times]
    if values[0] > 0.0:
        return times[0]
    for i in range(1, len(times)):
        is_positive = values[i] > 0.0
        high = times[i]
        if not is_positive and i + 1 < len(times) and values[i - 1] < values[i] >= values[i + 1]:
            optimum = minimize_scalar(
                lambda t: -function(t), bounds=(times[i - 1], times[i + 1]), method="bounded",
                options={"xatol": 1e-9 * (times[i + 1] - times[i - 1])},
            )  # fmt: skip
            is_positive, high = -float(optimum.fun) > 0.0, float(optimum.x)
        if is_positive:
            low = times[i - 1]
            return float(brentq(function, low, high, xtol=1e-300, rtol=4.0 * np.finfo(float).eps))
    return None
