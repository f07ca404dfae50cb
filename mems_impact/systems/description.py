"""The description of a hybrid system: its equations, names, units, numbers and times."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import cached_property

from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.definition import Definition
from mems_impact.hybrid.problem import ProblemParameters, Section, check_times
from mems_impact.systems.observables import Observable
from mems_impact.systems.result import Result
from mems_impact.systems.state import State
from mems_impact.systems.units import Units


class SystemDescription(Result, ABC):
    """The description of a hybrid system, which its state space, statistics and checks read."""

    name: str
    observables: tuple[Observable, ...]
    definition: Definition | None = None
    """The user's functions, with states, parameters and modes; None for other classes."""

    @property
    @abstractmethod
    def automaton(self) -> Automaton:
        """Modes, flow, guards and transitions."""

    @property
    @abstractmethod
    def parameters(self) -> dict[str, float]:
        """Names and values of all parameters, in the system's units."""

    @cached_property
    @abstractmethod
    def units(self) -> Units:
        """Units by name, without dimensionless quantities, and the scales of the variables."""

    @property
    @abstractmethod
    def initial(self) -> State:
        """Initial state of runs by default."""

    @property
    @abstractmethod
    def forcing_period(self) -> float | None:
        """The forcing period; None for an autonomous system."""

    @property
    @abstractmethod
    def section(self) -> Section | None:
        """The Poincaré section: component, level, direction."""

    @abstractmethod
    def numbers(self, changes: Mapping[str, float] | None = None) -> ProblemParameters:
        """Return the part of the problem that depends on the parameters, in scaled units.

        Parameters
        ----------
        changes : mapping of str to float, optional
            Other values of some parameters, in the system's units, allowed or not, as finite
            differences and trial steps need them.
        """

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the components of the state."""
        return self.automaton.states

    @property
    def modes(self) -> tuple[str, ...]:
        """Names of the modes."""
        return self.automaton.modes

    @property
    def forced(self) -> bool:
        """Whether the system has a forcing period."""
        return self.forcing_period is not None

    def check_parameter(self, name: str, field: str = "parameter") -> None:
        """Raise InvalidParameter unless `name` is a parameter."""
        if name not in self.parameters:
            raise InvalidParameter(field, name, f"one of {', '.join(self.parameters)}")

    @cached_property
    def _checked_numbers(self) -> ProblemParameters:
        """The part of the problem that depends on the parameters, shared by all problems."""
        numbers = self.numbers()
        size, unit = self.units.factor("time"), self.units.get("time", "")
        check_times(numbers, size, unit, forced=self.forced)
        return numbers
