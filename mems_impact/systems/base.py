"""The interface of a hybrid system, used by runs, orbits, studies, tables and figures."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from operator import itemgetter
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.limits import UNLIMITED, Limits
from mems_impact._util.units import Scales
from mems_impact.errors import InvalidParameter, RunError
from mems_impact.export.model import ExportedModel, ExportedNumber
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.definition import Typical
from mems_impact.hybrid.pickling import portable
from mems_impact.hybrid.problem import Problem, ProblemParameters
from mems_impact.integrators.dual_numbers import Dual
from mems_impact.integrators.options import Options
from mems_impact.orbits.family import Family
from mems_impact.systems.checks import Checks
from mems_impact.systems.description import SystemDescription
from mems_impact.systems.result import deep_equal
from mems_impact.systems.state import State
from mems_impact.systems.state_space import StateSpace
from mems_impact.systems.statistics import SystemStatistics
from mems_impact.systems.typical_scales import warn_if_badly_scaled_orbit
from mems_impact.systems.units import Conversion
from mems_impact.tables import unit_of


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
        return system_at(self.system, self.values).problem(self.options)

    def with_method(self, method: str) -> SystemFamily:
        """Return the family integrated by another method."""
        other = replace(self, options=replace(self.options, method=method))
        vars(other)["_problem"] = replace(self._problem, options=other.options)
        return other

    def numbers(self, /, **changes: float) -> ProblemParameters:
        """Return the part of the problem that depends on the values."""
        if not changes and "_problem" in vars(self):
            return self._problem.numbers
        return self.system.numbers(self._changes(changes))

    def derivative(self, name: str) -> tuple[Floats, float, Floats]:
        """Return the derivatives of parameter array, period and switching times by a value."""
        rates = self.system._number_rates(name, self._changes({}))
        if rates is None:
            return super().derivative(name)
        return rates.parameters, rates.period, np.array(rates.switches)

    def _changes(self, changes: Mapping[str, float]) -> dict[str, float]:
        """Return the parameters that differ from the system's, in its units."""
        return _changes(self.system, {**self.values, **changes})

    def amount(self, heading: str, value: float) -> str:
        """Return a number in the system's units, as text."""
        return self.system.units.amount(heading, value)

    def convert(self, error: RunError) -> None:
        """Convert the numbers in an error of a run to the system's units."""
        error.convert(self.system.units, forced=self.system.forced)


class HybridSystem(SystemDescription):
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

    _run_type: ClassVar[Any] = None
    """The class of its runs; a subclass may add tables."""
    _orbit_type: ClassVar[Any] = None
    """The class of its orbits; a subclass may add tables."""

    @property
    @abstractmethod
    def statistics(self) -> SystemStatistics:
        """Statistics of runs, orbits and attractors, by the names of tables."""

    @property
    @abstractmethod
    def state_space(self) -> StateSpace:
        """Its states: names, modes, conversion from and to scaled states."""

    @property
    @abstractmethod
    def checks(self) -> Checks:
        """Checks of its functions, before and along motions."""

    @property
    @abstractmethod
    def functions(self) -> dict[str, str]:
        """Where its functions are defined, as ``module:name``, for display."""

    def _number_rates(self, name: str, changes: Mapping[str, float]) -> ProblemParameters | None:
        """Return the derivatives of `numbers` by a scaled parameter; None if they are unknown."""
        if name not in self._parameter_indices:
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
        rates[self._parameter_indices[name]] = 1.0
        return ProblemParameters(rates, 0.0, (0.0,) * len(numbers.switches), None)

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

    @property
    def without_until(self) -> Any:
        """The system without the `until` function that ended its run (see `simulate`)."""
        return vars(self).get("_unended", self)

    @cached_property
    def _scaled_parameters(self) -> dict[str, float]:
        """Names and values of all parameters, in scaled units."""
        return {name: self.units.into(name, value) for name, value in self.parameters.items()}

    def changed(self, /, **values: float | str) -> Self:
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
    def without_integrals(self) -> Self:
        """The system without states that are integrals along the motion, with the same orbits."""
        return self

    @property
    def is_data_only(self) -> bool:
        """Whether names and numbers define the system completely; a file cannot hold functions."""
        return False

    def family(self, options: Options) -> Family:
        """Return the problems for all values of the parameters, in scaled units."""
        if not self.units.is_scaled and self.forced:
            warn_if_badly_scaled_orbit(self._checked_numbers.period)
        return SystemFamily(self._scaled_parameters, self, options)

    def problem(self, options: Options) -> Problem:
        """Return the problem that the event loop integrates, in scaled units."""
        checks = self.checks
        return Problem(
            automaton=self.automaton,
            section=self.section,
            options=options,
            discontinuity_check=checks.discontinuity,
            mode_failure=checks.mode_failure,
            **self._checked_numbers._asdict(),
        )

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

        return write_fmu(path, self._export_model(inputs, initial, options), fmi)

    def _export_model(
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
        start = self.state_space.instant(initial, problem)
        indices = self._parameter_indices
        numbers = tuple(
            ExportedNumber(
                name=name,
                value=value,
                unit=self.units.get(name, ""),
                factor=self.units.factor(name),
                index=indices.get(name),
                limits=self._limits(name),
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
            mode_by_switch=self.state_space.mode_by_switch,
        )

    def _limits(self, name: str) -> Limits:
        """Return the range of a parameter."""
        return UNLIMITED

    @cached_property
    def _parameter_indices(self) -> Mapping[str, int]:
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
        return portable(self._given)

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


def system_at(system: HybridSystem, inner: Mapping[str, float]) -> Any:
    """Return a system at scaled values of its parameters, allowed or not."""
    changes = _changes(system, inner)
    return system.shifted(changes) if changes else system


def _changes(system: HybridSystem, inner: Mapping[str, float]) -> dict[str, float]:
    """Return the scaled values that differ from those of a system, in the system's units."""
    own = system._scaled_parameters
    changed = {name: value for name, value in inner.items() if value != own[name]}
    return {name: system.units.out(name, value) for name, value in changed.items()}


def conversion(systems: Sequence[HybridSystem]) -> Conversion:
    """Return the conversion of columns that have a row for each of some systems."""
    first = systems[0]
    if all(system.units.scales == first.units.scales for system in systems):
        return first.units.out

    def out(heading: str, value: Any) -> Any:
        unit = unit_of(heading, first.units)
        return value * np.array([system.units.scales.factors.get(unit, 1.0) for system in systems])

    return out
