"""A census of attractors: their names, their shares of the points, and where they return."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import binomtest

from mems_impact.analysis import attractor
from mems_impact.analysis.attractor import Case
from mems_impact.analysis.state import State, state_from
from mems_impact.analysis.system import System
from mems_impact.studies.measuring import MOTION, PERIOD, RETURNS, Measuring
from mems_impact.studies.recognition import LEFT, MODE
from mems_impact.studies.starts import Grid, Starts
from mems_impact.studies.study import STATUS

__all__ = ["ATTRACTOR", "FAILED", "LEVEL", "returns", "state_of", "taken"]

ATTRACTOR = "attractor"
FAILED = attractor.FAILED
LEVEL = 0.95  # of the intervals of shares


def taken(
    table: pd.DataFrame, labels: NDArray[np.int64], starts: Starts
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the table of all points with the names of their attractors, and that of attractors.

    Parameters
    ----------
    table : DataFrame
    labels : array of int
        Of each point, as `Recognition` tells them.
    starts : Starts
        Bounds of shares depend on whether they are a grid.
    """
    known, firsts, counts = np.unique(labels, return_index=True, return_counts=True)
    order = [i for i in np.lexsort((firsts, -counts)) if known[i] >= 0]
    rows = table.iloc[firsts[order]].reset_index(drop=True)
    names = _names([_kind(motion, period) for motion, period in rows[[MOTION, PERIOD]].to_numpy()])
    bounds = [_bounds(labels == known[i], starts) for i in order]
    told = {
        ATTRACTOR: np.array(names, dtype=object),
        MOTION: rows[MOTION],
        PERIOD: rows[PERIOD],
        "points": counts[order],
        "share": counts[order] / max(1, len(table)),
        "low": np.array([low for low, _ in bounds]),
        "high": np.array([high for _, high in bounds]),
    }
    left = [n for n in rows if n not in (*told, *starts.names, RETURNS, STATUS)]
    attractors = pd.DataFrame({**told, **{name: rows[name] for name in left}})
    by_label = dict(zip(known[order].tolist(), names, strict=True))
    named = table.copy(deep=False)
    column = np.array([by_label.get(label, FAILED) for label in labels.tolist()], dtype=object)
    named.insert(len(starts.names), ATTRACTOR, column)
    named.attrs = attractors.attrs = dict(table.attrs)
    return named, attractors


def state_of(system: System, row: Any) -> State:
    """Return where the motion of a row was left."""
    components = {name: float(row[f"{name} {LEFT}"]) for name in system.states}
    return state_from(components, float(row[f"time {LEFT}"]), row[MODE] or None)


def returns(attractors: pd.DataFrame, measuring: Measuring) -> pd.DataFrame:
    """Return the states at the returns of each attractor, from where it was left.

    Of one that does not repeat itself as many as are measured of it.
    """
    system, settle = measuring.system, measuring.settle
    longest = max(settle.longest, int(settle.periods))
    further = replace(measuring, settle=replace(settle, longest=longest))
    found = further.follow(
        [Case(system, state_of(system, row)) for _, row in attractors.iterrows()]
    )
    seen = [
        np.empty((0, len(system.states))) if one.states is None else one.states for one in found
    ]
    names = np.repeat(attractors[ATTRACTOR].to_numpy(), [len(states) for states in seen])
    values = np.concatenate([np.empty((0, len(system.states))), *seen])
    table = pd.DataFrame({ATTRACTOR: names.astype(object), **dict(zip(system.states, values.T))})
    table.attrs = dict(attractors.attrs)
    return table


def _kind(motion: str, period: int) -> str:
    if motion == attractor.PERIODIC:
        return f"period {period}"
    return f"{motion}, period {period}" if motion == attractor.OFF and period > 1 else motion


def _names(kinds: list[str]) -> list[str]:
    """Return a name for each of some attractors: its kind, and a letter where there are several."""
    names, seen = [], dict.fromkeys(kinds, 0)
    for kind in kinds:
        names.append(kind if kinds.count(kind) == 1 else f"{kind} {_letters(seen[kind])}")
        seen[kind] += 1
    return names


def _letters(number: int) -> str:
    """Return a, b, …, z, aa, ab, …"""
    before, letter = divmod(number, 26)
    return (_letters(before - 1) if before else "") + chr(ord("a") + letter)


def _bounds(own: NDArray[np.bool_], starts: Starts) -> tuple[float, float]:
    """Return between what the share of an attractor lies; see `basins`."""
    if not isinstance(starts, Grid):
        interval = binomtest(int(own.sum()), len(own)).proportion_ci(LEVEL, method="wilson")
        return float(interval.low), float(interval.high)
    cells = own.reshape(starts.shape)
    inner, outer = cells.copy(), cells.copy()
    for place in range(cells.ndim):
        ahead = tuple(slice(1, None) if i == place else slice(None) for i in range(cells.ndim))
        behind = tuple(slice(None, -1) if i == place else slice(None) for i in range(cells.ndim))
        for here, there in ((ahead, behind), (behind, ahead)):
            inner[here] &= cells[there]
            outer[here] |= cells[there]
    return float(inner.mean()), float(outer.mean())
