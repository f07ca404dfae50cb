"""The interface of a hybrid system, used by runs, orbits, studies, tables and figures."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from numbers import Integral
from operator import itemgetter
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact._util.limits import UNLIMITED, Limits
from mems_impact._util.units import Scales
from mems_impact.errors import InvalidParameter, RunError
from mems_impact.export.model import ExportedModel, ExportedNumber
from mems_impact.hybrid.attractors.mapper import CompiledObservables, RecurrenceColumns
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.definition import Definition, Typical
from mems_impact.hybrid.event_loop.workspace import whole_periods
from mems_impact.hybrid.pickling import portable
from mems_impact.hybrid.problem import Problem, ProblemParameters, Section, check_times
from mems_impact.hybrid.simulation import MAX_CYCLE, Events, Trajectory
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.dual_numbers import Dual
from mems_impact.integrators.options import Options
from mems_impact.orbits.family import Family
from mems_impact.systems import observables as quantity
from mems_impact.systems.observables import (
    EventObserver,
    Observable,
    Quantity,
)
from mems_impact.systems.result import Result, deep_equal
from mems_impact.systems.state import State, is_number, state_from
from mems_impact.systems.typical_scales import warn_if_badly_scaled_orbit
from mems_impact.systems.units import Units
from mems_impact.systems.window_statistics import StatisticsAccumulator, TimeWindow
from mems_impact.tables import unit_of

__all__ = ["Conversion", "HybridSystem", "SystemFamily", "conversion"]

PHASE_RTOL = 1e-12  # of a time, within which it has a phase


@cache
def cached_names(kind: type) -> frozenset[str]:
    """Return the names of the cached properties of a class."""
    spaces = (vars(base).items() for base in kind.__mro__)
    return frozenset(
        name for space in spaces for name, each in space if isinstance(each, cached_property)
    )


def slope_of(number: Any) -> Any:
    """Return the tangent of a number, zero if it has none; of None, None."""
    return number.slope if isinstance(number, Dual) else None if number is None else 0.0


@dataclass(frozen=True)
class SystemFamily(Family):
    """The problems of a system for all values of its parameters, in scaled units."""

    system: HybridSystem
    options: Options

    @property
    def automaton(self) -> Automaton:
        """The automaton, the same for all values."""
        return self.system.automaton

    def problem(self) -> Problem:
        """Return the problem at the present values."""
        return self._problem

    @cached_property
    def _problem(self) -> Problem:
        return self.system.at(self.values).problem(self.options)

    def with_method(self, method: str) -> SystemFamily:
        """Return the family integrated by another method."""
        other = replace(self, options=replace(self.options, method=method))
        vars(other)["_problem"] = replace(self._problem, options=other.options)
        return other

    def numbers(self, /, **changes: float) -> ProblemParameters:
        """Return the part of the problem that depends on the values."""
        return self.system.numbers(self._changes(changes))

    def derivative(self, name: str) -> tuple[Floats, float, Floats]:
        """Return the derivatives of parameter array, period and switching times by a value."""
        rates = self.system.number_rates(name, self._changes({}))
        if rates is None:
            return super().derivative(name)
        return rates.parameters, rates.period, np.array(rates.switches)

    def _changes(self, changes: Mapping[str, float]) -> dict[str, float]:
        """Return the parameters that differ from the system's, in its units."""
        system = self.system
        return system.parameter_changes({**self.values, **changes}, system.internal_parameters)

    def amount(self, heading: str, value: float) -> str:
        """Return a number in the system's units, as text."""
        return self.system.units.amount(heading, value)

    def convert(self, error: RunError) -> None:
        """Convert the numbers in an error of a run to the system's units."""
        error.convert(self.system.units, forced=self.system.forced)


class HybridSystem(Result, ABC):
    """A hybrid system: smooth modes, guards and transitions.

    Three classes implement it: `System` by functions, `ActuatorSystem` by an actuator and a drive,
    `DetachedSystem` by the description in a file. Arguments and results are in the system's units;
    computations use variables scaled by the scales of `units`.

    See Also
    --------
    System, Actuator, find_orbit

    Examples
    --------
    >>> import mems_impact as mi
    >>> system = mi.load_actuator("zhao2004").under(mi.Sine(amplitude=0.24, omega=0.5))
    >>> isinstance(system, mi.HybridSystem)
    True
    """

    name: str
    observables: tuple[Observable, ...]
    definition: Definition | None = None
    """The user's functions, with states, parameters and modes; None for other classes."""
    typical: Typical | None = None
    """Typical magnitudes given by the user, by which variables are scaled."""

    run_type: ClassVar[Any] = None
    """The class of its runs; a subclass may add tables."""
    orbit_type: ClassVar[Any] = None
    """The class of its orbits; a subclass may add tables."""
    mode_by_switch: ClassVar[bool] = False
    """Whether the transition at a switch determines the mode of a state."""

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
    def mode_of(self, y: Floats, time: float, problem: Problem, mode: int = 0) -> int:
        """Return the mode of a state whose mode is not given."""

    @property
    @abstractmethod
    def functions(self) -> dict[str, str]:
        """Where its functions are defined, as ``module:name``, for display."""

    @abstractmethod
    def numbers(self, changes: Mapping[str, float] | None = None) -> ProblemParameters:
        """Return the part of the problem that depends on the parameters, in scaled units.

        Parameters
        ----------
        changes : mapping of str to float, optional
            Other values of some parameters, in the system's units, allowed or not, as finite
            differences and trial steps need them.
        """

    def number_rates(self, name: str, changes: Mapping[str, float]) -> ProblemParameters | None:
        """Return the derivatives of `numbers` by a scaled parameter; None if they are unknown."""
        if name not in self._indices:
            values: dict[str, Any] = {name: self.parameters[name], **changes}
            values[name] = Dual(values[name], self.units.factor(name))
            try:
                numbers = self.numbers(values)
            except Exception:  # differences report errors
                return None
            rates = np.array([slope_of(each) for each in numbers.parameters])
            times = numbers.period, *numbers.switches
            period, *switches = (slope_of(each) for each in times)
            return ProblemParameters(rates, period, tuple(switches), None)
        numbers = self._checked_numbers
        rates = np.zeros(len(numbers.parameters))
        rates[self._indices[name]] = 1.0
        return ProblemParameters(rates, 0.0, (0.0,) * len(numbers.switches), None)

    @cached_property
    def _indices(self) -> Mapping[str, int]:
        """Indices of the parameters that occur in the parameter array, and nowhere else."""
        return self.parameter_indices

    @abstractmethod
    def shifted(self, values: Mapping[str, float]) -> Self:
        """Return the system at other values, allowed or not, for continuation."""

    @abstractmethod
    def restored(
        self, values: Mapping[str, float], scales: Scales, typical: Typical | None = None
    ) -> Self:
        """Return the system at the values and scales of a file."""

    @abstractmethod
    def ending(self, until: Callable[..., float]) -> HybridSystem:
        """Return the system whose runs end where ``until(mode, t, y, p)`` falls through zero."""

    @abstractmethod
    def evaluate_observable(self, observable: Observable, y: Floats, problem: Problem) -> float:
        """Return an observable at a scaled state."""

    @abstractmethod
    def evaluate_event_observable(
        self, observable: Observable, events: Events, i: int, problem: Problem
    ) -> float:
        """Return an observable at an event in scaled units."""

    @property
    @abstractmethod
    def observed(self) -> CompiledObservables:
        """The observables that studies record, as one function of scaled states."""

    @abstractmethod
    def gatherer(
        self, problem: Problem, start: HybridState, window: TimeWindow
    ) -> StatisticsAccumulator:
        """Return the accumulator of the statistics of a run."""

    @abstractmethod
    def measures(
        self, settled: RecurrenceColumns, periods: Floats, out: Conversion
    ) -> dict[str, Floats]:
        """Return the statistics of attractors that studies write, by heading.

        Parameters
        ----------
        settled : RecurrenceColumns
        periods : float array, shape (points,)
            Lengths of the statistics: in forcing periods, or in the unit of time of tables.
        out : Conversion
            The conversion of columns to the units of tables.
        """

    @property
    @abstractmethod
    def measure_names(self) -> tuple[str, ...]:
        """The headings of `measures`."""

    def fits(self, mode: int, y: Floats, problem: Problem) -> bool:
        """Return whether a state satisfies the constraints of a mode: on its surface, at rest."""
        automaton = problem.automaton
        if mode in automaton.constrained:  # the projection keeps the mode
            p = np.asarray(problem.parameters, dtype=float)
            return automaton.state_after(mode, automaton.switch_code, 0.0, y, p)[0] == mode
        return self.mode_of(y, 0.0, problem, mode) == mode

    @property
    def without_until(self) -> Any:
        """The system without the `until` function that ended its run (see `simulate`)."""
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
        """The states that vary on the section."""
        hidden = {self.states[i] for i in self.automaton.cyclic}
        if self.section is not None:
            hidden.add(self.states[self.section[0]])
        return tuple(name for name in self.states if name not in hidden)

    @property
    def forced(self) -> bool:
        """Whether the system has a forcing period."""
        return self.forcing_period is not None

    def state_from(self, components: State | Mapping[str, Any], field: str = "initial") -> State:
        """Return the state with components of these names, which may be texts with units.

        Raises
        ------
        InvalidParameter
            If `components`, named `field` in the error, is neither a state nor a mapping.
        """
        if isinstance(components, State):
            return components
        if not isinstance(components, Mapping):
            allowed = f"a State({self.states[0]}=…), or a mapping of names to numbers"
            raise InvalidParameter(field, components, allowed)
        known = (*self.states, "time")
        return state_from(
            {
                name: self.units.parse(name, value) if name in known else value
                for name, value in components.items()
            }
        )

    def check_parameter(self, name: str, field: str = "parameter") -> None:
        """Raise InvalidParameter unless `name` is a parameter."""
        if name not in self.parameters:
            raise InvalidParameter(field, name, f"one of {', '.join(self.parameters)}")

    def value(self, name: str) -> float:
        """Return a parameter in the system's units."""
        return self.parameters[name]

    @cached_property
    def internal_parameters(self) -> dict[str, float]:
        """Names and values of all parameters, in scaled units."""
        return {name: self.units.into(name, value) for name, value in self.parameters.items()}

    def parameter_changes(
        self, inner: Mapping[str, float], current: Mapping[str, float]
    ) -> dict[str, float]:
        """Return the parameters that differ between two scaled sets, in the system's units."""
        return {
            name: self.units.out(name, value)
            for name, value in inner.items()
            if value != current[name]
        }

    def hybrid_state(
        self,
        state: State | Mapping[str, float] | None,
        problem: Problem,
        field: str = "initial",
        start: float | None = None,
    ) -> HybridState:
        """Return the initial condition of a run from `state`, in scaled units.

        `field` is the name of the argument in errors, `start` the time at which the run begins.

        Raises
        ------
        InvalidParameter
            If the state has unknown components, an unknown mode, or a time beyond the period.
        """
        state = self.initial if state is None else self.state_from(state, field)
        self._check_state(field, state)
        values = {**dict.fromkeys(self.states, 0.0), **self.initial.as_dict(), **state.as_dict()}
        y = np.array([self.units.into(name, values[name]) for name in self.states], dtype=float)
        time = self.units.into("time", state.time)
        if self.forced and not state.time < self.units.out("time", problem.period):
            period, unit = self.units.out("time", problem.period), self.units.get("time", "")
            raise InvalidParameter(
                "time", state.time, f"below the forcing period {period:g} {unit}".rstrip()
            )
        if not self.forced and state.time != 0.0:
            allowed = "0: the system has no forcing period; give start="
            raise InvalidParameter("time", state.time, allowed)
        time = min(time, math.nextafter(problem.period, 0.0))  # scaling may round it up
        cycle = 0
        if start is not None:
            cycle, time = self._instant(start, time, problem.period)
        mode = state.mode if state.mode is not None else self.initial.mode
        now = time if self.forced else cycle * problem.period + time
        if mode is None:
            begin = HybridState(cycle, time, self.mode_of(y, now, problem), y)
        else:
            begin = self.start_in(self.mode_number(mode), now, y, problem)
        return replace(
            begin, cycle=cycle, time=time, initial=state._initial, waiting=state._waiting
        )

    def _instant(self, start: float, phase: float, period: float) -> tuple[int, float]:
        """Return the period in which a run begins, and the time since its start.

        The phase of the initial state, unless zero, must be the phase of the start.
        """
        value = self.units.parse("time", start, "start")
        if not is_number(value):
            raise InvalidParameter("start", start, "a finite number")
        time = self.units.into("time", value)
        if not abs(time) < MAX_CYCLE * period:
            allowed = f"within {self.units.out('time', MAX_CYCLE * period):.3g}"
            raise InvalidParameter("start", start, allowed)
        cycle = round((time - phase) / period)
        if abs(cycle * period + phase - time) <= PHASE_RTOL * max(period, abs(time)):
            return cycle, phase
        if phase != 0.0:
            whole, unit = self.units.out("time", period), self.units.get("time", "")
            allowed = (
                f"the phase of the initial state, plus whole periods of {whole:.9g} {unit}".rstrip()
            )
            raise InvalidParameter("start", start, allowed)
        cycle = whole_periods(time, period)
        return cycle, time - cycle * period

    def start_in(self, mode: int, time: float, y: Floats, problem: Problem) -> HybridState:
        """Return the initial condition of a run from a state whose mode is given."""
        return HybridState(0, time, mode, y)

    def state_of(self, instant: HybridState) -> State:
        """Return a scaled instant as a state in the system's units."""
        values = zip(self.states, instant.y.tolist(), strict=True)
        return state_from(
            {name: self.units.out(name, value) for name, value in values},
            time=float(self.units.out("time", instant.time)) if self.forced else 0.0,
            mode=self.modes[instant.mode] if len(self.modes) > 1 else None,
            initial=instant.initial,
            waiting=instant.waiting,
        )

    def mode_number(self, mode: str | int, field: str = "mode") -> int:
        """Return the number of a mode; InvalidParameter if there is no such mode."""
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
        """The states by which sweeps and branches display an orbit, at its section."""
        return self.section_states

    @property
    def sweep_statistics(self) -> tuple[str, ...]:
        """The statistics in the table of a sweep."""
        counted = "period" if self.forced else "time"
        return (f"impacts per {counted}", *(each.name for each in self.observables))

    @property
    def quantities(self) -> Mapping[str, tuple[str, str]]:
        """The statistics that a figure of a sweep can show: column and label, by a short name."""
        return {each.name: (each.name, each.name) for each in self.observables}

    @property
    def study_observables(self) -> tuple[Observable, ...]:
        """The observables that studies record."""
        return self.observables

    @property
    def time_functions(self) -> tuple[Callable[..., Any], ...]:
        """The user's functions of the parameters that give times, such as the forcing period."""
        return ()

    def observable_codes(self, observable: Observable) -> tuple[int, ...]:
        """Return the codes of the transitions at which studies evaluate an observable."""
        guards = [guard.name for guard in self.automaton.guards]
        numbers = tuple(guards.index(name) for name in observable.at)
        return (*numbers, *(len(guards) + number for number in numbers))

    @property
    def symbols(self) -> Mapping[str, str]:
        """Symbols of parameters in figures, where they differ from the names."""
        return {}

    def derived_columns(
        self, cycle: NDArray[np.int64], time: Floats, y: Floats
    ) -> Mapping[str, Floats]:
        """Return further columns of tables of states, in scaled units.

        Parameters
        ----------
        cycle : int array, shape (k,)
            Numbers of the periods.
        time : float array, shape (k,)
            Times since the starts of the periods.
        y : float array, shape (k, n)
        """
        return {}

    def start_of(self, direction: str) -> State:
        """Return the default initial state of a sweep "up" or "down"."""
        return self.initial

    def moves(self, instant: HybridState) -> bool:
        """Return whether statistics need the state within an arc."""
        return any(not each.at for each in self.observables)

    @property
    def orbit_quantities(self) -> tuple[Quantity, ...]:
        """The quantities of an orbit that `sensitivity` and `optimize` differentiate.

        The gain per period of each cyclic state, the observables (over the orbit, as in the tables
        of branches), the period of a limit cycle, the largest impact speed, the closest approach,
        and the largest modulus of a multiplier.
        """
        units, states = self.units, self.states
        cyclic = [states[i] for i in self.automaton.cyclic]
        each = "period" if self.forced else "cycle"
        quantities: list[Any] = [
            Quantity(
                f"{state} per {each}", partial(quantity.gain, state=state), unit_of(state, units)
            )
            for state in cyclic
        ]
        quantities += [
            Quantity(
                other.name,
                partial(quantity.observable, name=other.name),
                unit_of(other.name, units),
            )
            for other in self.observables
        ]
        if not self.forced:
            quantities.append(Quantity("period", quantity.period, unit_of("time", units)))
        if any(guard.impact for guard in self.automaton.guards):
            quantities.append(
                Quantity("impact speed", quantity.impact_speed, unit_of("impact speed", units))
            )
            closest = "closest approach"
            quantities.append(Quantity(closest, quantity.closest_approach, unit_of(closest, units)))
        return (*quantities, quantity.MULTIPLIER)

    def changed(self, /, **values: float) -> Self:
        """Return the system with other values of some parameters.

        Parameters
        ----------
        **values : float or str
            Numbers, or texts with units where the system has units.

        Raises
        ------
        InvalidParameter
            If a name is not a parameter of the system, or a value is not a number.
        """
        for name in values:
            self.check_parameter(name)
        other = self.shifted({name: self.units.parse(name, v) for name, v in values.items()})
        other._checked_numbers  # noqa: B018 - raises if they are not allowed
        return other

    @property
    def is_data_only(self) -> bool:
        """Whether names and numbers define the system completely; a file cannot hold functions."""
        return False

    def check_recurrence(self) -> None:
        """Raise FunctionError or InvalidParameter if time rules out periodic motions."""

    def check_forcing(self, trajectory: Trajectory) -> None:
        """Raise FunctionError unless the functions of the forcing are periodic along a run."""

    def standstill_test(self) -> Callable[[Trajectory], float | None]:
        """Return a test for standstill: the number of periods after which a run rests, or None."""
        problem = "for actuators only; give a function (mode, t, y, p) that falls through zero"
        raise InvalidParameter("until", "still", "", problem=problem)

    def validity(self, problem: Problem, start: HybridState) -> EventObserver | None:
        """Return an observer that warns if a run leaves the range of validity of the model."""
        return None

    def snap_to_mode(self, mode: int, y: Floats) -> Floats:
        """Return a state found by Newton's method with its constraints satisfied exactly."""
        return y

    def check_continued(self, name: str) -> None:
        """Raise InvalidParameter unless orbits can be continued in the parameter `name`."""
        self.check_parameter(name)

    def family(self, options: Options) -> Family:
        """Return the problems for all values of the parameters, in scaled units."""
        if not self.units.is_scaled and self.forced:
            warn_if_badly_scaled_orbit(self._checked_numbers.period)
        return SystemFamily(self.internal_parameters, self, options)

    def at(self, inner: Mapping[str, float]) -> Self:
        """Return the system at scaled values of the parameters, allowed or not."""
        changes = self.parameter_changes(inner, self.internal_parameters)
        return self.shifted(changes) if changes else self

    def problem(self, options: Options) -> Problem:
        """Return the problem that the event loop integrates, in scaled units."""
        return Problem(
            automaton=self.automaton,
            section=self.section,
            options=options,
            discontinuity_check=self.discontinuity_check,
            mode_failure=self.mode_failure,
            **self._checked_numbers._asdict(),
        )

    @property
    def checked_modes(self) -> set[int]:
        """The modes in which the user's functions have been validated; mutable."""
        return set()

    @property
    def user_transitions(self) -> frozenset[str]:
        """The names of the guards whose transitions are functions of the user."""
        return frozenset()

    @property
    def discontinuity_check(self) -> Callable[[HybridState, float], bool] | None:
        """Check for a discontinuity of the flow where steps become very short, if there is one."""
        return None

    @property
    def mode_failure(self) -> Callable[[int, HybridState], tuple[str, str]] | None:
        """Function that returns why no mode fits a state, and the remedy; or None."""
        return None

    def other_mode(self, start: HybridState, problem: Problem) -> int:
        """Return the mode of another motion from the start on a switching surface, or -1."""
        return -1

    def warn_of_expansion(self, trajectory: Trajectory) -> None:
        """Warn if a run slides on switching surfaces around which motions may expand."""

    @cached_property
    def _checked_numbers(self) -> ProblemParameters:
        """The part of the problem that depends on the parameters, shared by all problems."""
        numbers = self.numbers()
        size, unit = self.units.factor("time"), self.units.get("time", "")
        check_times(numbers, size, unit, forced=self.forced)
        return numbers

    def to_fmu(
        self,
        path: str | PathLike[str],
        *,
        fmi: str = "3.0",
        inputs: Sequence[str] = (),
        initial: State | Mapping[str, float] | None = None,
        options: Options | None = None,
    ) -> Path:
        """Write the system as a functional mock-up unit (FMU), for other simulation tools.

        The FMU contains the flow, the guards and the transitions as C source, translated from the
        Python functions, with the package's event loop, for model exchange and co-simulation; and
        a binary for this platform if a C compiler is available.

        Parameters
        ----------
        path : str or os.PathLike
            Name of the file, usually with the suffix ``.fmu``.
        fmi : {"3.0", "2.0"}, optional
            Version of the standard.
        inputs : sequence of str, optional
            Parameters that become inputs, except parameters of the forcing period. Co-simulation
            holds inputs between communication points.
        initial : State or mapping of str to float, optional
            Initial state; by default the initial state of the system.
        options : Options, optional
            Tolerances of co-simulation. Its method is DOP853.

        Returns
        -------
        Path

        Raises
        ------
        InvalidParameter
            If an argument is not allowed.
        FunctionError
            If a function cannot be translated to C; the message names the line.

        See Also
        --------
        System, simulate

        Examples
        --------
        >>> import mems_impact as mi
        >>> system = mi.load_actuator("zhao2004").under(mi.Sine(amplitude=0.24, omega=0.5))
        >>> system.to_fmu("actuator.fmu").name
        'actuator.fmu'
        """
        from mems_impact.export.fmu import write_fmu

        return write_fmu(path, self.export_model(inputs, initial, options), fmi)

    def export_model(
        self,
        inputs: Sequence[str] = (),
        initial: State | Mapping[str, float] | None = None,
        options: Options | None = None,
    ) -> ExportedModel:
        """Return the system as plain data for export."""
        chosen = Options() if options is None else options
        if not isinstance(chosen, Options):
            raise InvalidParameter("options", chosen, "Options(…)")
        if chosen.method not in (None, "dop853"):
            raise InvalidParameter("method", chosen.method, "'dop853' for export")
        if isinstance(inputs, str):
            raise InvalidParameter("inputs", inputs, "a sequence of names: ('force',)")
        problem = self.problem(replace(chosen, method="dop853"))
        start = self.hybrid_state(initial, problem)
        indices = self.parameter_indices
        numbers = tuple(
            ExportedNumber(
                name=name,
                value=value,
                unit=self.units.get(name, ""),
                factor=self.units.factor(name),
                index=indices.get(name),
                limits=self.limits(name),
            )
            for name, value in self.parameters.items()
        )
        settable = [number.name for number in numbers if number.index is not None]
        for name in inputs:
            if name not in settable:
                raise InvalidParameter("inputs", name, f"among {', '.join(settable)}")
        states = self.automaton.states
        return ExportedModel(
            name=self.name,
            automaton=self.automaton,
            problem=problem,
            initial=start,
            numbers=numbers,
            state_units=tuple(self.units.get(name, "") for name in states),
            state_factors=tuple(float(self.units.out(name, 1.0)) for name in states),
            time_unit=unit_of("time", self.units),
            time_factor=float(self.units.out("time", 1.0)),
            start_time=float(self.units.out("time", start.time)),
            inputs=tuple(inputs),
            mode_by_switch=self.mode_by_switch,
        )

    def limits(self, name: str) -> Limits:
        """Return the range of a parameter."""
        return UNLIMITED

    @property
    def parameter_indices(self) -> Mapping[str, int]:
        """Indices in the parameter array of the parameters that occur in it as they stand."""
        return {}

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={value:.6g}" for name, value in self.parameters.items())
        return f"{type(self).__name__}({self.name or ', '.join(self.states)}; {values})"

    def summary(self) -> dict[str, Any]:
        """Return states, modes, guards and parameters."""
        return {
            "states": ", ".join(self.states),
            "modes": ", ".join(self.modes),
            "guards": ", ".join(guard.name for guard in self.automaton.guards),
            **{self.units.label(name): value for name, value in self.parameters.items()},
        }

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, HybridSystem):
            return NotImplemented
        return type(self) is type(other) and deep_equal(self._key(), other._key())

    def __hash__(self) -> int:  # type: ignore[override]
        return hash((type(self), *self.parameters.items()))

    def __copy__(self) -> Self:
        return self  # immutable

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self

    def __getstate__(self) -> dict[str, Any]:
        """Return the pickled state, with functions that another process can load."""
        state: dict[str, Any] = portable(self._given)
        return state

    @property
    def _given(self) -> dict[str, Any]:
        """The defining attributes of the system, without cached values."""
        cached = cached_names(type(self))
        return {name: each for name, each in vars(self).items() if name not in cached}

    def _key(self) -> tuple[Any, ...]:
        """Return the key by which systems are compared."""
        return tuple(each for _, each in sorted(self._given.items(), key=itemgetter(0)))

    def _copy(self) -> Self:
        other: Self = object.__new__(type(self))
        other.__dict__.update(self._given)
        return other


Conversion = Callable[[str, Any], Any]
"""Conversion of a number or a column of that heading to the units of tables."""


def conversion(systems: Sequence[HybridSystem]) -> Conversion:
    """Return the conversion of columns that have a row for each of some systems."""
    first = systems[0]
    if all(system.units.scales == first.units.scales for system in systems):
        return first.units.out

    def out(heading: str, value: Any) -> Any:
        unit = unit_of(heading, first.units)
        return value * np.array([system.units.scales.factors.get(unit, 1.0) for system in systems])

    return out
