"""Kinds of motions in tables of studies: their names, their order, how many there are and where."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING

from mems_impact.analysis.kinds import (
    CHAOTIC,
    FAILED,
    OFF,
    PERIODIC,
    QUASI_PERIODIC,
    RESTING,
    UNSETTLED,
    counted_periods,
)
from mems_impact.studies.study import STATUS
from mems_impact.tables.common import bare

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["MOTION", "PERIOD", "SILENT", "in_order", "map_summary", "motions", "period_of"]

MOTION, PERIOD = "motion", "period"  # columns
SILENT = (OFF, RESTING)  # motions of which there is nothing to measure
_IRREGULAR = (QUASI_PERIODIC, CHAOTIC, UNSETTLED, FAILED)


def motions(table: pd.DataFrame) -> pd.Series:
    """Return the kind of motion in each row: a periodic one with its period, ``"period 2"``."""
    kinds = table[MOTION].astype(str)
    counted = table[PERIOD].astype(int).map(counted_periods)
    return kinds.where((kinds != PERIODIC) | (table[PERIOD] <= 0), counted)


def period_of(motion: str) -> int:
    """Return the period in the name of a kind of motion; 0 if there is none."""
    found = re.match(r"period (\d+)", motion)
    return int(found[1]) if found else 0


def in_order(kinds: Iterable[str]) -> list[str]:
    """Return kinds of motions from the simplest to the last: off, period 1, 2, …, chaotic."""
    known = (*SILENT, PERIODIC, *_IRREGULAR)

    def place(kind: str) -> tuple[int, int, str]:
        period = period_of(kind)
        name = PERIODIC if period else kind
        return known.index(name) if name in known else len(known), period, kind

    return sorted(set(kinds), key=place)


def map_summary(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each kind of motion in a map: how many points, and where they lie.

    Parameters
    ----------
    table : DataFrame
        From `operating_map`, whole or in part, or read back from a file: its first two columns are
        the parameters.

    Returns
    -------
    DataFrame
        Motion ("off", "period 1", "chaotic", …), the number of points, their share of those in the
        table, and the smallest and largest value of each parameter among them.

    See Also
    --------
    operating_map, OperatingMap

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> found = mi.operating_map(
    ...     actuator, mi.Sine(amplitude=0.24, omega=0.5),
    ...     x=("amplitude", [0.2, 0.24]), y=("omega", [0.49, 0.5]),
    ... )
    >>> summary = mi.map_summary(found.table)
    >>> summary[["motion", "points"]].values.tolist()
    [['off', 1], ['period 1', 3]]
    """
    table = bare(table)
    x, y = table.columns[:2]
    groups = table.groupby(motions(table).rename(None))
    ends = {f"{name} {which}": (name, which) for name in (x, y) for which in ("min", "max")}
    summary = groups.agg(points=(STATUS, "size"), **ends)
    summary = summary.reindex(in_order(summary.index)).rename_axis(MOTION).reset_index()
    summary.insert(2, "share", summary["points"] / len(table))
    units = table.attrs.get("units", {})
    told = {name: units[source] for name, (source, _) in ends.items() if source in units}
    summary.attrs = {**table.attrs, "units": told}
    return summary
