"""Waveforms on a timeline: repeated, truncated, or side by side.

A timeline is a list of segments. In each, the time of the nested waveform runs from a given value,
and never beyond the last floating-point number before its next switch. The value at a switch is
therefore exactly the value after the switch, in every repetition.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact.actuator.drives.base import Drive, Waveform
from mems_impact.actuator.drives.piecewise import COUNT, FIRST, PERIOD, fold, piece_at

NO_END = 1e300
NO_VOLTAGE = -1.0  # as `last`: no voltage
STRETCH_NUMBERS = 3  # numbers per segment, stored in q like the pieces of `piecewise`


class TimelineSegment(NamedTuple):
    """A segment from `start`, with the nested waveform from `nested_start` to `nested_end`."""

    start: float
    nested_start: float
    nested_end: float


@cache
def retime(nested: Waveform) -> Waveform:
    """Return `nested` on a timeline: q is that of `array_of`, then the q of `nested`."""

    def waveform(t, q):  # type: ignore[no-untyped-def]
        u = fold(t, q[PERIOD])
        i = piece_at(u, q, STRETCH_NUMBERS)
        if q[i + 2] < 0.0:
            return 0.0
        nested_start = FIRST + STRETCH_NUMBERS * int(q[COUNT])
        return nested(min(u - q[i] + q[i + 1], q[i + 2]), q[nested_start:])

    return waveform


@cache
def with_offset(nested: Waveform, block: int) -> Waveform:
    """Return `nested` for a q made of blocks, each headed by its length; it gets one of them."""

    def waveform(t, q):  # type: ignore[no-untyped-def]
        start = 0
        for _ in range(block):
            start += 1 + int(q[start])
        return nested(t, q[start + 1 :])

    return waveform


def array_of(
    period: float, stretches: list[TimelineSegment], nested: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the q of a retimed waveform."""
    return np.concatenate([[period, len(stretches)], np.ravel(stretches), nested])


def repeated(drive: Drive, length: float) -> list[TimelineSegment]:
    """Return the segments of `drive` repeated from 0 to `length`, with its changes of sign."""
    period, switches = drive.period, drive.switches
    if drive.changes_sign:
        period, switches = 2.0 * period, (*switches, *(period + time for time in switches))
    if not switches:
        return [TimelineSegment(0.0, 0.0, NO_END)]
    # At the switch that closes a period, the next one begins.
    segment_starts = [0.0 if time == period else time for time in switches]
    stretches = []
    if segment_starts[-1] != 0.0:
        stretches.append(TimelineSegment(0.0, 0.0, math.nextafter(switches[0], 0.0)))
    else:
        segment_starts = [0.0, *segment_starts[:-1]]
    ends = [*segment_starts[1:], period + segment_starts[0]]
    limit = length - 1e-12 * period
    for k in range(math.ceil(length / period)):
        for segment_start, end in zip(segment_starts, ends, strict=True):
            start = k * period + segment_start
            if start < limit:
                stretches.append(TimelineSegment(start, segment_start, math.nextafter(end, 0.0)))
    return stretches
