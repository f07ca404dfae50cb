"""Parameter sweeps."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from mems_impact import tables as sweep_tables
from mems_impact._util.arrays import Floats
from mems_impact._util.progress import Watch
from mems_impact._util.warning_scopes import at_study_point
from mems_impact.analysis.attractor import STUDY_OPTIONS
from mems_impact.analysis.run import Run, check_direction
from mems_impact.analysis.simulate import simulate
from mems_impact.analysis.steady_state import steady_state
from mems_impact.errors import FunctionError, InvalidParameter, MemsImpactError, RunError
from mems_impact.hybrid.simulation import INSTANT_RTOL
from mems_impact.integrators.availability import is_compiled
from mems_impact.integrators.options import Options
from mems_impact.studies.engine.scheduler import run_study
from mems_impact.studies.engine.study import OK, STATUS, Columns, Study
from mems_impact.studies.sampling import finite_numbers
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.dispatch import takes_system
from mems_impact.systems.parameter_result import ParameterResult
from mems_impact.systems.serialization.identity import identity, identity_of_state
from mems_impact.systems.state import State, at_same_phase, positive, state_from, whole
from mems_impact.systems.statistics import maxima
from mems_impact.tables import merged_columns

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike

# --- Sweeps as studies, with a chain of values per direction

Point = dict[str, Any]  # input of `tables.sweep` for one value
TEXT = (sweep_tables.DIRECTION, STATUS)


@dataclass(frozen=True, kw_only=True)
class SweepStudy(Study):
    """The values of a parameter, once in each direction."""

    system: HybridSystem
    parameter: str
    values: tuple[float, ...]  # ascending
    starts: Mapping[str, State]  # initial state of each direction, "up" or "down"
    # Lengths of transient and measurement at each value, in forcing periods, or in time for an
    # autonomous system.
    transient: float
    length: float
    section: int
    steady: bool = False
    options: Options = STUDY_OPTIONS

    kind: ClassVar[str] = "sweep"
    chunk: ClassVar[int] = 16

    @property
    def points(self) -> int:
        """Number of values in all directions."""
        return len(self.values) * len(self.starts)

    @property
    def threaded(self) -> bool:
        """Whether values can be computed in parallel threads."""
        # Interpreted engines hold the GIL; CVODE redirects standard output for all threads.
        return is_compiled(self.system.problem(self.options).options)

    @property
    def chains(self) -> tuple[range, ...]:
        """One chain per direction."""
        n = len(self.values)
        return tuple(range(i * n, (i + 1) * n) for i in range(len(self.starts)))

    def identity(self) -> Mapping[str, Any]:
        """Return the inputs on which the results depend."""
        return {
            **identity(self.system, self.options),
            "parameter": self.parameter,
            "values": list(self.values),
            "initial": {name: identity_of_state(state) for name, state in self.starts.items()},
            "transient": self.transient,
            "periods" if self.system.forced else "duration": self.length,
            "section": self.section,
            "steady": self.steady,
        }

    @property
    def schema(self) -> Mapping[str, str]:
        """The columns of the table."""
        states, statistics, system = self._table_columns
        first = self.parameter, sweep_tables.DIRECTION, sweep_tables.number_column(system)
        names = *first, *states, *statistics, STATUS
        return merged_columns(*({name: "str" if name in TEXT else "float"} for name in names))

    @property
    def attrs(self) -> Mapping[str, Any]:
        """Units and captions of the table."""
        empty = sweep_tables.sweep(
            self.parameter, [], *self._table_columns, quantities=self.system.statistics.plotted
        )
        return empty.attrs

    def prepare(self) -> None:
        """Compile the event loop once for all threads."""
        if not self.threaded:
            return
        case, (start, *_) = self.case(0), self.starts.values()
        with contextlib.suppress(MemsImpactError):  # the chain raises the error again
            options = replace(self.options, engine="compiled")
            simulate(case, **self._run_length(1e-3), initial=start, options=options)

    def case(self, number: int) -> HybridSystem:
        """Return the system of a point; InvalidParameter if its value is not allowed."""
        return self.system.changed(**{self.parameter: self._value(number)})

    def compute(
        self, first: int, last: int, carried: Any = None, watch: Watch | None = None
    ) -> tuple[Columns, Any]:
        """Compute some values; see `Study`."""
        if carried is None:
            state = self.starts[self._direction(first)]
            period = _period_of(self.system)
        else:
            state = state_from(*carried["state"])
            period = carried["period"]
        points = []
        for number in range(first, last):
            point = self._empty(number)
            points.append(point)
            try:
                with at_study_point(number):
                    case = self.case(number)
                new_period = _period_of(case)
            except (InvalidParameter, FunctionError) as error:
                point["status"] = str(error)
                continue
            state, period = at_same_phase(state, period, new_period), new_period
            if not case.forced:
                state = state.replace(time=0.0)  # the system is autonomous
            with at_study_point(number):
                state = self._run(case, point, state, _value_progress(watch, number - first))
        carried = {"state": state.parts(), "period": period}
        return sweep_tables.sweep_columns(self.parameter, points, *self._table_columns), carried

    def point_label(self, number: int) -> str:
        """Return the name of a point in messages."""
        return f"{self.parameter} = {self._value(number):.6g}"

    def failed(self, first: int, last: int, reason: str) -> Columns:
        """Return rows of values that could not be computed."""
        points = [{**self._empty(number), "status": reason} for number in range(first, last)]
        return sweep_tables.sweep_columns(self.parameter, points, *self._table_columns)

    @property
    def _table_columns(self) -> tuple[tuple[str, ...], tuple[str, ...], HybridSystem]:
        statistics = self.system.statistics.sweep_columns
        columns = [(name, sweep_tables.error_column(name)) for name in statistics]
        return self._states, tuple(chain.from_iterable(columns)), self.system

    @cached_property
    def _states(self) -> tuple[str, ...]:
        """The recorded states of every crossing, the states in displays of orbits first."""
        return tuple(
            dict.fromkeys(
                [*self.system.state_space.displayed, *reversed(self.system.state_space.on_section)]
            )
        )

    def _direction(self, number: int) -> str:
        return list(self.starts)[number // len(self.values)]

    def _value(self, number: int) -> float:
        index = number % len(self.values)
        return self.values[index if self._direction(number) == "up" else -1 - index]

    def _empty(self, number: int) -> Point:
        return {
            "value": self._value(number),
            "direction": self._direction(number),
            "section": {},
            "statistics": {},
            "status": "ok",
        }

    def _run(self, system: HybridSystem, point: Point, start: State, watch: Watch | None) -> State:
        """Compute one value into its part of the table; return the last good state."""
        first, length = self.transient, self.transient + self.length
        if system.forced:
            first += start.time / _period_of(system)
        try:
            run = simulate(
                system,
                **self._run_length(length),
                initial=start,
                window=(first, first + self.length),
                options=self.options,
                progress=watch or False,
            )
            if self.steady:
                run = steady_state(run, progress=watch or False)
            run.warn_of_transient()
            statistics = {}
            for name in system.statistics.sweep_columns:
                statistics[name] = system.units.out(name, run._scaled_statistics[name])
                statistics[sweep_tables.error_column(name)] = run.settling.remaining(name)
            numbers, y = self._forced(system, run) if system.forced else self._unforced(system, run)
        except (RunError, InvalidParameter, FunctionError) as error:
            point["status"] = str(error)
            return start
        point["section"] = {
            sweep_tables.number_column(system): numbers,
            **{
                name: system.units.out(name, y[:, system.states.index(name)])
                for name in self._states
            },
        }
        point["statistics"] = statistics
        return run.final

    def _run_length(self, length: float) -> dict[str, Any]:
        """Return the argument of `simulate` for the length of a run."""
        return {"periods" if self.system.forced else "duration": length}

    def _forced(self, system: HybridSystem, run: Run) -> tuple[Floats, Floats]:
        """Return the periods of the crossings of the section, and the states there.

        Without a section, the states at the starts of periods.
        """
        trajectory = run.trajectory
        if system.section is None:
            grid = trajectory.samples(1, first=run.window[0])
            inside = grid.cycle < math.floor(run.window[1])  # without the end of the last one
            cycle, time, y = grid.cycle[inside], grid.time[inside], grid.y[inside]
        else:
            log = trajectory.events.crossings(self.section)
            cycle, time, y = log.cycle, log.time, log.after
        transient = math.floor(run.window[0] + INSTANT_RTOL)
        settled = (cycle - transient) * trajectory.period + time >= trajectory.start.time
        return (cycle[settled] - transient).astype(float), y[settled]

    def _unforced(self, system: HybridSystem, run: Run) -> tuple[Floats, Floats]:
        """Return the numbers of the crossings of the section, from 0, and the states there.

        Without a section, the maxima of each state; one row has the k-th maximum of each.
        """
        trajectory = run.trajectory
        first = float(system.units.into("time", run.window[0])) / trajectory.period
        if system.section is None:
            peaks = maxima(trajectory, first)
            y = np.full((max(map(len, peaks)), len(peaks)), math.nan)
            for i, values in enumerate(peaks):
                y[: len(values), i] = values
        else:
            log = trajectory.events.crossings(self.section)
            y = log.after[log.cycle + log.time / trajectory.period >= first]
        return np.arange(float(len(y))), y


def _period_of(system: HybridSystem) -> float:
    """Return the forcing period, in the units of the system."""
    return system.forcing_period or 1.0


def _value_progress(watch: Watch | None, done: int) -> Watch | None:
    """Return a callback of runs that reports completed values instead of periods."""
    return None if watch is None else lambda _: watch(done)


# --- Sweeps


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Sweep(ParameterResult):
    """Motions while a parameter is varied slowly.

    Attributes
    ----------
    system : System
        At its own value of the parameter.
    parameter : str
    table : DataFrame
        One row per crossing of the section: the parameter, direction ("up" or "down"), period
        (counted from the end of the transient), v2, v1, and for each value impacts per period,
        blows per period (see `mems_impact.BlowStatistics`), displacement per period and per impact
        (the step; NaN without an impact), mean speed, closest approach and status. After each
        statistic follows its error, a bound of the distance from the attractor's value (see
        `Settling`): of a motion that does not become periodic, the statistical error; infinite if
        unknown. A value without crossings is one row with NaN in the columns of a crossing. A value
        that failed is one row with NaN in all columns and the reason, rather than "ok", as status;
        the sweep continues from the last good state. For an autonomous system, crossings have a
        number, from 0, in place of the period, and impacts are counted per time. The k-th maxima of
        all states share a row, with NaN where a state has fewer; a state at rest has one maximum,
        its value.

    See Also
    --------
    sweep, plot_sweep

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> sweep = mi.sweep(actuator, drive, "amplitude", [0.2, 0.24], transient=200, periods=10)
    >>> sweep
    Sweep(amplitude = 0.2 to 0.24, 2 values; direction up)
    >>> sweep.statistics[["amplitude", "impacting"]].values.tolist()
    [[0.2, False], [0.24, True]]
    """

    @cached_property
    def statistics(self) -> pd.DataFrame:
        """One row for each value, in the order of computation.

        Parameter, direction, status, impacting (whether impacts occur in the measured time; False
        if the value failed), the statistics of the table, smallest and largest value of the first
        state on the section, and the number of crossings.
        """
        return sweep_tables.sweep_summary(self.table)

    def summary(self) -> dict[str, Any]:
        """Return the values of the parameter, the directions, and how many values failed."""
        failed = int((self.statistics[STATUS] != OK).sum())
        directions = ", ".join(self.table[sweep_tables.DIRECTION].unique())
        rows = {**super().summary(), "direction": directions}
        return {**rows, "failed": failed} if failed else rows


TRANSIENT, PERIODS = 300, 60  # defaults for a system with forcing
CHAINS = {"up": ("up",), "down": ("down",), "both": ("up", "down")}


@takes_system(start="initial")
def sweep(
    system: HybridSystem,
    parameter: str,
    values: ArrayLike,
    *,
    direction: Literal["up", "down", "both"] = "up",
    transient: float | None = None,
    periods: int | None = None,
    duration: float | None = None,
    section: Literal[1, -1, 0] = 1,
    steady: bool = False,
    initial: State | Mapping[str, State] | None = None,
    options: Options = STUDY_OPTIONS,
    store: str | os.PathLike[str] | None = None,
    executor: Executor | Callable[[], Executor] | None = None,
    workers: int | None = None,
    progress: bool | Callable[[float], None] = False,
) -> Sweep:
    """Sweep one parameter slowly; every value starts from the final state of the previous value.

    Parameters
    ----------
    system : System, or Actuator and Drive
    parameter : str
        A parameter of the system: of an actuator, a number of the drive (``"amplitude"``,
        ``"omega"``, …) or of the device.
    values : array_like of float or str
        Values of the parameter, in any order; texts may have units (``"70 V"``).
    direction : {"up", "down", "both"}, optional
        Ascending, descending, or one chain of each.
    transient : int, optional
        Forcing periods discarded at each value; 300 by default.
    periods : int, optional
        Forcing periods then measured at each value; 60 by default.
    duration : float, optional
        Time measured at each value, for an autonomous system; `transient` is then a time, too, and
        both are required.
    section : {1, -1, 0}, optional
        Crossings of the Poincaré section to keep: upwards, downwards or both. A system without a
        section is sampled at the beginning of each forcing period, an autonomous system at the
        local maxima of each state.
    steady : bool, optional
        Continue each run until its statistics have settled. See `steady_state`. Otherwise
        statistics that still change raise a warning.
    initial : State or mapping of str to State, optional
        Initial state: one for both directions, or one each for ``"up"`` and ``"down"``; by default
        the initial state of the system. For an actuator, the sweep up starts at rest in the middle,
        the sweep down with a kick (see `kicked_state`), so that both attractors appear in a
        bistable range.
    options : Options, optional
        Options of integration; method "auto" by default.
    store : str or os.PathLike, optional
        Directory in which finished values are stored; an interrupted or killed sweep resumes from
        it.
    executor : concurrent.futures.Executor or callable, optional
        Threads by default, or processes. A cluster's executor, or a function that creates one.
    workers : int, optional
        Number of threads, at most one for each direction. Results do not depend on it.
    progress : bool or callable, optional
        Show progress: after one second a bar on a terminal, elsewhere lines. A function is called
        with the number of finished values.

    Returns
    -------
    Sweep

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or a value is not allowed for the parameter.
    Interrupted
        On Ctrl-C; ``partial`` is the table of the finished values.

    Warns
    -----
    TransientWarning
        If statistics still change.

    See Also
    --------
    Sweep, plot_sweep, steady_state, operating_map, continue_solution

    Notes
    -----
    Where the forcing period changes, the phase of the drive is carried over as a fraction of the
    period.

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> sweep = mi.sweep(actuator, drive, "amplitude", [0.2, 0.24], transient=200, periods=10)
    >>> sweep.statistics["impacting"].tolist()  # from rest: off, then on
    [False, True]
    """
    if direction not in CHAINS:
        raise InvalidParameter("direction", direction, f"one of {', '.join(CHAINS)}")
    check_direction("section", section)
    if not system.forced:
        transient = system.units.parse("time", transient, "transient")
        duration = system.units.parse("time", duration, "duration")
    settling, length = _spans(system, transient, periods, duration)
    system.check_parameter(parameter)
    numbers = system.units.parse(parameter, values, "values")
    ascending = np.sort(finite_numbers("values", values, numbers)).tolist()
    ends = {"up": ascending[0], "down": ascending[-1]}
    study = SweepStudy(
        system=system,
        parameter=parameter,
        values=tuple(ascending),
        starts={
            name: _initial(initial, name, _changed_if_valid(system, parameter, ends[name]))
            for name in CHAINS[direction]
        },
        transient=settling,
        length=length,
        section=section,
        steady=bool(steady),
        options=options,
    )
    for number in range(len(ascending)):
        with contextlib.suppress(FunctionError):  # it becomes a failed row
            study.case(number)  # check all values before the first is computed
    for start in study.starts.values():
        system.state_space.instant(start, system.problem(options))
    table = run_study(
        study,
        store=store,
        executor=executor,
        workers=workers,
        progress=progress,
        # In memory, chunks of one value lose the least by an interruption.
        chunk=1 if store is None and executor is None else None,
    )
    return Sweep(system=system, parameter=parameter, table=table)


def _spans(
    system: HybridSystem, transient: float | None, periods: int | None, duration: float | None
) -> tuple[float, float]:
    """Return the lengths of transient and measurement in forcing periods, or in time."""
    if system.forced:
        if duration is not None:
            problem = "the system has a forcing period, by which a sweep counts: give periods"
            raise InvalidParameter("duration", duration, "", problem=problem)
        settling = TRANSIENT if transient is None else whole("transient", transient, 0)
        return settling, PERIODS if periods is None else whole("periods", periods, 1)
    if periods is not None:
        problem = "the system has no forcing period: give the duration, a time"
        raise InvalidParameter("periods", periods, "", problem=problem)
    if transient is None or duration is None:
        problem = (
            "the system is autonomous: give the times of transient and measurement, transient and "
            "duration"
        )
        missing = "duration" if duration is None else "transient"
        raise InvalidParameter(missing, None, "", problem=problem)
    return positive("transient", transient, zero=True), positive("duration", duration)


def _initial(initial: State | Mapping[str, State] | None, name: str, system: HybridSystem) -> State:
    if isinstance(initial, Mapping):
        unknown = set(initial) - {"up", "down"}
        if unknown:
            raise InvalidParameter("initial", sorted(unknown), "given for 'up' and 'down' alone")
        initial = initial.get(name)
    if initial is None:
        return system.state_space.initial(name)
    if not isinstance(initial, State):
        raise InvalidParameter("initial", initial, "a State, or a mapping of 'up', 'down' to State")
    return initial


def _changed_if_valid(system: HybridSystem, parameter: str, value: float) -> HybridSystem:
    """Return the system at a value; unchanged if a user function fails there."""
    try:
        return system.changed(**{parameter: value})
    except FunctionError:
        return system
