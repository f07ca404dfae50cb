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

from mems_impact.analysis.simulate import simulate
from mems_impact.analysis.state import State
from mems_impact.analysis.system import System
from mems_impact.analysis.threads import Watch, stoppable_threads
from mems_impact.engines.options import Options
from mems_impact.errors import FunctionError, InvalidParameter, MemsImpactError, RunError

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
    """What all values of a sweep share."""

    system: System
    parameter: str
    transient: int
    periods: int
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
        first = start.time / case.period + self.transient
        try:
            run = simulate(
                system,
                self.transient + self.periods,
                initial=start,
                window=(first, first + self.periods),
                options=self.options,
                progress=watch or False,
            )
        except (RunError, InvalidParameter, FunctionError) as error:
            point["status"] = str(error)
            return point, start
        trajectory = run.trajectory
        if system.section is None:
            grid = trajectory.samples(1, first=first)
            inside = grid.cycle < self.transient + self.periods  # the end begins another period
            cycle, time, y = grid.cycle[inside], grid.time[inside], grid.y[inside]
        else:
            log = trajectory.events.crossings(self.section)
            cycle, time, y = log.cycle, log.time, log.after
        settled = (cycle - self.transient) * trajectory.period + time >= trajectory.start.time
        point["section"] = {
            "period": (cycle[settled] - self.transient).astype(float),
            **{
                name: system.out(name, y[settled, system.states.index(name)])
                for name in self.states
            },
        }
        point["statistics"] = {name: system.out(name, run.gathered[name]) for name in system.told}
        return point, run.final


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
        simulate(case.system, 1e-3, initial=chain.initial, options=options)


def _at_same_phase(state: State, old: float, new: float) -> State:
    return state.replace(time=min(state.time / old * new, math.nextafter(new, 0.0)))
