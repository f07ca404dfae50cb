"""Measurements to which `fit` compares a system: records of states, observables and events."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from io import StringIO
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact._util.limits import UNLIMITED, Limits
from mems_impact._util.text_tables import (
    decoded,
    even_times,
    with_headings,
    with_points,
    with_times,
)
from mems_impact.analysis.run import Run
from mems_impact.analysis.run_derivatives import INITIAL, RunDerivatives
from mems_impact.analysis.simulate import simulate
from mems_impact.errors import InvalidFile, InvalidParameter
from mems_impact.hybrid.differences import sixth_order_difference
from mems_impact.integrators.options import Options
from mems_impact.studies.event_matching import UNMATCHED, local_spacings, match_events
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.observables import Observable
from mems_impact.systems.state import State
from mems_impact.tables import event_names, unit_of, without_units

if TYPE_CHECKING:
    import pandas as pd

DELAY, OFFSET = "delay", "offset."  # names of free quantities of a record
TIME, EVENT = "t", "event"
HEADING = re.compile(
    r"(?:^|[,;\t])\s*[\"']?t\b"
)  # with a column t, below what an instrument writes
LOCATING = ("period", "time", "mode", "mode before", "mode after")
"""Columns of the tables of runs that locate a row and are not compared."""
STEP = 1e-4  # of the derivatives of observables, relative to the changes of a state


@dataclass(frozen=True)
class Conditions:
    """The conditions under which `fit` simulates."""

    model: Any  # a system, or a model with a method ``under(drive)`` that returns one
    drive: Any  # of the records without one
    initial: State | Mapping[str, float] | None  # None for the system's own
    transient: int | None  # forcing periods before a measurement; None for the default of its class
    periods: int  # forcing periods of statistics
    options: Options

    def system(self, drive: Any) -> HybridSystem:
        """Return the system under a drive."""
        if isinstance(self.model, HybridSystem):
            if drive is not None:
                allowed = "None: the system has its forcing"
                raise InvalidParameter("drive", drive, allowed)
            return self.model
        return self.model.under(self.drive if drive is None else drive)


class Prediction(NamedTuple):
    """Computed data."""

    values: Floats  # shape (m,), nan where an event is unmatched
    jacobian: Floats  # shape (m, s)
    surplus: Mapping[str, int] = {}  # computed events without a recorded one, by name


class Comparison(ABC):
    """Measured data beside those that a system gives."""

    name: str  # of the record; "" of a single one
    own: tuple[str, ...] = ()  # free quantities that belong to this record alone
    table: pd.DataFrame  # one row per datum: record, quantity, t, measured
    errors: Floats  # standard errors, shape (m,); nan where unknown
    weights: Floats  # shape (m,), relative to other data of the same quantity with unknown errors
    spreads: Floats  # sizes of the changes of each datum, shape (m,)

    @abstractmethod
    def start(self, name: str) -> float | None:
        """Return the first value of a free quantity; None if it has no part in these data."""

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """The quantities that may be free."""

    @abstractmethod
    def check(self, values: Mapping[str, float]) -> None:
        """Raise InvalidParameter if there is no system with these values."""

    @abstractmethod
    def predict(self, values: Mapping[str, float], part: float, gap: float) -> Prediction:
        """Return the data that a system with these values gives, up to a part of the record.

        An event without a partner counts as one that is `gap` spacings away.
        """

    def sequence(self, values: Mapping[str, float]) -> Any:
        """Return what changes discretely with the values."""
        return None

    def limits(self, name: str) -> Limits:
        """Return the range of a free quantity."""
        return UNLIMITED

    def parse(self, name: str, value: Any, field: str) -> Any:
        """Return a value of a free quantity, or several, as numbers."""
        return value

    def unit(self, name: str) -> str:
        """Return the unit of a free quantity."""
        return ""

    def until(self, part: float) -> NDArray[np.bool_]:
        """Return which data belong to a part of the record."""
        return np.ones(len(self.table), dtype=bool)

    def remarks(self, values: Mapping[str, float], prediction: Prediction) -> list[tuple[str, str]]:
        """Return verdicts, "" for none, and sentences about the data at the fitted values."""
        return []


class Measurement(ABC):
    """Base class of what a system is fitted to."""

    @classmethod
    @abstractmethod
    def comparisons(
        cls, measurements: Sequence[Self], conditions: Conditions
    ) -> Sequence[Comparison]:
        """Return measurements of one class beside their computation."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Record(Measurement):
    """A record of a motion: samples of states and observables, times of events, or both.

    Parameters
    ----------
    samples : DataFrame or path, optional
        A column ``t``, strictly ascending, and columns of states and observables. In a file of an
        instrument the first column is ``t``.
    events : DataFrame or path, optional
        A column ``t``, a column ``event`` with names as in `Run.events`, which impacts on a single
        stopper do not need, and states after the event or observables. It may lack events of the
        motion, and have others.
    errors : mapping of str to float or array, optional
        Standard errors by column, ``"t"`` for the times of events. Those of other columns are
        estimated from the residuals.
    weights : mapping of str to float or array, optional
        Inverse standard errors up to a common factor, instead of `errors`.
    drive : Drive, optional
        Of this record, for a model that takes a drive.
    changes : mapping of str to float, optional
        Parameters of this record that differ from those of the system.
    initial : State or mapping of str to float, optional
        State at `start`.
    start : float, optional
        Time at which the motion begins; 0 by default.
    transient : int, optional
        Forcing periods for which the motion has run before `start`, from the initial state.
    free : sequence of str, optional
        Free quantities that this record does not share with others.
    name : str, optional
    columns : mapping of str to str, optional
        States and observables by the headings that an instrument writes, such as ``{"CH1": "x2"}``;
        other columns are omitted.

    See Also
    --------
    fit, Fit

    Examples
    --------
    >>> import pandas as pd
    >>> import mems_impact as mi
    >>> heard = pd.DataFrame({"t": [0.452, 1.174, 1.753]})
    >>> record = mi.Record(events=heard, errors={"t": 0.001}, free=["delay"])
    >>> len(record.events)
    3
    """

    samples: pd.DataFrame | str | PathLike[str] | None = None
    events: pd.DataFrame | str | PathLike[str] | None = None
    errors: Mapping[str, Any] | None = None
    weights: Mapping[str, Any] | None = None
    drive: Any = None
    changes: Mapping[str, float] | None = None
    initial: State | Mapping[str, float] | None = None
    start: float | None = None
    transient: int | None = None
    free: Sequence[str] = ()
    name: str = ""
    columns: Mapping[str, str] | None = None

    def __post_init__(self) -> None:
        if self.samples is None and self.events is None:
            raise InvalidParameter("samples", None, "", problem="missing, or events")
        for field in ("samples", "events"):
            object.__setattr__(self, field, table_of(field, getattr(self, field), self.columns))
        object.__setattr__(self, "free", tuple(self.free))

    @classmethod
    def of(cls, data: Any) -> Record:
        """Return the record of a table, of events if it has such a column."""
        table = table_of("data", data)
        return cls(events=table) if EVENT in table else cls(samples=table)

    @classmethod
    def comparisons(
        cls, measurements: Sequence[Self], conditions: Conditions
    ) -> Sequence[Comparison]:
        """Return each record beside its computation."""
        several = len(measurements) > 1
        names = [each.name or str(i) * several for i, each in enumerate(measurements, 1)]
        if len(set(names)) != len(names):
            raise InvalidParameter("name", names, "different names of records")
        return [
            RecordComparison(each, conditions, name)
            for each, name in zip(measurements, names, strict=True)
        ]


def table_of(field: str, data: Any, columns: Mapping[str, str] | None = None) -> Any:
    """Return the table of a file or a DataFrame, with units in its attributes.

    With `columns`, new names by headings, the other columns are omitted.
    """
    import pandas as pd

    if isinstance(data, str | PathLike):
        try:
            lines = with_points(decoded(Path(data).read_bytes()).splitlines())
            first = next((i for i, line in enumerate(lines) if HEADING.search(line)), None)
            if first is None:
                first, lines = 0, with_headings(with_times(lines, str(data)))
            separator = max(",;\t", key=lines[first].count) if lines else ","
            text = StringIO("\n".join(lines[first:]))
            data = pd.read_csv(text, sep=separator, skipinitialspace=True)
            even = even_times(data[TIME]) if TIME in data and EVENT not in data else None
            if even is not None:
                data[TIME] = even.times
        except InvalidFile:
            raise
        except (OSError, ValueError) as error:
            raise InvalidFile(data, f"is no table: {error}", "give a CSV file") from None
    if data is None:
        return None
    if not isinstance(data, pd.DataFrame):
        raise InvalidParameter(field, data, "a DataFrame, or the path of a CSV file")
    table = without_units(data)
    if columns is not None:
        names = {TIME: TIME, EVENT: EVENT, **columns}
        for heading in set(columns) - set(table.columns):
            raise InvalidParameter(
                "columns", heading, f"one of {', '.join(map(str, table.columns))}"
            )
        units = table.attrs.get("units", {})
        table = table[[each for each in table.columns if each in names]].rename(columns=names)
        table.attrs["units"] = {names[each]: unit for each, unit in units.items() if each in names}
    if TIME not in table:
        raise InvalidParameter(field, list(table.columns), "a table with a column t")
    if table.empty:
        raise InvalidParameter(field, None, "", problem="without rows")
    for name in table.columns:
        if name in (*LOCATING, EVENT):
            continue
        try:
            numbers = table[name].to_numpy(dtype=float)
        except (TypeError, ValueError):
            problem = f"column {name} has texts, must be numbers"
            raise InvalidParameter(field, None, "", problem=problem) from None
        wrong = np.flatnonzero(~np.isfinite(numbers))
        if wrong.size:
            row, value = table.index[wrong[0]], numbers[wrong[0]]
            problem = f"column {name} is {value:g} in row {row}: omit such rows"
            raise InvalidParameter(field, None, "", problem=problem)
    kinds = [each for _, each in table.groupby(EVENT, sort=False)] if EVENT in table else [table]
    for rows in kinds:
        late = np.flatnonzero(np.diff(rows[TIME].to_numpy(dtype=float)) <= 0.0)
        if late.size:
            row, time = rows.index[late[0] + 1], rows[TIME].iloc[late[0] + 1]
            same = time == rows[TIME].iloc[late[0]]
            problem = f"t = {time:g} in row {row} is {'given twice' if same else 'not in order'}"
            raise InvalidParameter(field, None, "", problem=f"{problem}: sort by t, once each")
    return table


class Block(NamedTuple):
    """The data of one column of a record."""

    field: str  # "samples" or "events"
    column: str
    rows: slice  # of the comparison


class RecordComparison(Comparison):
    """A record beside the run of a system."""

    def __init__(self, record: Record, conditions: Conditions, name: str) -> None:
        import pandas as pd

        self.name, self.own, self._options = name, tuple(record.free), conditions.options
        system = conditions.system(record.drive).changed(**(record.changes or {}))
        self._system, self._label = system, name and f" of record {name}"
        initial = record.initial if record.initial is not None else conditions.initial
        self._initial = None if initial is None else system.state_space.parse(initial)
        transient = record.transient if record.transient is not None else conditions.transient
        self._transient = transient or 0
        if self._transient and not system.forced:
            raise InvalidParameter("transient", transient, "0 without a forcing period; give start")
        start = 0.0 if record.start is None else record.start
        self._begin = float(system.units.parse("time", start, "start"))
        self._observables = {each.name: each for each in system.observables}
        self._times: dict[str, Floats] = {}
        self._blocks: list[Block] = []
        measured: list[Floats] = []
        times, errors, weights = [], [], []
        for field, table in (("samples", record.samples), ("events", record.events)):
            if table is None:
                continue
            self._times[field] = self._numbers(table, TIME)
            for column in self._columns(field, table):
                values = self._numbers(table, column)
                begin = sum(len(each) for each in measured)
                self._blocks.append(Block(field, column, slice(begin, begin + len(values))))
                measured.append(values)
                times.append(self._times[field])
                errors.append(self._scatter(table, column, "errors", record.errors, math.nan))
                weights.append(self._scatter(table, column, "weights", record.weights, 1.0))
        self._check_scatter(record)
        names = [b.column for b in self._blocks for _ in range(b.rows.stop - b.rows.start)]
        self.table = pd.DataFrame(
            {
                "record": name,
                "quantity": names,
                TIME: np.concatenate(times),
                "measured": np.concatenate(measured),
            }
        )
        self.errors, self.weights = np.concatenate(errors), np.concatenate(weights)
        earliest = float(self.table[TIME].min())
        if earliest < self._begin:
            allowed = f">= {self._begin:g}, where the motion begins{self._label}; give start"
            raise InvalidParameter(TIME, earliest, allowed)
        self._duration = (float(self.table[TIME].max()) - self._begin) or 1.0
        self._kinds = self._event_kinds(record.events)
        spreads = [self._spread(b, each) for b, each in zip(self._blocks, measured, strict=True)]
        self.spreads = np.concatenate(spreads)

    # --- Data

    def _numbers(self, table: pd.DataFrame, column: str) -> Floats:
        """Return a column in the units of the system."""
        values = table[column].to_numpy(dtype=float)
        return values * self._factor(table, column)

    def _factor(self, table: pd.DataFrame, column: str) -> float:
        unit = table.attrs.get("units", {}).get(column, "")
        heading = "time" if column == TIME else column
        own = unit_of(heading, self._system.units)
        return 1.0 if unit == own else float(self._system.units.parse(heading, f"1 {unit}"))

    def _columns(self, field: str, table: pd.DataFrame) -> list[str]:
        """Return the compared columns of a table."""
        system, at_events = self._system, field == "events"
        known = [*system.states, *(o.name for o in system.observables if bool(o.at) == at_events)]
        chosen = [str(each) for each in table.columns if each not in (TIME, EVENT, *LOCATING)]
        for column in chosen:
            if column not in known:
                allowed = (
                    f"t, event or one of {', '.join(known)}; else give columns={{'{column}': …}}"
                )
                raise InvalidParameter(f"column of {field}{self._label}", column, allowed)
        if not at_events and not chosen:
            allowed = f"a table with columns of {', '.join(known)}"
            raise InvalidParameter(f"{field}{self._label}", list(table.columns), allowed)
        return [TIME, *chosen] if at_events else chosen

    def _scatter(
        self, table: pd.DataFrame, column: str, field: str, given: Any, default: float
    ) -> Floats:
        """Return the errors or weights of a column."""
        count = len(table)
        if not given or column not in given:
            return np.full(count, default)
        try:
            values = np.broadcast_to(np.asarray(given[column], dtype=float), (count,))
        except (TypeError, ValueError):
            allowed = f"a number, or {count} numbers"
            raise InvalidParameter(f"{field} of {column}", given[column], allowed) from None
        if not (np.isfinite(values) & (values > 0.0)).all():
            wrong = float(values[~(np.isfinite(values) & (values > 0.0))][0])
            problem = "must be > 0; omit rows that do not count"
            raise InvalidParameter(f"{field} of {column}", wrong, "> 0", problem=problem)
        factor = self._factor(table, column)
        return values * factor if field == "errors" else values / factor

    def _check_scatter(self, record: Record) -> None:
        columns = [block.column for block in self._blocks]
        for field in ("errors", "weights"):
            for column in getattr(record, field) or {}:
                if column not in columns:
                    raise InvalidParameter(field, column, f"one of {', '.join(columns)}")
        for column in {*(record.errors or {})} & {*(record.weights or {})}:
            raise InvalidParameter("weights", column, "without errors of the same column")

    def _event_kinds(self, table: pd.DataFrame | None) -> dict[str, NDArray[np.int64]]:
        """Return the rows of the table of events by the name of the event."""
        if table is None:
            return {}
        known = event_names(self._system.automaton)[:-1]
        if EVENT not in table:
            all_guards = self._system.automaton.guards
            guards = [guard.name for guard in all_guards if guard.impact or len(all_guards) == 1]
            if len(guards) != 1:
                problem = f"without a column event, with names among {', '.join(known)}"
                raise InvalidParameter(f"events{self._label}", None, "", problem=problem)
            return {guards[0]: np.arange(len(table))}
        names = table[EVENT].astype(str).to_numpy()
        for name in dict.fromkeys(names):
            if name not in known:
                raise InvalidParameter(f"event{self._label}", name, f"one of {', '.join(known)}")
        return {name: np.flatnonzero(names == name) for name in dict.fromkeys(names)}

    def _spread(self, block: Block, values: Floats) -> Floats:
        if block.field == "events" and block.column == TIME:
            return self._spacings
        size = float(values.std()) or float(np.abs(values).max()) or 1.0
        return np.full(values.size, size)

    @cached_property
    def _spacings(self) -> Floats:
        """Distance of each recorded event from the nearest one of its name."""
        times = self._times["events"]
        spacings = np.empty(times.size)
        for rows in self._kinds.values():
            spacings[rows] = local_spacings(times[rows], self._duration)
        return spacings

    def until(self, part: float) -> NDArray[np.bool_]:
        """Return which data belong to a part of the record."""
        end = self._begin + part * self._duration
        return self.table[TIME].to_numpy() <= end * (1.0 + 1e-12)

    # --- Free quantities

    def start(self, name: str) -> float | None:
        """Return the first value of a free quantity; None if it has no part in these data."""
        system = self._system
        if name not in self.names:
            return None
        if name in system.parameters:
            return system.parameters[name]
        if not name.startswith(INITIAL):
            return 0.0
        state, problem = name.removeprefix(INITIAL), system.problem(self._options)
        begin = system.state_space.instant(self._initial, problem).y
        return float(system.units.out(state, begin[system.states.index(state)]))

    @property
    def names(self) -> tuple[str, ...]:
        """The quantities that may be free."""
        states = (f"{INITIAL}{name}" for name in self._system.states)
        offsets = (f"{OFFSET}{block.column}" for block in self._blocks if block.column != TIME)
        return (*self._system.parameters, *states, DELAY, *offsets)

    def limits(self, name: str) -> Limits:
        """Return the range of a free quantity."""
        return self._system._limits(name) if name in self._system.parameters else UNLIMITED

    def parse(self, name: str, value: Any, field: str) -> Any:
        """Return a value of a free quantity, or several, as numbers."""
        return self._system.units.parse(_heading(name), value, field)

    def unit(self, name: str) -> str:
        """Return the unit of a free quantity."""
        return unit_of(_heading(name), self._system.units)

    def check(self, values: Mapping[str, float]) -> None:
        """Raise InvalidParameter if there is no system with these values."""
        self._at(values)

    def _at(self, values: Mapping[str, float]) -> HybridSystem:
        inner = {n: v for n, v in values.items() if n in self._system.parameters}
        return self._system.changed(**inner) if inner else self._system

    # --- The run

    def run(self, values: Mapping[str, float], part: float = 1.0) -> Run:
        """Return the run with these values, beyond the last datum of a part of the record."""
        system, delay = self._at(values), values.get(DELAY, 0.0)
        states = {n.removeprefix(INITIAL): v for n, v in values.items() if n.startswith(INITIAL)}
        initial = self._initial
        if states:
            initial = (system.initial if initial is None else initial).replace(**states)
        begin = self._begin - self._transient * (system.forcing_period or 0.0)
        end = self._begin + part * self._duration - delay
        if self._kinds:
            end += float(np.median(self._spacings))
        end += 1e-9 * max(self._duration, abs(end))
        start = None if begin == 0.0 else begin
        length = end - begin
        return simulate(
            system, duration=length, initial=initial, start=start, options=self._options
        )

    def sequence(self, values: Mapping[str, float]) -> Any:
        """Return the events of the run, and between which of them the samples lie."""
        events, samples = self.run(values).events, self._times.get("samples", np.zeros(0))
        instants = events[TIME].to_numpy() + values.get(DELAY, 0.0)
        sides = np.searchsorted(instants, samples, side="right")
        count = len(events) if self._kinds else int(sides.max(initial=0))
        return [*events[EVENT].astype(str)[:count], *sides.tolist()]

    def predict(self, values: Mapping[str, float], part: float, gap: float) -> Prediction:
        """Return the data that the system gives, up to a part of the record."""
        names = list(values)
        inner = [each for each in names if each != DELAY and not each.startswith(OFFSET)]
        run = self.run(values, part)
        found = run.derivatives(inner or [f"{INITIAL}{self._system.states[0]}"])
        computed = np.full(len(self.table), math.nan)
        jacobian = np.zeros((len(self.table), len(names)))
        surplus: dict[str, int] = {}
        within, delay = self.until(part), values.get(DELAY, 0.0)
        for field, times in self._times.items():
            blocks = [block for block in self._blocks if block.field == field]
            used = np.flatnonzero(within[blocks[0].rows])
            if not used.size:
                continue
            if field == "samples":
                columns = self._of_samples(found, times[used] - delay, inner, blocks)
            else:
                used, columns, surplus = self._of_events(found, used, delay, gap, inner, blocks)
            for block in blocks:
                rows = np.arange(block.rows.start, block.rows.stop)[used]
                value, rates, by_time = columns[block.column]
                offset = f"{OFFSET}{block.column}"
                computed[rows] = value + values.get(offset, 0.0)
                for j, name in enumerate(names):
                    if name in inner:
                        jacobian[rows, j] = rates[:, inner.index(name)]
                    elif name == DELAY:
                        jacobian[rows, j] = -by_time
                    elif name == offset:
                        jacobian[rows, j] = 1.0
        return Prediction(computed, jacobian, surplus)

    def _of_samples(
        self, found: RunDerivatives, times: Floats, names: Sequence[str], blocks: Sequence[Block]
    ) -> dict[str, tuple[Floats, Floats, Floats]]:
        """Return value, derivatives, and derivative by time, of each column of samples."""
        table, states = found.samples(times.tolist()), self._system.states
        y = table[list(states)].to_numpy()
        slopes = table[[f"d{name}/dt" for name in states]].to_numpy()
        rates = (
            np.stack(
                [table[[f"d{s}/d{name}" for s in states]].to_numpy() for name in names], axis=-1
            )
            if names
            else np.zeros((*y.shape, 0))
        )
        columns = {}
        for block in blocks:
            if block.column in states:
                i = states.index(block.column)
                columns[block.column] = y[:, i], rates[:, i], slopes[:, i]
            else:
                observable = self._observables[block.column]
                columns[block.column] = _observed(found.run, observable, y, rates, slopes, names)
        return columns

    def _of_events(
        self,
        found: RunDerivatives,
        used: NDArray[np.int64],
        delay: float,
        gap: float,
        names: Sequence[str],
        blocks: Sequence[Block],
    ) -> tuple[NDArray[np.int64], dict[str, tuple[Floats, Floats, Floats]], dict[str, int]]:
        """Return the matched rows, and as `_of_samples` their columns, and unmatched events."""
        events, rates = found.run.events, found.events
        kinds, instants = events[EVENT].astype(str).to_numpy(), events[TIME].to_numpy() + delay
        recorded, partner = self._times["events"], np.full(len(self._times["events"]), UNMATCHED)
        surplus = {}
        for kind, rows in self._kinds.items():
            mine = rows[np.isin(rows, used)]
            theirs = np.flatnonzero((kinds == kind) & (instants >= self._begin))
            matched = match_events(recorded[mine], instants[theirs], self._spacings[mine], gap)
            partner[mine[matched >= 0]] = theirs[matched[matched >= 0]]
            surplus[kind] = int(matched.max(initial=UNMATCHED) + 1 - (matched >= 0).sum())
        used = used[partner[used] >= 0]
        chosen, nothing = partner[used], np.zeros(used.size)
        columns = {}
        for block in blocks:
            column = block.column
            if column == TIME or column in self._system.states:
                value = instants if column == TIME else events[column].to_numpy()
                slopes = rates[[f"d{column}/d{name}" for name in names]].to_numpy()
                slopes = slopes[chosen].reshape(used.size, len(names))
            else:
                value = events[column].to_numpy(dtype=float)
                slopes = np.zeros((used.size, 0))
                if names:
                    slopes = found.jacobian(partial(_event_column, column))[chosen]
            columns[column] = value[chosen], slopes, nothing - (column == TIME)
        return used, columns, surplus

    def remarks(self, values: Mapping[str, float], prediction: Prediction) -> list[tuple[str, str]]:
        """Return sentences about events without a partner."""
        sentences = []
        for kind, rows in self._kinds.items():
            block = next(each for each in self._blocks if each.field == "events")
            missing = int(np.isnan(prediction.values[block.rows][rows]).sum())
            surplus = prediction.surplus.get(kind, 0)
            if missing:
                sentences.append(
                    f"{missing} of {rows.size} recorded events {kind}{self._label} have no event "
                    "of the system and are omitted"
                )
            if surplus:
                sentences.append(
                    f"{surplus} events {kind} of the system are not in the record{self._label}"
                )
        return [("", each) for each in sentences]


def _event_column(column: str, run: Run) -> Floats:
    return np.asarray(run.events[column], dtype=float)


def _heading(name: str) -> str:
    """Return the quantity whose unit a free quantity has."""
    return "time" if name in (DELAY, TIME) else name.removeprefix(INITIAL).removeprefix(OFFSET)


def _observed(
    run: Run, observable: Observable, y: Floats, rates: Floats, slopes: Floats, names: Sequence[str]
) -> tuple[Floats, Floats, Floats]:
    """Return an observable of states, its derivatives, and its derivative by time.

    Differences along the derivatives of the states, without an error of an integration.
    """
    system = run.system
    units = np.array([float(system.units.out(name, 1.0)) for name in system.states])

    def at(direction: Floats, name: str, h: float) -> Floats:
        inner = name in system.parameters
        owner = system.shifted({name: system.parameters[name] + h}) if inner else system
        problem = owner.problem(run.options) if inner else run.trajectory.problem
        states = (y + h * direction) / units
        value = owner.statistics.value
        return np.array([value(observable, state, problem) for state in states])

    found = []
    for direction, name in [
        *((rates[:, :, j], name) for j, name in enumerate(names)),
        (slopes, ""),
    ]:
        sizes = np.abs(direction).max(axis=0) / (np.abs(y).max(axis=0) + 1e-300)
        largest = float(sizes.max())
        if name in system.parameters:
            largest = max(largest, 1.0 / (abs(system.parameters[name]) or 1.0))
        step = STEP / (largest or 1.0)
        found.append(sixth_order_difference(partial(at, direction, name), step))
    factor = float(system.units.out(observable.name, 1.0))
    columns = factor * np.stack(found, axis=-1)
    return factor * at(slopes, "", 0.0), columns[:, :-1], columns[:, -1]
