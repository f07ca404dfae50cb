"""The interface of a system: names, units, conversion, and defaults of tables and figures."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from numbers import Integral
from typing import Any

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.units import Scales
from mems_impact.errors import InvalidParameter, RunError
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.problem import Problem, Section
from mems_impact.hybrid.state import HybridState
from mems_impact.systems.observables import Observable
from mems_impact.systems.result import Result
from mems_impact.systems.state import State, state_from
from mems_impact.tables import unit_of

__all__ = ["Shown", "Terms"]

# --- The terms of a system: its names and units, and the way to the numerics and back.


class Terms(Result):
    """What a user calls things, and in which units, beside what the numerics count in."""

    @property
    @abstractmethod
    def automaton(self) -> Automaton:
        """Modes, flow, guards and transitions."""

    @property
    @abstractmethod
    def parameters(self) -> dict[str, float]:
        """Names and values of all parameters, in the system's units."""

    @property
    @abstractmethod
    def units(self) -> Mapping[str, str]:
        """Units by name; none for pure numbers."""

    @property
    @abstractmethod
    def scales(self) -> Scales:
        """The units of the numerics."""

    @property
    @abstractmethod
    def initial(self) -> State:
        """Where runs start if nothing else is said."""

    @property
    @abstractmethod
    def forcing_period(self) -> float | None:
        """The forcing period; None for a system without forcing."""

    @property
    @abstractmethod
    def section(self) -> Section | None:
        """The Poincaré section: component, level, direction."""

    @abstractmethod
    def mode_of(self, y: Floats, time: float, problem: Problem, mode: int = 0) -> int:
        """Return the mode of a state whose mode is not given."""

    @property
    def without_until(self) -> Any:
        """The system without what ended its run (see `simulate`)."""
        return vars(self).get("_unended", self)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the components of the state."""
        return self.automaton.states

    @property
    def modes(self) -> tuple[str, ...]:
        """Names of the modes."""
        return self.automaton.modes

    @property
    def visible(self) -> tuple[str, ...]:
        """The states that tell something where the section cuts an orbit."""
        hidden = {self.states[i] for i in self.automaton.cyclic}
        if self.section is not None:
            hidden.add(self.states[self.section[0]])
        return tuple(name for name in self.states if name not in hidden)

    @property
    def forced(self) -> bool:
        """Whether the system has a forcing period."""
        return self.forcing_period is not None

    def check_parameter(self, name: str, field: str = "parameter") -> None:
        """Raise InvalidParameter unless `name` is a parameter."""
        if name not in self.parameters:
            raise InvalidParameter(field, name, f"one of {', '.join(self.parameters)}")

    def value(self, name: str) -> float:
        """Return a parameter in the system's units."""
        return self.parameters[name]

    def unit(self, name: str) -> str:
        """Return the unit of a parameter, a state or an observable, empty for a pure number."""
        return self.units.get(name, "")

    @property
    def is_scaled(self) -> bool:
        """Whether the numerics count in sizes that are typical of the system."""
        return True

    def factor(self, heading: str) -> float:
        """Return the unit of the numerics for what stands under a heading: a name, or "time"."""
        factors = self.scales.factors
        return factors.get(unit_of(heading, self.units), 1.0) if factors else 1.0

    def margin_unit(self, guard: str) -> float:
        """Return the unit of the numerics for the margin of a guard."""
        return 1.0

    def into(self, name: str, value: float) -> float:
        """Return a value of a parameter, a state or the time in the units of the numerics."""
        return value / self.factor(name)

    def out(self, heading: str, value: Any) -> Any:
        """Return a value, or an array, in the system's units."""
        factor = self.factor(heading)
        return value if factor == 1.0 else value * factor

    def amount(self, heading: str, value: float) -> str:
        """Return a number of the numerics in the system's units, to be printed."""
        return f"{self.out(heading, value):.9g} {unit_of(heading, self.units)}".rstrip()

    def margin_amount(self, guard: str, value: float, *, rate: bool = False) -> str:
        """Return the margin of a guard, or its rate, in the system's units, to be printed."""
        factor = self.margin_unit(guard) / (self.factor("time") if rate else 1.0)
        return f"{value * factor:.3g}"

    def convert(self, error: RunError) -> None:
        """Let an error of a run tell all in the system's units."""
        error.convert(self.out, self.units)

    def label(self, name: str) -> str:
        """Return a name with its unit, to be printed."""
        return self.scales.label(name, self.unit(name))

    @property
    def internal_parameters(self) -> dict[str, float]:
        """Names and values of all parameters, in the units of the numerics."""
        return {name: self.into(name, value) for name, value in self.parameters.items()}

    def parameter_changes(
        self, inner: Mapping[str, float], here: Mapping[str, float]
    ) -> dict[str, float]:
        """Return what differs between two sets of inner values, in the system's units."""
        return {name: self.out(name, value) for name, value in inner.items() if value != here[name]}

    def instant(
        self, state: State | Mapping[str, float] | None, problem: Problem, field: str = "initial"
    ) -> HybridState:
        """Return where a run from `state` starts, in the units of the numerics.

        `field` is what errors call the state.

        Raises
        ------
        InvalidParameter
            If the state has other components, a mode that there is not, or lies beyond the period.
        """
        if state is None:
            state = self.initial
        elif not isinstance(state, State):
            if not isinstance(state, Mapping):
                allowed = f"a State({self.states[0]}=…), or a mapping of names to numbers"
                raise InvalidParameter(field, state, allowed)
            state = state_from(state)
        self._check_state(field, state)
        values = {**dict.fromkeys(self.states, 0.0), **self.initial.as_dict(), **state.as_dict()}
        y = np.array([self.into(name, values[name]) for name in self.states], dtype=float)
        time = self.into("time", state.time)
        if self.forced and not state.time < self.out("time", problem.period):
            period, unit = self.out("time", problem.period), self.unit("time")
            raise InvalidParameter(
                "time", state.time, f"below the forcing period {period:g} {unit}".rstrip()
            )
        if not self.forced and state.time != 0.0:
            allowed = "0: nothing forces the system, and its functions do not depend on time"
            raise InvalidParameter("time", state.time, allowed)
        time = min(time, math.nextafter(problem.period, 0.0))  # scaling may round it up
        mode = state.mode if state.mode is not None else self.initial.mode
        if mode is None:
            return HybridState(0, time, self.mode_of(y, time, problem), y)
        return HybridState(0, time, self.mode_number(mode), y)

    def state_of(self, instant: HybridState) -> State:
        """Return an instant of the numerics as a state in the system's units."""
        values = zip(self.states, instant.y.tolist(), strict=True)
        return state_from(
            {name: self.out(name, value) for name, value in values},
            time=float(self.out("time", instant.time)) if self.forced else 0.0,
            mode=self.modes[instant.mode] if len(self.modes) > 1 else None,
        )

    def mode_number(self, mode: str | int, field: str = "mode") -> int:
        """Return the number of a mode; InvalidParameter if there is none such."""
        if isinstance(mode, str) and mode in self.modes:
            return self.modes.index(mode)
        if isinstance(mode, Integral) and 0 <= mode < len(self.modes):
            return int(mode)
        raise InvalidParameter(field, mode, f"one of {', '.join(self.modes)}")

    def _check_state(self, field: str, state: State) -> None:
        unknown = [name for name in state if name not in self.states]
        if unknown:
            raise InvalidParameter(field, unknown[0], f"components among {', '.join(self.states)}")


# --- What tables, sweeps and figures show of a system, where its kind says nothing else.


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
    def study_observables(self) -> tuple[Observable, ...]:
        """The observables that studies gather."""
        return self.observables

    @property
    def symbols(self) -> Mapping[str, str]:
        """Symbols of parameters in figures, where they are not to be read off the names."""
        return {}

    def start_of(self, direction: str) -> State:
        """Return where a sweep "up" or "down" starts if nothing is said."""
        return self.initial

    def moves(self, instant: HybridState) -> bool:
        """Return whether statistics need to know where an arc has come to at any time."""
        return any(not each.at for each in self.observables)
