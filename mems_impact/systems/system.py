"""Systems defined by functions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache, cached_property
from typing import Any, Self

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.units import DIMENSIONLESS, Scales
from mems_impact.errors import InvalidParameter
from mems_impact.export.model import ExportedModel
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.definition import (
    RATE_STEP,
    Definition,
    Typical,
    automaton_of,
    ending,
    hidden_parameters,
    named_tuple,
    scaled,
    writes_into_arrays,
)
from mems_impact.hybrid.pickling import reference
from mems_impact.hybrid.problem import Problem, ProblemParameters, Section
from mems_impact.integrators.dual_numbers import Dual, copy_for_tangents
from mems_impact.integrators.options import Options
from mems_impact.systems import arguments
from mems_impact.systems.base import HybridSystem, slope_of
from mems_impact.systems.checks import FunctionChecks, Passed
from mems_impact.systems.components import assembly
from mems_impact.systems.components.assembly import AssembledSystem, Composition, assemble
from mems_impact.systems.components.base import Part, Quantity
from mems_impact.systems.observables import Observable
from mems_impact.systems.state import Mode, State
from mems_impact.systems.state_space import FunctionStateSpace
from mems_impact.systems.statistics import SystemStatistics
from mems_impact.systems.typical_scales import typical_of
from mems_impact.systems.units import Units
from mems_impact.systems.validation import CHECK_OPTIONS, check_end, check_parted, check_run

Number = float | Callable[..., float]


class System(HybridSystem):
    """A hybrid system, defined by functions that read like its equations.

    Parameters
    ----------
    states : sequence of str, or int
        Names of the components of the state, or their number (then u0, u1, …).
    flow : callable
        ``flow(mode, t, y, p)`` returns the time derivatives of the states. ``y`` and ``p`` provide
        states and parameters by name (``y.x``, ``p.omega``); ``t`` is the time since the start of
        the run; with a period, the flow is periodic and receives the time less whole periods. For
        many states, ``flow(mode, t, y, p, dy)`` writes the derivatives into ``dy``, and ``y`` is an
        array (see `mems_impact.hybrid.definition`).
    parameters : mapping of str to float, optional
        Names and values.
    guards : sequence of Guard, optional
        Events that end a mode or are recorded: `Guard` and `Impact`.
    parts : sequence of Part, optional
        Ready-made components: `Friction`, `Stopper`, `Relay`, `RateLimit`, `SwitchingSurface`.
        ``flow`` then returns the derivatives without the parts, and reads the mode of each part by
        its name (``mode.wall``).
    masses : mapping of str to float, str or callable, optional
        Masses of the bodies on which parts act, by velocity: numbers, names of parameters or
        functions of ``p``; 1 by default. If a state is the velocity relative to another body, its
        mass is given for the sum of both, ``"w + r"``.
    modes : sequence of Mode or str, optional
        All modes, from `modes`; required if there are several and no guard names a mode.
    period : float or callable, optional
        The forcing period: a number, or ``period(p)``. Without a period the functions may depend on
        time in any way, but only runs take such a system.
    switches : sequence of float or callable, optional
        Times, ascending, at which the flow is discontinuous; or ``switches(p)``. With a period the
        times lie in (0, period] and recur; without a period they are above 0, since the start of
        the run.
    switch_transition : callable, optional
        ``switch_transition(mode, t, y, p)`` returns mode and state after such a time; by default
        both are unchanged. An initial state, a sample and the end of a run at such a time are the
        state before the transition.
    constraints : mapping of mode to callable, optional
        Functions that are zero during a mode, such as the velocity of a body that sticks: ``{STUCK:
        speed}`` with ``speed(mode, t, y, p)``, or several functions. Transitions into the mode must
        make these functions zero, and the flow must keep them zero. Equilibria, multipliers and
        exponents then exclude perturbations that violate constraints. Parts define their own
        constraints.
    section : tuple of str and float, optional
        A Poincaré section: a state and its value. Crossings are recorded. The default section of a
        system with forcing is the start of the forcing period.
    initial : mapping of str to float, or State, optional
        Initial state of runs by default; missing components are 0.
    observables : sequence of Observable, optional
        Named quantities in tables and studies, in addition to the states.
    units : mapping of str to str, optional
        Units of states, parameters and ``"time"``.
    typical : mapping of str to float, optional
        Typical magnitudes of states, parameters and ``"time"``, or of units: ``{"x": 1e-6, "time":
        1e-3}``, ``{"m": 1e-6, "s": 1e-3}``. Integration and continuation then use variables scaled
        by these magnitudes, to which tolerances are relative; arguments and results remain in the
        system's units.
    cyclic : sequence of str, optional
        States on which no function depends, such as a position that only grows. Cyclic states are
        accumulated separately, and an orbit need not close in a cyclic state.
    time_scale : float or callable, optional
        Characteristic time of the motion, if it is not the period; 1 by default. Guards and flow
        are evaluated at least sixteen times in this time, or a million times since the last event.
        For an autonomous system, studies and exponents count time scales in place of forcing
        periods: give about the period of its cycles.
    name : str, optional

    Raises
    ------
    InvalidParameter
        If names repeat or are not printable, or a name, a number or a function is missing or of the
        wrong type.
    FunctionError
        If a function fails or is inconsistent in a short trial run.

    See Also
    --------
    Guard, Impact, modes, NamedValues, Friction, Stopper, simulate

    Examples
    --------
    >>> import mems_impact as mi
    >>> def fall(mode, t, y, p):
    ...     return y.v, -p.g
    >>> def height(mode, t, y, p):
    ...     return y.x
    >>> def bounce(mode, t, y, p):
    ...     return mode, (0.0, -p.e * y.v)
    >>> ball = mi.System(
    ...     states=("x", "v"), flow=fall, parameters={"g": 9.81, "e": 0.8},
    ...     guards=[mi.Impact("floor", height, bounce)], initial={"x": 1.0},
    ... )
    >>> len(mi.simulate(ball, duration=2.0).impacts)
    3
    """

    _parameters: dict[str, float]
    _period: Number | None
    _switches: Sequence[float] | Callable[..., Sequence[float]]
    _time_scale: Number | None
    _section: Section | None
    _composition: Composition
    _typical: Typical | None = None
    definition: Definition

    def __init__(
        self,
        *,
        states: Sequence[str] | int,
        flow: Callable[..., Any],
        parameters: Mapping[str, float] | None = None,
        guards: Sequence[Guard] = (),
        parts: Sequence[Part] = (),
        masses: Mapping[str, Quantity] | None = None,
        modes: Sequence[Mode | str] | None = None,
        period: Number | None = None,
        switches: Sequence[float] | Callable[..., Sequence[float]] = (),
        switch_transition: Callable[..., Any] | None = None,
        constraints: Mapping[Any, Any] | None = None,
        section: tuple[str, float] | None = None,
        initial: Mapping[str, float] | State | None = None,
        observables: Sequence[Observable] = (),
        units: Mapping[str, str] | None = None,
        typical: Mapping[str, float] | None = None,
        cyclic: Sequence[str] = (),
        time_scale: Number | None = None,
        name: str = "",
    ) -> None:
        names, flow = arguments.states(states), arguments.check_flow(flow)
        guards = arguments.guards(guards, arguments.transition_arguments(flow))
        self.name = str(name)
        self._parameters = arguments.numbers(parameters or {})
        self._period, self._switches, self._time_scale = period, switches, time_scale
        built = AssembledSystem(flow, switch_transition, guards, modes)
        if parts:
            arguments.reject_with_components(
                modes=modes, switch_transition=switch_transition, constraints=constraints
            )
            built = assemble(
                parts,
                flow=flow,
                states=names,
                parameters=tuple(self._parameters),
                masses=masses or {},
                guards=guards,
                time_scale=next(each for each in (time_scale, period, 1.0) if each is not None),
            )
            signs, start = {part.name: part.signs for part in parts}, arguments.initial(initial)
            check_parted(flow, names, self._parameters, signs, start.as_dict())
        flow, guards, self._composition = built.flow, built.guards, built.composition
        called = arguments.mode_names(built.modes, guards)
        self.definition = Definition(
            states=names,
            modes=called,
            parameters=tuple(self._parameters),
            flow=flow,
            guards=guards,
            switch_transition=arguments.check_optional(
                "switch_transition", built.switch_transition, *arguments.transition_arguments(flow)
            ),
            cyclic=arguments.state_indices("cyclic", cyclic, names),
            constrained=built.constrained,
            projection=built.projection,
            constraints=arguments.constraints(constraints, flow, called),
            forced=period is not None,
        )
        self._section = arguments.section(section, names)
        self.observables = arguments.observables(observables, names, guards)
        quantities = [each.name for each in self.observables]
        self._units = arguments.units(units, (*names, *self._parameters, *quantities))
        self._typical = None
        self._initial = arguments.initial(initial)
        arguments.check_names(
            name=[self.name],
            modes=called,
            guards=[guard.name for guard in guards],
            observables=quantities,
            **{f"unit of {name}": [unit] for name, unit in self.units.items()},
        )
        sizes = arguments.sizes(typical)
        # In the user's units, in which functions and messages count.
        problem = self.problem(CHECK_OPTIONS)
        check_run(
            self,
            self.definition,
            problem,
            self.state_space.given(problem),
            self.checks.modes,
            time=sizes.get("time"),
            initial_given=initial is not None,
        )
        if sizes:
            self._typical = typical_of(
                sizes,
                definition=self.definition,
                values=self._parameters,
                initial=self._initial.as_dict(),
                units=self._units,
                time=self._own_time(),
            )
            del self._checked_numbers, self.units  # in other units

    @property
    def parameters(self) -> dict[str, float]:
        """Names and values of all parameters, in the system's units."""
        return dict(self._parameters)

    @cached_property
    def units(self) -> Units:
        """Units of states, parameters, observables and times, and the scales of the variables."""
        names = {**self._units, **{each.name: each.unit for each in self.observables if each.unit}}
        scales, typical = Scales() if names else DIMENSIONLESS, self._typical
        if typical is None:
            return Units(names, scales, is_scaled=False)
        sizes = dict(zip(self.states, typical.states, strict=True), time=typical.time)
        sizes |= zip(self._parameters, typical.parameters, strict=True)
        return Units(names, scales, typical=typical, sizes=sizes)

    @property
    def statistics(self) -> SystemStatistics:
        """Statistics of runs, orbits and attractors, by the names of tables."""
        return SystemStatistics(self, self._state, self._to_user)

    @property
    def state_space(self) -> FunctionStateSpace:
        """Its states: names, modes, conversion from and to scaled states."""
        return FunctionStateSpace(self, self._composition, self._state, self._to_user)

    @property
    def checks(self) -> FunctionChecks:
        """Checks of its functions, before and along motions."""
        system = self.without_until  # an `until` function is only a margin
        times = self._period, self._switches, self._time_scale
        functions = self._composition, self._state, self._to_user
        return FunctionChecks(system, system._passed, times, *functions)

    @cached_property
    def _passed(self) -> Passed:
        return Passed()

    @property
    def initial(self) -> State:
        """Initial state of runs by default."""
        return self._initial

    def shifted(self, values: Mapping[str, float]) -> Self:
        """Return the system at other values, allowed or not, for continuation."""
        other = self._copy()
        other._parameters = {**self._parameters, **arguments.numbers(values)}
        return other

    def restored(
        self, values: Mapping[str, float], scales: Scales, typical: Typical | None = None
    ) -> Self:
        """Return the system at the values and scales of a file."""
        other = self.shifted(values)
        other._typical = typical
        return other

    @property
    def functions(self) -> dict[str, str]:
        """Where its functions are defined, as ``module:name``, for display."""
        definition = self.definition
        functions: dict[str, Any] = {
            "flow": definition.flow,
            "switch_transition": definition.switch_transition,
            "period": self._period,
            "switches": self._switches,
            "time_scale": self._time_scale,
        }
        for guard in definition.guards:
            for role in ("margin", "transition", "rest"):
                functions[f"{role} of {guard.name}"] = getattr(guard, role)
        for i, (mode, constraint) in enumerate(definition.constraints):
            functions[f"constraint {i} of {definition.modes[mode]}"] = constraint
        functions |= {f"observable {each.name}": each.function for each in self.observables}
        return {
            role: reference(function)
            for role, function in functions.items()
            if callable(function)
            and function.__module__ != assembly.__name__  # generated for parts
        }

    def ending(self, until: Callable[..., float]) -> System:
        """Return the system whose runs end where ``until(mode, t, y, p)`` falls through zero."""
        other = self._copy()
        vars(other)["_unended"] = self
        arguments.function("until", until, *arguments.ARGUMENTS)
        other.definition = ending(self.definition, until)
        problem = self.problem(CHECK_OPTIONS)
        check_end(other.definition, problem, self.state_space.given(problem))
        return other

    @property
    def automaton(self) -> Automaton:
        """Modes, flow, guards and transitions, in the form that the event loop takes."""
        if self._typical is None:
            return automaton_of(self.definition)
        return automaton_of(scaled(self.definition, self._typical))

    @property
    def section(self) -> Section | None:
        """The Poincaré section: component, level, direction; in scaled units."""
        if self._section is None:
            return None
        state, level, direction = self._section
        return state, self.units.into(self.states[state], level), direction

    def numbers(self, changes: Mapping[str, float] | None = None) -> ProblemParameters:
        """Return the part of the problem that depends on the parameters, in scaled units.

        Parameters
        ----------
        changes : mapping of str to float, optional
            Other values of some parameters, in the system's units, allowed or not, as finite
            differences and trial steps need them.
        """
        p = self._named({**self._parameters, **(changes or {})}.values())
        return self._with_times(self._to_internal(p), self._times(p), 1.0)

    def _number_rates(self, name: str, changes: Mapping[str, float]) -> ProblemParameters | None:
        """Return the derivatives of `numbers` by a scaled parameter, exact to rounding.

        None if a function of the times does not take numbers with tangents.
        """
        if type(self).numbers is not System.numbers:
            return None
        values: dict[str, Any] = {**self._parameters, **changes}
        values[name] = Dual(values[name], self.units.factor(name))
        try:
            period, scale, switches = self._times(self._named(values.values()), copy_for_tangents)
        except Exception:  # differences report the errors of functions
            return None
        slopes = slope_of(period), slope_of(scale), tuple(map(slope_of, switches))
        return self._with_times(np.array([float(each == name) for each in values]), slopes, 0.0)

    def _times(
        self, p: Any, form: Callable[[Any], Any] = lambda function: function
    ) -> tuple[Any, Any, tuple[Any, ...]]:
        """Return forcing period, time scale and switching times, by a form of their functions."""
        period, scale, switches = (
            form(each) if callable(each) else each
            for each in (self._period, self._time_scale, self._switches)
        )
        time = self.units.factor("time")
        return (
            _in_units(arguments.number("period", period, p), time),
            _in_units(arguments.number("time_scale", scale, p), time),
            tuple(switch / time for switch in arguments.times("switches", switches, p)),
        )

    def _with_times(
        self, p: Floats, times: tuple[Any, Any, tuple[Any, ...]], default: float
    ) -> ProblemParameters:
        """Return the numbers of a problem from scaled parameters and times."""
        period, scale, switches = times
        unit = scale if scale is not None else period if period is not None else default
        tail = np.zeros(_hidden_parameters(self.definition))
        tail[0] = RATE_STEP * unit
        return ProblemParameters(
            parameters=np.concatenate([p, tail]),
            period=period if period is not None else unit,
            switches=switches,
            time_scale=scale,
        )

    @cached_property
    def _checked_numbers(self) -> ProblemParameters:
        for limit in self._composition.limits:
            limit.check(self._named(self._parameters.values()))
        return super()._checked_numbers

    def _export_model(
        self,
        inputs: Sequence[str] = (),
        initial: State | Mapping[str, float] | None = None,
        options: Options | None = None,
    ) -> ExportedModel:
        """Return the system as plain data for export."""
        from mems_impact.export.generated_source import automaton_with_source

        automaton, generated = automaton_with_source(self.definition, self._typical)
        model = super()._export_model(inputs, initial, options)
        for name in inputs:
            changed = {**self._parameters, name: self._parameters[name] * 1.001 or 0.001}
            if self._period_of(changed) != self.forcing_period:
                problem = "the forcing period depends on it, and is constant during a run"
                raise InvalidParameter("inputs", name, "", problem=problem)
        return replace(
            model,
            automaton=automaton,
            generated=generated,
            mode_of=self._composition.begin,
            period=_function_or_none(self._period),
            time_scale=_function_or_none(self._time_scale),
            switches=_function_or_none(self._switches),
            rate_step_index=len(self._parameters),
        )

    @cached_property
    def _parameter_indices(self) -> Mapping[str, int]:
        """Indices of the parameters in the parameter array."""
        return {name: i for i, name in enumerate(self._parameters)}

    @property
    def forced(self) -> bool:
        """Whether the system has a forcing period; a function that defines it is not called."""
        return self._period is not None

    @property
    def forcing_period(self) -> float | None:
        """The forcing period; None for an autonomous system."""
        return self._period_of(self._parameters)

    def _period_of(self, parameters: Mapping[str, float]) -> float | None:
        """Return the forcing period at these parameters; None for an autonomous system."""
        return arguments.number("period", self._period, self._named(parameters.values()))

    def _named(self, values: Iterable[float]) -> Any:
        return named_tuple("Parameters", tuple(self._parameters))(*values)

    def _state(self, y: Floats) -> Any:
        """Return a state by name, or as a list for functions that take an array."""
        values = (y if self._typical is None else y * np.array(self._typical.states)).tolist()
        if writes_into_arrays(self.definition.flow):
            return values
        return named_tuple("State", self.states)(*values)

    def _to_internal(self, p: Any) -> Floats:
        """Return parameters in scaled units."""
        values = np.array(p, dtype=float)
        return values if self._typical is None else values / np.array(self._typical.parameters)

    def _to_user(self, problem: Problem) -> Any:
        """Return the parameters of a problem by name, as functions read them."""
        values = problem.parameters[: len(self._parameters)]
        if self._typical is not None:
            values = values * np.array(self._typical.parameters)
        return self._named(values.tolist())

    def _own_time(self) -> float:
        """Return a characteristic time of the system, if known."""
        p = self._named(self._parameters.values())
        scale = arguments.number("time_scale", self._time_scale, p)
        period = arguments.number("period", self._period, p)
        return scale or (period or 2.0 * math.pi) / (2.0 * math.pi)


def _function_or_none(value: Any) -> Any:
    return value if callable(value) else None


def _in_units(value: float | None, unit: float) -> float | None:
    return None if value is None else value / unit


# Differences by parameters and corrections of equilibria need it thousands of times.
_hidden_parameters = cache(hidden_parameters)
