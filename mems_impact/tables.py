"""Every table of the package: one function each, from columns of numbers to a pandas DataFrame.

Headings are the symbols of the paper and plain words. Times and phases that stand beside a
``period`` count from the start of that forcing period; ``t`` counts from the start of period 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mems_impact.actuator.modes import GUARDS, MODES, RIGHT_IMPACT, STATES, V1, V2, X1
from mems_impact.hybrid import loop
from mems_impact.hybrid.trajectory import Events, Floats, Samples

__all__ = ["events", "impacts", "samples", "section", "statistics", "sweep", "sweep_summary"]

CHATTER_ENDS = "chatter ends"
DRIVE_SWITCHES = "drive switches"


def impacts(rows: Events, steps: Floats, energy: Floats, period: float) -> pd.DataFrame:
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
    """
    columns = {
        **_when(rows.cycle, rows.time),
        "phase": rows.time / period,
        "stopper": _words(["right", "left"], (rows.guard != RIGHT_IMPACT).astype(np.int64)),
        "v1 before": rows.before[:, V1],
        "v1 after": rows.after[:, V1],
        "v2 before": rows.before[:, V2],
        "v2 after": rows.after[:, V2],
        "energy lost": energy,
        "x1": rows.after[:, X1],
        "step": steps,
    }
    return _table(columns)


def events(log: Events) -> pd.DataFrame:
    """Return one row a transition: what happened, the modes before and after, the state after."""
    shown = np.isin(log.kind, (loop.TRANSITION, loop.ACCUMULATION, loop.SWITCH))
    log = log[shown]
    names = [*(guard.name for guard in GUARDS), CHATTER_ENDS, DRIVE_SWITCHES]
    name = np.where(log.kind == loop.ACCUMULATION, len(GUARDS), log.guard)
    name = np.where(log.kind == loop.SWITCH, len(GUARDS) + 1, name)
    columns = {
        **_when(log.cycle, log.time),
        "event": _words(names, name),
        "mode before": _words(MODES, log.mode_before),
        "mode after": _words(MODES, log.mode_after),
        **_states(log.after),
    }
    return _table(columns)


def section(log: Events, direction: int) -> pd.DataFrame:
    """Return one row a crossing of the Poincaré section x2 = 0.

    Parameters
    ----------
    log : Events
    direction : {-1, 0, 1}
        Crossings with v2 < 0, both, or v2 > 0.
    """
    log = crossings(log, direction)
    columns = {
        **_when(log.cycle, log.time),
        "v2": log.after[:, V2],
        "v1": log.after[:, V1],
        "x1": log.after[:, X1],
        "direction": log.guard,
    }
    return _table(columns)


def crossings(log: Events, direction: int) -> Events:
    """Return the rows that are crossings of the section in `direction` (0: both)."""
    wanted = log.kind == loop.SECTION_CROSSING
    if direction != 0:
        wanted &= log.guard == direction
    return log[wanted]


def samples(grid: Samples, period: float) -> pd.DataFrame:
    """Return one row a sample."""
    columns = {
        **_when(grid.cycle, grid.time),
        "t": grid.cycle * period + grid.time,
        **_states(grid.y),
        "mode": _words(MODES, grid.mode),
    }
    return _table(columns)


def statistics(values: Mapping[str, float]) -> pd.Series:
    """Return one number a row, in the order given; underscores in the names become spaces."""
    names = [name.replace("_", " ") for name in values]
    return pd.Series(list(values.values()), index=names, dtype=float, name="statistics")


def sweep(parameter: str, points: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Return one row a crossing of the section, or one with NaN for a point without any.

    Parameters
    ----------
    parameter : str
        Name of the parameter that was swept.
    points : sequence of mapping
        One for each value, in order: ``value``, ``direction``, ``section`` (Events of crossings),
        ``impacts per period``, ``displacement per period`` and ``status``.
    """
    repeats = [max(1, len(point["section"])) for point in points]

    def repeated(name: str) -> NDArray[Any]:
        return np.repeat([point[name] for point in points], repeats)

    def crossing(column: Any) -> NDArray[Any]:
        none = np.array([np.nan])
        found = [column(p["section"]) if len(p["section"]) else none for p in points]
        return np.concatenate([*found, none])[:-1]

    columns = {
        parameter: repeated("value").astype(float),
        "direction": repeated("direction").astype(str).astype(object),
        "period": crossing(lambda rows: rows.cycle.astype(float)),
        "v2": crossing(lambda rows: rows.after[:, V2]),
        "v1": crossing(lambda rows: rows.after[:, V1]),
        "impacts per period": repeated("impacts per period").astype(float),
        "displacement per period": repeated("displacement per period").astype(float),
        "status": repeated("status").astype(str).astype(object),
    }
    return _table(columns)


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
        point failed), impacts and displacement per period, smallest and largest v2 on the section
        and the number of crossings.
    """
    parameter = table.columns[0]
    # A value may stand in the sweep twice: rows belong together as long as nothing changes. A
    # crossing earlier than the one before it begins a new point.
    keys = table[[parameter, "direction"]]
    changed = (keys != keys.shift()).any(axis=1)
    changed |= table["period"] < table["period"].shift()
    groups = table.groupby(changed.cumsum(), sort=False)
    summary = groups.agg(
        **{
            parameter: (parameter, "first"),
            "direction": ("direction", "first"),
            "status": ("status", "first"),
            "impacts per period": ("impacts per period", "first"),
            "displacement per period": ("displacement per period", "first"),
            "v2 min": ("v2", "min"),
            "v2 max": ("v2", "max"),
            "crossings": ("v2", "count"),
        }
    ).reset_index(drop=True)
    summary.insert(3, "impacting", summary["impacts per period"] > 0.0)
    return summary


def _table(columns: Mapping[str, Any]) -> pd.DataFrame:
    # All tables pass here: the place for units in headings, once devices carry them.
    return pd.DataFrame(columns)


def _when(cycle: NDArray[np.int64], time: Floats) -> dict[str, Any]:
    return {"period": cycle, "time": time}


def _states(y: Floats) -> dict[str, Any]:
    return {name: y[:, i] for i, name in enumerate(STATES)}


def _words(names: Sequence[str], numbers: NDArray[np.int64]) -> Any:
    # Categories: a mode is one of nine words, a million times.
    return pd.Categorical.from_codes(numbers, categories=list(names))
