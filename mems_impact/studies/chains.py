"""Chains: the values of a sweep in one direction, and how several chains are run.

Chains are independent of each other, so that they may run in threads: the compiled loop does not
hold Python's lock.
"""

from __future__ import annotations

import contextlib
import math
import queue
import threading
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

from mems_impact import tables
from mems_impact.actuator.drive import Drive
from mems_impact.actuator.modes import V1, V2
from mems_impact.actuator.parameters import PARAMETER_NAMES, PARAMETER_UNITS, Actuator
from mems_impact.engines.options import Options
from mems_impact.errors import InvalidParameter, MemsImpactError
from mems_impact.studies.simulate import simulate
from mems_impact.studies.state import State

__all__ = ["Case", "Chain", "Point", "Study", "in_threads", "in_turn"]

Point = dict[str, Any]  # what `tables.sweep` takes for one value
Results = Generator[tuple[int, Point], None, None]  # number of the chain, and what it computed


@dataclass(frozen=True)
class Case:
    """One value of the parameter, put where it belongs."""

    value: float
    actuator: Actuator
    drive: Drive


@dataclass(frozen=True)
class Study:
    """What all values of a sweep share."""

    actuator: Actuator
    drive: Drive
    parameter: str
    transient: int
    periods: int
    section: int
    options: Options

    def case(self, value: float) -> Case:
        """Return the case of one value; InvalidParameter if it is not allowed."""
        if self.parameter in self.drive.names:
            return Case(value, self.actuator, self.drive.varied({self.parameter: value}))
        if self.parameter in PARAMETER_NAMES:
            changed = self.actuator.replace(**{self.parameter: value})
            return Case(value, changed, self.drive)
        names = [*self.drive.names, *PARAMETER_NAMES]
        raise InvalidParameter("parameter", self.parameter, f"one of {', '.join(names)}")

    @property
    def unit(self) -> str:
        """The SI unit of the parameter; empty for a pure number."""
        if self.parameter in self.drive.names:
            return self.drive.unit(self.parameter)
        return PARAMETER_UNITS.get(self.parameter, "")

    def point(
        self, case: Case, name: str, start: State, watch: Callable[[float], None] | None
    ) -> tuple[Point, State]:
        """Compute one value; return its part of the table and the last good state."""
        point: Point = {
            "value": case.value,
            "direction": name,
            "section": {},
            "impacts per period": math.nan,
            "blows per period": math.nan,
            "displacement per period": math.nan,
            "status": "ok",
        }
        period = case.drive.period
        first = start.time / period + self.transient
        try:
            run = simulate(
                case.actuator,
                case.drive,
                self.transient + self.periods,
                initial=start,
                window=(first, first + self.periods),
                options=self.options,
                progress=watch or False,
            )
        except MemsImpactError as error:
            point["status"] = str(error)
            return point, start
        log, begin = tables.crossings(run.trajectory.events, self.section), run.trajectory.start
        elapsed = (log.cycle - self.transient) * run.trajectory.period + log.time
        log = log[elapsed >= begin.time]
        # By the scales of this case: a parameter that is varied may change them.
        scales = case.actuator.scales
        point["section"] = {
            "period": (log.cycle - self.transient).astype(float),
            "v2": scales.out(log.after[:, V2], "m/s"),
            "v1": scales.out(log.after[:, V1], "m/s"),
        }
        moved = run.measured.displacement_per_period
        point["impacts per period"] = run.measured.impacts_per_period
        point["blows per period"] = run.measured.blows_per_period
        point["displacement per period"] = scales.out(moved, "m")
        return point, run.final


@dataclass(frozen=True)
class Chain:
    """One direction of a sweep."""

    study: Study
    name: str
    cases: list[Case]
    initial: State

    def points(self, watch: Callable[[float], None] | None = None) -> Iterator[Point]:
        """Compute value after value. `watch` is called now and then and may raise."""
        state, period = self.initial, self.cases[0].drive.period
        for case in self.cases:
            if case.drive.period != period:
                state = _at_same_phase(state, period, case.drive.period)
                period = case.drive.period
            point, state = self.study.point(case, self.name, state, watch)
            yield point


class _Stopped(Exception):
    """Ends a run in a thread whose result nobody waits for any more."""


def in_turn(chains: list[Chain]) -> Results:
    """Run one chain after the other."""
    for number, chain in enumerate(chains):
        for point in chain.points():
            yield number, point


def in_threads(chains: list[Chain]) -> Results:
    """Run every chain in a thread of its own; the points come as they are done."""
    compile_once(chains[0])
    stop = threading.Event()
    results: queue.Queue[tuple[int, Point | BaseException | None]] = queue.Queue()

    def watch(_: float) -> None:
        if stop.is_set():
            raise _Stopped

    def work(number: int) -> None:
        try:
            for point in chains[number].points(watch):
                results.put((number, point))
            results.put((number, None))
        except BaseException as error:
            results.put((number, error))

    with ThreadPoolExecutor(len(chains), thread_name_prefix="sweep") as threads:
        try:
            for number in range(len(chains)):
                threads.submit(work, number)
            running = len(chains)
            while running:
                number, point = results.get()
                if isinstance(point, BaseException):
                    raise point
                if point is None:
                    running -= 1
                else:
                    yield number, point
        finally:
            # Reached on Ctrl-C too, which comes to the main thread: leave no thread at work.
            stop.set()


def compile_once(chain: Chain) -> None:
    """Have the loop compiled once, rather than in every thread at the same time."""
    case = chain.cases[0]
    options = replace(chain.study.options, engine="compiled")
    with contextlib.suppress(MemsImpactError):  # the chain itself will say so
        simulate(case.actuator, case.drive, 1e-3, initial=chain.initial, options=options)


def _at_same_phase(state: State, old: float, new: float) -> State:
    return replace(state, time=min(state.time / old * new, math.nextafter(new, 0.0)))
