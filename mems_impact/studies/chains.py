"""Sweeps as studies: the values in one direction are a chain, and several are independent."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from mems_impact.analysis.extremes import maxima
from mems_impact.analysis.run import Run
from mems_impact.analysis.simulate import simulate
from mems_impact.analysis.state import State, state_from
from mems_impact.analysis.storing.identity import (
    identity,
    identity_of_options,
    identity_of_state,
)
from mems_impact.analysis.system import System
from mems_impact.analysis.threads import Watch
from mems_impact.engines.options import Options
from mems_impact.errors import FunctionError, InvalidParameter, MemsImpactError, RunError
from mems_impact.hybrid.problem import is_compiled
from mems_impact.hybrid.trajectory import Floats
from mems_impact.studies.study import STATUS, Columns, Study
from mems_impact.tables import sweep as sweep_tables
from mems_impact.telling import about

__all__ = ["SweepStudy"]

Point = dict[str, Any]  # what `tables.sweep` takes for one value
TEXT = (sweep_tables.DIRECTION, STATUS)


@dataclass(frozen=True, kw_only=True)
class SweepStudy(Study):
    """The values of a parameter, once in each direction.

    Attributes
    ----------
    system : System
    parameter : str
    values : tuple of float
        Ascending.
    starts : mapping of str to State
        Where the chain of each direction, "up" or "down", begins.
    transient, length : float
        How long each value settles and is measured: in forcing periods, or a time where nothing
        forces the system.
    section : int
    options : Options
    """

    system: System
    parameter: str
    values: tuple[float, ...]
    starts: Mapping[str, State]
    transient: float
    length: float
    section: int
    options: Options = field(default_factory=Options)

    kind: ClassVar[str] = "sweep"

    @property
    def points(self) -> int:
        """How many values there are, those of all directions."""
        return len(self.values) * len(self.starts)

    @property
    def chunk(self) -> int:
        """How many values are computed together."""
        return 16

    @property
    def threaded(self) -> bool:
        """Whether values hold no lock of Python's."""
        # An interpreted engine does; CVODE's silences standard output for all threads.
        return is_compiled(self.system.problem(self.options).options)

    @property
    def chains(self) -> tuple[range, ...]:
        """One of each direction."""
        n = len(self.values)
        return tuple(range(i * n, (i + 1) * n) for i in range(len(self.starts)))

    def identity(self) -> Mapping[str, Any]:
        """Return what the numbers depend on."""
        return {
            **identity(self.system),
            "parameter": self.parameter,
            "values": list(self.values),
            "initial": {name: identity_of_state(state) for name, state in self.starts.items()},
            "transient": self.transient,
            "periods" if self.system.forced else "duration": self.length,
            "section": self.section,
            "options": identity_of_options(self.system.problem(self.options).options),
        }

    @property
    def schema(self) -> Mapping[str, str]:
        """The columns of the table."""
        names = sweep_tables.columns_of(self.parameter, [], *self._told)
        return {name: "str" if name in TEXT else "float" for name in names}

    @property
    def attrs(self) -> Mapping[str, Any]:
        """Units and captions of the table."""
        empty = sweep_tables.sweep(
            self.parameter, [], *self._told, quantities=self.system.quantities
        )
        return empty.attrs

    def prepare(self) -> None:
        """Have the loop compiled once, rather than in every thread at the same time."""
        if not self.threaded:
            return
        case, (start, *_) = self.case(0), self.starts.values()
        with contextlib.suppress(MemsImpactError):  # the chain itself will say so
            options = replace(self.options, engine="compiled")
            simulate(case, **self._lasting(1e-3), initial=start, options=options)

    def case(self, number: int) -> System:
        """Return the system of a point; InvalidParameter if its value is not allowed."""
        return self.system.changed(**{self.parameter: self._value(number)})

    def compute(
        self,
        first: int,
        last: int,
        carried: Any = None,
        watch: Callable[[float], None] | None = None,
    ) -> tuple[Columns, Any]:
        """Compute some values; see `Study`."""
        if carried is None:
            state = self.starts[self._direction(first)]
            period = self.system.forcing_period or _period_of(self.case(first))
        else:
            state = state_from(carried["state"], carried["time"], carried["mode"])
            period = carried["period"]
        points = []
        for number in range(first, last):
            case = self.case(number)
            if _period_of(case) != period:
                state = _at_same_phase(state, period, _period_of(case))
                period = _period_of(case)
            if not case.forced:
                state = state.replace(time=0.0)  # nothing depends on it
            point = self._empty(number)
            with about(number):
                state = self._run(case, point, state, _told_by(watch, number - first))
            points.append(point)
        told = {"state": state.as_dict(), "time": state.time, "mode": state.mode, "period": period}
        return sweep_tables.columns_of(self.parameter, points, *self._told), told

    def place(self, number: int) -> str:
        """Return what a point is called in messages."""
        return f"{self.parameter} = {self._value(number):.6g}"

    def failed(self, first: int, last: int, reason: str) -> Columns:
        """Return rows of values that could not be computed."""
        points = [{**self._empty(number), "status": reason} for number in range(first, last)]
        return sweep_tables.columns_of(self.parameter, points, *self._told)

    @property
    def _told(self) -> tuple[tuple[str, ...], tuple[str, ...], System]:
        return self._states, tuple(self.system.told), self.system

    @cached_property
    def _states(self) -> tuple[str, ...]:
        """The states that are told of every crossing: those by which orbits are shown first."""
        return tuple(dict.fromkeys([*self.system.shown, *reversed(self.system.visible)]))

    def _direction(self, number: int) -> str:
        return list(self.starts)[number // len(self.values)]

    def _value(self, number: int) -> float:
        place = number % len(self.values)
        return self.values[place if self._direction(number) == "up" else -1 - place]

    def _empty(self, number: int) -> Point:
        return {
            "value": self._value(number),
            "direction": self._direction(number),
            "section": {},
            "statistics": {},
            "status": "ok",
        }

    def _run(self, system: System, point: Point, start: State, watch: Watch | None) -> State:
        """Compute one value into its part of the table; return the last good state."""
        first, whole = self.transient, self.transient + self.length
        if system.forced:
            first += start.time / _period_of(system)
        try:
            run = simulate(
                system,
                **self._lasting(whole),
                initial=start,
                window=(first, first + self.length),
                options=self.options,
                progress=watch or False,
            )
        except (RunError, InvalidParameter, FunctionError) as error:
            point["status"] = str(error)
            return start
        numbers, y = self._forced(system, run) if system.forced else self._unforced(system, run)
        point["section"] = {
            sweep_tables.counted(system): numbers,
            **{name: system.out(name, y[:, system.states.index(name)]) for name in self._states},
        }
        point["statistics"] = {name: system.out(name, run.gathered[name]) for name in system.told}
        return run.final

    def _lasting(self, length: float) -> dict[str, Any]:
        """Return the argument of `simulate` that says how long."""
        return {"periods" if self.system.forced else "duration": length}

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


def _period_of(system: System) -> float:
    """Return the forcing period, in the units of the system."""
    return system.forcing_period or 1.0


def _at_same_phase(state: State, old: float, new: float) -> State:
    return state.replace(time=min(state.time / old * new, math.nextafter(new, 0.0)))


def _told_by(watch: Watch | None, done: int) -> Watch | None:
    """Return what a run is to call: it tells how many values are done, not periods."""
    return None if watch is None else lambda _: watch(done)
