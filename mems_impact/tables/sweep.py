"""Tables of sweeps: all that was seen at every value of a parameter, and one row a value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mems_impact.tables.common import Labels, bare, captions, table

__all__ = ["columns_of", "counted", "sweep", "sweep_summary", "switches"]

# Columns of a sweep that are neither the parameter, which comes first, nor states nor statistics.
DIRECTION, PERIOD, NUMBER, STATUS = "direction", "period", "number", "status"


def counted(labels: Labels) -> str:
    """Return the column that tells the crossings at one value apart: periods, or their numbers."""
    return PERIOD if labels.forced else NUMBER


def columns_of(
    parameter: str,
    points: Sequence[Mapping[str, Any]],
    states: Sequence[str],
    statistics: Sequence[str],
    labels: Labels,
) -> dict[str, NDArray[Any]]:
    """Return the columns of `sweep`, one row a crossing of the section.

    The parameters are those of `sweep`.
    """
    count = counted(labels)
    crossings = [len(point["section"].get(count, ())) for point in points]
    repeats = [max(1, k) for k in crossings]

    def repeated(values: Sequence[Any]) -> NDArray[Any]:
        return np.repeat(np.array(values), repeats)

    def crossing(column: str) -> NDArray[Any]:
        none = np.array([np.nan])
        found = [
            p["section"][column] if k else none for p, k in zip(points, crossings, strict=True)
        ]
        return np.concatenate([*found, none])[:-1]

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
    """Return one row a crossing of the section, or one with NaN for a point without any.

    Parameters
    ----------
    parameter : str
        Name of the parameter that was swept.
    points : sequence of mapping
        One for each value, in order: ``value``, ``direction``, ``section`` (what is `counted`, and
        `states`, of the crossings), ``statistics`` by name, and ``status``; in the units of the
        system.
    states, statistics : sequence of str
        What there is a column of.
    labels : Labels
    quantities : mapping of str to tuple, optional
        What figures show beside the states, for ``attrs``: the column and what an axis says.
    """
    columns = columns_of(parameter, points, states, statistics, labels)
    shown = {**captions(labels), "states": list(states)}
    if not labels.forced and labels.section is None:
        shown["maxima"] = True
    told = {name: list(pair) for name, pair in quantities.items()}
    return table({}, labels, given=columns, **shown, quantities=told)


def sweep_summary(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each value of a sweep, in the order in which they were computed.

    Parameters
    ----------
    table : DataFrame
        From `sweep`, or read back from a file: its first column is the parameter.

    Returns
    -------
    DataFrame
        Parameter, direction, status, impacting (impacts in the measured time; False where the
        point failed), the statistics of the sweep, smallest and largest value of the first state
        on the section, and the number of crossings.

    See Also
    --------
    sweep, plot_sweep

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> table = mi.sweep(actuator, drive, "amplitude", [0.2, 0.24], transient=100, periods=10)
    >>> mi.sweep_summary(table)[["amplitude", "impacting"]].values.tolist()
    [[0.2, False], [0.24, True]]
    """
    table = bare(table)
    parameter, count, state = table.columns[0], table.columns[2], table.columns[3]
    # A value may stand in the sweep twice: rows belong together as long as nothing changes. A
    # crossing earlier than the one before it begins a new point.
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
    shown = {name: unit for name, unit in units.items() if name in summary}
    summary.attrs = {**table.attrs, "units": shown}
    return summary


def switches(table: pd.DataFrame) -> list[tuple[str, float, bool]]:
    """Return where each chain first begins or ceases to impact: direction, value, begins.

    Parameters
    ----------
    table : DataFrame
        From `sweep`, or read back from a file. Values that failed are passed over.
    """
    summary = sweep_summary(table)
    summary = summary[summary["status"] == "ok"]
    found = []
    for direction, rows in summary.groupby("direction", sort=False):
        impacting = rows["impacting"].to_numpy()
        changes = (impacting[1:] != impacting[:-1]).nonzero()[0]
        if changes.size:
            row = rows.iloc[changes[0] + 1]
            found.append((str(direction), float(row.iloc[0]), bool(row["impacting"])))
    return found
