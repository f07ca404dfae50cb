"""Results of continuation: branches, and curves of special points."""

from __future__ import annotations

from functools import cached_property
from typing import Any, ClassVar, Generic

from mems_impact.analysis.equilibrium import Equilibrium
from mems_impact.analysis.orbit import Orbit
from mems_impact.analysis.solution import S, solution_of
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.result import Result


class ContinuationResult(Result, Generic[S]):
    """Base class of results of continuation: a branch in one parameter, by default."""

    system: HybridSystem
    parameter: str
    bounds: tuple[float, float]
    special_points: tuple[Any, ...]
    ended: str
    numeric: Any

    _stored: ClassVar[tuple[str, ...]] = ("table", "special_table")

    @cached_property
    def solutions(self) -> tuple[S, ...]:
        """All orbits or equilibria, in order along the branch or curve."""
        # An orbit is integrated once for its tables, so the orbits of special points are the same.
        special = {id(s.solution.numeric): s.solution for s in self.special_points}
        return tuple(
            special.get(id(point)) or solution_of(self.system, point)
            for point in self.numeric.solutions
        )

    @property
    def orbits(self) -> tuple[Orbit, ...]:
        """All orbits, in order; AttributeError on a branch or curve of equilibria."""
        return self._solutions_of("orbits")

    @property
    def equilibria(self) -> tuple[Equilibrium, ...]:
        """All equilibria, in order; AttributeError on a branch or curve of orbits."""
        return self._solutions_of("equilibria")

    def _solutions_of(self, noun: str) -> tuple[Any, ...]:
        if self.of != noun:
            raise AttributeError(f"{self!r} consists of {self.of}: see its solutions")
        return self.solutions

    @property
    def of(self) -> str:
        """Noun for its solutions, in the plural."""
        return str(self.numeric.noun)

    def __len__(self) -> int:
        return len(self.numeric.points)

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({self._subject}, {len(self)} {self.of}, "
            f"special points: {self._special}; ended: {self.ended})"
        )

    def summary(self) -> dict[str, Any]:
        """Return the parameter and its range, the special points and the reason for the end."""
        return {
            "system": repr(self.system),
            **self._subject_rows,
            self.of: len(self),
            "special points": self._special,
            "ended": self.ended,
        }

    @property
    def _subject(self) -> str:
        """Parameter and range, for the repr."""
        return f"{self.parameter} {self._range}"

    @property
    def _subject_rows(self) -> dict[str, Any]:
        """The same in the summary."""
        return {self.system.units.label(self.parameter): self._range}

    @property
    def _range(self) -> str:
        low, high = self.bounds
        return f"{low:g} to {high:g}"

    @property
    def _special(self) -> str:
        return ", ".join(f"{s.label} {s.value:.6g}" for s in self.special_points) or "none"
