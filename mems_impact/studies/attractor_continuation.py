"""Continuation of attractors and their basins over a parameter."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from mems_impact._util.progress import Watch
from mems_impact._util.warning_scopes import at_study_point
from mems_impact.analysis.attractor import (
    STUDY_OPTIONS,
    Attractor,
    InitialCondition,
    RecurrenceOptions,
)
from mems_impact.errors import InvalidParameter
from mems_impact.integrators.options import Options
from mems_impact.studies.attractor_matching import (
    ATTRACTOR,
    AttractorMatcher,
    bounds_of,
    unique_labels,
)
from mems_impact.studies.attractor_study import AttractorEvaluator, AttractorStudy, motions
from mems_impact.studies.basins import Basins, BasinsStudy
from mems_impact.studies.engine.scheduler import completed_study, run_study
from mems_impact.studies.engine.study import OK, STATUS, Columns
from mems_impact.studies.sampling import Axis, InitialConditions, axis, identity_of_axis
from mems_impact.systems.parameter_result import ParameterResult
from mems_impact.systems.result import check_kind
from mems_impact.systems.serialization.identity import identity_of_state
from mems_impact.systems.state import State, at_same_phase, state_from
from mems_impact.systems.statistics import FAILED
from mems_impact.tables import merged_columns

# --- Branches of attractors

Integers = NDArray[np.int64]
REVERSIBLE = "follows"  # whether the motion returns when the parameter steps back


def match_branches(
    rows: pd.DataFrame, chains: Sequence[range], rules: AttractorMatcher
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the table of branches at each value, and the table of branches.

    `rows` of all chains are in the order of continuation, with the parameter first.
    """
    parameter = str(rows.columns[0])
    stretch, origins, jumps = _segments(rows, chains)
    branch = merge_segments(rows, stretch, set(origins), rules)[stretch]
    names = _names(rows, branch, origins, parameter)
    fine = (rows[STATUS] == OK).to_numpy()
    row_names = np.where(fine, [names[b] for b in branch], FAILED)
    table = rows.assign(**{ATTRACTOR: row_names.astype(object)}).drop(columns=REVERSIBLE)
    table = table.drop_duplicates([ATTRACTOR, parameter]).sort_values(
        [ATTRACTOR, parameter], key=lambda column: _order(column, [*names.values(), FAILED])
    )
    table = table.reset_index(drop=True)
    ends: dict[tuple[str, int], str] = {}
    for before, after, direction in jumps:
        ends.setdefault((names[branch[before]], direction), names[branch[after]])
    followed = table[table[ATTRACTOR] != FAILED]
    return table, _summary(followed, ends, parameter)


def count_in(
    table: pd.DataFrame,
    value: float,
    points: pd.DataFrame,
    starts: InitialConditions,
    rules: AttractorMatcher,
) -> None:
    """Add basin shares at one value of the parameter to a table of branches."""
    rows = table.index[(table.iloc[:, 0] == value) & (table[ATTRACTOR] != FAILED)]
    columns = {
        name: np.concatenate([points[name].to_numpy(), table.loc[rows, name].to_numpy()])
        for name in points
        if name in table
    }
    labels = rules.labels(columns, {name: points[name].to_numpy() for name in starts.names})
    count = len(points)
    for row, label in zip(rows, labels[count:].tolist(), strict=True):
        in_basin = labels[:count] == label
        table.loc[row, ["share", "low", "high"]] = [in_basin.mean(), *bounds_of(in_basin, starts)]


def _segments(
    rows: pd.DataFrame, chains: Sequence[range]
) -> tuple[Integers, dict[int, str], list[tuple[int, int, int]]]:
    """Return the segment of each row, the first segments of the attractors, and all jumps.

    The two chains of one attractor share their first segment. A jump consists of the rows before
    and after it, and the direction, 1 or -1.
    """
    follows, failed = rows[REVERSIBLE].to_numpy(), (rows[STATUS] != OK).to_numpy()
    names, values = rows[ATTRACTOR].to_numpy(), rows.iloc[:, 0].to_numpy()
    stretch: Integers = np.empty(len(rows), dtype=np.int64)
    first: dict[str, int] = {}
    jumps: list[tuple[int, int, int]] = []
    count = 0
    for chain in chains:
        name = names[chain.start]
        if name not in first:
            first[name], count = count, count + 1
        segment, previous = first[name], None
        for i in chain:
            if not failed[i] and not follows[i]:
                segment, count = count, count + 1
                if previous is not None:
                    jumps.append((previous, i, 1 if values[i] > values[previous] else -1))
            stretch[i] = segment
            previous = previous if failed[i] else i
    return stretch, {number: name for name, number in first.items()}, jumps


def merge_segments(
    rows: pd.DataFrame, stretch: Integers, begun: set[int], rules: AttractorMatcher
) -> Integers:
    """Return the branch of each segment: segments that coincide at some value share a branch.

    First segments of different attractors are never merged, since these attractors are distinct.
    """
    branch: Integers = np.arange(max(stretch.max(), *begun) + 1)
    for _, group in rows.groupby(rows.columns[0]):
        labels = rules.labels({name: group[name].to_numpy() for name in group}, {})
        for label in sorted(set(labels.tolist()) - {-1}):
            same = {int(number) for number in branch[stretch[group.index[labels == label]]]}
            one, *others = sorted(same, key=lambda number: (number not in begun, number))
            for other in others:
                if other not in begun:
                    branch[branch == other] = one
    return branch


def _names(
    rows: pd.DataFrame, branch: Integers, origins: dict[int, str], parameter: str
) -> dict[int, str]:
    """Return names of branches: names of attractors, or the values of their first appearance."""
    kinds, names = motions(rows), {}
    for number in dict.fromkeys(branch.tolist()):
        i = int(np.flatnonzero(branch == number)[0])
        description = f"{kinds.iloc[i]} at {parameter} = {rows.iloc[i, 0]:g}"
        names[number] = origins.get(number, description)
    return dict(zip(names, unique_labels(list(names.values())), strict=True))


def _order(column: pd.Series, names: list[str]) -> pd.Series:
    return column.map(names.index) if column.name == ATTRACTOR else column


def _summary(table: pd.DataFrame, ends: dict[tuple[str, int], str], parameter: str) -> pd.DataFrame:
    kinds = motions(table)
    entries = []
    for name, rows in table.groupby(ATTRACTOR, sort=False):
        names = dict.fromkeys(kinds[rows.index])
        values = rows[parameter]
        before, after = ends.get((name, -1), ""), ends.get((name, 1), "")
        entries.append((name, values.min(), values.max(), ", ".join(names), before, after))
    columns = [ATTRACTOR, f"{parameter} min", f"{parameter} max", "motion", "before", "after"]
    result = pd.DataFrame(entries, columns=columns)
    unit = table.attrs.get("units", {}).get(parameter, "")
    units = dict.fromkeys(columns[1:3], unit) if unit else {}
    result.attrs = {**table.attrs, "units": units}
    return result


# --- Continuation of attractors by simulation


@dataclass(frozen=True, kw_only=True)
class AttractorContinuationStudy(AttractorStudy):
    """Each attractor continued upwards, then downwards, from the system's own value."""

    over: Axis  # the parameter, and its values in ascending order
    names: tuple[str, ...]  # of the attractors
    states: tuple[State, ...]  # one of each attractor
    recognition: AttractorMatcher

    kind: ClassVar[str] = "continue_attractors"
    chunk: ClassVar[int] = 16

    @property
    def points(self) -> int:
        """Number of points."""
        return len(self.names) * len(self.over.values)

    @property
    def upwards(self) -> tuple[float, ...]:
        """The system's own value and the values above it."""
        current = self.measuring.system.parameters[self.over.name]
        return tuple(value for value in self.over.values if value >= current)

    @property
    def chains(self) -> tuple[range, ...]:
        """The upward and downward chain of each attractor."""
        count, up = len(self.over.values), len(self.upwards)
        ends = [(i * count, i * count + up, (i + 1) * count) for i in range(len(self.names))]
        ranges = [part for a, b, c in ends for part in (range(a, b), range(b, c))]
        return tuple(part for part in ranges if part)

    def identity(self) -> Mapping[str, Any]:
        """Return the inputs on which the results depend."""
        states = zip(self.names, self.states, strict=True)
        return {
            **self.measuring.identity(),
            "parameter": identity_of_axis(self.over),
            "attractors": {name: identity_of_state(state) for name, state in states},
            "distance": self.recognition.distance,
        }

    @property
    def schema(self) -> Mapping[str, str]:
        """The columns of the table."""
        schema = self.measuring.schema
        status = {STATUS: schema.pop(STATUS)}
        first = {self.over.name: "float", ATTRACTOR: "str", REVERSIBLE: "bool"}
        return merged_columns(first, schema, self.recognition.schema, status)

    def compute(
        self, first: int, last: int, carried: Any = None, watch: Watch | None = None
    ) -> tuple[Columns, Any]:
        """Compute some values of a chain; see `Study`."""
        if carried is None:
            state, value = self._start(first)
        else:
            state, value = state_from(*carried["state"]), carried["value"]
        rows, follows = [], []
        before = self._at(value, state, value)
        for number in range(first, last):
            if watch is not None:
                watch(float(number - first))
            new = self._value(number)
            with at_study_point(number):
                attractor = self._at(new, state, value)
                back = attractor.motion != FAILED and self._is_reversible(
                    attractor, new, before, value
                )
            follows.append(back)
            rows.append(attractor)
            if attractor.final is not None:
                state, value, before = attractor.final, new, attractor
        columns = {**self._columns(first, last, rows), REVERSIBLE: np.array(follows)}
        return columns, {"state": state.parts(), "value": value}

    def failed(self, first: int, last: int, reason: str) -> Columns:
        """Return the rows of points that failed."""
        return {**super().failed(first, last, reason), REVERSIBLE: np.full(last - first, False)}

    def _attractor_columns(self, attractors: Sequence[Attractor]) -> Columns:
        columns = super()._attractor_columns(attractors)
        return {**columns, **self.recognition.columns(attractors)}

    def _identity_columns(self, first: int, last: int) -> Columns:
        numbers = range(first, last)
        names = [self.names[number // len(self.over.values)] for number in numbers]
        values = np.array([self._value(number) for number in numbers])
        return {self.over.name: values, ATTRACTOR: np.array(names, dtype=object)}

    def _value(self, number: int) -> float:
        position, up = number % len(self.over.values), len(self.upwards)
        if position < up:
            return self.upwards[position]
        return self.over.values[len(self.over.values) - 1 - position]

    def _start(self, number: int) -> tuple[State, float]:
        state = self.states[number // len(self.over.values)]
        return state, self.measuring.system.parameters[self.over.name]

    def _at(self, value: float, state: State, before: float) -> Attractor:
        """Return the attractor at a value, started from a final state at another value."""

        def case(_number: int) -> InitialCondition:
            own, name = self.measuring.system, self.over.name
            system = own.changed(**{name: value})
            old = own.shifted({name: before}).forcing_period or 1.0
            return InitialCondition(system, at_same_phase(state, old, system.forcing_period or 1.0))

        return self.measuring.follow_numbered(range(1), case)[0]

    def _is_reversible(
        self, attractor: Attractor, target: float, before: Attractor, value: float
    ) -> bool:
        """Return whether the motion returns when the parameter steps back; otherwise it jumped."""
        assert attractor.final is not None
        back = self._at(value, attractor.final, target)
        pair = [before, back]
        labels = self.recognition.labels(self._attractor_columns(pair), {})
        return bool(labels[0] == labels[1] >= 0)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class AttractorBranches(ParameterResult):
    """Attractors over a parameter.

    Attributes
    ----------
    system : System
        The system at the value of the basins.
    parameter : str
    table : DataFrame
        One row per branch and value of the parameter at which the branch was seen: the parameter,
        the name of the ``attractor``, its motion and the measured quantities, as in `basins`.
        Values at which a motion failed are rows of the attractor "failed", with the reason.
    branches : DataFrame
        One row per branch: its name, its first and last value of the parameter, its kinds of
        ``motion``, and its ends ``before`` and ``after``: the branch to which the motion jumps,
        empty where the values end.

    See Also
    --------
    continue_attractors, basins

    Examples
    --------
    >>> import numpy as np
    >>> import mems_impact as mi
    >>> actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.2, omega=0.5)
    >>> v2 = np.linspace(-1.2, 1.2, 9)
    >>> found = mi.basins(actuator, drive, x=("x2", [0.0]), y=("v2", v2))
    >>> over = mi.continue_attractors(found, "amplitude", np.linspace(0.16, 0.24, 5))
    >>> over.parameter, sorted(over.branches["attractor"])
    ('amplitude', ['off', 'period 1'])
    """

    branches: pd.DataFrame

    def summary(self) -> dict[str, Any]:
        """Return the system, the values of the parameter and the names of the branches."""
        return {**super().summary(), "branches": ", ".join(self.branches[ATTRACTOR])}


def continue_attractors(
    basins: Basins,
    parameter: str,
    values: ArrayLike,
    *,
    recurrence: RecurrenceOptions = RecurrenceOptions(),  # noqa: B008 - immutable
    distance: float = 1e-3,
    shares: bool = False,
    options: Options = STUDY_OPTIONS,
    store: str | os.PathLike[str] | None = None,
    executor: Executor | Callable[[], Executor] | None = None,
    workers: int | None = None,
    progress: bool | Callable[[float], None] = False,
) -> AttractorBranches:
    """Continue coexisting attractors over a parameter, to the ends of their branches.

    Each attractor is continued upwards and downwards from the system's own value; every value
    starts from the state at the previous value. If a motion does not return to its attractor when
    the parameter steps back by one value, the motion has jumped to another branch, known or new:
    its branch ends between the two values. A period doubling does not end a branch. To find
    branches that none of the attractors reaches, run `basins` at other values.

    Parameters
    ----------
    basins : Basins
        The attractors, from `basins`.
    parameter : str
    values : array_like of float
        In any order.
    recurrence : RecurrenceOptions, optional
    distance : float, optional
        Distance within which two motions share an attractor, as in `basins`.
    shares : bool, optional
        Whether to compute basin shares at each value from the initial states of `basins`: the table
        then has ``share``, ``low`` and ``high``. The rest up to 1 reaches other attractors.
    options : Options, optional
        Options of the integration; method "auto" by default.
    store, executor, workers, progress
        As in `basins`. One worker at a time continues an attractor.

    Returns
    -------
    AttractorBranches

    Raises
    ------
    InvalidParameter
        If an argument is out of range. Where a value is not allowed, or a run fails, the table has
        a row of the attractor "failed" with the reason, in no branch.
    Interrupted
        On Ctrl-C; ``partial`` is the table of the finished points.

    See Also
    --------
    AttractorBranches, basins, continue_solution

    Examples
    --------
    >>> import numpy as np
    >>> import mems_impact as mi
    >>> actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.2, omega=0.5)
    >>> v2 = np.linspace(-1.2, 1.2, 9)
    >>> found = mi.basins(actuator, drive, x=("x2", [0.0]), y=("v2", v2))
    >>> over = mi.continue_attractors(found, "amplitude", np.linspace(0.16, 0.24, 5))
    >>> rows = over.branches.set_index("attractor")
    >>> rows.loc["off", "after"], rows.loc["period 1", "before"]
    ('period 1', 'off')
    """
    check_kind(basins, "basins", Basins, "Basins, as mems_impact.basins returns them")
    system = basins.system
    measuring = AttractorEvaluator(system=system, recurrence=recurrence, options=options)
    system.check_parameter(parameter)
    over = axis("values", (parameter, values), (parameter,), system)
    names = tuple(basins.attractors[ATTRACTOR])
    if not names:
        raise InvalidParameter("basins", None, "", problem="holds no attractor: all points failed")
    study = AttractorContinuationStudy(
        over=Axis(parameter, tuple(sorted(over.values))),
        names=names,
        states=tuple(basins.state(name) for name in names),
        measuring=measuring.without_exponents,
        recognition=AttractorMatcher(system=system, options=options, distance=distance),
    )
    rows = run_study(study, store=store, executor=executor, workers=workers, progress=progress)
    with completed_study(study, rows):
        table, branches = match_branches(rows, study.chains, study.recognition)
        if shares:
            followed = set(table.loc[table[ATTRACTOR] != FAILED, parameter])
            for number, value in enumerate(study.over.values):
                if value not in followed:  # no branch has a share there
                    continue
                one = BasinsStudy(
                    starts=basins.starts,
                    measuring=replace(study.measuring, system=system.changed(**{parameter: value})),
                    recognition=study.recognition,
                    initial=basins.initial,
                )
                directory = None if store is None else os.path.join(store, f"shares-{number}")
                points = run_study(
                    one, store=directory, executor=executor, workers=workers, progress=progress
                )
                count_in(table, value, points, basins.starts, study.recognition)
    return AttractorBranches(system=system, parameter=parameter, table=table, branches=branches)
