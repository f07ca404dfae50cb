"""The interface of a hybrid system: what runs, orbits, studies, tables and figures ask of it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from numbers import Integral
from operator import itemgetter
from typing import Any, ClassVar, Self

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.units import Scales
from mems_impact.errors import InvalidParameter, RunError
from mems_impact.hybrid.attractors.mapper import CompiledObservables, RecurrenceResult
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.definition import Definition, Typical
from mems_impact.hybrid.pickling import portable
from mems_impact.hybrid.problem import Problem, ProblemParameters, Section, check_times
from mems_impact.hybrid.simulation import Events, Trajectory
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.options import Options
from mems_impact.orbits.family import Family
from mems_impact.systems import observables as quantity
from mems_impact.systems.observables import (
    EventObserver,
    Observable,
    Quantity,
    StatisticsAccumulator,
    TimeWindow,
)
from mems_impact.systems.result import Result, deep_equal
from mems_impact.systems.state import State, state_from
from mems_impact.systems.typical_scales import warn_if_badly_scaled_orbit
from mems_impact.tables import unit_of

__all__ = ["HybridSystem", "SystemFamily"]


DERIVED = ("_checked_numbers", "internal_parameters")  # cached on a system


@dataclass(frozen=True)
class SystemFamily(Family):
    """The problems of a system for all values of its parameters, in the units of the numerics."""

    system: HybridSystem
    options: Options

    @property
    def automaton(self) -> Automaton:
        """The automaton, the same for all values."""
        return self.system.automaton

    def problem(self) -> Problem:
        """Return the problem at the present values."""
        return self.system.at(self.values).problem(self.options)

    def with_method(self, method: str) -> SystemFamily:
        """Return the family integrated by another method."""
        return replace(self, options=replace(self.options, method=method))

    def numbers(self, /, **changes: float) -> ProblemParameters:
        """Return what of the problem depends on the values, without making it."""
        values = {**self.values, **changes}
        return self.system.numbers(
            self.system.parameter_changes(values, self.system.internal_parameters)
        )

    def amount(self, heading: str, value: float) -> str:
        """Return a number in the system's units, to be printed."""
        return self.system.amount(heading, value)

    def convert(self, error: RunError) -> None:
        """Convert the numbers in an error of a run to the system's units."""
        self.system.convert(error)


class HybridSystem(Result, ABC):
    """A system that switches between smooth modes, whatever defines it.

    Three kinds implement it: `System` by functions, `ActuatorSystem` by an actuator and a drive,
    `DetachedSystem` by the description in a file. Users see the system's units; the numerics
    count in `scales` or typical sizes.
    """

    name: str
    observables: tuple[Observable, ...]
    definition: Definition | None = None
    """The functions of a user and what they are of; none of other kinds."""
    typical: Typical | None = None
    """Typical sizes in which the numerics count, where a user gives them."""

    run_type: ClassVar[Any] = None
    """The class of its runs, where a kind of system adds tables of its own."""
    orbit_type: ClassVar[Any] = None
    """The class of its orbits, likewise."""

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
    @abstractmethod
    def functions(self) -> dict[str, str]:
        """Where its functions are defined, as ``module:name``: to be shown."""

    @abstractmethod
    def numbers(self, changes: Mapping[str, float] | None = None) -> ProblemParameters:
        """Return what of the problem depends on the parameters, in the units of the numerics.

        Parameters
        ----------
        changes : mapping of str to float, optional
            Other values of some parameters, in the system's units, allowed or not: differences by
            a parameter at the end of its range look beyond it, as do trial steps.
        """

    @abstractmethod
    def shifted(self, values: Mapping[str, float]) -> Self:
        """Return the system at values that may not be allowed, at which continuation looks."""

    @abstractmethod
    def restored(
        self, values: Mapping[str, float], scales: Scales, typical: Typical | None = None
    ) -> Self:
        """Return the system at the values of a file, and in the units in which it counted."""

    @abstractmethod
    def ending(self, until: Callable[..., float]) -> HybridSystem:
        """Return the system whose runs end where ``until(mode, t, y, p)`` falls through zero."""

    @abstractmethod
    def evaluate_observable(self, observable: Observable, y: Floats, problem: Problem) -> float:
        """Return an observable of a state of the numerics."""

    @abstractmethod
    def evaluate_event_observable(
        self, observable: Observable, events: Events, i: int, problem: Problem
    ) -> float:
        """Return an observable at an event of the numerics."""

    @property
    @abstractmethod
    def observed(self) -> CompiledObservables:
        """The observables that studies gather, as one function of the numerics."""

    @abstractmethod
    def gatherer(
        self, problem: Problem, start: HybridState, window: TimeWindow
    ) -> StatisticsAccumulator:
        """Return what gathers the statistics of a run."""

    @abstractmethod
    def measures(self, settled: RecurrenceResult, period: float) -> dict[str, float]:
        """Return the statistics of an attractor that studies write, by heading."""

    @property
    @abstractmethod
    def measure_names(self) -> tuple[str, ...]:
        """The headings of `measures`."""

    def fits(self, mode: int, y: Floats, problem: Problem) -> bool:
        """Return whether a state may be in a mode, as far as parts say: on its surface, at rest."""
        automaton = problem.automaton
        if mode in automaton.constrained:  # of a state that is there already
            p = np.asarray(problem.parameters, dtype=float)
            return automaton.state_after(mode, automaton.switch_code, 0.0, y, p)[0] == mode
        return self.mode_of(y, 0.0, problem, mode) == mode

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
    def section_states(self) -> tuple[str, ...]:
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

    @cached_property
    def internal_parameters(self) -> dict[str, float]:
        """Names and values of all parameters, in the units of the numerics."""
        return {name: self.into(name, value) for name, value in self.parameters.items()}

    def parameter_changes(
        self, inner: Mapping[str, float], here: Mapping[str, float]
    ) -> dict[str, float]:
        """Return what differs between two sets of inner values, in the system's units."""
        return {name: self.out(name, value) for name, value in inner.items() if value != here[name]}

    def hybrid_state(
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

    @property
    def displayed_states(self) -> tuple[str, ...]:
        """The states by which sweeps and branches show an orbit, where the section cuts it."""
        return self.section_states

    @property
    def sweep_statistics(self) -> tuple[str, ...]:
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

    @property
    def orbit_quantities(self) -> tuple[Quantity, ...]:
        """The numbers of an orbit whose derivatives `sensitivity` and `optimize` know.

        What each cyclic state gains per period, its observables (over the orbit, as in the tables
        of branches), the period of a limit cycle, the largest impact speed, the closest approach,
        and the largest modulus of a multiplier.
        """
        units, states = self.units, self.states
        cyclic = [states[i] for i in self.automaton.cyclic]
        each = "period" if self.forced else "cycle"
        found: list[Any] = [
            Quantity(
                f"{state} per {each}", partial(quantity.gain, state=state), unit_of(state, units)
            )
            for state in cyclic
        ]
        found += [
            Quantity(
                other.name,
                partial(quantity.observable, name=other.name),
                unit_of(other.name, units),
            )
            for other in self.observables
        ]
        if not self.forced:
            found.append(Quantity("period", quantity.period, unit_of("time", units)))
        if any(guard.impact for guard in self.automaton.guards):
            found.append(
                Quantity("impact speed", quantity.impact_speed, unit_of("impact speed", units))
            )
            closest = "closest approach"
            found.append(Quantity(closest, quantity.closest_approach, unit_of(closest, units)))
        return (*found, quantity.MULTIPLIER)

    def changed(self, /, **values: float) -> Self:
        """Return the system with other values of some parameters.

        Parameters
        ----------
        **values : float

        Raises
        ------
        InvalidParameter
            If a name is none of the system's, or a value is not a number.
        """
        for name in values:
            self.check_parameter(name)
        other = self.shifted(values)
        other._checked_numbers  # noqa: B018 - raises where they are not allowed
        return other

    @property
    def is_data_only(self) -> bool:
        """Whether names and numbers say all of it; a file cannot hold functions."""
        return False

    def standstill_test(self) -> Callable[[Trajectory], float | None]:
        """Return what tells after how many periods a run stands still; None if it does not."""
        problem = "of an actuator alone; give a function (mode, t, y, p) that falls through zero"
        raise InvalidParameter("until", "still", "", problem=problem)

    def validity(self, problem: Problem, start: HybridState) -> EventObserver | None:
        """Return what warns of a run that leaves the range in which the system's model holds."""
        return None

    def snap_to_mode(self, mode: int, y: Floats) -> Floats:
        """Return a state that Newton's method has found, without what rounding made of it."""
        return y

    def check_continued(self, name: str) -> None:
        """Raise InvalidParameter unless an orbit can be followed over the parameter `name`."""
        self.check_parameter(name)

    def family(self, options: Options) -> Family:
        """Return the problems for all values of the parameters, in the units of the numerics."""
        if not self.is_scaled and self.forced:
            warn_if_badly_scaled_orbit(self.numbers().period, self.parameters)
        return SystemFamily(self.internal_parameters, self, options)

    def at(self, inner: Mapping[str, float]) -> Self:
        """Return the system at values in the units of the numerics, allowed or not."""
        changes = self.parameter_changes(inner, self.internal_parameters)
        return self.shifted(changes) if changes else self

    def problem(self, options: Options) -> Problem:
        """Return what the event loop integrates, in the units of the numerics."""
        return Problem(
            automaton=self.automaton,
            section=self.section,
            options=options,
            discontinuity_check=self.discontinuity_check,
            **self._checked_numbers._asdict(),
        )

    @property
    def checked_modes(self) -> set[int]:
        """The modes in which functions of a user have been compared; to be added to."""
        return set()

    @property
    def discontinuity_check(self) -> Callable[[HybridState, float], bool] | None:
        """What warns of a jump of the flow where steps become very short, if it can."""
        return None

    @cached_property
    def _checked_numbers(self) -> ProblemParameters:
        """What of the problem depends on the parameters, once for all problems of the system."""
        numbers = self.numbers()
        check_times(numbers, self.factor("time"), self.unit("time"))
        return numbers

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={value:.6g}" for name, value in self.parameters.items())
        return f"{type(self).__name__}({self.name or ', '.join(self.states)}; {values})"

    def summary(self) -> dict[str, Any]:
        """Return states, modes, guards and parameters."""
        return {
            "states": ", ".join(self.states),
            "modes": ", ".join(self.modes),
            "guards": ", ".join(guard.name for guard in self.automaton.guards),
            **{self.label(name): value for name, value in self.parameters.items()},
        }

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, HybridSystem):
            return NotImplemented
        return type(self) is type(other) and deep_equal(self._key(), other._key())

    def __hash__(self) -> int:  # type: ignore[override]
        return hash((type(self), *self.parameters.items()))

    def __copy__(self) -> Self:
        return self  # it does not change

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self

    def __getstate__(self) -> dict[str, Any]:
        """Return what is pickled, with functions fit to go to another process."""
        state: dict[str, Any] = portable(self._given)
        return state

    @property
    def _given(self) -> dict[str, Any]:
        """What the system is made of, without what is derived of that."""
        return {name: each for name, each in vars(self).items() if name not in DERIVED}

    def _key(self) -> tuple[Any, ...]:
        """Return all by which systems differ."""
        return tuple(each for _, each in sorted(self._given.items(), key=itemgetter(0)))

    def _copy(self) -> Self:
        other: Self = object.__new__(type(self))
        other.__dict__.update(self._given)
        return other
