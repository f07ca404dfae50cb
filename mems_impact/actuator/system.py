"""A device under a drive as a system.

The energy input of the drive is accumulated in cyclic states. These affect the step size, so that
motions agree with those of the actuator to tolerance, not exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, cached_property
from typing import Any

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.limits import UNLIMITED, Limits
from mems_impact._util.units import Scales
from mems_impact.actuator import equations as eq
from mems_impact.actuator import impact_law
from mems_impact.actuator.automaton import IMPACTS, Waveforms, device_automaton, device_definition
from mems_impact.actuator.drives import WAVEFORMS
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.drives.files import drive_of_kind
from mems_impact.actuator.drives.imported import VOLTAGES, imported
from mems_impact.actuator.drives.sine import Sine
from mems_impact.actuator.energy_accounting import accounts, sum_of
from mems_impact.actuator.equations import X2
from mems_impact.actuator.model import bounds_of, compose
from mems_impact.actuator.numerics import A, ActuatorNumerics
from mems_impact.actuator.parameter_base import limits_of
from mems_impact.actuator.parameters import PARAMETER_NAMES, ActuatorParameters
from mems_impact.actuator.results import ActuatorOrbit, ActuatorRun
from mems_impact.actuator.state_space import ActuatorStateSpace
from mems_impact.actuator.statistics import ActuatorStatistics
from mems_impact.actuator.terms.base import TermKind, Validity, drive_unit
from mems_impact.actuator.units import PARAMETER_UNITS
from mems_impact.errors import InvalidParameter
from mems_impact.export.model import ExportedModel, ExportedNumber
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.definition import Typical
from mems_impact.hybrid.pickling import reference
from mems_impact.hybrid.problem import Problem, ProblemParameters, Section
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.options import Options
from mems_impact.systems import arguments
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.checks import Checks
from mems_impact.systems.observables import EventObserver, Observable
from mems_impact.systems.state import State

# --- The system of an actuator under a drive

AT_REST = State()


def _frame_position(y: Any, p: Any) -> float:
    return float(y.x1)


def _energy_lost(mode: int, t: float, before: Any, after: Any, p: Any) -> float:
    return float(impact_law.impact_loss(p[eq.M1], p[eq.M2], before.v2, after.v2))


def _contact_loss(y: Any, p: Any) -> float:
    return float(y.contact_loss)


STEP_OBSERVABLE = Observable("step", _frame_position, unit="m")
IMPACT_LOSS = Observable("energy lost", _energy_lost, at=IMPACTS, reduce="sum", unit="J")
CONTACT_LOSS = Observable("energy lost", _contact_loss, unit="J")  # of compliant stoppers


class ActuatorSystem(ActuatorNumerics[A]):
    """An actuator under a drive, with all their numbers as parameters.

    `scales` are the units of the scaled variables, which remain when parameters vary; by default
    those of the actuator. Raises InvalidParameter if `actuator` is not an actuator, or `drive` is
    not a drive, does not fit the actuator or is not representable in floating point.
    """

    _run_type = ActuatorRun
    _orbit_type = ActuatorOrbit

    def __init__(self, actuator: A, drive: Drive, scales: Scales | None = None) -> None:
        if not isinstance(actuator, ActuatorParameters):
            raise InvalidParameter("actuator", actuator, "an Actuator (see load_actuator)")
        if not isinstance(drive, Drive):
            raise InvalidParameter("drive", drive, "a Drive, such as Sine(amplitude=…, omega=…)")
        if actuator.units == "dimensionless":
            drive.check_without_units()
        drive.check_texts(drive_unit(actuator.terms))
        drive.check()
        drive.check_period()
        self._put(actuator, drive, scales or actuator.scales)
        for term in actuator.terms:
            term.check_under(drive)
        if drive.clamp_voltage is not None and not self.clamp_driven:
            problem = "nothing follows it; give the device a ClampElectrode with follows='clamp'"
            raise InvalidParameter("clamp", None, "", problem=problem)
        if self._signed or self.source is not drive:
            drive.check_signed()
            self.source.check()

    def _put(self, actuator: Any, drive: Drive, scales: Scales) -> None:
        super()._put(actuator, drive, scales)
        self.observables = (STEP_OBSERVABLE, CONTACT_LOSS if self._yields else IMPACT_LOSS)

    def _key(self) -> tuple[Any, ...]:
        return dict(self.actuator), self.drive, self._scales, self._until, self.includes_energy

    def restored(
        self, values: Mapping[str, float], scales: Scales, typical: Typical | None = None
    ) -> ActuatorSystem:
        """Return the system at the values and scales of a file."""
        other = self.shifted(values)
        other._put(other.actuator, other.drive, scales)
        return other

    @property
    def is_data_only(self) -> bool:
        """Whether the waveform is the package's own, and no function of the user ends runs."""
        return not self.functions

    @property
    def functions(self) -> dict[str, str]:
        """Where the functions are defined that are not the package's own."""
        until = {} if self._until is None else {"until": reference(self._until)}
        return {**own_functions(self.drive), **until}

    def __repr__(self) -> str:
        return f"{self.actuator!r} under {self.drive!r}"

    @cached_property
    def automaton(self) -> Automaton:
        """The actuator's modes and guards, under the drive's waveform."""
        return device_automaton(not self.is_data_only, *self._structure)

    @cached_property
    def _structure(self) -> tuple[Any, ...]:
        """What determines the equations: terms, waveforms, sums and the end of runs."""
        source, until = self.source, None
        if self._until is not None:
            scales = self.units.scales
            kinds = (PARAMETER_UNITS.get(name) for name in PARAMETER_NAMES)
            sizes = [float(scales.out(1.0, unit)) if unit else 1.0 for unit in kinds]
            units = [float(self.units.out(name, 1.0)) for name in self._own_states]
            until = self._until, (*units, float(scales.out(1.0, "s")), *sizes), PARAMETER_NAMES
        return self._kinds, Waveforms.of(source), self.includes_energy, until

    def _export_model(
        self,
        inputs: Sequence[str] = (),
        initial: State | Mapping[str, float] | None = None,
        options: Options | None = None,
    ) -> ExportedModel:
        """Return the system as plain data for export."""
        others = tuple(name for name in inputs if name not in VOLTAGES)
        if len(others) < len(inputs):
            return self._with_imported_voltage(inputs)._export_model(others, initial, options)
        from mems_impact.export.generated_source import automaton_with_source

        kinds, waveforms, summed, until = self._structure
        definition = device_definition(kinds, waveforms, summed=summed, until=until)
        automaton, generated = automaton_with_source(definition, None)
        voltages = tuple(
            ExportedNumber(
                name=name,
                value=value,
                unit=self.drive_unit if self.units.scales.named else "",
                factor=self.units.scales.unit(self.drive_unit),
                index=self._first_of_drive + index,
                rate_index=self._first_of_drive + rate,
            )
            for name, (index, rate, value) in self.drive.inputs.items()
        )
        model = super()._export_model(inputs, initial, options)
        return replace(
            model,
            name=self.name or "actuator",
            automaton=automaton,
            generated=generated,
            numbers=(*model.numbers, *voltages),
            inputs=(*inputs, *(number.name for number in voltages)),
            bounds=bounds_of(self._kinds),
        )

    def _limits(self, name: str) -> Limits:
        """Return the range of a parameter."""
        owner, dot, own = name.partition(".")
        if dot:
            term = self.actuator.term(owner)
            fields = {} if term is None else type(term).model_fields
        else:
            own = name
            fields = {**type(self.drive).model_fields, **ActuatorParameters.model_fields}
        return limits_of(fields[own]) if own in fields else UNLIMITED

    def _with_imported_voltage(self, inputs: Sequence[str]) -> ActuatorSystem:
        """Return the system with voltages as inputs, in place of the drive."""
        if self.source is not self.drive:
            problem = "the device limits the rate of its drive; omit that term"
            raise InvalidParameter("inputs", "voltage", "", problem=problem)
        own = 2.0 * math.pi * math.sqrt(self.actuator.m2 / self.actuator.k)
        return self._with(self.actuator, imported(self.drive, inputs, own), self._scales)

    @cached_property
    def _parameter_indices(self) -> Mapping[str, int]:
        """Indices in the parameter array of the numbers that occur in it as they stand."""
        places = {**{name: i for i, name in enumerate(PARAMETER_NAMES)}, **self._term_indices}
        if isinstance(self.source, Sine):
            first = self._first_of_drive
            places |= {"amplitude": first, "phase": first + 3}
        shaping = {
            f"{term.name()}.{name}"
            for term in self.actuator.terms
            if term.source(self.drive) is not self.drive
            for name in term.names
        }
        names, own = self.parameters.keys() - shaping, self.numbers()  # tables are no parameters
        return {
            name: i for name, i in places.items() if name in names and self._occurs_at(name, i, own)
        }

    def _occurs_at(self, name: str, place: int, before: ProblemParameters) -> bool:
        """Return whether a parameter changes one element of the array, in proportion, alone."""
        value = self.parameters[name]
        other = value * (1.0 + 2.0**-10) if value != 0.0 else 2.0**-10
        after = self.numbers({name: other})
        if len(before.parameters) != len(after.parameters) or before[1:] != after[1:]:
            return False
        changed = np.flatnonzero(before.parameters != after.parameters).tolist()
        return changed == [place] and after.parameters[place] == other / self.units.factor(name)

    @property
    def initial(self) -> State:
        """Initial state by default: at rest in the middle."""
        return AT_REST

    @property
    def section(self) -> Section:
        """The section x2 = 0, where the block passes the middle."""
        return X2, 0.0, 0

    @property
    def statistics(self) -> ActuatorStatistics:
        """Statistics of runs, orbits and attractors."""
        if not self.includes_energy:
            return ActuatorStatistics(self)
        places = _of_drive(self._kinds, self._electrodes, self.states)
        sums = {
            "energy in per period": places,
            **{f"{name} per period": (self.states.index(sum_of(each)),)
               for name, each in (("slip", "slip"), ("friction loss", "friction"))},
        }  # fmt: skip
        given = Observable("energy in", _total(places), unit="J")
        return ActuatorStatistics(self, (given,), sums)

    @property
    def state_space(self) -> ActuatorStateSpace:
        """Its states: modes, limits, conversion from and to scaled states."""
        return ActuatorStateSpace(self)

    @property
    def checks(self) -> ActuatorChecks:
        """Checks of the validity of its terms, and of continuation."""
        return ActuatorChecks(self)

    def resting_pull(self, right: Floats, left: Floats) -> Floats:
        """Return the force on the block at rest in the middle for values of both sources."""
        model, p = compose(self._kinds, self._electrodes), self.numbers().parameters
        y = np.zeros(len(model.layout.states))
        rows = zip(self.into_drive(right), self.into_drive(left), strict=True)
        pulls = np.array([model.pull(v, w, y, p) for v, w in rows], dtype=np.float64)
        return np.asarray(self._scales.out(pulls, "N"))

    def ending(self, until: Callable[..., float]) -> HybridSystem:
        """Return the system with runs that end at a falling zero of ``until(mode, t, y, p)``.

        The function is called in the units of the device, with the states and the eleven
        parameters by name. The position of the frame is measured from the start of the run.
        """
        arguments.function("until", until, *arguments.ARGUMENTS)
        return self._featuring(until, self.includes_energy)

    @property
    def without_until(self) -> ActuatorSystem:
        """The system without the function that ends its runs."""
        return self._featuring(None, self.includes_energy)


class ActuatorChecks(Checks):
    """Checks of an actuator under a drive."""

    _system: ActuatorSystem

    def start_side(self, problem: Problem, start: HybridState) -> None:
        """Warn of nothing: the mode fits the state."""

    def continuation(self, name: str) -> None:
        """Raise InvalidParameter unless orbits can be continued in the parameter `name`."""
        super().continuation(name)
        system, of_bias = self._system, name.rpartition(".")[2] == "bias"
        if of_bias and system.parameters[name] == 0.0 and not system._signed:
            problem = "the forcing period doubles at bias = 0; start from another value"
            raise InvalidParameter(name, 0.0, "", problem=problem)

    def observers(self, problem: Problem, start: HybridState) -> list[EventObserver]:
        """Return an observer that warns if a run leaves the range of validity of its terms."""
        system = self._system
        parts = compose(system._kinds, system._electrodes).contributions if system._kinds else ()
        limits = [limit for part in parts for limit in part.limits]
        return [Validity(limits, problem, start, system._scales)] if limits else []


def kind_of(drive: Drive) -> str:
    """Return the kind of a waveform in files; empty if files cannot contain it."""
    return _kind_of(type(drive))


@cache
def _kind_of(waveform: type[Drive]) -> str:
    kinds = {name: kind for kind, name in WAVEFORMS.items()}
    kind = kinds.get(waveform.__name__, "")
    return kind if kind and drive_of_kind(kind) is waveform else ""


def own_functions(drive: Drive) -> dict[str, str]:
    """Return the places of definition of a drive's functions that its numbers do not determine."""
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


@cache
def _of_drive(
    kinds: tuple[TermKind, ...], electrodes: int, states: tuple[str, ...]
) -> tuple[int, ...]:
    """Return the states whose sum is the energy input: work and losses of the electrodes."""
    lost = accounts(kinds, electrodes).at_electrodes
    return tuple(states.index(sum_of(name)) for name in ("electrodes", *lost))


@cache
def _total(places: tuple[int, ...]) -> Callable[[Any, Any], float]:
    """Return the sum of some states as an observable."""

    def energy_in(y, p):  # type: ignore[no-untyped-def]
        total = 0.0
        for place in places:
            total += y[place]
        return total

    return energy_in
