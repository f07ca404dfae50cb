"""Every table of the package: one function each, from columns of numbers to a pandas DataFrame.

Headings are the symbols of the paper and plain words. Times and phases that stand beside a
``period`` count from the start of that forcing period; ``t`` counts from the start of period 0.

What a run computed is dimensionless. Where the device is in SI, its `Scales` put every column of
`COLUMN_UNITS` in SI and the unit in its heading: ``x1 [m]``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mems_impact.actuator.modes import GUARDS, MODES, RIGHT_IMPACT, STATES, V1, V2, X1
from mems_impact.actuator.units import DIMENSIONLESS, Scales
from mems_impact.hybrid import loop
from mems_impact.hybrid.trajectory import Events, Floats, Samples

__all__ = [
    "COLUMN_UNITS",
    "END",
    "EVENTS",
    "SWEEP_COLUMNS",
    "blows",
    "branch",
    "chart",
    "chart_points",
    "chart_types",
    "checks",
    "codimension_two",
    "curve",
    "displacement",
    "event_codes",
    "events",
    "fit_parameters",
    "fit_residuals",
    "heading",
    "impacts",
    "is_shown",
    "samples",
    "section",
    "segments",
    "special_points",
    "speed",
    "statistics",
    "step_lengths",
    "sweep",
    "sweep_summary",
    "symbols",
    "transitions",
    "verification",
]

COLUMN_UNITS = {
    **dict.fromkeys(["time", "t", "start", "end"], "s"),
    **dict.fromkeys(["x1", "x2", "step", "displacement"], "m"),
    **dict.fromkeys(["v1", "v1 before", "v1 after", "v2", "v2 before", "v2 after"], "m/s"),
    **dict.fromkeys(["v2 min", "v2 max"], "m/s"),
    "energy lost": "J",
    "impact speed": "m/s",
    # statistics
    "displacement per period": "m",
    **dict.fromkeys(["displacement per impact", "displacement per impact std"], "m"),
    **dict.fromkeys(["displacement per blow", "displacement per blow std"], "m"),
    **dict.fromkeys(["impact speed min", "impact speed mean", "impact speed max"], "m/s"),
    "mean speed": "m/s",
    "closest approach": "m",
    "energy lost per period": "J",
    # differences of two runs
    "time apart": "s",
    "position apart": "m",
    **dict.fromkeys(["impact speed apart", "velocity apart"], "m/s"),
}
"""The SI unit of every column, and of every statistic, that is not a pure number."""

CHATTER_ENDS = "chatter ends"
DRIVE_SWITCHES = "drive switches"
END = "end of the run"
EVENTS = (*(guard.name for guard in GUARDS), CHATTER_ENDS, DRIVE_SWITCHES, END)
"""What a row of the event log is called, by `event_codes`; and what comes after the last."""


def impacts(
    rows: Events, steps: Floats, energy: Floats, period: float, scales: Scales = DIMENSIONLESS
) -> pd.DataFrame:
    """Return one row an impact.

    Parameters
    ----------
    rows : Events
        Impacts only.
    steps : float array
        Displacement of the frame from each impact until the frame rests or the next impact comes.
    energy : float array
        Kinetic energy lost in each.
    period : float
        Forcing period.
    scales : Scales, optional
    """
    columns = {
        **_when(rows.cycle, rows.time),
        "phase": rows.time / period,
        "stopper": _stopper(rows),
        "v1 before": rows.before[:, V1],
        "v1 after": rows.after[:, V1],
        "v2 before": rows.before[:, V2],
        "v2 after": rows.after[:, V2],
        "energy lost": energy,
        "x1": rows.after[:, X1],
        "step": steps,
    }
    return _table(columns, scales)


def blows(
    first: Events,
    impacts: NDArray[np.int64],
    rests: NDArray[np.bool_],
    displacement: Floats,
    energy: Floats,
    period: float,
    scales: Scales = DIMENSIONLESS,
) -> pd.DataFrame:
    """Return one row a blow.

    Parameters
    ----------
    first : Events
        The first impact of each.
    impacts : int array
        How many it has.
    rests : bool array
        Whether it ends in rest on the stopper.
    displacement : float array
        What it moves the frame by.
    energy : float array
        Kinetic energy lost in each.
    period : float
        Forcing period.
    scales : Scales, optional
    """
    columns = {
        **_when(first.cycle, first.time),
        "phase": first.time / period,
        "stopper": _stopper(first),
        "impacts": impacts,
        "ends in rest": rests,
        "v2 before": first.before[:, V2],
        "energy lost": energy,
        "x1": first.after[:, X1],
        "displacement": displacement,
    }
    return _table(columns, scales)


def events(log: Events, scales: Scales = DIMENSIONLESS) -> pd.DataFrame:
    """Return one row a transition: what happened, the modes before and after, the state after."""
    log = log[is_shown(log)]
    columns = {
        **_when(log.cycle, log.time),
        "event": _words(EVENTS[:-1], event_codes(log)),
        "mode before": _words(MODES, log.mode_before),
        "mode after": _words(MODES, log.mode_after),
        **_states(log.after),
    }
    return _table(columns, scales)


def is_shown(log: Events) -> NDArray[np.bool_]:
    """Return where the rows of the log are events to a user: what ends an arc."""
    shown: NDArray[np.bool_] = np.isin(log.kind, (loop.TRANSITION, loop.ACCUMULATION, loop.SWITCH))
    return shown


def event_codes(log: Events) -> NDArray[np.int64]:
    """Return what happened in each row that is shown: places in `EVENTS`."""
    codes = np.where(log.kind == loop.ACCUMULATION, EVENTS.index(CHATTER_ENDS), log.guard)
    return np.where(log.kind == loop.SWITCH, EVENTS.index(DRIVE_SWITCHES), codes)


def verification(
    matched: Sequence[tuple[int, Floats]], alone: Sequence[int], scales: Scales = DIMENSIONLESS
) -> pd.DataFrame:
    """Return one row a kind of event in two runs: how often, and the largest differences.

    Parameters
    ----------
    matched : sequence of tuple
        Of every event that both have: its place in `EVENTS`, and the differences of instants,
        impact speeds, positions and velocities.
    alone : sequence of int
        Of every event that only one has: its place in `EVENTS`.
    scales : Scales, optional
    """
    codes = np.array([code for code, _ in matched], dtype=np.int64)
    values = np.array([differences for _, differences in matched]).reshape(-1, 4)
    kinds = np.union1d(codes, np.array(alone, dtype=np.int64))
    # A NaN is no difference, of what has no impact speed; all NaN stay so.
    largest = np.array([np.fmax.reduce(values[codes == kind], initial=np.nan) for kind in kinds])
    columns = {
        "event": [EVENTS[kind] for kind in kinds],
        "matched": [int((codes == kind).sum()) for kind in kinds],
        "in one run only": [alone.count(kind) for kind in kinds],
        **dict(
            zip(
                ("time apart", "impact speed apart", "position apart", "velocity apart"),
                largest.reshape(-1, 4).T,
                strict=True,
            )
        ),
    }
    return _table(columns, scales)


def section(log: Events, direction: int, scales: Scales = DIMENSIONLESS) -> pd.DataFrame:
    """Return one row a crossing of the Poincaré section x2 = 0.

    Parameters
    ----------
    log : Events
    direction : {-1, 0, 1}
        Crossings with v2 < 0, both, or v2 > 0.
    scales : Scales, optional
    """
    log = crossings(log, direction)
    columns = {
        **_when(log.cycle, log.time),
        "v2": log.after[:, V2],
        "v1": log.after[:, V1],
        "x1": log.after[:, X1],
        "direction": log.guard,
    }
    return _table(columns, scales)


def crossings(log: Events, direction: int) -> Events:
    """Return the rows that are crossings of the section in `direction` (0: both)."""
    wanted = log.kind == loop.SECTION_CROSSING
    if direction != 0:
        wanted &= log.guard == direction
    return log[wanted]


def samples(grid: Samples, period: float, scales: Scales = DIMENSIONLESS) -> pd.DataFrame:
    """Return one row a sample."""
    columns = {
        **_when(grid.cycle, grid.time),
        "t": grid.cycle * period + grid.time,
        **_states(grid.y),
        "mode": _words(MODES, grid.mode),
    }
    return _table(columns, scales)


def segments(
    period: Sequence[int],
    mode: Sequence[int],
    start: Floats,
    end: Floats,
    ends: Sequence[str],
    scales: Scales = DIMENSIONLESS,
) -> pd.DataFrame:
    """Return one row a stretch of an orbit: its period, mode, start, end and what ends it."""
    columns = {
        "period": np.asarray(period, dtype=np.int64),
        "mode": _words(MODES, np.asarray(mode, dtype=np.int64)),
        "start": start,
        "end": end,
        "ends with": list(ends),
    }
    return _table(columns, scales)


ORBIT_COLUMNS = (
    "stable",
    "admissible",
    "piece",
    "largest multiplier",
    "impacts",
    "impact speed",
    "step",
    "closest approach",
)


def branch(
    parameter: str, rows: Sequence[Mapping[str, Any]], scales: Scales = DIMENSIONLESS
) -> pd.DataFrame:
    """Return one row an orbit of a branch.

    Parameters
    ----------
    parameter : str
        Heading of its value.
    rows : sequence of mapping
        ``value`` in the units of the device, `ORBIT_COLUMNS` where they apply, and ``v2``, the
        velocities at the crossings of the section, in descending order.
    scales : Scales, optional
    """
    columns = {parameter: np.array([row["value"] for row in rows], dtype=float)}
    return _table({**columns, **_orbit_columns(rows)}, scales)


def special_points(
    parameter: str, rows: Sequence[Mapping[str, Any]], scales: Scales = DIMENSIONLESS
) -> pd.DataFrame:
    """Return one row a special point of a branch; `rows` with ``label`` and ``kind`` as well."""
    columns = {
        "label": [row["label"] for row in rows],
        "kind": [row["kind"] for row in rows],
        parameter: np.array([row["value"] for row in rows], dtype=float),
    }
    return _table({**columns, **_orbit_columns(rows)}, scales)


def curve(
    parameters: Sequence[str], rows: Sequence[Mapping[str, Any]], scales: Scales = DIMENSIONLESS
) -> pd.DataFrame:
    """Return one row an orbit of a curve; `rows` with ``values`` of the two `parameters`."""
    return _table({**_values(parameters, rows), **_orbit_columns(rows)}, scales)


def codimension_two(
    parameters: Sequence[str], rows: Sequence[Mapping[str, Any]], scales: Scales = DIMENSIONLESS
) -> pd.DataFrame:
    """Return one row a point of codimension two; as `curve`, with ``kind``."""
    columns = {"kind": [row["kind"] for row in rows], **_values(parameters, rows)}
    return _table({**columns, **_orbit_columns(rows)}, scales)


def chart(parameters: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Return one row a point of a boundary: boundary, the `parameters`, type, kind."""
    columns = {
        "boundary": [row["boundary"] for row in rows],
        **_values(parameters, rows),
        "type": [row["type"] for row in rows],
        "kind": [row["kind"] for row in rows],
    }
    return pd.DataFrame(columns)


def chart_types(parameter: str, rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Return one row a type: type, grazing, `parameter` from and to, on, off."""
    columns = {
        "type": [row["type"] for row in rows],
        "grazing": [row["grazing"] for row in rows],
        **_values((f"{parameter} from", f"{parameter} to"), rows),
        "on": [row["on"] for row in rows],
        "off": [row["off"] for row in rows],
    }
    return pd.DataFrame(columns)


def chart_points(parameters: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Return one row a point of codimension two: kind and the `parameters`."""
    return pd.DataFrame({"kind": [row["kind"] for row in rows], **_values(parameters, rows)})


def _values(parameters: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {
        name: np.array([row["values"][i] for row in rows], dtype=float)
        for i, name in enumerate(parameters)
    }


def _orbit_columns(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    columns = {
        name: np.array([row[name] for row in rows])
        for name in ORBIT_COLUMNS
        if all(name in row for row in rows)
    }
    most = max((len(row["v2"]) for row in rows), default=1)
    for i in range(max(1, most)):
        values = [row["v2"][i] if i < len(row["v2"]) else np.nan for row in rows]
        columns["v2" if i == 0 else f"v2 {i + 1}"] = np.array(values, dtype=float)
    return columns


def statistics(values: Mapping[str, float], scales: Scales = DIMENSIONLESS) -> pd.Series:
    """Return one number a row, in the order given; underscores in the names become spaces."""
    named = {name.replace("_", " "): value for name, value in values.items()}
    return pd.Series(_in_units(named, scales), dtype=float, name="statistics")


SWEEP_COLUMNS = (
    "impacts per period",
    "blows per period",
    "displacement per period",
    "displacement per impact",
    "mean speed",
)
"""What a sweep says of every value: statistics, as a run has them."""


def sweep(
    parameter: str,
    points: Sequence[Mapping[str, Any]],
    unit: str = "",
    scales: Scales = DIMENSIONLESS,
) -> pd.DataFrame:
    """Return one row a crossing of the section, or one with NaN for a point without any.

    Parameters
    ----------
    parameter : str
        Name of the parameter that was swept.
    points : sequence of mapping
        One for each value, in order: ``value``, ``direction``, ``section`` (period, v2 and v1 of
        the crossings), `SWEEP_COLUMNS` and ``status``; all in the units of the device.
    unit : str, optional
        The SI unit of the parameter.
    scales : Scales, optional
        Of the device, for the headings.
    """
    crossings = [len(point["section"].get("v2", ())) for point in points]
    repeats = [max(1, k) for k in crossings]

    def repeated(name: str) -> NDArray[Any]:
        return np.repeat([point[name] for point in points], repeats)

    def crossing(column: str) -> NDArray[Any]:
        none = np.array([np.nan])
        found = [
            p["section"][column] if k else none for p, k in zip(points, crossings, strict=True)
        ]
        return np.concatenate([*found, none])[:-1]

    columns = {
        scales.label(parameter, unit): repeated("value").astype(float),
        "direction": repeated("direction").astype(str).astype(object),
        "period": crossing("period"),
        scales.label("v2", "m/s"): crossing("v2"),
        scales.label("v1", "m/s"): crossing("v1"),
        **{
            scales.label(name, COLUMN_UNITS.get(name, "")): repeated(name).astype(float)
            for name in SWEEP_COLUMNS
        },
        "status": repeated("status").astype(str).astype(object),
    }
    return pd.DataFrame(columns)


def sweep_summary(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each value of a sweep, in the order in which they were computed.

    Parameters
    ----------
    table : DataFrame
        From `sweep`, or read back from a file: its first column is the parameter.

    Returns
    -------
    DataFrame
        Parameter, direction, status, impacting (impacts in the measured periods; False where the
        point failed), `SWEEP_COLUMNS`, smallest and largest v2 on the section and the number of
        crossings.
    """
    parameter = table.columns[0]
    # A value may stand in the sweep twice: rows belong together as long as nothing changes. A
    # crossing earlier than the one before it begins a new point.
    keys = table[[parameter, "direction"]]
    changed = (keys != keys.shift()).any(axis=1)
    changed |= table["period"] < table["period"].shift()
    groups = table.groupby(changed.cumsum(), sort=False)
    v2 = heading(table, "v2")
    # A file may have been written before there were all of them.
    statistics = [name for name in table.columns if _symbol(name) in SWEEP_COLUMNS]
    summary = groups.agg(
        **{
            parameter: (parameter, "first"),
            "direction": ("direction", "first"),
            "status": ("status", "first"),
            **{name: (name, "first") for name in statistics},
            v2.replace("v2", "v2 min"): (v2, "min"),
            v2.replace("v2", "v2 max"): (v2, "max"),
            "crossings": (v2, "count"),
        }
    ).reset_index(drop=True)
    summary.insert(3, "impacting", summary["impacts per period"] > 0.0)
    return summary


def fit_parameters(
    names: Sequence[str],
    start: Sequence[float],
    fitted: Sequence[float],
    limits: Floats,
    errors: Floats,
    determined: NDArray[np.bool_],
    at_bound: NDArray[np.bool_],
) -> pd.DataFrame:
    """Return one row a free parameter of a fit; `errors` are relative."""
    columns = {
        "parameter": list(names),
        "start": list(start),
        "fitted": list(fitted),
        "low": limits[:, 0],
        "high": limits[:, 1],
        "standard error": np.array(fitted) * errors,
        "determined": determined,
        "at bound": at_bound,
    }
    return pd.DataFrame(columns)


def fit_residuals(
    quantities: Sequence[str],
    drives: Sequence[str],
    measured: Floats,
    computed: Floats,
    tolerances: Floats,
) -> pd.DataFrame:
    """Return one row a target of a fit."""
    columns = {
        "quantity": list(quantities),
        "drive": list(drives),
        "measured": measured,
        "computed": computed,
        "difference": computed - measured,
        "in tolerances": (computed - measured) / tolerances,
    }
    return pd.DataFrame(columns)


def step_lengths(
    period: NDArray[np.int64],
    phase: Floats,
    speed: Floats,
    voltage: Floats,
    simulated: Floats,
    formula: Floats,
    scales: Scales = DIMENSIONLESS,
) -> pd.DataFrame:
    """Return one row an impact: the simulated step beside the formula; all in device units."""
    columns = {
        "period": period,
        "phase": phase,
        scales.label("v2 before", "m/s"): speed,
        scales.label("voltage", "V"): voltage,
        scales.label("step", "m"): simulated,
        scales.label("formula", "m"): formula,
        "ratio": simulated / formula,
    }
    return pd.DataFrame(columns)


def speed(
    parameter: str,
    voltage: Floats,
    impacts_per_period: Floats,
    blows_per_period: Floats,
    displacement_per_period: Floats,
    period: float,
    scales: Scales = DIMENSIONLESS,
) -> pd.DataFrame:
    """Return one row a value of `parameter`, a voltage: steps and mean speed; in device units."""

    def each(number: Floats) -> Floats:
        none = np.full(number.size, np.nan)
        return np.divide(displacement_per_period, number, out=none, where=number > 0.0)

    columns = {
        scales.label(parameter, "V"): voltage,
        "impacts per period": impacts_per_period,
        "blows per period": blows_per_period,
        scales.label("displacement per period", "m"): displacement_per_period,
        scales.label("displacement per impact", "m"): each(impacts_per_period),
        scales.label("displacement per blow", "m"): each(blows_per_period),
        scales.label("mean speed", "m/s"): displacement_per_period / period,
    }
    return pd.DataFrame(columns)


def transitions(rows: Sequence[tuple[str, str, str, int]]) -> pd.DataFrame:
    """Return one row a transition of the automaton: mode, event, mode, and how often seen."""
    return pd.DataFrame(rows, columns=["mode before", "event", "mode after", "seen"])


def displacement(rows: Sequence[tuple[float, float, float, float]]) -> pd.DataFrame:
    """Return one row a voltage of a device in SI: frequency, amplitude, and what it does."""
    columns = [
        "frequency [Hz]",
        "amplitude [V]",
        "displacement per blow [m]",
        "blows per period",
    ]
    return pd.DataFrame(rows, columns=columns)


def checks(rows: Sequence[tuple[float, str, str, float, float, float]]) -> pd.DataFrame:
    """Return one row a boundary of a chart that was checked by brute force."""
    columns = ["omega", "type", "boundary", "chart", "brute force", "steps apart"]
    return pd.DataFrame(rows, columns=columns)


def heading(table: pd.DataFrame, symbol: str) -> str:
    """Return the heading of the column `symbol`, with the unit that it may carry."""
    return next(name for name in table.columns if _symbol(name) == symbol)


def symbols(table: pd.DataFrame) -> pd.DataFrame:
    """Return the same table with symbols alone for headings, whatever the units."""
    return table.rename(columns=_symbol)


def _symbol(name: str) -> str:
    return str(name).partition(" [")[0]


def _table(columns: Mapping[str, Any], scales: Scales) -> pd.DataFrame:
    return pd.DataFrame(_in_units(columns, scales))


def _unnumbered(name: str) -> str:
    """Return the heading of the first of several columns alike: v2 for "v2 3"."""
    first, _, number = name.rpartition(" ")
    return first if number.isdigit() else name


def _in_units(columns: Mapping[str, Any], scales: Scales) -> dict[str, Any]:
    """Return columns as computed in the units of the device, which stand in the headings."""
    if scales is DIMENSIONLESS:
        return dict(columns)
    result = {}
    for name, values in columns.items():
        unit = COLUMN_UNITS.get(_unnumbered(name), "")
        result[scales.label(name, unit)] = scales.out(values, unit) if unit else values
    return result


def _when(cycle: NDArray[np.int64], time: Floats) -> dict[str, Any]:
    return {"period": cycle, "time": time}


def _stopper(impacts: Events) -> Any:
    return _words(["right", "left"], (impacts.guard != RIGHT_IMPACT).astype(np.int64))


def _states(y: Floats) -> dict[str, Any]:
    return {name: y[:, i] for i, name in enumerate(STATES)}


def _words(names: Sequence[str], numbers: NDArray[np.int64]) -> Any:
    # Categories: a mode is one of nine words, a million times.
    return pd.Categorical.from_codes(numbers, categories=list(names))
