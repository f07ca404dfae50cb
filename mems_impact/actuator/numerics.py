"""The numbers of an actuator under a drive, as parameters of a system."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any, Generic, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact._util.units import DIMENSIONLESS, Scales
from mems_impact.actuator.automaton import MARGIN_UNITS
from mems_impact.actuator.design.data_sheet_quantities import QUANTITIES
from mems_impact.actuator.drives.base import CHANNELS, Drive, Waveform
from mems_impact.actuator.equations import X2
from mems_impact.actuator.geometry.geometry import PREFIX
from mems_impact.actuator.model import HIDDEN, compose, layout
from mems_impact.actuator.parameters import PARAMETER_NAMES, ActuatorParameters, with_geometry
from mems_impact.actuator.terms.base import Term, TermKind, drive_unit, is_compliant
from mems_impact.actuator.units import COLUMN_UNITS, PARAMETER_UNITS, DeviceScales, scaled_fields
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.definition import RATE_STEP
from mems_impact.hybrid.problem import Problem, ProblemParameters
from mems_impact.integrators.options import Options
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.units import Units

NORMAL_SAMPLES = 33  # of the normal force between two switches of the drive


A = TypeVar("A", bound=ActuatorParameters)


class ActuatorNumerics(HybridSystem, Generic[A]):
    """A system whose parameters are the numbers of an actuator, of its terms and of a drive."""

    actuator: A
    drive: Drive
    _scales: Scales
    _until: Callable[..., Any] | None = None
    includes_energy = False
    """Whether works and losses are states, and studies show the energy input of the drive."""

    def _put(self, actuator: Any, drive: Drive, scales: Scales) -> None:
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
        return source_of(self.actuator.terms, self.drive)

    @cached_property
    def drive_unit(self) -> str:
        """The SI unit of the values of the drive: "V", or "C" if it sets a charge."""
        return drive_unit(self.actuator.terms)

    @property
    def clamp_driven(self) -> bool:
        """Whether the normal force on the ground depends on the voltages of the drive."""
        return compose(self._kinds, self._electrodes).clamp_driven

    def source_values(self, time: Any) -> tuple[Floats, ...]:
        """Return the scaled voltages of both electrodes and a clamp at times of the drive."""
        values = (self.source.value(time, channel=channel) for channel in CHANNELS)
        return tuple(np.asarray(self.into_drive(each)) for each in values)

    def normal_forces(self) -> Floats:
        """Return the normal force on the ground, scaled: samples of a period if it varies."""
        model, p = compose(self._kinds, self._electrodes), self.numbers().parameters
        if not model.clamp_driven:
            return np.array([model.normal_force(0.0, 0.0, 0.0, p)])
        edges = [0.0, *self.source.switches, self.source.period]
        inner = [np.linspace(a, np.nextafter(b, 0.0), NORMAL_SAMPLES) for a, b in pairwise(edges)]
        rows = zip(*self.source_values(np.concatenate(inner)), strict=True)
        return np.array([model.normal_force(*row, p) for row in rows])

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
        for name, number in self.actuator.numbers.items():
            values.setdefault(name, number)
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
            if self.actuator.geometry is not None:
                names |= self.actuator.geometry.number_units
        return Units(
            names,
            self._scales,
            margin_names=MARGIN_UNITS,
            symbols={} if names else {"amplitude": "$f$"},  # the paper's, without a unit
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

    def changed(self, /, **values: float | str) -> Self:
        """Return the system at other, validated values of some parameters."""
        for name in values:
            self.check_parameter(name)
        numbers = {name: self.units.parse(name, value) for name, value in values.items()}
        actuator, drive = self._moved(numbers, checked=True)
        return self._with(actuator, drive, actuator.scales)

    def shifted(self, values: Mapping[str, float]) -> Self:
        """Return the system at other values, allowed or not, in the same scales.

        Finite differences at the end of a parameter's range go beyond it, as do trial steps.
        """
        return self._with(*self._moved(values, checked=False), self._scales)

    def _moved(self, values: Mapping[str, float], *, checked: bool) -> tuple[A, Drive]:
        """Return actuator and drive at other values, out of range only if not `checked`."""
        of_drive, of_actuator, of_terms = self._sorted(values, checked=checked)
        drive = self.drive.varied(of_drive, checked=checked) if of_drive else self.drive
        if of_terms:
            of_actuator["terms"] = self._terms(of_terms, checked=checked)
        replace = self.actuator.replace if checked else self.actuator.replace_unchecked
        return replace(**of_actuator) if of_actuator else self.actuator, drive

    def _with(self, actuator: Any, drive: Drive, scales: Scales) -> Self:
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

    def with_energy(self) -> Self:
        """Return the system with energy accounting of the drive's input.

        Its studies show the input per period and per impact.
        """
        return self._featuring(self._until, True)

    @property
    def without_integrals(self) -> Self:
        """The system without energy accounting."""
        return self._featuring(self._until, False) if self.includes_energy else self

    def _sorted(
        self, values: Mapping[str, float], *, checked: bool = False
    ) -> tuple[dict[str, float], dict[str, Any], dict[str, float]]:
        """Return the values of the drive, of the actuator and of its terms."""
        of_drive, of_actuator, of_terms = {}, {}, {}
        for name, value in with_geometry(self.actuator, values, checked=checked).items():
            if name in self._drive_names:
                of_drive[name] = value
            elif name in PARAMETER_NAMES or name == "geometry":
                of_actuator[name] = value
            else:
                if name in values:
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
    def inner_actuator(self) -> A:
        """The actuator in the units of the numerics."""
        if self._scales is DIMENSIONLESS:
            return self.actuator
        values = scaled_fields(self.actuator, PARAMETER_UNITS, self._scales)
        terms = tuple(term.scaled(self._scales) for term in self.actuator.terms)
        values |= {"terms": terms, "geometry": None, "units": "dimensionless"}
        return self.actuator.replace_unchecked(**values)

    def problem(self, options: Options) -> Problem:
        """Return the problem for the event loop, dimensionless.

        Raises InvalidParameter if the tolerances do not resolve a term.
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
        if changes and any(name.startswith(PREFIX) for name in changes):
            return self.shifted(changes).numbers()
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
            numbers = source_of(terms, drive).numbers({}, self._drive_scales)
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

    @property
    def _electrodes(self) -> int:
        return len(self.drive.sides)

    @cached_property
    def _own_states(self) -> tuple[str, ...]:
        """The states of the actuator, without sums of energy accounting."""
        return layout(self._kinds, self._electrodes).states

    @cached_property
    def _yields(self) -> bool:
        """Whether the stoppers are compliant, so that a block may be beyond them."""
        return is_compliant(self.actuator)

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


def source_of(terms: Sequence[Term], drive: Drive) -> Drive:
    """Return the drive as terms change it."""
    for term in terms:
        drive = term.source(drive)
    return drive
