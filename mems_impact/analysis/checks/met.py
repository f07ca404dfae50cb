"""Rates and times compared where the system comes to: on the short run, and later in other modes.

The short run at the start seldom meets all modes. So runs, and orbits that are found, put down the
first states in modes that nobody has met, and the same is asked there once they are done: what is
wrong in such a mode would else stay silent for ever.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from mems_impact.analysis.checks.rates import check_constraint, check_rate
from mems_impact.analysis.checks.times import Clock, check_times
from mems_impact.analysis.terms import Terms
from mems_impact.hybrid.faults import definition_of
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.trajectory import Events, Instant
from mems_impact.hybrid.tried import Place, Tried, Undefined
from mems_impact.hybrid.written import Definition

__all__ = ["Meeting", "compare", "meeting", "met"]

POINTS = 3  # at which a mode is looked at after a run
CALLS = 1000  # of functions after a run, roughly: some milliseconds


def met(system: Terms) -> set[int]:
    """Return the modes in which a system has been looked at, at any parameters; to be added to."""
    return _met(vars(system)["_definition"], vars(system)["_period"])


@cache
def _met(definition: Definition, period: float | Callable[..., float] | None) -> set[int]:
    return set()


def compare(tried: Tried, clock: Clock, at: Place, slope: Sequence[float]) -> None:
    """Compare the flow with that at other times, rates with differences, constraints with zero."""
    if not clock.switches:
        check_times(tried, at, slope, clock.period, clock.unit)
    for i, guard in enumerate(tried.definition.guards):
        if guard.rate is not None and (guard.modes is None or at.mode in guard.modes):
            check_rate(tried, i, at, slope, clock.unit)
    for i, (mode, _) in enumerate(tried.definition.constraints):
        if mode == at.mode:
            check_constraint(tried, i, at, slope, clock.unit)


class Meeting:
    """What a run meets: the first states in modes in which nothing has been compared yet.

    Parameters
    ----------
    system : Terms
    problem : Problem
        In the units of the numerics.
    """

    def __init__(self, system: Terms, problem: Problem) -> None:
        self.system, self.problem = system, problem
        self.definition: Definition = vars(system)["_definition"]
        unmet = set(range(len(system.modes))) - met(system)
        self.points: dict[int, list[Place]] = {mode: [] for mode in unmet}

    def __call__(self, events: Events) -> None:
        """Take a chunk of events in: where arcs begin and where they end."""
        for modes, states in (
            (events.mode_after, events.after),
            (events.mode_before, events.before),
        ):
            for mode, points in self.points.items():
                if len(points) < POINTS:
                    for row in np.flatnonzero(modes == mode)[: POINTS - len(points)]:
                        cycle, time = int(events.cycle[row]), float(events.time[row])
                        self.put(Instant(cycle, time, mode, states[row]))

    def put(self, at: Instant) -> None:
        """Put a state down, in the units of the numerics, if its mode has not been met."""
        if at.mode not in self.points or len(self.points[at.mode]) == POINTS:
            return
        out, y = self.system.out, at.y.copy()
        y[list(self.definition.cyclic)] = 0.0  # as functions see them, to whom they mean nothing
        time = at.time if self.system.forced else at.cycle * self.problem.period + at.time
        values = zip(self.system.states, y.tolist(), strict=True)
        place = Place(at.mode, float(out("time", time)), [float(out(*each)) for each in values])
        self.points[at.mode].append(place)

    def check(self) -> None:
        """Compare where the run has come to.

        Raises
        ------
        FunctionError
            About the first function that does not do what it must.
        """
        if not any(self.points.values()):
            return
        system, problem, definition = self.system, self.problem, self.definition
        tried = Tried(definition, [system.value(name) for name in definition.parameters])
        unit = float(system.out("time", problem.time_scale or problem.period))
        clock = Clock(system.forcing_period, unit, problem.switches)
        each = 10 * max(1, len(definition.guards))  # calls at a point, roughly
        left = max(1, CALLS // each)
        for mode, points in self.points.items():
            for at in points[:left]:
                try:
                    compare(tried, clock, at, tried.flow(at))
                except Undefined:
                    continue  # differences may leave the domain where the run has not
            left -= len(points[:left])
            if points:
                met(system).add(mode)


def meeting(system: Terms, problem: Problem) -> Meeting | None:
    """Return what notes the modes that a run meets; None for a system without functions."""
    if definition_of(problem.automaton) is None:
        return None
    return Meeting(system.unended, problem)  # what ends a run is a margin alone
