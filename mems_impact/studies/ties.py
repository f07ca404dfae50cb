"""Which stretches of attractors, followed over a parameter, are of one branch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mems_impact.studies.census import ATTRACTOR, bounds_of, lettered
from mems_impact.studies.motions import motions
from mems_impact.studies.recognition import Recognition
from mems_impact.studies.starts import Starts
from mems_impact.studies.study import OK, STATUS

__all__ = ["FOLLOWS", "count_in", "tied"]

Integers = NDArray[np.int64]
FOLLOWS = "follows"  # whether the motion, led back by one value, is what it was


def tied(
    rows: pd.DataFrame, chains: Sequence[range], rules: Recognition
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the table of branches at the values, and that of the branches.

    Parameters
    ----------
    rows : DataFrame
        Of all chains, as they were followed: the parameter first.
    chains : sequence of range
    rules : Recognition
    """
    parameter = str(rows.columns[0])
    stretch, origins, jumps = _stretches(rows, chains)
    branch = _joined(rows, stretch, set(origins), rules)[stretch]
    names = _names(rows, branch, origins, parameter)
    fine = (rows[STATUS] == OK).to_numpy()
    table = rows.assign(**{ATTRACTOR: [names[b] for b in branch]})[fine].drop(columns=FOLLOWS)
    table = table.drop_duplicates([ATTRACTOR, parameter]).sort_values(
        [ATTRACTOR, parameter], key=lambda column: _order(column, list(names.values()))
    )
    table = table.reset_index(drop=True)
    table.attrs = dict(rows.attrs)
    ends: dict[tuple[str, int], str] = {}
    for before, after, way in jumps:
        ends.setdefault((names[branch[before]], way), names[branch[after]])
    return table, _summary(table, ends, parameter)


def count_in(
    table: pd.DataFrame,
    value: float,
    points: pd.DataFrame,
    starts: Starts,
    rules: Recognition,
) -> None:
    """Put into a table of branches the share of the points that come to each at one value."""
    here = table.index[table.iloc[:, 0] == value]
    columns = {
        name: np.concatenate([points[name].to_numpy(), table.loc[here, name].to_numpy()])
        for name in points
        if name in table
    }
    labels = rules.labels(columns, {name: points[name].to_numpy() for name in starts.names})
    count = len(points)
    for row, label in zip(here, labels[count:].tolist(), strict=True):
        own = labels[:count] == label
        table.loc[row, ["share", "low", "high"]] = [own.mean(), *bounds_of(own, starts)]


def _stretches(
    rows: pd.DataFrame, chains: Sequence[range]
) -> tuple[Integers, dict[int, str], list[tuple[int, int, int]]]:
    """Return the stretch of each row, whose stretches attractors begin with, and all jumps.

    The two chains of one attractor begin with one stretch. A jump is the row before, that after,
    and the way, 1 or -1.
    """
    follows, failed = rows[FOLLOWS].to_numpy(), (rows[STATUS] != OK).to_numpy()
    names, values = rows[ATTRACTOR].to_numpy(), rows.iloc[:, 0].to_numpy()
    stretch: Integers = np.empty(len(rows), dtype=np.int64)
    first: dict[str, int] = {}
    jumps: list[tuple[int, int, int]] = []
    count = 0
    for chain in chains:
        name = names[chain.start]
        if name not in first:
            first[name], count = count, count + 1
        here, last = first[name], None
        for i in chain:
            if not failed[i] and not follows[i]:
                here, count = count, count + 1
                if last is not None:
                    jumps.append((last, i, 1 if values[i] > values[last] else -1))
            stretch[i] = here
            last = last if failed[i] else i
    return stretch, {number: name for name, number in first.items()}, jumps


def _joined(rows: pd.DataFrame, stretch: Integers, begun: set[int], rules: Recognition) -> Integers:
    """Return the branch of each stretch: those that are the same at some value are one.

    Those that attractors begin with are not, as these were told apart.
    """
    own: Integers = np.arange(max(stretch.max(), *begun) + 1)
    for _, group in rows.groupby(rows.columns[0]):
        labels = rules.labels({name: group[name].to_numpy() for name in group}, {})
        for label in sorted(set(labels.tolist()) - {-1}):
            same = {int(number) for number in own[stretch[group.index[labels == label]]]}
            one, *others = sorted(same, key=lambda number: (number not in begun, number))
            for other in others:
                if other not in begun:
                    own[own == other] = one
    return own


def _names(
    rows: pd.DataFrame, branch: Integers, origins: dict[int, str], parameter: str
) -> dict[int, str]:
    """Return names of branches: those of attractors, or where another was seen first."""
    kinds, names = motions(rows), {}
    for number in dict.fromkeys(branch.tolist()):
        i = int(np.flatnonzero(branch == number)[0])
        seen = f"{kinds.iloc[i]} at {parameter} = {rows.iloc[i, 0]:g}"
        names[number] = origins.get(number, seen)
    return dict(zip(names, lettered(list(names.values())), strict=True))


def _order(column: pd.Series, names: list[str]) -> pd.Series:
    return column.map(names.index) if column.name == ATTRACTOR else column


def _summary(table: pd.DataFrame, ends: dict[tuple[str, int], str], parameter: str) -> pd.DataFrame:
    kinds = motions(table)
    found = []
    for name, rows in table.groupby(ATTRACTOR, sort=False):
        told = dict.fromkeys(kinds[rows.index])
        values = rows[parameter]
        before, after = ends.get((name, -1), ""), ends.get((name, 1), "")
        found.append((name, values.min(), values.max(), ", ".join(told), before, after))
    columns = [ATTRACTOR, f"{parameter} min", f"{parameter} max", "motion", "before", "after"]
    result = pd.DataFrame(found, columns=columns)
    unit = table.attrs.get("units", {}).get(parameter, "")
    units = dict.fromkeys(columns[1:3], unit) if unit else {}
    result.attrs = {**table.attrs, "units": units}
    return result
