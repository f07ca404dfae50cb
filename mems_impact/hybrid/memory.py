"""The memory of the event loop: its clock, table and buffers, for a problem and an engine."""

from __future__ import annotations

from typing import Any

import numpy as np

from mems_impact.hybrid import loop, record
from mems_impact.hybrid.problem import Bound, Problem
from mems_impact.hybrid.trajectory import Floats, Instant

__all__ = ["EVENT_ROWS", "LoopMemory"]

EVENT_ROWS = 4096  # beside one for each guard


class LoopMemory:
    """What the event loop reads and writes; it lives as long as this.

    Parameters
    ----------
    problem : Problem
    bound : Bound
    sample_rows : int
        Room for samples.
    **numbers
        Fields of the clock that the problem does not tell.

    Attributes
    ----------
    clock : CLOCK
    table : float array, or lists where they are read by Python
    events, samples : float array
    """

    def __init__(
        self,
        problem: Problem,
        bound: Bound,
        sample_rows: int,
        **numbers: float,
    ) -> None:
        automaton, options = problem.automaton, problem.options
        n, m = len(automaton.states), len(automaton.guards)
        switches = len(problem.switches)
        section, level, direction = problem.section or (record.NONE, 0.0, 0)
        self.table = bound.table(record.ROWS, max(n, 2 * m, switches))
        self.events = np.empty((EVENT_ROWS + m, loop.HEAD + 2 * n))
        self.samples = np.empty((sample_rows, 3 + n))
        for i, values in (*automaton.rows, (record.SWITCHES, problem.switches)):
            self.table[i][: len(values)] = values
        self.clock: Any = bound.record(
            loop.CLOCK,
            {"table": self.table, "events": self.events, "samples": self.samples},
            {
                "width": len(self.table[0]),
                "event_rows": EVENT_ROWS + m,
                "sample_rows": sample_rows,
                "n": n,
                "m": m,
                "switches": switches,
                "modes": len(automaton.modes),
                "period": problem.period,
                "scale": problem.time_scale or problem.period,
                "rtol": options.rtol,
                "atol": options.atol,
                "fresh": 1,
                "pending": loop.NONE,
                "stop": np.inf,
                "max_steps": options.max_steps,
                "max_events": options.max_events,
                "section": section,
                "level": level,
                "direction": direction,
                **numbers,
            },
        )

    def put(self, y: Floats) -> None:
        """Write the state."""
        self.table[record.Y][: len(y)] = np.asarray(y, dtype=float).tolist()

    def take_fall(self) -> tuple[Instant, float] | None:
        """Return where a very short step began, and its length, once; None if there is none."""
        clock, length = self.clock, float(self.clock["fallen"])
        if length == 0.0:
            return None
        clock["fallen"] = 0.0
        y = np.array(self.table[record.FALLEN][: clock["n"]], dtype=float)
        cycle, mode = int(clock["fallen_cycle"]), int(clock["fallen_mode"])
        return Instant(cycle, float(clock["fallen_time"]), mode, y), length

    @property
    def local(self) -> Floats:
        """The state as the functions see it."""
        return np.array(self.table[record.Y][: self.clock["n"]], dtype=float)

    @property
    def state(self) -> Floats:
        """The state, with what its cyclic components have gathered."""
        return self.local + self.table[record.OFFSET][: self.clock["n"]]
