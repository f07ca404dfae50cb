"""The base of studies whose points are attractors."""

from __future__ import annotations

import math
import re
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from mems_impact._util.garbage import pause_collection
from mems_impact._util.progress import Watch
from mems_impact._util.warning_scopes import at_study_point
from mems_impact.analysis.attractor import (
    STUDY_OPTIONS,
    Attractor,
    InitialCondition,
    RecurrenceOptions,
    check_recurrence,
    map_attractors,
)
from mems_impact.errors import FunctionError, InvalidParameter
from mems_impact.integrators.availability import is_compiled
from mems_impact.integrators.options import Options
from mems_impact.studies.engine.study import STATUS, Columns, Study, row_label
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.serialization.identity import identity
from mems_impact.systems.state import State
from mems_impact.systems.statistics import (
    CHAOTIC,
    FAILED,
    OFF,
    PERIODIC,
    QUASI_PERIODIC,
    RESTING,
    UNSETTLED,
    counted_periods,
)
from mems_impact.tables import captions, merged_columns, unit_of, without_units

if TYPE_CHECKING:
    import pandas as pd

# --- Kinds of motions in tables of studies

MOTION, PERIOD = "motion", "period"  # columns
STATIONARY_STATUSES = (OFF, RESTING)  # motions without measured quantities
_IRREGULAR = (QUASI_PERIODIC, CHAOTIC, UNSETTLED, FAILED)


def motions(table: pd.DataFrame) -> pd.Series:
    """Return the kind of motion in each row: a periodic one with its period, ``"period 2"``."""
    kinds = table[MOTION].astype(str)
    counted = table[PERIOD].astype(int).map(counted_periods)
    return kinds.where((kinds != PERIODIC) | (table[PERIOD] <= 0), counted)


def period_of(motion: str) -> int:
    """Return the period in the name of a kind of motion; 0 without one."""
    match = re.match(r"period (\d+)", motion)
    return int(match[1]) if match else 0


def in_order(kinds: Iterable[str]) -> list[str]:
    """Return kinds of motions in order of complexity: off, period 1, 2, …, chaotic."""
    order = (*STATIONARY_STATUSES, PERIODIC, *_IRREGULAR)

    def rank(kind: str) -> tuple[int, int, str]:
        period = period_of(kind)
        name = PERIODIC if period else kind
        return order.index(name) if name in order else len(order), period, kind

    return sorted(set(kinds), key=rank)


def counted_motions(table: pd.DataFrame) -> str:
    """Return the number of motions of each kind as text: "1 off, 3 period 1"."""
    counts = motions(table).value_counts()
    return ", ".join(f"{counts[kind]} {kind}" for kind in in_order(counts.index))


def map_summary(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each kind of motion in the table of a map; see `OperatingMap.motions`."""
    table = without_units(table)
    x, y = table.columns[:2]
    groups = table.groupby(motions(table).rename(None))
    ends = {f"{name} {end}": (name, end) for name in (x, y) for end in ("min", "max")}
    summary = groups.agg(points=(STATUS, "size"), **ends)
    summary = summary.reindex(in_order(summary.index)).rename_axis(MOTION).reset_index()
    summary.insert(2, "share", summary["points"] / len(table))
    units = table.attrs.get("units", {})
    end_units = {name: units[source] for name, (source, _) in ends.items() if source in units}
    summary.attrs = {**table.attrs, "units": end_units}
    return summary


# --- Evaluation of attractors

EXPONENT, ERROR = "lyapunov exponent", "lyapunov error"
RETURNS = "returns"


@dataclass(frozen=True, kw_only=True)
class AttractorEvaluator:
    """Simulates motions of a system and classifies their attractors."""

    system: HybridSystem
    recurrence: RecurrenceOptions = field(default_factory=RecurrenceOptions)
    options: Options = STUDY_OPTIONS

    def __post_init__(self) -> None:
        check_recurrence(self.recurrence)

    @property
    def without_exponents(self) -> AttractorEvaluator:
        """The same without Lyapunov exponents."""
        return replace(self, recurrence=replace(self.recurrence, exponents="none"))

    def start(self, initial: State | Mapping[str, float] | None) -> State | None:
        """Return the initial state of points; InvalidParameter if the system has no such state."""
        start = None if initial is None else self.system.state_space.parse(initial)
        self.system.state_space.instant(start, self.system.problem(self.options))
        return start

    @cached_property
    def threaded(self) -> bool:
        """Whether points release the GIL."""
        return is_compiled(self.system.problem(self.options).options)

    @property
    def schema(self) -> dict[str, str]:
        """The columns that describe a motion, each with its type."""
        names = dict.fromkeys(self.system.statistics.names, "float")
        has_exponents = self.recurrence.exponents != "none"
        exponents = {EXPONENT: "float", ERROR: "float"} if has_exponents else {}
        first, last = {MOTION: "str", PERIOD: "int"}, {RETURNS: "int", STATUS: "str"}
        return merged_columns(first, names, exponents, last)

    def identity(self) -> dict[str, Any]:
        """Return the inputs on which the results depend."""
        return {**identity(self.system, self.options), **asdict(self.recurrence)}

    def attrs(self, columns: Sequence[str]) -> dict[str, Any]:
        """Return the ``attrs`` of a table with these columns."""
        units = {name: unit_of(name, self.system.units) for name in columns}
        if time := self.system.units.get("time", ""):
            units |= {name: f"1/{time}" for name in (EXPONENT, ERROR) if name in columns}
        return {
            "units": {name: unit for name, unit in units.items() if unit},
            "system": repr(self.system),
            **captions(self.system),
        }

    def follow(
        self,
        cases: Sequence[InitialCondition],
        watch: Watch | None = None,
        numbers: Sequence[int] | None = None,
    ) -> list[Attractor]:
        """Return the attractors of many points."""
        return map_attractors(cases, self.recurrence, self.options, watch, numbers)

    def follow_numbered(
        self, numbers: range, case: Callable[[int], InitialCondition], watch: Watch | None = None
    ) -> list[Attractor]:
        """Return the attractors of numbered points; an invalid point counts as failed."""
        cases: list[InitialCondition] = []
        refused: dict[int, str] = {}
        for number in numbers:
            try:
                with at_study_point(number):
                    cases.append(case(number))
            except (InvalidParameter, FunctionError) as error:
                refused[number] = str(error)
        allowed = [number for number in numbers if number not in refused]
        followed = iter(self.follow(cases, watch, allowed))
        return [
            Attractor(motion=FAILED, status=refused[number])
            if number in refused
            else next(followed)
            for number in numbers
        ]

    def columns(self, attractors: Sequence[Attractor]) -> Columns:
        """Return the columns of `schema`."""
        columns: Columns = {
            MOTION: _text_column([each.motion for each in attractors]),
            PERIOD: np.array([each.period for each in attractors], dtype=np.int64),
        }
        for name in self.system.statistics.names:
            columns[name] = np.array([each.measures.get(name, math.nan) for each in attractors])
        if self.recurrence.exponents != "none":
            columns[EXPONENT] = np.array([each.exponent for each in attractors])
            columns[ERROR] = np.array([each.error for each in attractors])
        columns[RETURNS] = np.array([each.returns for each in attractors], dtype=np.int64)
        columns[STATUS] = _text_column([each.status for each in attractors])
        return columns

    def prepare(self) -> None:
        """Compile the code that points need, once in a process."""
        problem = self.system.problem(self.options)
        brief = replace(self.recurrence, transient=0.0, periods=1.0)
        if problem.unavailable_reason == "" and self.threaded:
            map_attractors([InitialCondition(self.system)], brief, self.options)


def _text_column(texts: Sequence[str]) -> Any:
    return np.array(texts, dtype=object)


@dataclass(frozen=True, kw_only=True)
class AttractorStudy(Study):
    """A study whose points are motions, each described by its attractor."""

    measuring: AttractorEvaluator

    chunk: ClassVar[int] = 256

    @property
    def threaded(self) -> bool:
        """Whether threads may compute points in parallel."""
        return self.measuring.threaded

    @property
    def attrs(self) -> Mapping[str, Any]:
        """Units and captions of the table."""
        return self.measuring.attrs(tuple(self.schema))

    def prepare(self) -> None:
        """Compile the code that points need."""
        self.measuring.prepare()

    def failed(self, first: int, last: int, reason: str) -> Columns:
        """Return the rows of points that failed."""
        attractors = [Attractor(motion=FAILED, status=reason)] * (last - first)
        return self._columns(first, last, attractors)

    def point_label(self, number: int) -> str:
        """Return the name of a point in messages."""
        return row_label(self._identity_columns(number, number + 1))

    @abstractmethod
    def _identity_columns(self, first: int, last: int) -> Columns:
        """Return the columns that identify points."""

    def _attractor_columns(self, attractors: Sequence[Attractor]) -> Columns:
        """Return the columns that describe attractors."""
        return self.measuring.columns(attractors)

    def _columns(self, first: int, last: int, attractors: Sequence[Attractor]) -> Columns:
        return {**self._identity_columns(first, last), **self._attractor_columns(attractors)}


@dataclass(frozen=True, kw_only=True)
class IndependentAttractors(AttractorStudy):
    """A study of motions that do not depend on each other."""

    def compute(
        self, first: int, last: int, carried: Any = None, watch: Watch | None = None
    ) -> tuple[Columns, Any]:
        """Compute some points; see `Study`."""
        with pause_collection():
            attractors = self.measuring.follow_numbered(range(first, last), self._case, watch)
            return self._columns(first, last, attractors), None

    @abstractmethod
    def _case(self, number: int) -> InitialCondition:
        """Return a point; InvalidParameter if it is not allowed."""
