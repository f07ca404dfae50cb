"""What tables, sweeps and figures show of a system, where its kind says nothing else."""

from __future__ import annotations

from collections.abc import Mapping

from mems_impact.analysis.observable import Observable
from mems_impact.analysis.state import State
from mems_impact.analysis.terms import Terms
from mems_impact.hybrid.trajectory import Instant

__all__ = ["Shown"]


class Shown(Terms):
    """What is shown of a system whose kind has no tables of its own."""

    observables: tuple[Observable, ...]

    @property
    def shown(self) -> tuple[str, ...]:
        """The states by which sweeps and branches show an orbit, where the section cuts it."""
        return self.visible

    @property
    def told(self) -> tuple[str, ...]:
        """The statistics that a sweep tells of every value."""
        counted = "period" if self.forced else "time"
        return (f"impacts per {counted}", *(each.name for each in self.observables))

    @property
    def quantities(self) -> Mapping[str, tuple[str, str]]:
        """The statistics that the figure of a sweep shows: column and words, by a short name."""
        return {each.name: (each.name, each.name) for each in self.observables}

    @property
    def symbols(self) -> Mapping[str, str]:
        """Symbols of parameters in figures, where they are not to be read off the names."""
        return {}

    def start_of(self, direction: str) -> State:
        """Return where a sweep "up" or "down" starts if nothing is said."""
        return self.initial

    def moves(self, instant: Instant) -> bool:
        """Return whether statistics need to know where an arc has come to at any time."""
        return any(not each.at for each in self.observables)
