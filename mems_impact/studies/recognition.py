"""Which motions have come to the same attractor, by what is kept of where they return.

Of every motion the mean, the smallest and the largest value of each component at its returns are
kept: numbers that do not depend on the return at which it was left. Cyclic components tell nothing.
Which motions are the same does not depend on the order of points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mems_impact.analysis.attractor import Attractor
from mems_impact.analysis.kinds import FAILED, RESTING, UNSETTLED
from mems_impact.analysis.state import State
from mems_impact.analysis.system import System
from mems_impact.engines.options import Options
from mems_impact.hybrid.trajectory import Floats
from mems_impact.studies.measuring import MOTION, PERIOD
from mems_impact.studies.study import Columns

__all__ = ["LEFT", "Recognition"]

KEPT = ("mean", "min", "max")
LEFT = "final"  # suffix of where a motion was left
MODE = f"mode {LEFT}"
Integers = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Recognition:
    """What is kept of motions, and how they are told apart.

    Attributes
    ----------
    system : System
    options : Options
        Its ``atol / rtol`` is the smallest size to which the numerics look.
    distance : float
        Relative to the size of each component, that within which two motions are the same.
    """

    system: System
    options: Options
    distance: float

    @property
    def names(self) -> tuple[str, ...]:
        """The components that are looked at."""
        system = self.system
        hidden = {system.states[i] for i in system.automaton.cyclic}
        return tuple(name for name in system.states if name not in hidden)

    @property
    def schema(self) -> dict[str, str]:
        """The columns of what is kept."""
        kept = [f"{name} {what}" for name in self.names for what in KEPT]
        left = [f"{name} {LEFT}" for name in (*self.system.states, "time")]
        return {**dict.fromkeys([*kept, *left], "float"), MODE: "str"}

    def columns(self, found: Sequence[Attractor]) -> Columns:
        """Return the columns of `schema`."""
        rows = np.array([self._row(each) for each in found])
        columns: Columns = dict(zip(self.schema, rows.T, strict=False))
        modes = ["" if each.final is None else str(each.final.mode or "") for each in found]
        columns[MODE] = np.array(modes, dtype=object)
        return columns

    def nudged(self, state: State) -> State:
        """Return a state a tenth of the distance away in each component."""
        least = self.options.atol / self.options.rtol
        sizes = {
            name: max(abs(state[name]), float(self.system.out(name, least))) for name in self.names
        }
        off = {name: state[name] + 0.1 * self.distance * size for name, size in sizes.items()}
        return state.replace(**off)

    def labels(self, columns: Columns, starts: Columns) -> Integers:
        """Return a number for each motion, the same for the same attractor; -1 if it has failed.

        Periodic motions and those at rest are the same if their kind and period are, and what is
        kept of them lies within the distance, from one to the next. Unsettled ones are the same if
        the boxes around their returns meet.

        Parameters
        ----------
        columns : dict of array
            What is kept, motions and periods.
        starts : dict of array
            Where the motions started: components that were large once are told no better.
        """
        kind = columns[MOTION]
        labels: Integers = np.full(len(kind), -1, dtype=np.int64)
        at_rest = np.where(kind == RESTING, columns[MODE], "")
        kinds = sorted(set(zip(kind, columns[PERIOD].tolist(), at_rest, strict=True)))
        size = self._sizes(columns, starts)
        for motion, period, mode in kinds:
            if motion == FAILED:
                continue
            here = (kind == motion) & (columns[PERIOD] == period) & (at_rest == mode)
            kept = {what: self._kept(columns, what)[here] for what in KEPT}
            if motion == UNSETTLED:
                own = _meeting(kept["min"], kept["max"])
            else:
                own = _near(np.hstack(list(kept.values())) / np.tile(size, len(KEPT)))
            labels[here] = own + labels.max() + 1
        return labels

    def _kept(self, columns: Columns, what: str) -> Floats:
        return np.stack([columns[f"{name} {what}"] for name in self.names], axis=1)

    def _sizes(self, columns: Columns, starts: Columns) -> Floats:
        """Return the distance in each component, in its unit."""
        least = self.options.atol / self.options.rtol
        sizes = [float(self.system.out(name, least)) for name in self.names]
        for i, name in enumerate(self.names):
            values = [columns[f"{name} min"], columns[f"{name} max"], starts.get(name, np.empty(0))]
            known = np.abs(np.concatenate(values))
            sizes[i] = max(sizes[i], np.max(known, initial=0.0, where=~np.isnan(known)))
        return self.distance * np.array(sizes)

    def _row(self, found: Attractor) -> list[float]:
        count = len(self.schema) - 1
        if found.states is None or found.final is None:
            return [np.nan] * count
        places = [self.system.states.index(name) for name in self.names]
        seen = found.states[:, places]
        if not len(seen):  # at rest before the first return
            seen = np.array([[found.final[name] for name in self.names]])
        kept = np.stack([seen.mean(axis=0), seen.min(axis=0), seen.max(axis=0)], axis=1)
        final = found.final
        return [*kept.ravel(), *(final[name] for name in self.system.states), final.time]


def _near(places: Floats) -> Integers:
    """Return groups of points, in which each is near another: in the next cell of a grid."""
    cells, which = np.unique(np.rint(places), axis=0, return_inverse=True)
    pairs = cKDTree(cells).query_pairs(1.5, p=np.inf, output_type="ndarray")
    ones = np.ones(len(pairs))
    graph = coo_array((ones, (pairs[:, 0], pairs[:, 1])), shape=(len(cells), len(cells)))
    _, groups = connected_components(graph, directed=False)
    return np.asarray(groups[which.ravel()], dtype=np.int64)


def _meeting(low: Floats, high: Floats) -> Integers:
    """Return groups of boxes, the finest ones of which no two have hulls that meet."""
    hulls: list[tuple[Floats, Floats]] = []
    for below, above in zip(low, high, strict=True):
        grown = True
        while grown:  # a hull that has grown may meet others
            met = [hull for hull in hulls if ((hull[0] <= above) & (below <= hull[1])).all()]
            hulls = [hull for hull in hulls if not any(hull is other for other in met)]
            below = np.min([below, *(hull[0] for hull in met)], axis=0)
            above = np.max([above, *(hull[1] for hull in met)], axis=0)
            grown = bool(met)
        hulls.append((below, above))
    labels: Integers = np.empty(len(low), dtype=np.int64)
    for number, (below, above) in enumerate(hulls):
        labels[((below <= low) & (high <= above)).all(axis=1)] = number
    return labels
