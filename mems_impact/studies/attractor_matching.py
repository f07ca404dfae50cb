"""Matching of attractors: the points that share an attractor, and its name.

The features of a motion are the mean, smallest and largest value of each component at its returns,
which do not depend on the last return. Cyclic components are ignored. The result does not depend on
the order of points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mems_impact._util.arrays import Floats
from mems_impact.analysis.attractor import Attractor, InitialCondition
from mems_impact.integrators.options import Options
from mems_impact.studies.attractor_study import (
    ERROR,
    EXPONENT,
    MOTION,
    PERIOD,
    RETURNS,
    AttractorEvaluator,
    motions,
)
from mems_impact.studies.engine.study import STATUS, Columns
from mems_impact.studies.sampling import Grid, InitialConditions, wilson
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.state import State, state_from
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
from mems_impact.tables import texts

# --- Matching of attractors by their returns

KEPT_REDUCTIONS = ("mean", "min", "max")
FINAL_SUFFIX = "final"  # suffix of the columns of final states
MODE = f"mode {FINAL_SUFFIX}"
Integers = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class AttractorMatcher:
    """Features of motions, and their matching."""

    system: HybridSystem
    options: Options  # ``atol / rtol`` is the smallest size that the numerics resolve
    distance: float  # within which two motions are the same, relative to the size of each component

    @property
    def names(self) -> tuple[str, ...]:
        """The compared components."""
        return self.system.state_space.free

    @property
    def schema(self) -> dict[str, str]:
        """The columns of the features."""
        reductions = [f"{name} {what}" for name in self.names for what in KEPT_REDUCTIONS]
        final = [f"{name} {FINAL_SUFFIX}" for name in (*self.system.states, "time")]
        return {**dict.fromkeys([*reductions, *final], "float"), MODE: "str"}

    def columns(self, attractors: Sequence[Attractor]) -> Columns:
        """Return the columns of `schema`."""
        rows = np.array([self._row(each) for each in attractors])
        columns: Columns = dict(zip(self.schema, rows.T, strict=False))
        modes = ["" if each.final is None else str(each.final.mode or "") for each in attractors]
        columns[MODE] = np.array(modes, dtype=object)
        return columns

    def perturbed(self, state: State) -> State:
        """Return a state a tenth of the distance away in each component."""
        least_size = self.options.atol / self.options.rtol
        sizes = {
            name: max(abs(state[name]), float(self.system.units.out(name, least_size)))
            for name in self.names
        }
        off = {name: state[name] + 0.1 * self.distance * size for name, size in sizes.items()}
        return state.replace(**off)

    def labels(self, columns: Columns, starts: Columns) -> Integers:
        """Return a number for each motion, the same for the same attractor; -1 if it has failed.

        Periodic and resting motions are the same if their kinds and periods agree and their
        features are linked by steps within the distance. Unsettled motions are the same if the
        boxes around their returns intersect. `columns` has features, motions and periods; large
        initial values in `starts` limit the resolution of a component.
        """
        kind = columns[MOTION]
        labels: Integers = np.full(len(kind), -1, dtype=np.int64)
        at_rest = np.where(kind == RESTING, columns[MODE], "")
        kinds = sorted(set(zip(kind, columns[PERIOD].tolist(), at_rest, strict=True)))
        size = self._sizes(columns, starts)
        for motion, period, mode in kinds:
            if motion == FAILED:
                continue
            selected = (kind == motion) & (columns[PERIOD] == period) & (at_rest == mode)
            reductions = {
                what: np.stack([columns[f"{name} {what}"][selected] for name in self.names], axis=1)
                for what in KEPT_REDUCTIONS
            }
            if motion == UNSETTLED:
                groups = _intersecting_groups(reductions["min"], reductions["max"])
            else:
                groups = _neighbour_groups(
                    np.hstack(list(reductions.values())) / np.tile(size, len(KEPT_REDUCTIONS))
                )
            labels[selected] = groups + labels.max() + 1
        return labels

    def _sizes(self, columns: Columns, starts: Columns) -> Floats:
        """Return the distance in each component, in its unit."""
        least_size = self.options.atol / self.options.rtol
        sizes = [float(self.system.units.out(name, least_size)) for name in self.names]
        for i, name in enumerate(self.names):
            values = [columns[f"{name} min"], columns[f"{name} max"], starts.get(name, np.empty(0))]
            magnitudes = np.abs(np.concatenate(values))
            sizes[i] = max(sizes[i], np.max(magnitudes, initial=0.0, where=~np.isnan(magnitudes)))
        return self.distance * np.array(sizes)

    def _row(self, attractor: Attractor) -> list[float]:
        count = len(self.schema) - 1
        if attractor.states is None or attractor.final is None:
            return [np.nan] * count
        indices = [self.system.states.index(name) for name in self.names]
        states = attractor.states[:, indices]
        if not len(states):  # at rest before the first return
            states = np.array([[attractor.final[name] for name in self.names]])
        reductions = np.stack([states.mean(axis=0), states.min(axis=0), states.max(axis=0)], axis=1)
        final = attractor.final
        return [*reductions.ravel(), *(final[name] for name in self.system.states), final.time]


def _neighbour_groups(positions: Floats) -> Integers:
    """Return groups of points linked by neighbouring cells of a grid."""
    cells, cell_of_row = _distinct_rows(np.rint(positions))
    pairs = cKDTree(cells).query_pairs(1.5, p=np.inf, output_type="ndarray")
    ones = np.ones(len(pairs))
    graph = coo_array((ones, (pairs[:, 0], pairs[:, 1])), shape=(len(cells), len(cells)))
    _, groups = connected_components(graph, directed=False)
    return np.asarray(groups[cell_of_row], dtype=np.int64)


def _distinct_rows(rows: Floats) -> tuple[Floats, Integers]:
    """Return the distinct rows in ascending order, and the number of each row among these.

    `numpy.unique` of rows raises TypeError where Ctrl-C interrupts it.
    """
    order = np.lexsort(rows.T[::-1])
    ordered = rows[order]
    starts = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(axis=1)])
    numbers: Integers = np.empty(len(rows), dtype=np.int64)
    numbers[order] = np.cumsum(starts) - 1
    return ordered[starts], numbers


def _intersecting_groups(low: Floats, high: Floats) -> Integers:
    """Return the finest groups of boxes with disjoint hulls."""
    hulls: list[tuple[Floats, Floats]] = []
    for below, above in zip(low, high, strict=True):
        grown = True
        while grown:  # a larger hull may intersect others
            met_hulls = [hull for hull in hulls if ((hull[0] <= above) & (below <= hull[1])).all()]
            hulls = [hull for hull in hulls if not any(hull is other for other in met_hulls)]
            below = np.min([below, *(hull[0] for hull in met_hulls)], axis=0)
            above = np.max([above, *(hull[1] for hull in met_hulls)], axis=0)
            grown = bool(met_hulls)
        hulls.append((below, above))
    labels: Integers = np.empty(len(low), dtype=np.int64)
    for number, (below, above) in enumerate(hulls):
        labels[((below <= low) & (high <= above)).all(axis=1)] = number
    return labels


# --- Table of attractors

ATTRACTOR = "attractor"
RARE_SHARE = 0.01  # share of points below which an attractor is verified


class PartialBasins(NamedTuple):
    """Partial result of `Basins`."""

    table: pd.DataFrame
    attractors: pd.DataFrame
    returns: pd.DataFrame


def representatives(table: pd.DataFrame, labels: NDArray[np.int64]) -> pd.DataFrame:
    """Return the row of the first point of each attractor, in descending order of points."""
    distinct, firsts, counts = np.unique(labels, return_index=True, return_counts=True)
    order = np.lexsort((firsts, -counts))
    return table.iloc[firsts[order[distinct[order] >= 0]]]


def match_attractors(
    table: pd.DataFrame,
    names: Sequence[str],
    rules: AttractorMatcher,
    measuring: AttractorEvaluator,
) -> NDArray[np.int64]:
    """Return a number for each point, the same for the same attractor; -1 if it has failed.

    Initial states differ in the components `names`. A motion that starts close enough to the stable
    manifold of a saddle stays near the saddle for the whole run. Periodic motions that few points
    reach are therefore simulated again from perturbed states: if these reach another attractor, the
    motion is not an attractor, and its points are assigned to that one.
    """
    system, count = measuring.system, len(table)
    columns = {name: table[name].to_numpy() for name in table}
    starts = {name: columns[name] for name in names}
    labels = rules.labels(columns, starts)
    rows = representatives(table, labels)
    few = [bool((labels == labels[i]).sum() <= max(1.0, RARE_SHARE * count)) for i in rows.index]
    rows = rows[rows[MOTION].isin([PERIODIC, OFF]) & np.array(few, dtype=bool)]
    perturbed = [
        InitialCondition(system, rules.perturbed(state_of(system, row)))
        for _, row in rows.iterrows()
    ]
    if not perturbed:
        return labels
    attractors = measuring.follow(perturbed)
    more = {**measuring.columns(attractors), **rules.columns(attractors)}
    labels_of_both = rules.labels(
        {name: np.concatenate([columns[name], values]) for name, values in more.items()}, starts
    )
    labels, led = labels_of_both[:count], labels_of_both[count:]
    known_labels = set(labels.tolist()) - {-1}
    for i, label in zip(rows.index, led.tolist(), strict=True):
        if label in known_labels:
            labels[labels == labels[i]] = label
    return labels


def continued_motions(rows: pd.DataFrame, measuring: AttractorEvaluator) -> list[Attractor]:
    """Return the motions of rows, continued from their final states.

    Those that are not periodic have the states at all evaluated returns.
    """
    recurrence = measuring.recurrence
    longest = max(recurrence.longest, int(recurrence.periods))
    further = replace(measuring, recurrence=replace(recurrence, longest=longest))
    system = measuring.system
    return further.follow(
        [InitialCondition(system, state_of(system, row)) for _, row in rows.iterrows()]
    )


def label_points(
    table: pd.DataFrame,
    labels: NDArray[np.int64],
    motions: Sequence[Attractor],
    starts: InitialConditions,
    longest: int,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the table of points, with the names of their attractors, and of attractors.

    `labels` are from `AttractorMatcher.labels`, `motions` from `continued_motions` for the
    `representatives`. The bounds of shares depend on whether `starts` are a grid; `longest` is the
    largest detectable number of returns of a periodic motion.
    """
    rows = representatives(table, labels)
    distinct = labels[rows.index]
    kinds = [
        _late_recurrence(one, longest) if motion == UNSETTLED else (motion, period)
        for motion, period, one in zip(rows[MOTION], rows[PERIOD], motions, strict=True)
    ]
    names = unique_labels([_kind(*each) for each in kinds])
    members = [labels == label for label in distinct]
    bounds = [bounds_of(each, starts) for each in members]
    columns = {
        ATTRACTOR: texts(names),
        MOTION: texts(motion for motion, _ in kinds),
        PERIOD: np.array([period for _, period in kinds], dtype=np.int64),
        "points": np.array([each.sum() for each in members], dtype=np.int64),
        "share": np.array([each.mean() for each in members]),
        "low": np.array([low for low, _ in bounds]),
        "high": np.array([high for _, high in bounds]),
        EXPONENT: np.array([one.exponent for one in motions]),
        ERROR: np.array([one.error for one in motions]),
    }
    more = [name for name in rows if name not in (*columns, *starts.names, RETURNS, STATUS)]
    attractors = pd.DataFrame(columns).join(rows[more].reset_index(drop=True))
    labeled = table.copy(deep=False)
    column = np.full(len(table), FAILED, dtype=object)
    for name, each in zip(names, members, strict=True):
        column[each] = name
    labeled.insert(len(starts.names), ATTRACTOR, column)
    attractors.attrs = dict(table.attrs)
    return labeled, attractors


def label_partial(table: pd.DataFrame) -> PartialBasins:
    """Return kinds of motions in place of attractors, for the completed points.

    Attractors of one kind can be distinguished only when all points are completed.
    """
    kinds = motions(table)
    counts = kinds[kinds != FAILED].value_counts()
    columns = {ATTRACTOR: texts(counts.index), "points": counts.to_numpy()}
    attractors = pd.DataFrame({**columns, "share": columns["points"] / max(1, len(table))})
    labeled = table.assign(**{ATTRACTOR: kinds})
    return PartialBasins(labeled, attractors, pd.DataFrame({ATTRACTOR: texts([])}))


def state_of(system: HybridSystem, row: Any) -> State:
    """Return the final state of the motion of a row."""
    components = {name: float(row[f"{name} {FINAL_SUFFIX}"]) for name in system.states}
    return state_from(components, float(row[f"time {FINAL_SUFFIX}"]), row[MODE] or None, False)


def returns(
    attractors: pd.DataFrame, motions: Sequence[Attractor], system: HybridSystem
) -> pd.DataFrame:
    """Return the table of the states at the returns of attractors."""
    empty = np.empty((0, len(system.states)))
    seen = [empty if one.states is None else one.states for one in motions]
    names = np.repeat(attractors[ATTRACTOR].to_numpy(), [len(arrays) for arrays in seen])
    columns = dict(zip(system.states, np.concatenate([empty, *seen]).T, strict=True))
    table = pd.DataFrame({ATTRACTOR: texts(names), **columns})
    table.attrs = dict(attractors.attrs)
    return table


def _late_recurrence(attractor: Attractor, longest: int) -> tuple[str, int]:
    """Return motion and period of an attractor that was unsettled when it was reached.

    If it is periodic with a detectable period, it was a transient.
    """
    if attractor.motion in (CHAOTIC, QUASI_PERIODIC) or attractor.period > longest:
        return attractor.motion, attractor.period
    return UNSETTLED, 0


def _kind(motion: str, period: int) -> str:
    if motion == PERIODIC:
        return counted_periods(period)
    return f"{motion}, {counted_periods(period)}" if motion == OFF and period > 1 else motion


def unique_labels(kinds: list[str]) -> list[str]:
    """Return a name for each attractor: its kind, with a letter if several have this kind."""
    names, numbers = [], dict.fromkeys(kinds, 0)
    for kind in kinds:
        names.append(kind if kinds.count(kind) == 1 else f"{kind} {_letters(numbers[kind])}")
        numbers[kind] += 1
    return names


def _letters(number: int) -> str:
    """Return the letters of a number: a, b, …, z, aa, ab."""
    before, letter = divmod(number, 26)
    return (_letters(before - 1) if before else "") + chr(ord("a") + letter)


def bounds_of(in_basin: NDArray[np.bool_], starts: InitialConditions) -> tuple[float, float]:
    """Return the confidence bounds of an attractor's share; see `basins`."""
    if not isinstance(starts, Grid):
        return wilson(int(in_basin.sum()), len(in_basin))
    from scipy.ndimage import binary_dilation, binary_erosion

    cells = in_basin.reshape(starts.shape)
    inner, outer = binary_erosion(cells, border_value=1), binary_dilation(cells)
    return float(inner.mean()), float(outer.mean())
