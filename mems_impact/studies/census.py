"""A census of attractors: their names, their shares of the points, and where they return."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mems_impact.analysis.attractor import Attractor, Case
from mems_impact.analysis.kinds import (
    CHAOTIC,
    FAILED,
    OFF,
    PERIODIC,
    QUASI_PERIODIC,
    UNSETTLED,
    counted_periods,
)
from mems_impact.analysis.state import State, state_from
from mems_impact.analysis.system import System
from mems_impact.studies.measuring import ERROR, EXPONENT, MOTION, PERIOD, RETURNS, Measuring
from mems_impact.studies.motions import motions
from mems_impact.studies.recognition import LEFT, MODE, Recognition
from mems_impact.studies.sampling import wilson
from mems_impact.studies.starts import Grid, Starts
from mems_impact.studies.study import STATUS

__all__ = [
    "ATTRACTOR",
    "bounds_of",
    "followed",
    "lettered",
    "recognised",
    "representatives",
    "returns",
    "seen",
    "state_of",
    "taken",
]

ATTRACTOR = "attractor"
FEW = 0.01  # of all points: attractors of fewer are looked at again


class Seen(NamedTuple):
    """What is told of points before all are done: as of `Basins`."""

    table: pd.DataFrame
    attractors: pd.DataFrame
    returns: pd.DataFrame


def representatives(table: pd.DataFrame, labels: NDArray[np.int64]) -> pd.DataFrame:
    """Return the row of the first point of each attractor, that of the most points first."""
    known, firsts, counts = np.unique(labels, return_index=True, return_counts=True)
    order = np.lexsort((firsts, -counts))
    return table.iloc[firsts[order[known[order] >= 0]]]


def recognised(
    table: pd.DataFrame, names: Sequence[str], rules: Recognition, measuring: Measuring
) -> NDArray[np.int64]:
    """Return a number for each point, the same for the same attractor; -1 if it has failed.

    A start that lies near enough to the stable manifold of a saddle stays there for as long as it
    is followed. So periodic motions that few points come to are followed once more, from beside
    them: those that lead elsewhere attract nothing, and their points count as where they lead.

    Parameters
    ----------
    table : DataFrame
    names : sequence of str
        The components in which starts differ.
    rules : Recognition
    measuring : Measuring
    """
    system, count = measuring.system, len(table)
    columns = {name: table[name].to_numpy() for name in table}
    starts = {name: columns[name] for name in names}
    labels = rules.labels(columns, starts)
    rows = representatives(table, labels)
    few = np.array([(labels == labels[i]).sum() <= max(1.0, FEW * count) for i in rows.index])
    rows = rows[few & rows[MOTION].isin([PERIODIC, OFF]).to_numpy()]
    beside = [Case(system, rules.nudged(state_of(system, row))) for _, row in rows.iterrows()]
    if not beside:
        return labels
    found = measuring.follow(beside)
    more = {**measuring.columns(found), **rules.columns(found)}
    both = rules.labels(
        {name: np.concatenate([columns[name], values]) for name, values in more.items()}, starts
    )
    labels, led = both[:count], both[count:]
    known = set(labels.tolist()) - {-1}
    for i, label in zip(rows.index, led.tolist(), strict=True):
        if label in known:
            labels[labels == labels[i]] = label
    return labels


def followed(rows: pd.DataFrame, measuring: Measuring) -> list[Attractor]:
    """Return the motions that go on from where those of rows were left.

    With the states at as many returns as are measured, of those that do not repeat themselves.
    """
    settle = measuring.settle
    longest = max(settle.longest, int(settle.periods))
    further = replace(measuring, settle=replace(settle, longest=longest))
    system = measuring.system
    return further.follow([Case(system, state_of(system, row)) for _, row in rows.iterrows()])


def taken(
    table: pd.DataFrame,
    labels: NDArray[np.int64],
    found: Sequence[Attractor],
    starts: Starts,
    longest: int,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the table of all points with the names of their attractors, and that of attractors.

    Parameters
    ----------
    table : DataFrame
    labels : array of int
        Of each point, as `Recognition` tells them.
    found : sequence of Attractor
        As `followed` returns them of the `representatives`.
    starts : Starts
        Bounds of shares depend on whether they are a grid.
    longest : int
        Returns after which motions were looked at for whether they repeat themselves.
    """
    rows = representatives(table, labels)
    own = labels[rows.index]
    kinds = [
        _told_later(one, longest) if motion == UNSETTLED else (motion, period)
        for motion, period, one in zip(rows[MOTION], rows[PERIOD], found, strict=True)
    ]
    names = lettered([_kind(*each) for each in kinds])
    members = [labels == label for label in own]
    bounds = [bounds_of(each, starts) for each in members]
    told = {
        ATTRACTOR: np.array(names, dtype=object),
        MOTION: np.array([motion for motion, _ in kinds], dtype=object),
        PERIOD: np.array([period for _, period in kinds], dtype=np.int64),
        "points": np.array([each.sum() for each in members], dtype=np.int64),
        "share": np.array([each.mean() for each in members]),
        "low": np.array([low for low, _ in bounds]),
        "high": np.array([high for _, high in bounds]),
        EXPONENT: np.array([one.exponent for one in found]),
        ERROR: np.array([one.error for one in found]),
    }
    more = [name for name in rows if name not in (*told, *starts.names, RETURNS, STATUS)]
    attractors = pd.DataFrame({**told, **{name: rows[name].to_numpy() for name in more}})
    named = table.copy(deep=False)
    column = np.full(len(table), FAILED, dtype=object)
    for name, each in zip(names, members, strict=True):
        column[each] = name
    named.insert(len(starts.names), ATTRACTOR, column)
    named.attrs, attractors.attrs = dict(table.attrs), dict(table.attrs)
    return named, attractors


def seen(table: pd.DataFrame) -> Seen:
    """Return what some of the points come to: kinds of motions, in place of attractors.

    Those of one kind are told apart over all points, and none of them is followed again.

    Parameters
    ----------
    table : DataFrame
        Of the points that are done.
    """
    kinds = motions(table)
    counts = kinds[kinds != FAILED].value_counts()
    told = {ATTRACTOR: counts.index.to_numpy(dtype=object), "points": counts.to_numpy()}
    attractors = pd.DataFrame({**told, "share": told["points"] / max(1, len(table))})
    named = table.assign(**{ATTRACTOR: kinds})
    named.attrs = dict(table.attrs)
    return Seen(named, attractors, pd.DataFrame({ATTRACTOR: []}))


def state_of(system: System, row: Any) -> State:
    """Return where the motion of a row was left."""
    components = {name: float(row[f"{name} {LEFT}"]) for name in system.states}
    return state_from(components, float(row[f"time {LEFT}"]), row[MODE] or None)


def returns(attractors: pd.DataFrame, found: Sequence[Attractor], system: System) -> pd.DataFrame:
    """Return the table of the states at the returns of attractors."""
    none = np.empty((0, len(system.states)))
    seen = [none if one.states is None else one.states for one in found]
    names = np.repeat(attractors[ATTRACTOR].to_numpy(), [len(states) for states in seen])
    columns = dict(zip(system.states, np.concatenate([none, *seen]).T, strict=True))
    table = pd.DataFrame({ATTRACTOR: names.astype(object), **columns})
    table.attrs = dict(attractors.attrs)
    return table


def _told_later(found: Attractor, longest: int) -> tuple[str, int]:
    """Return motion and period of an attractor that was unsettled as it was reached.

    One that repeats itself as soon as others was on its way to them.
    """
    if found.motion in (CHAOTIC, QUASI_PERIODIC) or found.period > longest:
        return found.motion, found.period
    return UNSETTLED, 0


def _kind(motion: str, period: int) -> str:
    if motion == PERIODIC:
        return counted_periods(period)
    return f"{motion}, {counted_periods(period)}" if motion == OFF and period > 1 else motion


def lettered(kinds: list[str]) -> list[str]:
    """Return a name for each of some attractors: its kind, and a letter where there are several."""
    names, seen = [], dict.fromkeys(kinds, 0)
    for kind in kinds:
        names.append(kind if kinds.count(kind) == 1 else f"{kind} {_letters(seen[kind])}")
        seen[kind] += 1
    return names


def _letters(number: int) -> str:
    """Return the letters of a number: a, b, …, z, aa, ab."""
    before, letter = divmod(number, 26)
    return (_letters(before - 1) if before else "") + chr(ord("a") + letter)


def bounds_of(own: NDArray[np.bool_], starts: Starts) -> tuple[float, float]:
    """Return between what the share of an attractor lies; see `basins`."""
    if not isinstance(starts, Grid):
        return wilson(int(own.sum()), len(own))
    cells = own.reshape(starts.shape)
    inner, outer = cells.copy(), cells.copy()
    for place in range(cells.ndim):
        ahead = tuple(slice(1, None) if i == place else slice(None) for i in range(cells.ndim))
        behind = tuple(slice(None, -1) if i == place else slice(None) for i in range(cells.ndim))
        for here, there in ((ahead, behind), (behind, ahead)):
            inner[here] &= cells[there]
            outer[here] |= cells[there]
    return float(inner.mean()), float(outer.mean())
