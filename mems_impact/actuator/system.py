"""A device under a drive as a system.

The energy input of the drive is accumulated in cyclic states. These affect the step size, so that
motions agree with those of the actuator to tolerance, not exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact._util.limits import UNLIMITED, Bound, Limits
from mems_impact._util.units import DIMENSIONLESS, Scales
from mems_impact.actuator import equations as eq
from mems_impact.actuator import impact_law
from mems_impact.actuator.automaton import (
    IMPACTS,
    MARGIN_UNITS,
    device_automaton,
    device_definition,
    direction_of,
    side_of,
)
from mems_impact.actuator.design.data_sheet_quantities import QUANTITIES
from mems_impact.actuator.drives import WAVEFORMS
from mems_impact.actuator.drives.base import Drive, Waveform
from mems_impact.actuator.drives.files import drive_of_kind
from mems_impact.actuator.drives.imported import ImportedVoltage, ImportedVoltages
from mems_impact.actuator.drives.sine import Sine
from mems_impact.actuator.energy_accounting import accounts, sum_of
from mems_impact.actuator.equations import STATES, V1, X2
from mems_impact.actuator.model import HIDDEN, compose, layout
from mems_impact.actuator.parameter_base import limits_of
from mems_impact.actuator.parameters import PARAMETER_NAMES, Actuator
from mems_impact.actuator.results import (
    SYMBOLS,
    ActuatorOrbit,
    ActuatorRun,
)
from mems_impact.actuator.statistics import ActuatorStatistics
from mems_impact.actuator.terms.base import Term, TermKind, Validity, drive_unit, is_compliant
from mems_impact.actuator.units import COLUMN_UNITS, PARAMETER_UNITS, DeviceScales, scaled_fields
from mems_impact.errors import InvalidParameter
from mems_impact.export.model import ExportedModel, ExportedNumber
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.definition import RATE_STEP, Typical
from mems_impact.hybrid.pickling import reference
from mems_impact.hybrid.problem import Problem, ProblemParameters, Section
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.options import Options
from mems_impact.systems import arguments
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.checks import Checks
from mems_impact.systems.observables import EventObserver, Observable
from mems_impact.systems.state import State, state_from
from mems_impact.systems.state_space import StateSpace
from mems_impact.systems.units import Units

__all__ = [
    "ActuatorSystem",
    "kick_speeds",
    "kicked_state",
]

# --- Parameters of an actuator under a drive


class ActuatorNumerics(HybridSystem):
    """A system whose parameters are the numbers of an actuator, of its terms and of a drive."""

    actuator: Actuator
    drive: Drive
    _scales: Scales
    _until: Callable[..., Any] | None = None
    includes_energy = False
    """Whether works and losses are states, and studies show the energy input of the drive."""

    def _put(self, actuator: Actuator, drive: Drive, scales: Scales) -> None:
        self.name = ""
        self.actuator, self.drive, self._scales = actuator, drive, scales

    @cached_property
    def _kinds(self) -> tuple[TermKind, ...]:
        return tuple(term.kind for term in self.actuator.terms)

    @cached_property
    def _uses_full_voltage_period(self) -> bool:
        """Whether a term depends on the sign of v, and v changes sign after a period of v^2.

        The forcing period is then the period of v itself.
        """
        return self._signed and self.drive.changes_sign

    @cached_property
    def source(self) -> Drive:
        """The output of the source: the drive, unless a term limits its rate."""
        return _source(self.actuator.terms, self.drive)

    @cached_property
    def drive_unit(self) -> str:
        """The SI unit of the values of the drive: "V", or "C" if it sets a charge."""
        return drive_unit(self.actuator.terms)

    def into_drive(self, values: Any) -> Any:
        """Convert values of the drive to scaled units."""
        return self._scales.into(values, self.drive_unit)

    @cached_property
    def _drive_scales(self) -> Scales:
        """The scales, with the scale of the values of the drive as voltage."""
        if self.drive_unit == "V" or self._scales is DIMENSIONLESS:
            return self._scales
        return DeviceScales.of_drive(self._scales.unit(self.drive_unit), self._scales.unit("s"))

    @cached_property
    def _signed(self) -> bool:
        return any(kind.term.signed for kind in self._kinds)

    @property
    def parameters(self) -> dict[str, float]:
        """All numbers of drive and actuator."""
        return dict(self._parameters)

    @cached_property
    def _parameters(self) -> dict[str, float]:
        values = {name: self.drive.number(name) for name in self._drive_names}
        for name in PARAMETER_NAMES:
            values.setdefault(name, float(getattr(self.actuator, name)))
        for term in self.actuator.terms:
            values |= {f"{term.name()}.{name}": getattr(term, name) for name in term.names}
        return values

    @property
    def frequency_parameter(self) -> str:
        """The parameter of the drive's frequency: "frequency" [Hz], or "omega" [rad/s]."""
        return "frequency" if "frequency" in self._drive_names else "omega"

    @cached_property
    def units(self) -> Units:
        """SI units of parameters and columns; empty for a dimensionless device."""
        names: dict[str, str] = {}
        if self._scales is not DIMENSIONLESS:
            kinds = {"V": self.drive_unit}
            of_drive = {name: self.drive.unit(name) for name in self._drive_names}
            of_drive = {name: kinds.get(unit, unit) for name, unit in of_drive.items()}
            names = {**PARAMETER_UNITS, **COLUMN_UNITS, **of_drive, **self._term_units}
        return Units(
            names,
            self._scales,
            margin_names=MARGIN_UNITS,
            symbols={} if names else SYMBOLS,  # the paper's f for the amplitude without a unit
        )

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
    def forcing_period(self) -> float:
        """The period of the drive, or of the voltage itself if a term depends on its sign."""
        return self.drive.period * (2.0 if self._uses_full_voltage_period else 1.0)

    def check_parameter(self, name: str, field: str = "parameter") -> None:
        """Raise InvalidParameter unless `name` is a parameter, with the symbol of a quantity."""
        entry = QUANTITIES.get(name)
        if entry is not None and entry.parameter and name not in self.parameters:
            raise InvalidParameter(field, name, f"{entry.parameter}, the symbol of this quantity")
        super().check_parameter(name, field)

    def changed(self, /, **values: float) -> Self:
        """Return the system at other, validated values of some parameters."""
        for name in values:
            self.check_parameter(name)
        numbers = {name: self.units.parse(name, value) for name, value in values.items()}
        drive_values, actuator_values, term_values = self._sorted(numbers)
        drive = self.drive.varied(drive_values) if drive_values else self.drive
        if term_values:
            actuator_values["terms"] = self._terms(term_values)
        actuator = self.actuator.replace(**actuator_values) if actuator_values else self.actuator
        return self._with(actuator, drive, actuator.scales)

    def shifted(self, values: Mapping[str, float]) -> Self:
        """Return the system at other values, allowed or not, in the same scales.

        Finite differences at the end of a parameter's range go beyond it, as do trial steps.
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

    def _with(self, actuator: Actuator, drive: Drive, scales: Scales) -> Self:
        """Return the system of another actuator and drive, without validation."""
        other = object.__new__(type(self))
        other._until, other.includes_energy = self._until, self.includes_energy
        other._put(actuator, drive, scales)
        return other

    def _featuring(self, until: Callable[..., Any] | None, summed: bool) -> Self:
        """Return the system with other features of its runs."""
        other = self._with(self.actuator, self.drive, self._scales)
        other._until, other.includes_energy = until, summed
        return other

    def _sorted(
        self, values: Mapping[str, float]
    ) -> tuple[dict[str, float], dict[str, Any], dict[str, float]]:
        """Return the values of the drive, of the actuator and of its terms."""
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
        """Return the terms with some numbers changed."""
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
        terms = tuple(term.scaled(self._scales) for term in self.actuator.terms)
        return self.actuator.replace_unchecked(**values, terms=terms, units="dimensionless")

    def problem(self, options: Options) -> Problem:
        """Return the problem for the event loop, dimensionless.

        Raises
        ------
        InvalidParameter
            If the tolerances do not resolve a term.
        """
        if self._kinds:
            electrode = compose(self._kinds, 1).electrodes[0]
            capacitance = float(electrode.capacitance(0.0, self.numbers().parameters))
            for term in self.actuator.terms:
                term.check_resolved(options, self._scales, capacitance)
        return super().problem(options)

    def numbers(self, changes: Mapping[str, float] | None = None) -> ProblemParameters:
        """Return the part of the problem that depends on the parameters, dimensionless.

        The function works with plain numbers, without a validated actuator, and without a drive if
        its `numbers` does not need one.
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
            device[self._term_indices[name]] = self.units.into(name, value)
        if self.source is self.drive:
            q, period, switches, scale = self.drive.numbers(of_drive, self._drive_scales)
        else:
            drive = self.drive.varied(of_drive, checked=False) if of_drive else self.drive
            terms = self._terms(of_terms, checked=False) if of_terms else self.actuator.terms
            numbers = _source(terms, drive).numbers({}, self._drive_scales)
            q, period, switches, scale = numbers
        unfolded = self._uses_full_voltage_period
        if of_drive and self._signed:
            unfolded = self.drive.varied(of_drive, checked=False).changes_sign
        if unfolded:
            switches += tuple(period + time for time in switches)
            scale, period = scale or period, 2.0 * period
        hidden = [RATE_STEP * (scale or period), *[0.0] * (HIDDEN - 1)]
        return ProblemParameters(np.concatenate([device, hidden, q]), period, switches, scale)

    @cached_property
    def _device(self) -> Floats:
        """The numbers of actuator and terms in scaled units."""
        of_terms = [each for term in self.actuator.terms for each in term.numbers(self._scales)]
        return np.concatenate([self.inner_actuator.to_array(), of_terms])

    @property
    def _first_of_drive(self) -> int:
        """Index of the first number of the drive in the parameter array."""
        return len(self._device) + HIDDEN

    @cached_property
    def _term_indices(self) -> dict[str, int]:
        """Indices of the parameters of terms in the parameter array."""
        places: dict[str, int] = {}
        first = len(PARAMETER_NAMES)
        for kind in self._kinds:
            at = kind.indices(first)
            places |= {f"{kind.term.name()}.{name}": place for name, place in at.p.items()}
            first += kind.length
        return places

    @cached_property
    def _drive_names(self) -> tuple[str, ...]:
        return self.drive.names


def _source(terms: Sequence[Term], drive: Drive) -> Drive:
    for term in terms:
        drive = term.source(drive)
    return drive


# --- The system of an actuator under a drive

AT_REST = State()
CONTACT_TOLERANCE_RATIO = 1e-9  # of delta: scaling may round a block on its stopper


def _frame_position(y: Any, p: Any) -> float:
    return float(y.x1)


def _energy_lost(mode: int, t: float, before: Any, after: Any, p: Any) -> float:
    return float(impact_law.impact_loss(p[eq.M1], p[eq.M2], before.v2, after.v2))


def _contact_loss(y: Any, p: Any) -> float:
    return float(y.contact_loss)


STEP_OBSERVABLE = Observable("step", _frame_position, unit="m")
IMPACT_LOSS = Observable("energy lost", _energy_lost, at=IMPACTS, reduce="sum", unit="J")
CONTACT_LOSS = Observable("energy lost", _contact_loss, unit="J")  # of compliant stoppers


class ActuatorSystem(ActuatorNumerics):
    """An actuator under a drive, with all their numbers as parameters.

    Parameters
    ----------
    actuator : Actuator
    drive : Drive
    scales : Scales, optional
        Units of the scaled variables, which remain when parameters vary; by default those of the
        actuator.

    Raises
    ------
    InvalidParameter
        If `actuator` is not an actuator, or `drive` is not a drive or is not representable in
        floating point.
    """

    _run_type = ActuatorRun
    _orbit_type = ActuatorOrbit

    def __init__(self, actuator: Actuator, drive: Drive, scales: Scales | None = None) -> None:
        if not isinstance(actuator, Actuator):
            raise InvalidParameter("actuator", actuator, "an Actuator (see load_actuator)")
        if not isinstance(drive, Drive):
            raise InvalidParameter("drive", drive, "a Drive, such as Sine(amplitude=…, omega=…)")
        if actuator.units == "dimensionless":
            drive.check_without_units()
        drive.check_texts(drive_unit(actuator.terms))
        drive.check()
        drive.check_period()
        self._put(actuator, drive, scales or actuator.scales)
        if self._signed or self.source is not drive:
            drive.check_signed()
            self.source.check()

    def _put(self, actuator: Actuator, drive: Drive, scales: Scales) -> None:
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
        return self._kinds, source.voltage, source.left_voltage, self.includes_energy, until

    def _with_source(self, model: ExportedModel) -> ExportedModel:
        """Return a model for export with the source of its generated functions."""
        from mems_impact.export.generated_source import automaton_with_source

        kinds, voltage, left, summed, until = self._structure
        definition = device_definition(kinds, voltage, left, summed=summed, until=until)
        automaton, generated = automaton_with_source(definition, None)
        return replace(model, automaton=automaton, generated=generated)

    @property
    def _electrodes(self) -> int:
        return 1 if self.drive.left_voltage is None else 2

    @cached_property
    def _own_states(self) -> tuple[str, ...]:
        """The states of the actuator, without sums of energy accounting."""
        return layout(self._kinds, self._electrodes).states

    @cached_property
    def _yields(self) -> bool:
        """Whether the stoppers are compliant, so that a block may be beyond them."""
        return is_compliant(self.actuator)

    def _export_model(
        self,
        inputs: Sequence[str] = (),
        initial: State | Mapping[str, float] | None = None,
        options: Options | None = None,
    ) -> ExportedModel:
        """Return the system as plain data for export."""
        if any(name in VOLTAGES for name in inputs):
            return self._with_imported_voltage(inputs)._export_model(inputs, initial, options)
        model = self._with_source(super()._export_model(inputs, initial, options))
        named = self.name or "actuator"
        return replace(model, name=named, bounds=self._number_bounds)

    @property
    def _number_bounds(self) -> tuple[Bound, ...]:
        """Bounds that numbers of the device set for each other."""
        found, first = list(ORDERED), len(PARAMETER_NAMES)
        for kind in self._kinds:
            found += kind.term.bounds(kind.indices(first), kind.shape, self._yields)
            first += kind.length
        return tuple(found)

    def _limits(self, name: str) -> Limits:
        """Return the range of a parameter."""
        owner, dot, own = name.partition(".")
        if dot:
            term = self.actuator.term(owner)
            fields = {} if term is None else type(term).model_fields
        else:
            own = name
            fields = {**type(self.drive).model_fields, **Actuator.model_fields}
        return limits_of(fields[own]) if own in fields else UNLIMITED

    def _with_imported_voltage(self, inputs: Sequence[str]) -> ImportedSystem:
        """Return the system with voltages as inputs, in place of the drive."""
        left = self.drive.left_voltage is not None
        needed = VOLTAGES if left else VOLTAGES[:1]
        if not left and "left_voltage" in inputs:
            allowed = "voltage: this drive has no electrode on the left"
            raise InvalidParameter("inputs", "left_voltage", allowed)
        if not set(needed) <= set(inputs):
            allowed = "both voltage and left_voltage: this drive has two electrodes"
            raise InvalidParameter("inputs", tuple(inputs), allowed)
        if self.source is not self.drive:
            problem = "the device limits the rate of its drive; omit that term"
            raise InvalidParameter("inputs", "voltage", "", problem=problem)
        own = 2.0 * math.pi * math.sqrt(self.actuator.m2 / self.actuator.k)
        start = float(self.drive.value(0.0))
        values: dict[str, float] = {"period": min(own, self.drive.time_scale), "level": start}
        if left:
            values["left_level"] = float(self.drive.value(0.0, left=True))
        drive = (ImportedVoltages if left else ImportedVoltage)(**values)
        system = object.__new__(ImportedSystem)
        system._put(self.actuator, drive, self._scales)
        return system

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
        names = self.parameters.keys() - shaping  # tables are no parameters
        return {name: i for name, i in places.items() if name in names and self._occurs_at(name, i)}

    def _occurs_at(self, name: str, place: int) -> bool:
        """Return whether a parameter changes one element of the array, in proportion, alone."""
        value = self.parameters[name]
        other = value * (1.0 + 2.0**-10) if value != 0.0 else 2.0**-10
        before, after = self.numbers(), self.numbers({name: other})
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
        given = _given(self._kinds, self._electrodes, self.states)
        return ActuatorStatistics(self, (Observable("energy in", given, unit="J"),))

    @property
    def state_space(self) -> ActuatorStateSpace:
        """Its states: modes, limits, conversion from and to scaled states."""
        return ActuatorStateSpace(self)

    @property
    def checks(self) -> ActuatorChecks:
        """Checks of the validity of its terms, and of continuation."""
        return ActuatorChecks(self)

    @cached_property
    def shows_node(self) -> bool:
        """Whether the voltages at the electrodes differ from the voltages of the drive."""
        return any(kind.term.in_series for kind in self._kinds)

    def node_voltages(self, cycle: NDArray[np.int64], time: Floats, y: Floats) -> dict[str, Floats]:
        """Return the voltage at each electrode, scaled; arguments as for `derived_columns`."""
        if self.drive.changes_sign and not self._uses_full_voltage_period:
            # Two forcing periods are one of the voltage.
            time = time + self.numbers().period * (cycle % 2)
        source, p = self.source, self.numbers().parameters
        q = p[p.size - source.parameters().size :]
        sides: list[tuple[Waveform, str, float]] = [(source.voltage, "node voltage", 1.0)]
        if source.left_voltage is not None:
            sides.append((source.left_voltage, "left node voltage", -1.0))
        model, found = compose(self._kinds, len(sides)), {}
        for electrode, (waveform, name, side) in zip(model.electrodes, sides, strict=True):
            rows = zip(time.tolist(), y, strict=True)
            values = [electrode.node(waveform(t, q), side * at[X2], at, p) for t, at in rows]
            found[name] = np.array(values, dtype=np.float64)
        return found

    def resting_pull(self, right: Floats, left: Floats) -> Floats:
        """Return the force on the block at rest in the middle for values of both sources."""
        model, p = compose(self._kinds, self._electrodes), self.numbers().parameters
        y = np.zeros(len(model.layout.states))
        rows = zip(self.into_drive(right), self.into_drive(left), strict=True)
        pulls = np.array([model.pull(v, w, y, p) for v, w in rows], dtype=np.float64)
        return np.asarray(self._scales.out(pulls, "N"))

    def with_energy(self) -> ActuatorSystem:
        """Return the system with energy accounting of the drive's input.

        Its studies show the input per period and per impact.
        """
        return self._featuring(self._until, True)

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


class ActuatorStateSpace(StateSpace):
    """The states of an actuator under a drive."""

    mode_by_switch = True
    displayed = ("v2",)
    _system: ActuatorSystem

    def derived_columns(
        self, cycle: NDArray[np.int64], time: Floats, y: Floats
    ) -> Mapping[str, Floats]:
        """Return the voltages at the electrodes, if they differ from the voltages of the drive."""
        return self._system.node_voltages(cycle, time, y) if self._system.shows_node else {}

    def initial(self, direction: str) -> State:
        """Return rest in the middle for a sweep up, and a kick for one down."""
        return State() if direction == "up" else kicked_state(self._system.actuator)

    def _check_state(self, field: str, state: State) -> None:
        super()._check_state(field, state)
        x2, delta = state.as_dict().get("x2", 0.0), self._system.actuator.delta
        if self._system._yields:
            # Beyond, the electrode's force is frozen.
            delta = 0.5 * (delta + self._system.actuator.d)
        if not abs(x2) <= delta:
            where = "halfway from stopper to electrode" if self._system._yields else "the stoppers"
            limits = f"-{delta:g} and {delta:g}{' m' if self._units.scales.named else ''}"
            raise InvalidParameter("x2", x2, f"between {where} at {limits}")
        if state.mode is not None:
            self._check_mode(state)

    def _check_mode(self, state: State) -> None:
        """Raise InvalidParameter unless the velocities of a state are possible in its mode."""
        mode = self.mode_number(state.mode if state.mode is not None else 0)
        values = {**dict.fromkeys(STATES, 0.0), **state.as_dict()}
        direction, side, delta = direction_of(mode), side_of(mode), self._system.actuator.delta
        v1, resting = values["v1"], values["v2"] == 0.0
        beyond = abs(values["x2"]) - delta if side == 0 else side * values["x2"] - delta
        touching = CONTACT_TOLERANCE_RATIO * delta
        fits = v1 == 0.0 if direction == 0 else direction * v1 >= 0.0
        if self._system._yields:
            fits = fits and (beyond <= touching if side == 0 else beyond >= -touching)
        else:
            fits = fits and (side == 0 or (resting and abs(beyond) <= touching))
        if not fits:
            problem = f"does not fit {state!r}; omit it to derive it from the state"
            raise InvalidParameter("mode", state.mode, "", problem=problem)

    def state(self, instant: HybridState) -> State:
        """Return an instant as a state in the device's units, without sums."""
        values = {
            name: self._units.out(name, value)
            for name, value in zip(self._system._own_states, instant.y.tolist(), strict=False)
        }
        time = float(self._units.scales.out(instant.time, "s"))
        if self._units.scales is not DIMENSIONLESS:
            # Scaling may round a block on its stopper, or the end of a period, to just beyond it.
            delta = self._system.actuator.delta
            last = math.nextafter(self._system.forcing_period, 0.0)
            if not self._system._yields:
                values["x2"] = min(max(values["x2"], -delta), delta)
            time = min(time, last)
        return state_from(values, time=time, initial=instant.initial)

    def mode_of(self, y: Floats, time: float, problem: Problem, mode: int = 0) -> int:
        """Return the mode of a state, by Equation (4) and the contact force."""
        automaton = problem.automaton
        code = automaton.switch_code
        mode, y[:] = automaton.state_after(mode, code, time, y, problem.parameters)
        return mode

    def snap(self, mode: int, y: Floats) -> Floats:
        """Return a state found by Newton's method, with a stuck frame at rest."""
        # A rounding is left there, with which a run would begin to slip.
        return y if direction_of(mode) != 0 else np.where(np.arange(y.size) == V1, 0.0, y)


class ActuatorChecks(Checks):
    """Checks of an actuator under a drive."""

    _system: ActuatorSystem

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


def kicked_state(actuator: Actuator) -> State:
    """Return a kicked state: the block passes the middle fast enough to strike a stopper.

    Its kinetic energy is four times the spring energy at the stopper. If friction would need more
    than one free oscillation to stop the device, the frame moves the other way, with the opposite
    momentum: otherwise the device would coast for thousands of periods.

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
    >>> run = mi.simulate(actuator, drive, periods=300, initial=mi.kicked_state(actuator))
    >>> float(run.statistics["impacts per period"])
    1.0
    """
    speed, common = kick_speeds(actuator)
    oscillation = 2.0 * math.pi * math.sqrt(actuator.m2 / actuator.k)
    if common > actuator.mu_d * actuator.g * oscillation:
        return State(v1=-common, v2=speed)
    return State(v2=speed)


def kick_speeds(actuator: Actuator) -> tuple[float, float]:
    """Return the speeds of the block after a kick and of the center of mass with it."""
    spring: Any = actuator.term("tabulated_spring")
    stored = 0.0 if spring is None else spring.energy(actuator.delta)
    speed = 2.0 * actuator.delta * math.sqrt(actuator.k / actuator.m2)
    if stored > 0.0:
        speed = math.sqrt(8.0 * stored / actuator.m2)
    return speed, actuator.m2 * speed / (actuator.m1 + actuator.m2)


# --- Export with voltages as inputs

VOLTAGES = ("voltage", "left_voltage")
"""The inputs that replace a drive."""


def _gap(p: Any) -> Any:
    return p[eq.D]


def _static_friction(p: Any) -> Any:
    return p[eq.MU_S]


ORDERED = (
    Bound(name="delta", value=_gap, upper=True, meaning="the gap d"),
    Bound(name="mu_d", value=_static_friction, upper=True, excluded=False, meaning="which is mu_s"),
)
"""Bounds of parameters by others."""


class ImportedSystem(ActuatorSystem):
    """An actuator whose voltages are inputs, for export."""

    drive: ImportedVoltage

    def _export_model(
        self,
        inputs: Sequence[str] = (),
        initial: State | Mapping[str, float] | None = None,
        options: Options | None = None,
    ) -> ExportedModel:
        """Return the system as plain data for export."""
        if self.source is not self.drive:
            problem = (
                "the ramps of SlewRate are computed from a known voltage; export without the "
                "input, or remove the term and let the importer limit the rate"
            )
            raise InvalidParameter("inputs", list(inputs), "", problem=problem)
        others = [name for name in inputs if name not in VOLTAGES]
        model = self._with_source(HybridSystem._export_model(self, others, initial, options))
        first = self._first_of_drive
        unit = self.drive_unit if self.units.scales.named else ""
        voltages = tuple(
            ExportedNumber(
                name=name,
                value=value,
                unit=unit,
                factor=self.units.scales.unit(self.drive_unit),
                index=first + index,
                rate_index=first + rate,
            )
            for name, (index, rate, value) in self.drive.inputs.items()
        )
        own = tuple(number for number in model.numbers if number.name not in self._drive_names)
        return replace(
            model,
            name="actuator",
            numbers=(*own, *voltages),
            inputs=(*others, *(number.name for number in voltages)),
            bounds=self._number_bounds,
        )


@cache
def _given(
    kinds: tuple[TermKind, ...], electrodes: int, states: tuple[str, ...]
) -> Callable[[Any, Any], float]:
    """Return the energy input of the drive: work and losses of the electrodes."""
    lost = accounts(kinds, electrodes).at_electrodes
    places = tuple(states.index(sum_of(name)) for name in ("electrodes", *lost))

    def energy_in(y, p):  # type: ignore[no-untyped-def]
        total = 0.0
        for place in places:
            total += y[place]
        return total

    return energy_in
