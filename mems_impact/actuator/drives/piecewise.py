"""Piecewise cubic waveforms, on which most other waveforms are based."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact.actuator.drives.base import Drive

MIN_PIECE_PERIODS = 1e-14  # of a period: shorter parts have no duration

PERIOD, COUNT, FIRST, WIDTH = 0, 1, 2, 5  # places in q; a piece is its start and 4 coefficients


class Piece(NamedTuple):
    """A polynomial c0 + c1 x + c2 x^2 + c3 x^3 of the time x since `start`.

    The piece reaches to the start of the next piece. `switch`: whether integration restarts at its
    start.
    """

    start: float
    c0: float
    c1: float = 0.0
    c2: float = 0.0
    c3: float = 0.0
    switch: bool = True


def fold(t: float, period: float) -> float:
    """Return `t` within [0, period).

    The time just before a switch of the next period must not be folded beyond that switch: the
    difference below is exact for t < 2 period, which is as far as a drive with switches is asked.
    """
    u = t - period * math.floor(t / period)
    return u - period if u >= period else max(u, 0.0)


def piece_at(u: float, q: NDArray[np.float64], width: int) -> int:
    """Return the place in q of the piece that holds at `u`: the last that starts at or before.

    A piece is `width` numbers, its start first.
    """
    low, high = 0, int(q[COUNT])
    while high - low > 1:
        middle = (low + high) // 2
        if q[FIRST + width * middle] <= u:
            low = middle
        else:
            high = middle
    return FIRST + width * low


def piecewise_voltage(t: float, q: NDArray[np.float64]) -> float:
    """Return v(t)."""
    u = fold(t, q[PERIOD])
    i = piece_at(u, q, WIDTH)
    x = u - q[i]
    return q[i + 1] + x * (q[i + 2] + x * (q[i + 3] + x * q[i + 4]))


class WaveformArrays(NamedTuple):
    """The array q of a piecewise waveform, and its switching times in (0, period]."""

    q: NDArray[np.float64]
    switches: tuple[float, ...]


def waveform_arrays(
    pieces: Sequence[Piece], period: float, lead: float, *, mirrored: bool = False
) -> WaveformArrays:
    """Return the waveform of `pieces` (ascending, the first at 0), advanced by the time `lead`.

    The switching times are exactly the starts of the pieces: the value at a switch is the one after
    it, and the value at the previous floating-point number is the one before it. A `mirrored`
    waveform has the negative pieces in every second period.
    """
    shift = math.fmod(lead, period)
    shift = shift + period if shift < 0.0 else shift
    sign = -1.0 if mirrored and round((lead - shift) / period) % 2 else 1.0
    wrapped_sign = -sign if mirrored else sign
    ends = [piece.start for piece in pieces[1:]] + [period]
    result: list[Piece] = []
    for piece, end in zip(pieces, ends, strict=True):
        start = piece.start - shift
        if start >= 0.0:
            result.append(_scaled(piece, sign)._replace(start=start))
            continue
        start += period
        if start < period:
            result.append(_scaled(piece, wrapped_sign)._replace(start=start))
            if shift < end:  # the piece contains the start of the period
                result.append(_shifted(piece, shift - piece.start, sign))
        else:  # just before the start of the period by rounding
            result.append(_scaled(piece, sign)._replace(start=0.0))
    result.sort(key=lambda piece: piece.start)
    switches = [piece.start for piece in result if piece.switch and piece.start > 0.0]
    if result[0].switch:
        switches.append(period)
    if mirrored:
        mirror_images = (_scaled(piece, -1.0) for piece in result)
        result += [piece._replace(start=period + piece.start) for piece in mirror_images]
    rows = [piece[:WIDTH] for piece in result]
    voltage_period = 2.0 * period if mirrored else period
    q = np.concatenate([[voltage_period, len(rows)], np.ravel(rows)]).astype(np.float64)
    return WaveformArrays(q, tuple(switches))


def _scaled(piece: Piece, factor: float) -> Piece:
    """Return a piece multiplied by a factor."""
    start, c0, c1, c2, c3, switch = piece
    return Piece(start, factor * c0, factor * c1, factor * c2, factor * c3, switch)


def _shifted(piece: Piece, x: float, sign: float) -> Piece:
    """Return the same polynomial by powers of the time since `x` after its start, as start 0."""
    _, c0, c1, c2, c3, _ = _scaled(piece, sign)
    return Piece(
        0.0,
        c0 + x * (c1 + x * (c2 + x * c3)),
        c1 + x * (2.0 * c2 + x * 3.0 * c3),
        c2 + 3.0 * x * c3,
        c3,
        switch=False,
    )


class PiecewiseDrive(Drive):
    """Base of waveforms made of pieces; a subclass gives `period`, `lead` and `pieces`.

    A subclass whose voltage changes its sign from one forcing period to the next overrides
    `changes_sign`.
    """

    voltage = staticmethod(piecewise_voltage)

    @property
    def changes_sign(self) -> bool:
        """False: all forcing periods are equal."""
        return False

    @property
    @abstractmethod
    def lead(self) -> float:
        """Phase of the waveform, as a time."""

    @abstractmethod
    def pieces(self) -> list[Piece]:
        """Return the pieces of one period, the first at 0, without the lead."""

    @property
    def switches(self) -> tuple[float, ...]:
        """Times in (0, period] at which the voltage or its rate jumps."""
        return _arrays_of(self).switches

    def parameters(self) -> NDArray[np.float64]:
        """Return the array (period, n, then start and four coefficients of each of n pieces).

        The period in the array is the period of the voltage.
        """
        return _arrays_of(self).q.copy()


@lru_cache(maxsize=16)
def _arrays_of(drive: PiecewiseDrive) -> WaveformArrays:
    pieces, mirrored = drive.pieces(), drive.changes_sign
    return waveform_arrays(pieces, drive.period, drive.lead, mirrored=mirrored)
