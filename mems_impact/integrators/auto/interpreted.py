"""Automatic switching between DOP853 and BDF in Python."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from mems_impact.integrators.auto import stiffness
from mems_impact.integrators.auto.stiffness import EXPLICIT, MEMORY, ROWS
from mems_impact.integrators.cvode import interpreted as cvode
from mems_impact.integrators.dop853 import interpreted as onestep
from mems_impact.integrators.interface import Equations
from mems_impact.integrators.options import Options
from mems_impact.integrators.python_functions import Fault, Functions


class InterpretedAuto(Functions):
    """Two engines that share parameters and biases; `stiffness` selects one.

    The parameters are those of `mems_impact.integrators.cvode.interpreted.InterpretedCvode`. The
    attributes are the fields of `compiled.HANDLE`.
    """

    def __init__(self, equations: Equations, options: Options, max_step: float) -> None:
        super().__init__(equations)
        self.explicit = onestep.InterpretedDop853(
            equations, replace(options, method="dop853"), max_step
        )
        self.implicit = cvode.InterpretedCvode(equations, replace(options, method="bdf"), max_step)
        for one in (self.explicit, self.implicit):
            one.parameters, one.bias = self.parameters, self.bias
        self.at_work: onestep.InterpretedDop853 | cvode.InterpretedCvode = self.explicit
        self.rows = [[0.0] * max(equations.n, equations.modes) for _ in range(ROWS)]
        self.rtol, self.atol = float(options.rtol), float(options.atol)
        self.modes = equations.modes
        self.mode = self.wanted = self.handed_over = self.trial = 0
        self.now = EXPLICIT
        self.checks = self.steps = self.directed = self.begun = self.suspected = self.patience = 0
        self.longest = self.longest_before = self.t_begin = self.t_middle = 0.0
        self.last_instant = math.inf

    @property
    def implicit_arcs(self) -> int:
        """Arcs that BDF has begun so far."""
        return self.begun

    def export_memory(self) -> tuple[int, ...]:
        """Return the memory of each mode; see `stiffness`."""
        return tuple(map(int, self.rows[MEMORY][: self.modes]))

    def import_memory(self, memory: tuple[int, ...]) -> None:
        """Set the memory of each mode."""
        self.rows[MEMORY][: len(memory)] = memory

    def fault(self) -> Fault | None:
        """Return the first failed call, and clear the record."""
        faults = (super().fault(), self.explicit.fault(), self.implicit.fault())
        return next((each for each in faults if each is not None), None)

    def method_memory(self, mode: int) -> int:
        """Return the memory of `mode`."""
        return stiffness.method_memory(self, mode)

    def reset(self, max_step: float) -> None:
        """Restore the initial state, with the longest step `max_step`."""
        stiffness.reset(self, max_step)

    def lengthen(self, longest: float) -> None:
        """Allow steps of up to `longest` until the next restart."""
        stiffness.lengthen(self, longest)

    def sharpen(self, share: float, flight_time: float) -> None:
        """Reduce the tolerances of the next arc by the factor `share`."""
        stiffness.sharpen(self, share, flight_time)

    def restart(self, mode: int, t: float, y: Any, stop: float) -> None:
        """Begin an arc at (t, y) in `mode` with evaluations before `stop` only."""
        stiffness.restart(self, mode, t, y, stop)

    def step(self) -> int:
        """Take one step; STEPPED, STOPPED, ROOT, HANDOVER or a negative code."""
        return stiffness.step(self)

    def time(self) -> float:
        """Return the time at which the last step ended."""
        return self.at_work.time()

    def state(self, y: Any) -> None:
        """Copy the state at `time` into `y`."""
        self.at_work.state(y)

    def end_margins(self, out: Any) -> None:
        """Write margins and rates at `time` into `out`."""
        self.at_work.end_margins(out)

    def root_directions(self, i: int) -> int:
        """Return the direction in which root function `i` crossed zero at the last ROOT, or 0."""
        return self.at_work.root_directions(i)

    def interpolate(self, t: float, y: Any) -> None:
        """Write the state at `t`, within the last step, into `y`."""
        self.at_work.interpolate(t, y)
