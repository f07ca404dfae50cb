"""An actuator under a drive, as a system among others."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cached_property, partial
from typing import Any

import numpy as np

from mems_impact.actuator.composed import composed_automaton
from mems_impact.actuator.composing import SCRATCH
from mems_impact.actuator.design.statistics import Accumulator
from mems_impact.actuator.design.still import still_after
from mems_impact.actuator.drive import Drive
from mems_impact.actuator.drives import WAVEFORMS
from mems_impact.actuator.drives.files import drive_of_kind
from mems_impact.actuator.modes import (
    GUARDS,
    STATES,
    V1,
    X2,
    actuator_automaton,
    direction_of,
    side_of,
)
from mems_impact.actuator.parameters import PARAMETER_NAMES, PARAMETER_UNITS, Actuator
from mems_impact.actuator.results import ActuatorOrbit, ActuatorRun
from mems_impact.actuator.tables import COLUMN_UNITS, SWEEP_COLUMNS, SYMBOLS
from mems_impact.actuator.terms.base import Kind, Term
from mems_impact.actuator.units import scaled_fields
from mems_impact.analysis.observable import Observable
from mems_impact.analysis.state import State, state_from
from mems_impact.analysis.statistics import Gatherer, Span
from mems_impact.analysis.system import System
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.portable import reference
from mems_impact.hybrid.problem import Numbers, Problem, Section
from mems_impact.hybrid.scaling import Typical
from mems_impact.hybrid.trajectory import Events, Floats, Instant, Trajectory
from mems_impact.units import DIMENSIONLESS, Scales

__all__ = ["ActuatorSystem", "kicked"]

TOUCHING = 1e-9  # of delta: scaling may round a block on its stopper
IMPACTS = tuple(guard.name for guard in GUARDS if guard.impact)


def _frame_position(y: Any, p: Any) -> float:
    return float(y.x1)


def _energy_lost(mode: int, t: float, before: Any, after: Any, p: Any) -> float:
    # Equations (5) and (6) conserve momentum; what is lost is of the relative motion alone.
    m1, m2 = p[0], p[1]
    return float(0.5 * m1 * m2 / (m1 + m2) * (before.v2 - after.v2) * (before.v2 + after.v2))


class ActuatorSystem(System):
    """An actuator under a drive, with every number of theirs as a parameter.

    Parameters
    ----------
    actuator : Actuator
    drive : Drive
    scales : Scales, optional
        In which the numerics count; they stay when a parameter is varied from which they were
        made. Those of the actuator by default.

    Raises
    ------
    InvalidParameter
        If `actuator` is no actuator or `drive` no drive, or cannot be told in floating-point
        numbers.
    """

    run_type = ActuatorRun
    orbit_type = ActuatorOrbit
    observables = (
        Observable("step", _frame_position, unit="m"),
        Observable("energy lost", _energy_lost, at=IMPACTS, reduce="sum", unit="J"),
    )

    def __init__(self, actuator: Actuator, drive: Drive, scales: Scales | None = None) -> None:
        if not isinstance(actuator, Actuator):
            raise InvalidParameter("actuator", actuator, "an Actuator (see load_actuator)")
        if not isinstance(drive, Drive):
            raise InvalidParameter("drive", drive, "a Drive, such as Sine(amplitude=…, omega=…)")
        drive.check()
        self._put(actuator, drive, scales or actuator.scales)

    def _put(self, actuator: Actuator, drive: Drive, scales: Scales) -> None:
        self.name = ""
        self.actuator, self.drive, self._scales = actuator, drive, scales

    def _key(self) -> tuple[Any, ...]:
        return dict(self.actuator), self.drive, self._scales

    def restored(
        self, values: Mapping[str, float], scales: Scales, typical: Typical | None = None
    ) -> ActuatorSystem:
        """Return the system at the values of a file, and in the scales in which it counted."""
        other = self.shifted(values)
        other._put(other.actuator, other.drive, scales)
        return other

    @property
    def told_by_numbers(self) -> bool:
        """Whether the waveform is the package's own."""
        return not own_functions(self.drive)

    @property
    def functions(self) -> dict[str, str]:
        """Where functions of the drive are defined that are not the package's own."""
        return own_functions(self.drive)

    def __repr__(self) -> str:
        return f"{self.actuator!r} under {self.drive!r}"

    @property
    def automaton(self) -> Automaton:
        """The actuator's modes and guards, under the drive's waveform."""
        drive = self.drive
        waveform = (drive.voltage, drive.voltage_rate, drive.left_voltage, drive.left_rate)
        kinds = self._kinds
        if not kinds:
            return actuator_automaton(*waveform, self._bounds)
        return composed_automaton(kinds, *waveform, self._bounds)

    @cached_property
    def _kinds(self) -> tuple[Kind, ...]:
        return tuple(term.kind for term in self.actuator.terms)

    @cached_property
    def _unfolded(self) -> bool:
        """Whether the sign of the voltage matters, and changes from one period of v^2 to the next.

        The forcing period is then that of v itself.
        """
        return any(kind.term.signed for kind in self._kinds) and self.drive.changes_sign

    @cached_property
    def _yields(self) -> bool:
        """Whether the stoppers yield, and a block may be beyond them."""
        return any(kind.term.instead == "stopper" for kind in self._kinds)

    @cached_property
    def _bounds(self) -> bool:
        """Whether functions may read beyond arrays, and have to be kept from it: the user's."""
        return not self.told_by_numbers

    @property
    def parameters(self) -> dict[str, float]:
        """All numbers of drive and actuator."""
        values = {name: self.drive.number(name) for name in self.drive.names}
        for name in PARAMETER_NAMES:
            values.setdefault(name, float(getattr(self.actuator, name)))
        for term in self.actuator.terms:
            values |= {f"{term.name()}.{name}": getattr(term, name) for name in term.names}
        return values

    @property
    def is_scaled(self) -> bool:
        """Always."""
        return True

    @property
    def scales(self) -> Scales:
        """The units of the numerics."""
        return self._scales

    @property
    def units(self) -> Mapping[str, str]:
        """SI units of parameters and columns; none of a dimensionless device."""
        if self._scales is DIMENSIONLESS:
            return {}
        of_drive = {name: self.drive.unit(name) for name in self.drive.names}
        return {**PARAMETER_UNITS, **COLUMN_UNITS, **of_drive, **self._term_units}

    @cached_property
    def _term_units(self) -> dict[str, str]:
        """Units of the parameters of terms, and of their states."""
        found: dict[str, str] = {}
        for term in self.actuator.terms:
            own, both = term.states(term.shape), term.electrode_states(term.shape)
            names = {name: f"{term.name()}.{name}" for name in term.names}
            names |= {name: name for name in own + both}
            found |= {names[name]: unit for name, unit in term.units.items() if name in names}
            found |= {f"left_{name}": term.units[name] for name in both if name in term.units}
        return found

    @property
    def initial(self) -> State:
        """At rest in the middle."""
        return State()

    @property
    def section(self) -> Section:
        """The block passes the middle: x2 = 0."""
        return X2, 0.0, 0

    @property
    def shown(self) -> tuple[str, ...]:
        """The states by which orbits are shown."""
        return ("v2",)

    @property
    def told(self) -> tuple[str, ...]:
        """The statistics that a sweep tells of every value."""
        return SWEEP_COLUMNS

    @property
    def quantities(self) -> Mapping[str, tuple[str, str]]:
        """The step and the speed of the frame."""
        return {
            "step": ("displacement per impact", "step per impact"),
            "speed": ("mean speed", "mean speed"),
        }

    @property
    def symbols(self) -> Mapping[str, str]:
        """The paper's f for the amplitude."""
        return SYMBOLS

    def start_of(self, direction: str) -> State:
        """Return rest in the middle for a sweep up, and a kick for one down."""
        return State() if direction == "up" else kicked(self.actuator)

    @property
    def forcing_period(self) -> float:
        """The drive's; that of the voltage itself where a term makes its sign matter."""
        return self.drive.period * (2.0 if self._unfolded else 1.0)

    def check_continued(self, name: str) -> None:
        """Raise InvalidParameter unless an orbit can be followed over the parameter `name`."""
        super().check_continued(name)
        if name.rpartition(".")[2] == "bias" and self.value(name) == 0.0:
            problem = "the forcing period doubles where the bias sets in; begin with another value"
            raise InvalidParameter(name, 0.0, "", problem=problem)

    def changed(self, **values: float) -> ActuatorSystem:
        """Return the system at other values of some parameters, checked."""
        drive_values, actuator_values, term_values = self._sorted(values)
        drive = self.drive.varied(drive_values) if drive_values else self.drive
        if term_values:
            actuator_values["terms"] = self._terms(term_values)
        actuator = self.actuator.replace(**actuator_values) if actuator_values else self.actuator
        return self._with(actuator, drive, actuator.scales)

    def shifted(self, values: Mapping[str, float]) -> ActuatorSystem:
        """Return the system at values that may not be allowed, in the same scales.

        Differences by a parameter at the end of its range look beyond it, as do trial steps.
        """
        drive_values, actuator_values, term_values = self._sorted(values)
        actuator, drive = self.actuator, self.drive
        if drive_values:
            drive = drive.varied(drive_values, checked=False)
        if term_values:
            actuator_values["terms"] = self._terms(term_values, checked=False)
        if actuator_values:
            actuator = actuator.replace_unchecked(**actuator_values)
        return self._with(actuator, drive, self._scales)

    def _with(self, actuator: Actuator, drive: Drive, scales: Scales) -> ActuatorSystem:
        """Return the system of another actuator and drive, which have been checked or need not."""
        other = object.__new__(ActuatorSystem)
        other._put(actuator, drive, scales)
        return other

    def _sorted(
        self, values: Mapping[str, float]
    ) -> tuple[dict[str, float], dict[str, Any], dict[str, float]]:
        """Return the values of the drive, those of the actuator and those of its terms."""
        of_drive, of_actuator, of_terms = {}, {}, {}
        for name, value in values.items():
            if name in self._drive_names:
                of_drive[name] = value
            elif name in PARAMETER_NAMES:
                of_actuator[name] = value
            else:
                self.check_parameter(name)
                of_terms[name] = value
        return of_drive, of_actuator, of_terms

    def _terms(self, values: Mapping[str, float], *, checked: bool = True) -> tuple[Term, ...]:
        """Return the terms, some of their numbers changed."""
        found = []
        for term in self.actuator.terms:
            prefix = f"{term.name()}."
            own = {
                name.removeprefix(prefix): value
                for name, value in values.items()
                if name.startswith(prefix)
            }
            found.append(term.varied(own, checked=checked) if own else term)
        return tuple(found)

    @property
    def inner_actuator(self) -> Actuator:
        """The actuator in the units of the numerics."""
        if self._scales is DIMENSIONLESS:
            return self.actuator
        values = scaled_fields(self.actuator, PARAMETER_UNITS, self._scales)
        return self.actuator.replace_unchecked(**values, units="dimensionless")

    def numbers(self, changes: Mapping[str, float] | None = None) -> Numbers:
        """Return what of the problem depends on the parameters, dimensionless.

        Numbers all the way: no checked object is made of the actuator, nor of a drive whose own
        `numbers` does without.
        """
        of_drive, of_actuator, of_terms = self._sorted(changes) if changes else ({}, {}, {})
        device = self._device
        if of_actuator or of_terms:
            device = device.copy()
        for name, value in of_actuator.items():
            unit = PARAMETER_UNITS.get(name)
            inner = self._scales.into(value, unit) if unit else value
            device[PARAMETER_NAMES.index(name)] = inner
        for name, value in of_terms.items():
            device[self._term_places[name]] = self.into(name, value)
        q, period, switches, scale = self.drive.numbers(of_drive, self._scales)
        if self._unfolded:
            switches += tuple(period + time for time in switches)
            scale, period = scale or period, 2.0 * period
        return Numbers(np.concatenate([device, q]), period, switches, scale)

    @cached_property
    def _device(self) -> Floats:
        """The numbers of actuator and terms, in the units of the numerics; room for scratch."""
        own = self.inner_actuator.to_array()
        if not self._kinds:
            return own
        of_terms = [each for term in self.actuator.terms for each in term.numbers(self._scales)]
        scratch = np.zeros(SCRATCH * len(self.states))
        return np.concatenate([own, of_terms, scratch])

    @cached_property
    def _term_places(self) -> dict[str, int]:
        """Where the parameters of terms stand among the numbers."""
        places: dict[str, int] = {}
        first = len(PARAMETER_NAMES)
        for kind in self._kinds:
            at = kind.at(first)
            places |= {f"{kind.term.name()}.{name}": place for name, place in at.p.items()}
            first += kind.length
        return places

    @cached_property
    def _drive_names(self) -> tuple[str, ...]:
        return self.drive.names

    def ending(self, until: Callable[..., float]) -> System:
        """Refuse: the functions of an actuator are not written by name."""
        problem = (
            "functions are for systems made by mems_impact.System; give periods=, duration= or "
            "until='still'"
        )
        raise InvalidParameter("until", None, "", problem=problem)

    def standstill(self) -> Callable[[Trajectory], float | None]:
        """Return what tells after how many periods a run stands still; None if it does not."""
        return partial(still_after, actuator=self.inner_actuator)

    def _check_state(self, field: str, state: State) -> None:
        super()._check_state(field, state)
        x2, delta = state.as_dict().get("x2", 0.0), self.actuator.delta
        if not (abs(x2) <= delta or self._yields):
            raise InvalidParameter("x2", x2, f"between the stoppers at -{delta:g} and {delta:g}")
        if state.mode is not None:
            self._check_mode(state)

    def _check_mode(self, state: State) -> None:
        """Raise InvalidParameter unless the velocities of a state are those of its mode."""
        mode = self.mode_number(state.mode if state.mode is not None else 0)
        if self._yields:
            return  # whether the stopper touches says how far the block is
        values = {**dict.fromkeys(STATES, 0.0), **state.as_dict()}
        direction, side, delta = direction_of(mode), side_of(mode), self.actuator.delta
        v1, resting = values["v1"], values["v2"] == 0.0
        at_stopper = abs(values["x2"] - side * delta) <= TOUCHING * delta
        fits = v1 == 0.0 if direction == 0 else direction * v1 >= 0.0
        if not (fits and (side == 0 or (resting and at_stopper))):
            problem = f"does not fit {state!r}; leave it out, then it follows from the state"
            raise InvalidParameter("mode", state.mode, "", problem=problem)

    def state_of(self, instant: Instant) -> State:
        """Return an instant as a state in the device's units."""
        values = {
            name: self.out(name, value)
            for name, value in zip(self.states, instant.y.tolist(), strict=True)
        }
        time = float(self.scales.out(instant.time, "s"))
        if self.scales is not DIMENSIONLESS:
            # Scaling may round a block on its stopper, or the end of a period, to just beyond it.
            delta, last = self.actuator.delta, math.nextafter(self.forcing_period, 0.0)
            if not self._yields:
                values["x2"] = min(max(values["x2"], -delta), delta)
            time = min(time, last)
        return state_from(values, time=time)

    def mode_of(self, y: Floats, time: float, problem: Problem) -> int:
        """Return the mode of a state, by Equation (4) and the contact force."""
        automaton = problem.automaton
        code = automaton.switch_code
        return int(automaton.transition(0, code, time, y, problem.parameters))

    def gatherer(self, problem: Problem, start: Instant, window: Span) -> Gatherer:
        """Return what gathers the statistics of a run."""
        return Accumulator(self.inner_actuator, start, window)

    def measure(self, observable: Observable, y: Floats, problem: Problem) -> float:
        """Return an observable of a state, in the units of the numerics."""
        return float(observable.function(_Named(y), problem.parameters))

    def measure_event(
        self, observable: Observable, events: Events, i: int, problem: Problem
    ) -> float:
        """Return an observable at an event, in the units of the numerics."""
        before, after = _Named(events.before[i]), _Named(events.after[i])
        mode, time = int(events.mode_before[i]), float(events.time[i])
        return float(observable.function(mode, time, before, after, problem.parameters))

    def tidied(self, mode: int, y: Floats) -> Floats:
        """Return a state found by Newton's method, with a stuck frame at rest."""
        # A rounding is left there, with which a run would begin to slip.
        return y if direction_of(mode) != 0 else np.where(np.arange(y.size) == V1, 0.0, y)

    def moves(self, instant: Instant) -> bool:
        """Return whether the frame slides."""
        return direction_of(instant.mode) != 0


def kind_of(drive: Drive) -> str:
    """Return the kind of a waveform, as files name it; empty if it is none of the package's."""
    kinds = {name: kind for kind, name in WAVEFORMS.items()}
    kind = kinds.get(type(drive).__name__, "")
    return kind if kind and drive_of_kind(kind) is type(drive) else ""


def own_functions(drive: Drive) -> dict[str, str]:
    """Return where the functions of a drive are defined that its numbers do not tell."""
    if kind_of(drive) == "":
        return {type(drive).__name__: f"{type(drive).__module__}:{type(drive).__qualname__}"}
    found: dict[str, str] = {}
    for name in type(drive).model_fields:
        value = getattr(drive, name)
        if isinstance(value, Drive):
            found |= {f"{name}.{inner}": place for inner, place in own_functions(value).items()}
        elif callable(value):
            found[name] = reference(value)
    return found


def kicked(actuator: Actuator) -> State:
    """Return the state in which the block passes the middle fast enough to strike a stopper.

    Its kinetic energy is four times what the spring takes up on the way.
    """
    return State(v2=2.0 * actuator.delta * math.sqrt(actuator.k / actuator.m2))


class _Named:
    """A state of the actuator by name."""

    def __init__(self, y: Floats) -> None:
        self.x1, self.v1, self.x2, self.v2 = y[: len(STATES)].tolist()
