"""Piecewise cubic waveforms, on which most other waveforms are based."""

from __future__ import annotations

import math
import warnings
from abc import abstractmethod
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact.actuator.drives.base import Drive

__all__ = ["MIN_PIECE_PERIODS", "Piece", "PiecewiseDrive", "fold", "warn_of_one_force"]

MIN_PIECE_PERIODS = 1e-14  # of a period: shorter parts have no duration

PERIOD, COUNT, FIRST, WIDTH = 0, 1, 2, 5  # places in q; a piece is its start and 4 coefficients


class Piece(NamedTuple):
    """A polynomial c0 + c1 x + c2 x^2 + c3 x^3 of the time x since `start`.

    It reaches to the start of the next piece. `switch`: whether integration restarts at its start.
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


def piecewise_rate(t: float, q: NDArray[np.float64]) -> float:
    """Return dv/dt at t, from the right."""
    u = fold(t, q[PERIOD])
    i = piece_at(u, q, WIDTH)
    x = u - q[i]
    return q[i + 2] + x * (2.0 * q[i + 3] + x * 3.0 * q[i + 4])


class Assembled(NamedTuple):
    """Parameter array and switching times of a piecewise waveform."""

    q: NDArray[np.float64]
    switches: tuple[float, ...]


def assembled(
    pieces: Sequence[Piece], period: float, lead: float, *, mirrored: bool = False
) -> Assembled:
    """Return the waveform of `pieces` (ascending, the first at 0), advanced by the time `lead`.

    The switching times are exactly the starts of the pieces: the value at a switch is the one after
    it, and the value at the previous floating-point number is the one before it. A `mirrored`
    waveform has the negative pieces in every second period.
    """
    rest = math.fmod(lead, period)
    rest = rest + period if rest < 0.0 else rest
    sign = -1.0 if mirrored and round((lead - rest) / period) % 2 else 1.0
    wrapped = -sign if mirrored else sign
    ends = [piece.start for piece in pieces[1:]] + [period]
    turned: list[Piece] = []
    for piece, end in zip(pieces, ends, strict=True):
        start = piece.start - rest
        if start >= 0.0:
            turned.append(_times(piece, sign)._replace(start=start))
            continue
        start += period
        if start < period:
            turned.append(_times(piece, wrapped)._replace(start=start))
            if rest < end:  # the piece contains the start of the period
                turned.append(_later(piece, rest - piece.start, sign))
        else:  # just before the start of the period by rounding
            turned.append(_times(piece, sign)._replace(start=0.0))
    turned.sort(key=lambda piece: piece.start)
    switches = [piece.start for piece in turned if piece.switch and piece.start > 0.0]
    if turned[0].switch:
        switches.append(period)
    if mirrored:
        later = (_times(piece, -1.0) for piece in turned)
        turned += [piece._replace(start=period + piece.start) for piece in later]
    rows = [piece[:WIDTH] for piece in turned]
    turn = 2.0 * period if mirrored else period
    q = np.concatenate([[turn, len(rows)], np.ravel(rows)]).astype(np.float64)
    return Assembled(q, tuple(switches))


def _times(piece: Piece, factor: float) -> Piece:
    """Return a piece multiplied by a factor."""
    start, c0, c1, c2, c3, switch = piece
    return Piece(start, factor * c0, factor * c1, factor * c2, factor * c3, switch)


def _later(piece: Piece, x: float, sign: float) -> Piece:
    """Return the same polynomial by powers of the time since `x` after its start, as start 0."""
    _, c0, c1, c2, c3, _ = _times(piece, sign)
    return Piece(
        0.0,
        c0 + x * (c1 + x * (c2 + x * c3)),
        c1 + x * (2.0 * c2 + x * 3.0 * c3),
        c2 + 3.0 * x * c3,
        c3,
        switch=False,
    )


def warn_of_one_force(wave: str, amplitude: float, low: float, flank: float) -> None:
    """Warn if a waveform between two voltages exerts a constant force, except on its flanks."""
    if amplitude > 0.0 and abs(low) == amplitude and (low == amplitude or flank == 0.0):
        warnings.warn(
            f"the force of {wave} is constant: it depends on the square of the voltage, and "
            f"low = {low:g} is as strong as amplitude = {amplitude:g}; take another low, such as 0",
            stacklevel=3,
        )


class PiecewiseDrive(Drive):
    """Base of waveforms made of pieces; a subclass gives `period`, `lead` and `pieces`.

    A subclass whose voltage changes its sign from one forcing period to the next overrides
    `changes_sign`.
    """

    voltage = staticmethod(piecewise_voltage)
    voltage_rate = staticmethod(piecewise_rate)

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
        return _of(self).switches

    def parameters(self) -> NDArray[np.float64]:
        """Return the array (period, n, then start and four coefficients of each of n pieces).

        The period is that of the voltage.
        """
        return _of(self).q.copy()


@lru_cache(maxsize=16)
def _of(drive: PiecewiseDrive) -> Assembled:
    pieces, mirrored = drive.pieces(), drive.changes_sign
    return assembled(pieces, drive.period, drive.lead, mirrored=mirrored)
