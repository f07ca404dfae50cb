"""An actuator under a drive, as a system among others."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np

from mems_impact.actuator import equations as eq
from mems_impact.actuator.composed import composed_automaton
from mems_impact.actuator.composing import compose
from mems_impact.actuator.design.impacts import yields
from mems_impact.actuator.design.measures import REDUCED, measure_names, measures
from mems_impact.actuator.design.statistics import Accumulator
from mems_impact.actuator.design.still import still_after
from mems_impact.actuator.drives import WAVEFORMS, Drive
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
from mems_impact.actuator.numerics import ActuatorNumerics
from mems_impact.actuator.parameters import Actuator
from mems_impact.actuator.quantities import actuator_quantities
from mems_impact.actuator.results import ActuatorOrbit, ActuatorRun
from mems_impact.actuator.tables import SWEEP_COLUMNS, SYMBOLS
from mems_impact.actuator.validity import Validity
from mems_impact.analysis.observable import Observable
from mems_impact.analysis.quantity import Quantity
from mems_impact.analysis.state import State, state_from
from mems_impact.analysis.statistics import Gatherer, Span
from mems_impact.analysis.system import System
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.observed import Observed, observed
from mems_impact.hybrid.portable import reference
from mems_impact.hybrid.problem import Problem, Section
from mems_impact.hybrid.scaling import Typical
from mems_impact.hybrid.survey import Settled
from mems_impact.hybrid.trajectory import Events, Floats, Instant, Trajectory
from mems_impact.units import DIMENSIONLESS, Scales

__all__ = ["ActuatorSystem", "kicked"]

TOUCHING = 1e-9  # of delta: scaling may round a block on its stopper
IMPACTS = tuple(guard.name for guard in GUARDS if guard.impact)


def _frame_position(y: Any, p: Any) -> float:
    return float(y.x1)


def _energy_lost(mode: int, t: float, before: Any, after: Any, p: Any) -> float:
    return float(eq.impact_loss(p[eq.M1], p[eq.M2], before.v2, after.v2))


def _contact_loss(y: Any, p: Any) -> float:
    return float(y.contact_loss)


STEP = Observable("step", _frame_position, unit="m")
IMPACT_LOSS = Observable("energy lost", _energy_lost, at=IMPACTS, reduce="sum", unit="J")
CONTACT_LOSS = Observable("energy lost", _contact_loss, unit="J")  # where stoppers yield


def _impact_speed(mode: int, t: float, before: Any, after: Any, p: Any) -> float:
    return abs(float(before.v2))


IMPACT_SPEEDS = tuple(
    Observable(f"impact speed {reduce}", _impact_speed, at=IMPACTS, reduce=reduce, unit="m/s")
    for reduce in REDUCED
)


class ActuatorSystem(ActuatorNumerics):
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

    def __init__(self, actuator: Actuator, drive: Drive, scales: Scales | None = None) -> None:
        if not isinstance(actuator, Actuator):
            raise InvalidParameter("actuator", actuator, "an Actuator (see load_actuator)")
        if not isinstance(drive, Drive):
            raise InvalidParameter("drive", drive, "a Drive, such as Sine(amplitude=…, omega=…)")
        drive.check()
        self._put(actuator, drive, scales or actuator.scales)
        if self._signed:
            drive.check_signed()

    def _put(self, actuator: Actuator, drive: Drive, scales: Scales) -> None:
        super()._put(actuator, drive, scales)
        self.observables = (STEP, CONTACT_LOSS if self._yields else IMPACT_LOSS)

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
    def _yields(self) -> bool:
        """Whether the stoppers yield, and a block may be beyond them."""
        return yields(self.actuator)

    @cached_property
    def _bounds(self) -> bool:
        """Whether functions may read beyond arrays, and have to be kept from it: the user's."""
        return not self.told_by_numbers

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
    def studied(self) -> tuple[Observable, ...]:
        """The displacement of the frame, the speeds of impacts, the energy that they lose."""
        return (*self.observables, *IMPACT_SPEEDS)

    @property
    def observed(self) -> Observed:
        """The same as one function of the numerics."""
        guards = [guard.name for guard in self.automaton.guards]
        given = (
            (each.name, each.function, tuple(guards.index(name) for name in each.at))
            for each in self.studied
        )
        return observed(tuple(given), self.states, None)

    def measures(self, settled: Settled, period: float) -> dict[str, float]:
        """Return what studies tell of where a motion has come to, by heading."""
        return measures(self, settled, period)

    @property
    def measure_names(self) -> tuple[str, ...]:
        """The headings of `measures`."""
        return measure_names(self)

    @property
    def orbit_quantities(self) -> tuple[Quantity, ...]:
        """Step, speed and energies of an orbit, and what bounds them."""
        return actuator_quantities(self.units)

    @property
    def symbols(self) -> Mapping[str, str]:
        """The paper's f for the amplitude."""
        return SYMBOLS

    def with_energy(self) -> ActuatorSystem:
        """Return the system with account kept of the energy that the drive gives.

        Its studies tell it per period and per impact.
        """
        from mems_impact.actuator.ledger import LedgerSystem  # which is one of these

        return self._as(LedgerSystem)

    def start_of(self, direction: str) -> State:
        """Return rest in the middle for a sweep up, and a kick for one down."""
        return State() if direction == "up" else kicked(self.actuator)

    def check_continued(self, name: str) -> None:
        """Raise InvalidParameter unless an orbit can be followed over the parameter `name`."""
        super().check_continued(name)
        if name.rpartition(".")[2] == "bias" and self.value(name) == 0.0 and not self._signed:
            problem = "the forcing period doubles where the bias sets in; begin with another value"
            raise InvalidParameter(name, 0.0, "", problem=problem)

    def ending(self, until: Callable[..., float]) -> System:
        """Return the system whose runs end where ``until(mode, t, y, p)`` falls through zero."""
        from mems_impact.actuator.ending import ended  # which returns one of these

        return ended(self, until)

    def standstill(self) -> Callable[[Trajectory], float | None]:
        """Return what tells after how many periods a run stands still; None if it does not."""
        return partial(still_after, actuator=self.inner_actuator)

    def _check_state(self, field: str, state: State) -> None:
        super()._check_state(field, state)
        x2, delta = state.as_dict().get("x2", 0.0), self.actuator.delta
        if self._yields:
            delta = 0.5 * (delta + self.actuator.d)  # beyond, the electrode's force is frozen
        if not abs(x2) <= delta:
            where = "halfway from stopper to electrode" if self._yields else "the stoppers"
            raise InvalidParameter("x2", x2, f"between {where} at -{delta:g} and {delta:g}")
        if state.mode is not None:
            self._check_mode(state)

    def _check_mode(self, state: State) -> None:
        """Raise InvalidParameter unless the velocities of a state are those of its mode."""
        mode = self.mode_number(state.mode if state.mode is not None else 0)
        values = {**dict.fromkeys(STATES, 0.0), **state.as_dict()}
        direction, side, delta = direction_of(mode), side_of(mode), self.actuator.delta
        v1, resting = values["v1"], values["v2"] == 0.0
        beyond = abs(values["x2"]) - delta if side == 0 else side * values["x2"] - delta
        touching = TOUCHING * delta
        fits = v1 == 0.0 if direction == 0 else direction * v1 >= 0.0
        if self._yields:
            fits = fits and (beyond <= touching if side == 0 else beyond >= -touching)
        else:
            fits = fits and (side == 0 or (resting and abs(beyond) <= touching))
        if not fits:
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

    def mode_of(self, y: Floats, time: float, problem: Problem, mode: int = 0) -> int:
        """Return the mode of a state, by Equation (4) and the contact force."""
        automaton = problem.automaton
        code = automaton.switch_code
        return int(automaton.transition(mode, code, time, y, problem.parameters))

    def gatherer(self, problem: Problem, start: Instant, window: Span) -> Gatherer:
        """Return what gathers the statistics of a run."""
        return Accumulator(self.inner_actuator, start, window)

    def validity(self, problem: Problem, start: Instant) -> Validity | None:
        """Return what warns of a run that leaves the range in which its terms hold."""
        sides = 1 if self.drive.left_voltage is None else 2
        parts = compose(self._kinds, sides).contributions if self._kinds else ()
        limits = [limit for part in parts for limit in part.limits]
        return Validity(limits, problem, start, self._scales) if limits else None

    def measure(self, observable: Observable, y: Floats, problem: Problem) -> float:
        """Return an observable of a state, in the units of the numerics."""
        return float(observable.function(_Named(self.states, y), problem.parameters))

    def measure_event(
        self, observable: Observable, events: Events, i: int, problem: Problem
    ) -> float:
        """Return an observable at an event, in the units of the numerics."""
        before, after = (_Named(self.states, y[i]) for y in (events.before, events.after))
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
    """Return the kind of a waveform, as files name it; empty if files do not know it."""
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

    Parameters
    ----------
    actuator : Actuator

    Returns
    -------
    State

    See Also
    --------
    State, simulate, sweep

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> run = mi.simulate(actuator, drive, periods=300, initial=mi.kicked(actuator))
    >>> float(run.statistics["impacts per period"])
    1.0
    """
    return State(v2=2.0 * actuator.delta * math.sqrt(actuator.k / actuator.m2))


class _Named:
    """A state of the actuator by name."""

    def __init__(self, states: Sequence[str], y: Floats) -> None:
        vars(self).update(zip(states, y.tolist(), strict=False))
