"""Chains: the values of a sweep in one direction, and how several chains are run.

Chains are independent of each other, so that they may run in threads: the compiled loop does not
hold Python's lock.
"""

from __future__ import annotations

import contextlib
import math
import queue
from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mems_impact.analysis.extremes import maxima
from mems_impact.analysis.run import Run
from mems_impact.analysis.simulate import simulate
from mems_impact.analysis.state import State
from mems_impact.analysis.system import System
from mems_impact.analysis.threads import Watch, stoppable_threads
from mems_impact.engines.options import Options
from mems_impact.errors import FunctionError, InvalidParameter, MemsImpactError, RunError
from mems_impact.hybrid.trajectory import Floats
from mems_impact.tables.sweep import counted

__all__ = ["Case", "Chain", "Point", "Study", "in_threads", "in_turn"]

Point = dict[str, Any]  # what `tables.sweep` takes for one value
Results = Generator[tuple[int, Point], None, None]  # number of the chain, and what it computed


@dataclass(frozen=True)
class Case:
    """One value of the parameter, put where it belongs."""

    value: float
    system: System

    @property
    def period(self) -> float:
        """The forcing period, in the units of the system."""
        return self.system.forcing_period or 1.0


@dataclass(frozen=True)
class Study:
    """What all values of a sweep share.

    How long they settle and are measured is in forcing periods, or a time where nothing forces.
    """

    system: System
    parameter: str
    transient: float
    length: float
    section: int
    options: Options

    def case(self, value: float) -> Case:
        """Return the case of one value; InvalidParameter if it is not allowed."""
        return Case(value, self.system.changed(**{self.parameter: float(value)}))

    @property
    def states(self) -> tuple[str, ...]:
        """The states that are told of every crossing: those by which orbits are shown first."""
        system = self.system
        return tuple(dict.fromkeys([*system.shown, *reversed(system.visible)]))

    def point(
        self, case: Case, name: str, start: State, watch: Watch | None
    ) -> tuple[Point, State]:
        """Compute one value; return its part of the table and the last good state."""
        point: Point = {
            "value": case.value,
            "direction": name,
            "section": {},
            "statistics": {},
            "status": "ok",
        }
        system = case.system
        first, whole = self.transient, self.transient + self.length
        if system.forced:
            first += start.time / case.period
        try:
            run = simulate(
                system,
                **_lasting(system, whole),
                initial=start,
                window=(first, first + self.length),
                options=self.options,
                progress=watch or False,
            )
        except (RunError, InvalidParameter, FunctionError) as error:
            point["status"] = str(error)
            return point, start
        numbers, y = self._forced(system, run) if system.forced else self._unforced(system, run)
        point["section"] = {
            counted(system): numbers,
            **{name: system.out(name, y[:, system.states.index(name)]) for name in self.states},
        }
        point["statistics"] = {name: system.out(name, run.gathered[name]) for name in system.told}
        return point, run.final

    def _forced(self, system: System, run: Run) -> tuple[Floats, Floats]:
        """Return in which periods the section is crossed, and the states there.

        Where periods begin, without a section.
        """
        trajectory = run.trajectory
        if system.section is None:
            grid = trajectory.samples(1, first=run.window[0])
            inside = grid.cycle < self.transient + self.length  # the end begins another period
            cycle, time, y = grid.cycle[inside], grid.time[inside], grid.y[inside]
        else:
            log = trajectory.events.crossings(self.section)
            cycle, time, y = log.cycle, log.time, log.after
        settled = (cycle - self.transient) * trajectory.period + time >= trajectory.start.time
        return (cycle[settled] - self.transient).astype(float), y[settled]

    def _unforced(self, system: System, run: Run) -> tuple[Floats, Floats]:
        """Return the numbers of the crossings of the section, from 0, and the states there.

        Without a section the maxima of each state, the k-th of all in one row.
        """
        trajectory = run.trajectory
        first = float(system.into("time", self.transient)) / trajectory.period
        if system.section is None:
            peaks = maxima(trajectory, first)
            y = np.full((max(map(len, peaks)), len(peaks)), math.nan)
            for i, values in enumerate(peaks):
                y[: len(values), i] = values
        else:
            log = trajectory.events.crossings(self.section)
            y = log.after[log.cycle + log.time / trajectory.period >= first]
        return np.arange(float(len(y))), y


@dataclass(frozen=True)
class Chain:
    """One direction of a sweep."""

    study: Study
    name: str
    cases: list[Case]
    initial: State

    def points(self, watch: Watch | None = None) -> Iterator[Point]:
        """Compute value after value. `watch` is called now and then and may raise."""
        state, period = self.initial, self.study.system.forcing_period or self.cases[0].period
        for case in self.cases:
            if case.period != period:
                state = _at_same_phase(state, period, case.period)
                period = case.period
            if not case.system.forced:
                state = state.replace(time=0.0)  # nothing depends on it
            point, state = self.study.point(case, self.name, state, watch)
            yield point


def in_turn(chains: list[Chain]) -> Results:
    """Run one chain after the other."""
    for number, chain in enumerate(chains):
        for point in chain.points():
            yield number, point


def in_threads(chains: list[Chain]) -> Results:
    """Run every chain in a thread of its own; the points come as they are done."""
    compile_once(chains[0])
    results: queue.Queue[tuple[int, Point | BaseException | None]] = queue.Queue()

    def work(number: int, watch: Watch) -> None:
        try:
            for point in chains[number].points(watch):
                results.put((number, point))
            results.put((number, None))
        except BaseException as error:
            results.put((number, error))

    with stoppable_threads(len(chains)) as (threads, watch):
        for number in range(len(chains)):
            threads.submit(work, number, watch)
        running = len(chains)
        while running:
            number, point = results.get()
            if isinstance(point, BaseException):
                raise point
            if point is None:
                running -= 1
            else:
                yield number, point


def compile_once(chain: Chain) -> None:
    """Have the loop compiled once, rather than in every thread at the same time."""
    case = chain.cases[0]
    options = replace(chain.study.options, engine="compiled")
    with contextlib.suppress(MemsImpactError):  # the chain itself will say so
        simulate(case.system, **_lasting(case.system, 1e-3), initial=chain.initial, options=options)


def _lasting(system: System, length: float) -> dict[str, float]:
    """Return the argument of `simulate` that says how long."""
    return {"periods" if system.forced else "duration": length}


def _at_same_phase(state: State, old: float, new: float) -> State:
    return state.replace(time=min(state.time / old * new, math.nextafter(new, 0.0)))
