"""The problems of a system at any values of its parameters, for families of orbits."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mems_impact.engines.options import Options
from mems_impact.errors import RunError
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.problem import Numbers, Problem

if TYPE_CHECKING:
    from mems_impact.analysis.system import System

__all__ = ["Build"]


@dataclass(frozen=True)
class Build:
    """The problem of a system at any values of its parameters."""

    system: System
    options: Options

    @property
    def automaton(self) -> Automaton:
        """The same for all values."""
        return self.system.automaton

    def __call__(self, values: Mapping[str, float]) -> Problem:
        """Return the problem at values in the units of the numerics."""
        return self.system.at(values).problem(self.options)

    def amount(self, heading: str, value: float) -> str:
        """Return a number of the numerics in the system's units, to be printed."""
        return self.system.amount(heading, value)

    def convert(self, error: RunError) -> None:
        """Let an error of a run tell all in the system's units."""
        self.system.convert(error)

    def by(self, method: str) -> Build:
        """Return the same, to be integrated by another method."""
        return Build(self.system, dataclasses.replace(self.options, method=method))

    @functools.cached_property
    def _here(self) -> dict[str, float]:
        return self.system.inner_parameters

    def numbers(self, values: Mapping[str, float]) -> Numbers:
        """Return what of that problem depends on the values, without making it."""
        return self.system.numbers(self.system.changes_to(values, self._here))
