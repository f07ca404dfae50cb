"""Bifurcation diagrams: attractors, their branches, and branches that emanate from these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from mems_impact import tables as diagram_tables
from mems_impact._util.arrays import Floats
from mems_impact.analysis.attractor import SAME_ATTRACTOR_RTOL
from mems_impact.analysis.branch import Branch, no_orbits
from mems_impact.analysis.special_points import SpecialPoint
from mems_impact.continuation.arclength import CLOSED
from mems_impact.continuation.orbit_identity import same_orbit
from mems_impact.orbits.equilibrium import EquilibriumState
from mems_impact.studies.attractor_search import BRANCH
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.result import Result

if TYPE_CHECKING:
    import pandas as pd

AnyBranch = Branch[Any]
AnyPoint = SpecialPoint[Any]

SAME_VALUE_RTOL = 1e-7  # largest relative difference of the values of one special point
PARTS = ("attractors", "branches", "other orbits", "cloud")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class BifurcationDiagram(Result):
    """All branches of a system that were found over a parameter, with its attractors.

    Attributes
    ----------
    system : System
    parameter : str
    bounds : tuple of float
    branches : tuple of Branch
        Each once.
    parents : tuple of int or None
        For each branch the number of the branch from which it emanates; None for a branch found
        from an attractor or by a search.
    origins : tuple of SpecialPoint or None
        The special point of the parent at which the branch emanates.
    attractors : DataFrame
        One row per attractor and value: the parameter, motion, period, the number of its branch (-1
        if there is none), Lyapunov exponent, and the last state of the motion.
    cloud : DataFrame
        The attractors on the section, with the columns of `sweep`.
    finished : tuple of str
        The finished parts of the computation: "attractors", "branches", "other orbits", "cloud".
    inputs : dict
        Arguments and system, by which a `store` is recognized.

    See Also
    --------
    bifurcation_diagram, plot_diagram, Branch

    Examples
    --------
    >>> import mems_impact as mi
    >>> def duffing(mode, t, y, p):
    ...     return y.v, p.a * y.x - y.x**3 - 0.1 * y.v
    >>> well = mi.System(states=("x", "v"), flow=duffing, parameters={"a": 1.0})
    >>> diagram = mi.bifurcation_diagram(well, "a", (-1.0, 1.0), values=5, starts=2)
    >>> print(diagram.tree)
    a -1 to 1
    0: equilibria, a -1 to 1, BP 0
    └─ 1: equilibria, a 0 to 1, from BP 0
    """

    system: HybridSystem = field(repr=False)
    parameter: str
    bounds: tuple[float, float]
    branches: tuple[AnyBranch, ...]
    parents: tuple[int | None, ...]
    origins: tuple[AnyPoint | None, ...] = field(repr=False)
    attractors: pd.DataFrame = field(repr=False)
    cloud: pd.DataFrame = field(repr=False)
    finished: tuple[str, ...] = PARTS
    inputs: dict[str, Any] = field(default_factory=dict, repr=False)

    _stored: ClassVar[tuple[str, ...]] = ("table", "special_table")

    @property
    def complete(self) -> bool:
        """Whether the computation finished."""
        return self.finished == PARTS

    def __repr__(self) -> str:
        low, high = self.bounds
        rest = "" if self.complete else ", incomplete"
        return (
            f"BifurcationDiagram({self.parameter} {low:g} to {high:g}, {len(self.branches)} "
            f"branches, {len(self.special_points)} special points{rest})"
        )

    def summary(self) -> dict[str, Any]:
        """Return the parameter and its range, and one entry per branch."""
        low, high = self.bounds
        rows = {f"branch {i}": self._line(i) for i in range(len(self.branches))}
        return {
            "system": repr(self.system),
            self.system.units.label(self.parameter): f"{low:g} to {high:g}",
            **rows,
        }

    @property
    def tree(self) -> str:
        """The branches as text, each below the branch from which it emanates."""
        low, high = self.bounds
        lines = [f"{self.parameter} {low:g} to {high:g}"]

        def add(number: int, indent: str, mark: str, below: str) -> None:
            lines.append(f"{indent}{mark}{number}: {self._line(number)}")
            children = self.children(number)
            for child in children:
                last = child == children[-1]
                add(child, indent + below, "└─ " if last else "├─ ", "   " if last else "│  ")

        for root in self.children(None):
            add(root, "", "", "")
        return "\n".join(lines)

    def children(self, number: int | None) -> tuple[int, ...]:
        """Return the numbers of the branches that emanate from a branch; for None of the roots."""
        return tuple(i for i, parent in enumerate(self.parents) if parent == number)

    def _line(self, number: int) -> str:
        branch, origin = self.branches[number], self.origins[number]
        values = np.append(_values(branch), [s.value for s in branch.special_points])
        low, high = _value_text(values.min()), _value_text(values.max())
        phrases = [_kind(branch), f"{self.parameter} {low} to {high}"]
        if branch.ended.endswith(CLOSED):
            phrases.append("closed")
        phrases += [
            f"{s.label} {_value_text(s.value)}"
            for s in branch.special_points
            if origin is None or not same_point(s, origin)
        ]
        if origin is not None:
            phrases.append(f"from {origin.label} {_value_text(origin.value)}")
        return ", ".join(phrases)

    @cached_property
    def special_points(self) -> tuple[AnyPoint, ...]:
        """The special points of all branches; a point that two branches share appears once."""
        return tuple(point for _, point in self._distinct)

    @cached_property
    def _distinct(self) -> list[tuple[int, AnyPoint]]:
        points: list[tuple[int, AnyPoint]] = []
        for i, branch in enumerate(self.branches):
            for point in branch.special_points:
                if not any(same_point(point, other) for _, other in points):
                    points.append((i, point))
        return points

    @cached_property
    def table(self) -> pd.DataFrame:
        """The tables of all branches, one below the other, with the number of the branch."""
        tables = [branch.table for branch in self.branches]
        return _joined(tables or [no_orbits(self.parameter, self.system)])

    @cached_property
    def special_table(self) -> pd.DataFrame:
        """One row per special point, with the number of its branch."""
        displayed = {(i, id(point)) for i, point in self._distinct}
        masks = [
            np.array([(i, id(s)) in displayed for s in branch.special_points], dtype=bool)
            for i, branch in enumerate(self.branches)
        ]
        pairs = zip(self.branches, masks, strict=True)
        tables = [branch.special_table[mask] for branch, mask in pairs]
        like = no_orbits(self.parameter, self.system).drop(columns="piece")
        empty = diagram_tables.special_points(self.parameter, [], self.system, like)
        return _joined(tables or [empty])


def _values(branch: AnyBranch) -> Floats:
    """Return the values of the parameter along a branch."""
    return branch.table.iloc[:, 0].to_numpy()


def _value_text(value: float) -> str:
    return f"{value:.6g}" if abs(value) > 1e-12 else "0"


def _kind(branch: AnyBranch) -> str:
    if branch.of == "equilibria":
        return branch.of
    if not branch.system.forced:
        return "cycles"
    return f"period {branch.orbits[0].periods}"


def _joined(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Return tables of branches as one, with the number of the branch after the other columns."""
    import pandas as pd

    numbered = [table.assign(**{BRANCH: i}) for i, table in enumerate(tables)]
    names = dict.fromkeys(name for table in numbered for name in table)
    full = [table for table in numbered if len(table)] or numbered[:1]
    joined = pd.concat(full, ignore_index=True).reindex(columns=list(names))
    joined.insert(len(names) - 1, BRANCH, joined.pop(BRANCH))
    joined.attrs = dict(tables[0].attrs)
    return joined


def same_point(one: AnyPoint, other: AnyPoint) -> bool:
    """Return whether two special points of branches are the same."""
    a, b = one.solution.numeric, other.solution.numeric
    if one.kind != other.kind or type(a) is not type(b):
        return False
    if abs(one.value - other.value) > SAME_VALUE_RTOL * max(1.0, abs(one.value)):
        return False
    if isinstance(a, EquilibriumState):
        return float(np.abs(a.state - b.state).max(initial=0.0)) < SAME_ATTRACTOR_RTOL
    return same_orbit(a, b, one.parameter) or same_orbit(b, a, one.parameter)
