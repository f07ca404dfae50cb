"""A system: an automaton with named parameters and all that the verbs of the package ask of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, ClassVar

from mems_impact.analysis import checks, given, quantity
from mems_impact.analysis.build import Build
from mems_impact.analysis.checks.parted import check_parted
from mems_impact.analysis.measures import measure_names, measures
from mems_impact.analysis.modes import Mode
from mems_impact.analysis.numerics import Number, Numerics
from mems_impact.analysis.observable import Observable
from mems_impact.analysis.parts import text
from mems_impact.analysis.parts.assembly import assembled
from mems_impact.analysis.parts.part import Part, Quantity
from mems_impact.analysis.sizes import tell_of_orbits
from mems_impact.analysis.state import State
from mems_impact.analysis.statistics import Gatherer, Gathering, Span, Watcher
from mems_impact.analysis.typical import typical_of
from mems_impact.analysis.values import same
from mems_impact.engines.options import Options
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.automaton import Guard
from mems_impact.hybrid.portable import portable, reference
from mems_impact.hybrid.problem import Problem, check_times
from mems_impact.hybrid.scaling import Typical
from mems_impact.hybrid.survey import Settled
from mems_impact.hybrid.trajectory import Floats, Instant, Trajectory
from mems_impact.hybrid.written import (
    Definition,
    ending,
)
from mems_impact.orbits.family import Family
from mems_impact.units import DIMENSIONLESS, Scales

__all__ = ["System"]


class System(Numerics):
    """A system that switches between smooth modes, from functions that read like its equations.

    Parameters
    ----------
    states : sequence of str, or int
        Names of the components of the state; or how many there are (then u0, u1, …).
    flow : callable
        ``flow(mode, t, y, p)`` returns the time derivatives of the states. ``y`` and ``p`` have
        states and parameters by name (``y.x``, ``p.omega``), ``t`` counts from the start of the
        forcing period. With many states ``flow(mode, t, y, p, dy)`` writes them into ``dy``, and
        ``y`` is an array (see `mems_impact.hybrid.written`).
    parameters : mapping of str to float, optional
        Names and values.
    guards : sequence of Guard, optional
        What ends a mode, or is recorded: `Guard` and `Impact`.
    parts : sequence of Part, optional
        What stands ready: `Friction`, `Stopper`, `Relay`, `Surface`. ``flow`` then tells the rest,
        and finds the mode of each part by its name (``mode.wall``).
    masses : mapping of str to float, str or callable, optional
        Of the bodies on which parts act, by their velocities: numbers, parameters or functions of
        ``p``; 1 by default.
    modes : sequence of Mode or str, optional
        All modes, from `modes`; needed where no guard names one and there are several.
    period : float or callable, optional
        The forcing period: a number, or ``period(p)``. None for a system without forcing.
    switches : sequence of float or callable, optional
        Times in (0, period], ascending, at which the flow jumps; or ``switches(p)``.
    settle : callable, optional
        ``settle(mode, t, y, p)`` returns mode and state after such a time; both go on by default.
    constraints : mapping of mode to callable, optional
        What is zero for as long as a mode lasts, such as the velocity of a body that sticks:
        ``{STUCK: speed}`` with ``speed(mode, t, y, p)``, or several functions. Transitions into the
        mode have to make it zero, and the flow to keep it so. Equilibria, multipliers and exponents
        then know that no motion of the mode leaves it. With parts, these say it.
    section : tuple of str and float, optional
        A Poincaré section: a state and its value there. Crossings are recorded. Without one, a
        system with forcing is looked at where its periods begin.
    initial : mapping of str to float, or State, optional
        Where runs start if nothing else is said; 0 for every component that is not given.
    observables : sequence of Observable, optional
        Named quantities that tables and studies show beside the states.
    units : mapping of str to str, optional
        Units of states, parameters and ``"time"``.
    typical : mapping of str to float, optional
        Sizes that are typical of states, parameters and ``"time"``, or of units: ``{"x": 1e-6,
        "time": 1e-3}``, ``{"m": 1e-6, "s": 1e-3}``. The numerics then count in these, so that
        tolerances are relative to them; what is given and returned stays in the system's units.
    cyclic : sequence of str, optional
        States that enter no function, such as a position that only grows. They are accumulated
        apart, and an orbit need not close in them.
    jacobian : callable, optional
        ``jacobian(mode, t, y, p, J)`` writes the derivatives of the flow into ``J[i, j]``, for
        method "bdf", which otherwise takes differences.
    time_scale : float or callable, optional
        Time within which the system shows all that it does, where that is not the period.
    name : str, optional

    Raises
    ------
    InvalidParameter
        If names repeat, or a name, a number or a function is missing or of the wrong kind.
    FunctionError
        If a function does not do what it must, as far as a short run meets it.

    See Also
    --------
    Guard, Impact, modes, Friction, Stopper, simulate

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

    # The classes of its runs and orbits, where a kind of system adds tables of its own.
    run_type: ClassVar[Any] = None
    orbit_type: ClassVar[Any] = None

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
        settle: Callable[..., Any] | None = None,
        constraints: Mapping[Any, Any] | None = None,
        section: tuple[str, float] | None = None,
        initial: Mapping[str, float] | State | None = None,
        observables: Sequence[Observable] = (),
        units: Mapping[str, str] | None = None,
        typical: Mapping[str, float] | None = None,
        cyclic: Sequence[str] = (),
        jacobian: Callable[..., Any] | None = None,
        time_scale: Number | None = None,
        name: str = "",
    ) -> None:
        names, flow = given.states(states), given.flow(flow)
        guards = given.guards(guards, given.changing(flow))
        self.name = str(name)
        self._parameters = given.numbers(parameters or {})
        self._period, self._switches, self._time_scale = period, switches, time_scale
        constrained: tuple[int, ...] = ()
        projection: Callable[..., Any] | None = None
        if parts:
            given.alone_with_parts(
                modes=modes, settle=settle, jacobian=jacobian, constraints=constraints
            )
            made = assembled(
                parts,
                flow=flow,
                states=names,
                parameters=tuple(self._parameters),
                masses=masses or {},
                guards=guards,
            )
            signs, start = {part.name: part.signs for part in parts}, given.initial(initial)
            check_parted(flow, names, self._parameters, signs, start.as_dict())
            flow, settle, guards, modes, self._begin, constrained, projection = made
        called = given.mode_names(modes, guards)
        self._definition = Definition(
            states=names,
            modes=called,
            parameters=tuple(self._parameters),
            flow=flow,
            guards=guards,
            settle=given.optional("settle", settle, *given.changing(flow)),
            jacobian=given.optional("jacobian", jacobian, *given.ARGUMENTS, "J"),
            cyclic=given.places("cyclic", cyclic, names),
            constrained=constrained,
            projection=projection,
            constraints=given.constraints(constraints, flow, called),
        )
        self._section = given.section(section, names)
        self.observables = given.observables(observables, names, guards)
        quantities = (each.name for each in self.observables)
        self._units = given.units(units, (*names, *self._parameters, *quantities))
        self._initial = given.initial(initial)
        self._typical = None
        sizes = given.sizes(typical)
        # In the user's own numbers, to which functions and messages belong.
        problem, time = self.problem(Options()), sizes.get("time")
        checks.check(self, self._definition, problem, time=time, meant=initial is not None)
        if sizes:
            self._typical = typical_of(
                sizes,
                definition=self._definition,
                values=self._parameters,
                initial=self._initial.as_dict(),
                units=self._units,
                time=self._own_time(),
            )

    # What each kind of system has in its own way; the actuator's stands in its own room.

    @property
    def parameters(self) -> dict[str, float]:
        """Names and values of all parameters, in the system's units."""
        return dict(self._parameters)

    @property
    def units(self) -> Mapping[str, str]:
        """Units of states, parameters, observables and times; none for pure numbers."""
        return {**self._units, **{each.name: each.unit for each in self.observables if each.unit}}

    @property
    def scales(self) -> Scales:
        """The units of the numerics."""
        return DIMENSIONLESS if not self.units else Scales()

    @property
    def initial(self) -> State:
        """Where runs start if nothing else is said."""
        return self._initial

    @property
    def orbit_quantities(self) -> tuple[quantity.Quantity, ...]:
        """The numbers of an orbit whose derivatives `sensitivity` and `optimize` know."""
        return quantity.general_quantities(self)

    def changed(self, /, **values: float) -> System:
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
        other.problem(Options())
        return other

    def shifted(self, values: Mapping[str, float]) -> System:
        """Return the system at values that may not be allowed, at which continuation looks."""
        other = self._copy()
        other._parameters = {**self._parameters, **given.numbers(values)}
        return other

    def restored(
        self, values: Mapping[str, float], scales: Scales, typical: Typical | None = None
    ) -> System:
        """Return the system at the values of a file, and in the units in which it counted."""
        other = self.shifted(values)
        other._typical = typical
        return other

    @property
    def told_by_numbers(self) -> bool:
        """Whether names and numbers say all of it; a file cannot hold functions."""
        return False

    @property
    def functions(self) -> dict[str, str]:
        """Where its functions are defined, as ``module:name``: to be shown."""
        definition = self._definition
        found: dict[str, Any] = {"flow": definition.flow, "settle": definition.settle}
        found |= {"jacobian": definition.jacobian, "period": self._period}
        found |= {"switches": self._switches, "time_scale": self._time_scale}
        for guard in definition.guards:
            for role in ("margin", "transition", "rate", "rest"):
                found[f"{role} of {guard.name}"] = getattr(guard, role)
        for i, (mode, constraint) in enumerate(definition.constraints):
            found[f"constraint {i} of {definition.modes[mode]}"] = constraint
        found |= {f"observable {each.name}": each.function for each in self.observables}
        return {
            role: reference(given)
            for role, given in found.items()
            if callable(given) and given.__module__ != text.__name__  # written for parts
        }

    def ending(self, until: Callable[..., float]) -> System:
        """Return the system whose runs end where ``until(mode, t, y, p)`` falls through zero."""
        other = self._copy()
        vars(other)["_unended"] = self
        given.function("until", until, *given.ARGUMENTS)
        other._definition = ending(self._definition, until)
        checks.check_end(self, other._definition, self.problem(Options()))
        return other

    def standstill(self) -> Callable[[Trajectory], float | None]:
        """Return what tells after how many periods a run stands still; None if it does not."""
        problem = "of an actuator alone; give a function (mode, t, y, p) that falls through zero"
        raise InvalidParameter("until", "still", "", problem=problem)

    def gatherer(self, problem: Problem, start: Instant, window: Span) -> Gatherer:
        """Return what gathers the statistics of a run."""
        return Gathering(self, problem, start, window)

    def measures(self, settled: Settled, period: float) -> dict[str, float]:
        """Return what studies tell of where a motion has come to, by heading."""
        return measures(self, settled, period)

    @property
    def measure_names(self) -> tuple[str, ...]:
        """The headings of `measures`."""
        return measure_names(self)

    def validity(self, problem: Problem, start: Instant) -> Watcher | None:
        """Return what warns of a run that leaves the range in which the system's model holds."""
        return None

    def tidied(self, mode: int, y: Floats) -> Floats:
        """Return a state that Newton's method has found, without what rounding made of it."""
        return y

    # What all kinds of system share.

    def check_continued(self, name: str) -> None:
        """Raise InvalidParameter unless an orbit can be followed over the parameter `name`."""
        self.check_parameter(name)

    def family(self, options: Options) -> Family:
        """Return the problems for all values of the parameters, in the units of the numerics."""
        if not self.is_scaled and self.forced:
            tell_of_orbits(self.numbers().period, self.parameters)
        return Family(Build(self, options), self.inner_parameters)

    def at(self, inner: Mapping[str, float]) -> System:
        """Return the system at values in the units of the numerics, allowed or not."""
        changes = self.changes_to(inner, self.inner_parameters)
        return self.shifted(changes) if changes else self

    def problem(self, options: Options) -> Problem:
        """Return what the event loop integrates, in the units of the numerics."""
        numbers = self.numbers()
        check_times(numbers, self.factor("time"), self.unit("time"))
        written = "_definition" in vars(self)
        return Problem(
            automaton=self.automaton,
            section=self.section,
            options=options,
            falls=partial(checks.tell_of_fall, self) if written else None,
            **numbers._asdict(),
        )

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
        if not isinstance(other, System):
            return NotImplemented
        return type(self) is type(other) and same(self._key(), other._key())

    def __hash__(self) -> int:  # type: ignore[override]
        return hash((type(self), *self.parameters.items()))

    def __copy__(self) -> System:
        return self  # it does not change

    def __deepcopy__(self, memo: dict[int, Any]) -> System:
        return self

    def __getstate__(self) -> dict[str, Any]:
        """Return what is pickled, with functions fit to go to another process."""
        state: dict[str, Any] = portable(vars(self))
        return state

    def _key(self) -> tuple[Any, ...]:
        """Return all by which systems differ."""
        return tuple(vars(self)[name] for name in sorted(vars(self)))

    def _copy(self) -> System:
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        return other
