"""The arcs of a run or an orbit: where each begins, how long it lasts, and what ends it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mems_impact.actuator.modes import V1, V2
from mems_impact.hybrid import loop
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.trajectory import Events, Floats, Instant

if TYPE_CHECKING:
    from mems_impact.actuator.results import ActuatorOrbit, ActuatorRun

__all__ = ["Leg", "arcs_of_orbit", "arcs_of_run"]


class Leg(NamedTuple):
    """A stretch of the motion within one mode.

    Attributes
    ----------
    begin : Instant
    length : float
        Time that it lasts.
    v2 : tuple of float
        Speed of the block before and after what ends it; equal unless that is an impact.
    row : int
        What ends it: the row of the event log, -1 for none.
    """

    begin: Instant
    length: float
    v2: tuple[float, float]
    row: int


def arcs_of_run(run: ActuatorRun, log: Events, first: float) -> Iterator[Leg]:
    """Return the arcs of a run from the one on in which the period `first` begins.

    Each begins as it did in the run, so that a chaotic motion stays what it was.
    """
    trajectory = run.trajectory
    period = trajectory.period
    begin = trajectory.start
    for row in np.flatnonzero(log.begin_arcs).tolist():
        cycle, time = int(log.cycle[row]), float(log.time[row])
        if cycle + time / period > first:
            start, length = begin, (cycle - begin.cycle) * period + (time - begin.time)
            if log.kind[row] == loop.ACCUMULATION:
                code = len(trajectory.automaton.guards) + int(log.guard[row])
                start = _touching(trajectory.problem, begin, code)
                if log.after[row, V1] == 0.0:
                    length = min(length, _slip(trajectory.problem, start))
            v2 = float(log.before[row, V2]), float(log.after[row, V2])
            yield Leg(start, length, v2, row)
        begin = Instant(cycle, time, int(log.mode_after[row]), log.after[row])
    final = trajectory.final
    length = (final.cycle - begin.cycle) * period + (final.time - begin.time)
    yield Leg(begin, length, (0.0, 0.0), -1)


def _touching(problem: Problem, begin: Instant, code: int) -> Instant:
    """Return how the rest of a sequence of impacts begins: bodies go on as if in touch already."""
    y = begin.y.copy()
    mode = problem.automaton.transition(begin.mode, code, begin.time, y, problem.parameters)
    return Instant(begin.cycle, begin.time, int(mode), y)


def _slip(problem: Problem, start: Instant) -> float:
    """Return after which time a frame, the block on its stopper, comes to rest."""
    dy = np.zeros(start.y.size)
    problem.automaton.flow(start.mode, start.time, start.y, problem.parameters, dy)
    speed, slowing = float(start.y[V1]), float(-dy[V1])
    return speed / slowing if speed * slowing > 0.0 else math.inf


def arcs_of_orbit(orbit: ActuatorOrbit) -> Iterator[Leg]:
    """Return the arcs of an orbit once round; rows are those of its own event log."""
    found = orbit.found
    cyclic = list(found.problem.automaton.cyclic)
    states, _ = found.shooting.unpack(found.point.unknowns)
    gathered: Floats = np.zeros(len(orbit.system.states))
    row = 0
    for i, segment in enumerate(found.segments):
        start, end = float(found.point.starts[i]), float(found.point.ends[i])
        event = found.point.events[i]
        y = orbit.system.tidied(segment.mode, states[i]) + gathered
        last = found.point.arcs[i].end
        after = last if event is None else event.after
        v2 = float(last[V2]), float(after[V2])
        yield Leg(
            Instant(segment.cycle, start, segment.mode, y), end - start, v2,
            -1 if event is None else row,
        )  # fmt: skip
        row += event is not None
        gathered[cyclic] += last[cyclic]
