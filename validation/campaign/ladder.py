"""A waveform of straight pieces with jumps between them, as a user would write it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mems_impact.actuator.drives import Drive
from mems_impact.actuator.parameter_base import Positive


def _rung(phase: float, q: Any) -> int:
    place = 0
    for i in range(1, int(q[1])):
        if phase >= q[2 + 3 * i]:
            place = i
    return 2 + 3 * place


def _voltage(t: float, q: Any) -> float:
    phase = t - math.floor(t / q[0]) * q[0]
    base = _rung(phase, q)
    return q[base + 1] + q[base + 2] * (phase - q[base])


class Ladder(Drive):
    """From each ``starts[i]`` on, ``levels[i] + slopes[i] (t - starts[i])``; starts[0] is 0."""

    length: Positive
    starts: tuple[float, ...]
    levels: tuple[float, ...]
    slopes: tuple[float, ...]

    units = {"length": "s", "starts": "s", "levels": "V"}  # noqa: RUF012

    voltage = staticmethod(_voltage)

    @property
    def period(self) -> float:
        return self.length

    @property
    def switches(self) -> tuple[float, ...]:
        return (*self.starts[1:], self.length)

    def parameters(self) -> np.ndarray:
        rows = np.column_stack([self.starts, self.levels, self.slopes]).ravel()
        return np.concatenate([[self.length, len(self.starts)], rows])
