"""DataFrames of runs, orbits, branches and sweeps, with units; export to xarray.

Headings are symbols and plain words without units. ``table.attrs["units"]`` holds the unit of each
heading; printed and written tables show it beside the heading (`with_units`). ``period`` and
``time`` locate a row within the forcing, ``t`` counts from the start of period 0.

The export to xarray is a function, since `DataFrame.to_xarray` ignores ``table.attrs``, and thus
units and provenance, and numbers rows instead of using time as coordinate.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Mapping, Sequence
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.problem import Section
from mems_impact.hybrid.simulation import Events, Samples

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

T = TypeVar("T")  # a column, or the name of its type

# --- Headings, units, provenance, categories

CHATTER_ENDS = "chatter ends"
DRIVE_SWITCHES = "drive switches"
END = "end of the run"
SUFFIXES = (
    "before", "after", "min", "max", "mean", "std", "error", "apart", "from", "to", "gain", "final",
)  # fmt: skip
TIME_COLUMNS = ("time", "t", "start", "end")


class Labels(Protocol):
    """Names and units of a system, for its tables."""

    @property
    def automaton(self) -> Automaton:
        """Names of states, modes and guards."""

    @property
    def units(self) -> Any:
        """Units by heading, and the conversion of scaled values: `mems_impact.systems.units`."""

    @property
    def forced(self) -> bool:
        """Whether the system has a forcing period."""

    @property
    def state_space(self) -> Any:
        """States and further columns in tables: `mems_impact.systems.state_space`."""

    @property
    def section(self) -> Section | None:
        """The Poincaré section: component, level, direction."""


def table(
    columns: Mapping[str, Any],
    labels: Labels,
    *,
    user_columns: Mapping[str, Any] = MappingProxyType({}),
    **attributes: Any,
) -> pd.DataFrame:
    """Return a table in the units of the system, from columns in the units of the numerics.

    `user_columns` are already in the units of the system; they come first. `attributes` go to
    ``table.attrs``, beside units and versions.
    """
    import pandas as pd  # imported on first use, which a run without tables need not wait for

    units = {name: unit_of(name, labels.units) for name in (*user_columns, *columns)}
    displayed = {name: labels.units.out(name, values) for name, values in columns.items()}
    result = pd.DataFrame({**user_columns, **displayed})
    result.attrs = {
        "units": {name: unit for name, unit in units.items() if unit},
        "system": repr(labels),
        "mems_impact": _version(),
        **attributes,
    }
    return result


def row_table(
    headings: Mapping[str, type], rows: Sequence[Sequence[Any]], labels: Labels, **attributes: Any
) -> pd.DataFrame:
    """Return a table of rows in the units of the system; columns keep their types without rows."""
    columns: dict[str, NDArray[Any]] = {
        name: np.array([row[i] for row in rows], dtype=kind)
        for i, (name, kind) in enumerate(headings.items())
    }
    return table({}, labels, user_columns=columns, **attributes)


def captions(labels: Labels) -> dict[str, Any]:
    """Return the captions of a table of orbits or sweeps, for its ``attrs``."""
    section = labels.section
    equation: list[Any] = []
    if section is not None:
        name = labels.automaton.states[section[0]]
        equation = [name, float(labels.units.out(name, section[1]))]
    forced = {} if labels.forced else {"forced": False}
    return {
        "states": list(labels.state_space.displayed),
        "section": equation,
        "symbols": dict(labels.units.symbols),
        **forced,
    }


@cache
def _version() -> str:
    return version("mems_impact")


def unit_of(heading: str, units: Mapping[str, str]) -> str:
    """Return the unit of a column: ``v2 before`` and ``v2 3`` have the unit of ``v2``."""
    return units.get(name_of(heading, units), "")


def name_of(heading: str, names: Container[str]) -> str:
    """Return the quantity of a column: ``v2`` for ``v2 before`` and ``v2 3``; empty if unknown."""
    if heading in TIME_COLUMNS:
        return "time"
    while heading not in names:
        first, _, last = heading.rpartition(" ")
        if not first or not (last in SUFFIXES or last.isdigit()):
            return ""
        heading = first
    return heading


def with_units(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table with units in its headings, ``x1 [m]``, for printing and writing."""
    units = table.attrs.get("units", {})
    return table.rename(
        columns={name: f"{name} [{unit}]" for name, unit in units.items() if name in table}
    )


def without_units(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table with units in ``attrs`` instead of its headings: the inverse of `with_units`.

    A table without units in its headings is returned unchanged.
    """
    pairs = {name: re.fullmatch(r"(.+) \[(.+)\]", str(name)) for name in table.columns}
    headings = {name: (match[1], match[2]) for name, match in pairs.items() if match}
    if not headings:
        return table
    result = table.rename(columns={name: plain for name, (plain, _) in headings.items()})
    result.attrs = {**table.attrs, "units": dict(headings.values())}
    return result


def time_columns(
    cycle: NDArray[np.int64], time: Floats, period: float, labels: Labels
) -> dict[str, Any]:
    """Return the columns of time: period, time within it, and running time.

    An autonomous system has the running time only.
    """
    running = {"t": cycle * period + time}
    return {"period": cycle, "time": time, **running} if labels.forced else running


def states(names: Sequence[str], y: Floats) -> dict[str, Any]:
    """Return one column per component of the state."""
    return {name: y[:, i] for i, name in enumerate(names)}


def category_column(names: Sequence[str], numbers: NDArray[np.int64]) -> Any:
    """Return a column of names by their numbers, as categories, which save memory."""
    import pandas as pd

    return pd.Categorical.from_codes(numbers, categories=list(names))


def texts(values: Iterable[str]) -> NDArray[np.str_]:
    """Return a column of texts, which keeps its type without rows."""
    return np.array(list(values), dtype=str)


def event_names(automaton: Automaton) -> tuple[str, ...]:
    """Return the names of events in the log, indexed by `event_codes`; the last is the end."""
    return (*(guard.name for guard in automaton.guards), CHATTER_ENDS, DRIVE_SWITCHES, END)


def event_codes(log: Events, automaton: Automaton) -> NDArray[np.int64]:
    """Return the event of each shown row, as an index into `event_names`."""
    m = len(automaton.guards)
    codes = np.where(log.kind == workspace.ACCUMULATION, m, log.guard)
    return np.where(log.kind == workspace.SWITCH, m + 1, codes)


def is_shown(log: Events) -> NDArray[np.bool_]:
    """Return a mask of the rows of the log that end an arc, the events to a user."""
    mask: NDArray[np.bool_] = np.isin(
        log.kind, (workspace.TRANSITION, workspace.ACCUMULATION, workspace.SWITCH)
    )
    return mask


# --- Tables as labelled arrays, with their units.

TIME = "t"


def to_xarray(table: pd.DataFrame, index: str | Sequence[str] | None = None) -> xr.Dataset:
    """Return a table as labelled arrays: ``dataset["x2"].attrs["units"]`` is the unit of x2.

    Parameters
    ----------
    table : DataFrame
        A table of this package, such as ``run.samples()`` or the ``table`` of a map.
    index : str or sequence of str, optional
        The columns that identify a row and become coordinates; several columns span a grid, such as
        ``("omega", "amplitude")`` of a map. By default the running time ``t``, or the number of the
        row in a table without ``t``.

    Returns
    -------
    xarray.Dataset
        One variable per column, with ``units`` in its ``attrs``; a flag that is missing in some
        row, as ``stable`` of a neutral orbit, is 1, 0 or NaN. The ``attrs`` of the dataset hold
        the other attributes of the table (``system``, version).

    Raises
    ------
    InvalidParameter
        If xarray is not installed, a column is not in the table, or two rows have the same
        coordinates of a grid.

    See Also
    --------
    Run, operating_map

    Examples
    --------
    >>> import mems_impact as mi
    >>> run = mi.simulate(mi.load_actuator("mita2003"), mi.Sine(amplitude=20.0, omega=900.0), 5)
    >>> mi.to_xarray(run.samples(per_period=100))["x2"].attrs["units"]
    'm'
    """
    import pandas as pd

    if not isinstance(table, pd.DataFrame):
        raise InvalidParameter("table", type(table).__name__, "a DataFrame")
    if find_spec("xarray") is None:
        problem = "needs xarray, which is not installed: pip install 'mems-impact[xarray]'"
        raise InvalidParameter("to_xarray", None, "", problem=problem)
    import xarray as xr

    names = [index] if isinstance(index, str) else list(index or ())
    if not names and TIME in table:
        names = [TIME]
    for column in names:
        if column not in table:
            raise InvalidParameter("index", column, f"one of {', '.join(map(str, table.columns))}")
    # Labelled arrays and netCDF have NumPy's types only, in which a flag that is missing is NaN.
    plain = table.astype(
        {
            name: object if kind != "boolean" else float if table[name].hasnans else bool
            for name, kind in table.dtypes.items()
            if isinstance(kind, pd.api.extensions.ExtensionDtype)
        }
    )
    rows = plain.set_index(names) if names else plain.rename_axis("row")
    if len(names) > 1 and rows.index.has_duplicates:
        raise InvalidParameter("index", tuple(names), "columns by which no two rows are the same")
    dataset = xr.Dataset.from_dataframe(rows)
    units = table.attrs.get("units", {})
    for name in dataset.variables:
        if name in units:
            dataset[name].attrs["units"] = units[name]
    others = {name: str(value) for name, value in table.attrs.items() if name != "units"}
    dataset.attrs.update(others)
    return dataset


# --- Tables of periodic orbits over one parameter and over two.


def branch(parameter: str, rows: Sequence[Mapping[str, Any]], labels: Labels) -> pd.DataFrame:
    """Return one row per orbit of a branch.

    `rows` have, in the units of the system, the ``value`` of the parameter, quantities of the orbit
    by heading, and ``states``, by name the values of a state at the crossings of the section.
    """
    values = np.array([row["value"] for row in rows], dtype=float)
    return _table({parameter: values}, rows, labels)


def special_points(
    parameter: str, rows: Sequence[Mapping[str, Any]], labels: Labels, branch_table: pd.DataFrame
) -> pd.DataFrame:
    """Return one row per special point of a branch; `rows` with its names as well.

    The table has the columns of `like`, the table of the branch, also without rows.
    """
    names = ("kind", "criticality", "type")
    columns = merged_columns(
        {"label": texts(row["label"] for row in rows)},
        {parameter: np.array([row["value"] for row in rows], dtype=float)},
        {name: texts(row[name] for row in rows) for name in names},
    )
    return _special(columns, rows, labels, branch_table)


def curve(
    parameters: Sequence[str], rows: Sequence[Mapping[str, Any]], labels: Labels
) -> pd.DataFrame:
    """Return one row per orbit of a curve; `rows` with ``values`` of the two `parameters`."""
    return _table(parameter_columns(parameters, rows), rows, labels)


def codimension_two(
    parameters: Sequence[str],
    rows: Sequence[Mapping[str, Any]],
    labels: Labels,
    curve_table: pd.DataFrame,
) -> pd.DataFrame:
    """Return one row per point of codimension two; as `curve`, with ``kind``.

    The table has the columns of `like`, the table of the curve, also without rows.
    """
    kinds = texts(row["kind"] for row in rows)
    return _special(
        {"kind": kinds, **parameter_columns(parameters, rows)}, rows, labels, curve_table
    )


def _special(
    first_columns: Mapping[str, Any],
    rows: Sequence[Mapping[str, Any]],
    labels: Labels,
    solutions: pd.DataFrame,
) -> pd.DataFrame:
    """Return a table of special points with the columns of the solutions in `like`.

    A column of `like` that no row has, such as a third crossing of the section, is NaN.
    """
    rows_table = _table(first_columns, rows, labels)
    for name in solutions.columns:
        if name not in rows_table:
            rows_table[name] = solutions[name].iloc[:0]
    measures = [name for name in solutions.columns if name not in first_columns]
    more = [
        name for name in rows_table.columns if name not in first_columns and name not in measures
    ]
    result = rows_table[[*first_columns, *measures, *more]]
    result.attrs = {
        **rows_table.attrs,
        "units": {**solutions.attrs["units"], **rows_table.attrs["units"]},
    }
    return result


def _table(
    first_columns: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], labels: Labels
) -> pd.DataFrame:
    columns = merged_columns(first_columns, _measures(rows))
    return table({}, labels, user_columns=columns, **captions(labels))


def merged_columns(*parts: Mapping[str, T]) -> dict[str, T]:
    """Return all columns of some parts; InvalidParameter if two columns have one name."""
    columns: dict[str, T] = {}
    for part in parts:
        for name in part:
            if name in columns:
                problem = "two columns of the table would have this name; give another name to "
                problem += "the parameter, state or observable"
                raise InvalidParameter(name, None, "", problem=problem)
        columns.update(part)
    return columns


def parameter_columns(
    parameters: Sequence[str], rows: Sequence[Mapping[str, Any]]
) -> dict[str, Floats]:
    """Return one column per parameter, from the ``values`` of each row."""
    return {
        name: np.array([row["values"][i] for row in rows], dtype=float)
        for i, name in enumerate(parameters)
    }


def _column(values: list[Any]) -> Any:
    """Return a column; flags are nullable, since the stability of a neutral orbit is None."""
    import pandas as pd

    are_flags = bool(values) and all(isinstance(each, bool | None) for each in values)
    return pd.array(values, dtype="boolean") if are_flags else np.array(values)


def _measures(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the columns that describe orbits, the location first."""
    leading = ("value", "values", "label", "kind", "criticality", "type", "states")
    names = [name for name in (rows[0] if rows else ()) if name not in leading]
    columns: dict[str, Any] = {name: _column([row[name] for row in rows]) for name in names}
    crossings: dict[str, Any] = {}
    for state in rows[0]["states"] if rows else ():
        columns_of_state = max(len(row["states"][state]) for row in rows)
        for i in range(max(1, columns_of_state)):
            values = [row["states"][state][i : i + 1] for row in rows]
            numbers = [float(value[0]) if len(value) else np.nan for value in values]
            crossings[state if i == 0 else f"{state} {i + 1}"] = np.array(numbers)
    return merged_columns(columns, crossings)


# --- Tables of one run, or of one orbit: events, impacts, crossings of the section, samples.


def events(
    log: Events, period: float, labels: Labels, observed: Mapping[str, Floats]
) -> pd.DataFrame:
    """Return one row per transition.

    Columns: when, what happened, the modes before and after, the state after, and `observed`.
    """
    mask = is_shown(log)
    log = log[mask]
    columns = {
        **_transitions(log, period, labels),
        **states(labels.automaton.states, log.after),
        **labels.state_space.derived_columns(log.cycle, log.time, log.after),
        **{name: values[mask] for name, values in observed.items()},
    }
    return table(columns, labels)


def corners(log: Events, period: float, labels: Labels) -> pd.DataFrame:
    """Return one row per transition: when, event, modes, impact, the states before and after."""
    log = log[is_shown(log)]
    columns = {
        **_transitions(log, period, labels),
        "impact": log.impacts(labels.automaton),
        **_states_around(log, labels),
    }
    return table(columns, labels)


def impacts(
    hits: Events, period: float, labels: Labels, observed: Mapping[str, Floats]
) -> pd.DataFrame:
    """Return one row per impact: when, phase, which guard, states before and after, `observed`."""
    columns = {
        **time_columns(hits.cycle, hits.time, period, labels),
        **({"phase": hits.time / period} if labels.forced else {}),
        "event": category_column([guard.name for guard in labels.automaton.guards], hits.guard),
        **_states_around(hits, labels),
        **observed,
    }
    return table(columns, labels)


def _transitions(log: Events, period: float, labels: Labels) -> dict[str, Any]:
    """Return when transitions occur, their events and modes."""
    automaton = labels.automaton
    return {
        **time_columns(log.cycle, log.time, period, labels),
        "event": category_column(event_names(automaton)[:-1], event_codes(log, automaton)),
        "mode before": category_column(automaton.modes, log.mode_before),
        "mode after": category_column(automaton.modes, log.mode_after),
    }


def _states_around(log: Events, labels: Labels) -> dict[str, Any]:
    """Return each state before and after the events."""
    return {
        f"{name} {side}": y[:, i]
        for i, name in enumerate(labels.automaton.states)
        for side, y in (("before", log.before), ("after", log.after))
    }


def section(log: Events, period: float, labels: Labels) -> pd.DataFrame:
    """Return one row per crossing of the Poincaré section: when, the state, the direction."""
    columns = {
        **time_columns(log.cycle, log.time, period, labels),
        **states(labels.automaton.states, log.after),
        "direction": log.guard,
    }
    return table(columns, labels)


def handovers(log: Events, period: float, labels: Labels) -> pd.DataFrame:
    """Return one row per change of method: when, the mode, the method from then on."""
    columns = {
        **time_columns(log.cycle, log.time, period, labels),
        "mode": category_column(labels.automaton.modes, log.mode_after),
        "method": category_column(("dop853", "bdf"), (log.guard < 0).astype(np.int64)),
    }
    return table(columns, labels)


def samples(grid: Samples, period: float, labels: Labels) -> pd.DataFrame:
    """Return one row per sample: when, the state, the mode."""
    columns = {
        **time_columns(grid.cycle, grid.time, period, labels),
        **states(labels.automaton.states, grid.y),
        **labels.state_space.derived_columns(grid.cycle, grid.time, grid.y),
        "mode": category_column(labels.automaton.modes, grid.mode),
    }
    return table(columns, labels)


def segments(
    period: Sequence[int],
    mode: Sequence[int],
    start: Floats,
    end: Floats,
    ends: Sequence[str],
    labels: Labels,
) -> pd.DataFrame:
    """Return one row per arc of an orbit: period, mode, start, end and final event."""
    columns = {
        "period": np.asarray(period, dtype=np.int64),
        "mode": category_column(labels.automaton.modes, np.asarray(mode, dtype=np.int64)),
        "start": start,
        "end": end,
        "ends with": texts(ends),
    }
    return table(columns, labels)


def statistics(values: Mapping[str, float], labels: Labels) -> pd.Series:
    """Return one number per row, in the order given."""
    table_of_columns = table({name: np.array([value]) for name, value in values.items()}, labels)
    result = table_of_columns.iloc[0].astype(float).rename("statistics")
    result.attrs = table_of_columns.attrs
    return result


def verification(
    matched: Sequence[tuple[int, Floats]],
    unmatched: Sequence[int],
    differences: Sequence[str],
    labels: Labels,
) -> pd.DataFrame:
    """Return one row per kind of event in two runs: how often, and the largest differences.

    `matched` has for every event of both runs its index in `event_names` and the differences, whose
    headings are `differences`; `unmatched` the indices of events of one run only.
    """
    names = event_names(labels.automaton)
    codes = np.array([code for code, _ in matched], dtype=np.int64)
    values = np.array([found for _, found in matched]).reshape(-1, len(differences))
    kinds = np.union1d(codes, np.array(unmatched, dtype=np.int64))
    # Ignore NaN, the difference of events without impact speed; all NaN gives NaN.
    largest = np.array([np.fmax.reduce(values[codes == kind], initial=np.nan) for kind in kinds])
    columns = {
        "event": texts(names[kind] for kind in kinds),
        "matched": [int((codes == kind).sum()) for kind in kinds],
        "in one run only": [unmatched.count(kind) for kind in kinds],
        **dict(zip(differences, largest.reshape(-1, len(differences)).T, strict=True)),
    }
    return table(columns, labels)


# --- Tables of sweeps: all crossings at every value of a parameter, and one row per value.

# Columns of a sweep that are neither the parameter, which comes first, nor states nor statistics.
DIRECTION, PERIOD, NUMBER, STATUS = "direction", "period", "number", "status"


def number_column(labels: Labels) -> str:
    """Return the column that numbers the crossings at one value: by period, or consecutively."""
    return PERIOD if labels.forced else NUMBER


def error_column(statistic: str) -> str:
    """Return the column with the error of a statistic."""
    return f"{statistic} error"


def sweep_columns(
    parameter: str,
    points: Sequence[Mapping[str, Any]],
    states: Sequence[str],
    statistics: Sequence[str],
    labels: Labels,
) -> dict[str, NDArray[Any]]:
    """Return the columns of `sweep`, one row per crossing of the section.

    Parameters are as in `sweep`.
    """
    count = number_column(labels)
    crossings = [len(point["section"].get(count, ())) for point in points]
    repeats = [max(1, k) for k in crossings]

    def repeated(values: Sequence[Any]) -> NDArray[Any]:
        return np.repeat(np.array(values), repeats)

    def crossing(column: str) -> NDArray[Any]:
        missing = np.array([np.nan])
        values = [
            p["section"][column] if k else missing for p, k in zip(points, crossings, strict=True)
        ]
        return np.concatenate([*values, missing])[:-1]

    return {
        parameter: repeated([point["value"] for point in points]).astype(float),
        DIRECTION: repeated([point["direction"] for point in points]).astype(str).astype(object),
        count: crossing(count),
        **{name: crossing(name) for name in states},
        **{
            name: repeated([point["statistics"].get(name, np.nan) for point in points])
            for name in statistics
        },
        STATUS: repeated([point["status"] for point in points]).astype(str).astype(object),
    }


def sweep(
    parameter: str,
    points: Sequence[Mapping[str, Any]],
    states: Sequence[str],
    statistics: Sequence[str],
    labels: Labels,
    quantities: Mapping[str, tuple[str, str]] = MappingProxyType({}),
) -> pd.DataFrame:
    """Return one row per crossing of the section, or one with NaN for a point without any.

    `points` has for each value of the parameter, in order and in the units of the system,
    ``value``, ``direction``, ``section`` (the columns `number_column` and `states` of the
    crossings), ``statistics`` by name, and ``status``. `states` and `statistics` have a column;
    `quantities` are other ones of figures, for ``attrs``: column and axis label.
    """
    columns = sweep_columns(parameter, points, states, statistics, labels)
    attributes = {**captions(labels), "states": list(states)}
    if not labels.forced and labels.section is None:
        attributes["maxima"] = True
    attributes["quantities"] = {name: list(pair) for name, pair in quantities.items()}
    return table({}, labels, user_columns=columns, **attributes)


def sweep_summary(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each value of the table of a sweep; see `Sweep.statistics`."""
    table = without_units(table)
    parameter, count, state = table.columns[0], table.columns[2], table.columns[3]
    # A sweep may contain a value twice: successive rows with the same value and direction belong
    # together. A crossing earlier than the one before it begins a new point.
    keys = table[[parameter, DIRECTION]]
    changed = (keys != keys.shift()).any(axis=1)
    changed |= table[count] < table[count].shift()
    groups = table.groupby(changed.cumsum(), sort=False)
    impacts = "impacts per period" if count == PERIOD else "impacts per time"
    first = list(table.columns).index(impacts)
    statistics = [name for name in table.columns[first:] if name != STATUS]
    summary = groups.agg(
        **{
            parameter: (parameter, "first"),
            DIRECTION: (DIRECTION, "first"),
            STATUS: (STATUS, "first"),
            **{name: (name, "first") for name in statistics},
            f"{state} min": (state, "min"),
            f"{state} max": (state, "max"),
            "crossings": (state, "count"),
        }
    ).reset_index(drop=True)
    summary.insert(3, "impacting", summary[impacts] > 0.0)
    units = dict(table.attrs.get("units", {}))
    if state in units:
        units[f"{state} min"] = units[f"{state} max"] = units[state]
    summary_units = {name: unit for name, unit in units.items() if name in summary}
    summary.attrs = {**table.attrs, "units": summary_units}
    return summary


class ImpactChange(NamedTuple):
    """Interval of a sweep in which impacts begin or cease."""

    direction: str
    before: float  # the last value before the change
    after: float  # the first value after the change
    begins: bool


def impact_changes(table: pd.DataFrame) -> list[ImpactChange]:
    """Return where impacts first begin or cease in each direction; failed values are ignored.

    The table is from `sweep`, or read back from a file.
    """
    summary = sweep_summary(table)
    summary = summary[summary["status"] == "ok"]
    result = []
    for direction, rows in summary.groupby("direction", sort=False):
        impacting = rows["impacting"].to_numpy()
        changes = (impacting[1:] != impacting[:-1]).nonzero()[0]
        if changes.size:
            before, after = (rows.iloc[changes[0] + i] for i in (0, 1))
            begins = bool(after["impacting"])
            result.append(
                ImpactChange(str(direction), float(before.iloc[0]), float(after.iloc[0]), begins)
            )
    return result
