"""DOP853 in Python."""

from __future__ import annotations

import math
from typing import Any

from mems_impact.integrators.dop853 import stepper
from mems_impact.integrators.dop853.stepper import ENGINE_NUMBERS, LOW, ROWS, STATE
from mems_impact.integrators.interface import Equations
from mems_impact.integrators.options import Options
from mems_impact.integrators.python_functions import Functions, scalars


class InterpretedDop853(Functions):
    """The functions of `stepper` over lists, with the interface of `integrators.interface`.

    The parameters are those of `mems_impact.integrators.cvode.interpreted.InterpretedCvode`; an
    explicit method does not use the Jacobian. The attributes are the fields of `compiled.HANDLE`.
    """

    def __init__(self, equations: Equations, options: Options, max_step: float) -> None:
        super().__init__(equations)
        n, m = equations.n, equations.m
        # Lists: access to scalars of arrays is several times slower.
        self.rows = [[0.0] * max(n, 2 * m + 2) for _ in range(ROWS)]
        self.components = [[0.0] * ENGINE_NUMBERS for _ in range(n)]
        self.crossings = [0] * (2 * m + 1)
        self.approaches = [int(each) for each in equations.approaches]
        self.section, self.level, self.direction = equations.crossing
        self.rtol, self.atol = float(options.rtol), float(options.atol)
        self.max_step = float(max_step)
        self.mode = 0
        self.t = self.t_start = self.t_end = 0.0
        self.stop = self.last_instant = math.inf
        self.h_next = self.longest = 0.0
        self.begun = self.rest = self.has_dense = 0
        self.at_border = self.off_border = self.stiff = 0
        self.steps = 0

    def is_stiff(self) -> bool:
        """Return whether stability, not accuracy, has limited steps."""
        return self.stiff == 1

    def reset(self, max_step: float) -> None:
        """Restore the initial state, with the longest step `max_step`."""
        stepper.reset(self, float(max_step))

    def lengthen(self, longest: float) -> None:
        """Allow steps of up to `longest` until the next restart."""
        stepper.lengthen(self, longest)

    def sharpen(self, share: float, flight_time: float) -> None:
        """Do nothing: the error of order 8 is negligible in a short flight."""

    def restart(self, mode: int, t: float, y: Any, stop: float) -> None:
        """Begin an arc at (t, y) in `mode` with evaluations before `stop` only."""
        stepper.restart(self, int(mode), float(t), scalars(y, self.n), float(stop))

    def step(self) -> int:
        """Take one step; STEPPED, STOPPED, ROOT or a negative code."""
        return stepper.step(self)

    def time(self) -> float:
        """Return the time at which the last step ended."""
        return self.t

    def state(self, y: Any) -> None:
        """Copy the state at `time` into `y`."""
        y[: self.n] = self.rows[STATE][: self.n]

    def end_margins(self, out: Any) -> None:
        """Write margins and rates at `time` into `out`."""
        out[: 2 * self.m] = self.rows[LOW][: 2 * self.m]

    def root_directions(self, i: int) -> int:
        """Return the direction in which root function `i` crossed zero at the last ROOT, or 0."""
        return self.crossings[i]

    def interpolate(self, t: float, y: Any) -> None:
        """Write the state at `t`, within the last step, into `y`."""
        stepper.interpolate(self, t, y)
