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
    """Two engines that share parameters and biases; the text of `switching` says which is at work.

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
        self.mode = self.wanted = self.handed = self.trial = 0
        self.now = EXPLICIT
        self.looks = self.taken = self.directed = self.begun = self.suspected = self.patience = 0
        self.longest = self.longest_before = self.t_begin = self.t_middle = 0.0
        self.last_instant = math.inf

    @property
    def implicit_arcs(self) -> int:
        """Arcs that BDF has begun so far."""
        return self.begun

    def export_memory(self) -> tuple[int, ...]:
        """Return what is remembered of each mode; see `switching`."""
        return tuple(map(int, self.rows[MEMORY][: self.modes]))

    def import_memory(self, known: tuple[int, ...]) -> None:
        """Begin with what was remembered of each mode."""
        self.rows[MEMORY][: len(known)] = known

    def fault(self) -> Fault | None:
        """Return the first call of a function that failed, and forget it."""
        faults = (super().fault(), self.explicit.fault(), self.implicit.fault())
        return next((each for each in faults if each is not None), None)

    def remembered(self, mode: int) -> int:
        """Return what is remembered of `mode`."""
        return stiffness.method_memory(self, mode)

    def renew(self, max_step: float) -> None:
        """Forget all that was before; no step is longer than `max_step`."""
        stiffness.reset(self, max_step)

    def sharpen(self, share: float, lasts: float) -> None:
        """Let the next arc err by a `share` of the tolerances; its flight `lasts` so long."""
        stiffness.sharpen(self, share, lasts)

    def restart(self, mode: int, t: float, y: Any, stop: float) -> None:
        """Begin an arc at (t, y) in `mode` that sees nothing from `stop` on."""
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

    def ended(self, out: Any) -> None:
        """Write margins and rates at `time` into `out`."""
        self.at_work.ended(out)

    def fired(self, i: int) -> int:
        """Return how root function `i` crossed zero at the last ROOT."""
        return self.at_work.fired(i)

    def interpolate(self, t: float, y: Any) -> None:
        """Write the state at `t`, within the last step, into `y`."""
        self.at_work.interpolate(t, y)
