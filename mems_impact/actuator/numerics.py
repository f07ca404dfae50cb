"""The numbers of an actuator under a drive: by name and unit, and as the numerics take them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, Self, TypeVar

import numpy as np

from mems_impact.actuator.composing import SCRATCH
from mems_impact.actuator.drives import Drive
from mems_impact.actuator.modes import MARGIN_UNITS
from mems_impact.actuator.parameters import PARAMETER_NAMES, PARAMETER_UNITS, Actuator
from mems_impact.actuator.tables import COLUMN_UNITS
from mems_impact.actuator.terms.base import Term, TermKind
from mems_impact.actuator.units import scaled_fields
from mems_impact.analysis.system import System
from mems_impact.hybrid.problem import Numbers
from mems_impact.hybrid.trajectory import Floats
from mems_impact.units import DIMENSIONLESS, Scales

__all__ = ["ActuatorNumerics"]

Kind = TypeVar("Kind", bound="ActuatorNumerics")


class ActuatorNumerics(System):
    """A system whose parameters are the numbers of an actuator, of its terms and of a drive."""

    actuator: Actuator
    drive: Drive
    _scales: Scales

    def _put(self, actuator: Actuator, drive: Drive, scales: Scales) -> None:
        self.name = ""
        self.actuator, self.drive, self._scales = actuator, drive, scales

    @cached_property
    def _kinds(self) -> tuple[TermKind, ...]:
        return tuple(term.kind for term in self.actuator.terms)

    @cached_property
    def _unfolded(self) -> bool:
        """Whether the sign of the voltage matters, and changes from one period of v^2 to the next.

        The forcing period is then that of v itself.
        """
        return self._signed and self.drive.changes_sign

    @cached_property
    def _signed(self) -> bool:
        return any(kind.term.signed for kind in self._kinds)

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

    def margin_amount(self, guard: str, value: float, *, rate: bool = False) -> str:
        """Return the margin of a guard, or its rate, in the units of the device, to be printed."""
        unit = MARGIN_UNITS.get(guard, "")
        factor = self.scales.unit(unit) if unit else 1.0  # a switch of the drive has no margin
        factor /= self.scales.unit("s") if rate else 1.0
        unit += "/s" if rate and unit else ""
        return f"{value * factor:.3g} {unit if self.scales.named else ''}".rstrip()

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
        """The drive's; that of the voltage itself where a term makes its sign matter."""
        return self.drive.period * (2.0 if self._unfolded else 1.0)

    def changed(self, /, **values: float) -> Self:
        """Return the system at other values of some parameters, checked."""
        drive_values, actuator_values, term_values = self._sorted(values)
        drive = self.drive.varied(drive_values) if drive_values else self.drive
        if term_values:
            actuator_values["terms"] = self._terms(term_values)
        actuator = self.actuator.replace(**actuator_values) if actuator_values else self.actuator
        return self._with(actuator, drive, actuator.scales)

    def shifted(self, values: Mapping[str, float]) -> Self:
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

    def _with(self, actuator: Actuator, drive: Drive, scales: Scales) -> Self:
        """Return the system of another actuator and drive, which have been checked or need not."""
        other = object.__new__(type(self))
        other._put(actuator, drive, scales)
        return other

    def _as(self, kind: type[Kind]) -> Kind:
        """Return the same actuator and drive as a system of another kind."""
        other = object.__new__(kind)
        other._put(self.actuator, self.drive, self._scales)
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
        terms = tuple(term.scaled(self._scales) for term in self.actuator.terms)
        return self.actuator.replace_unchecked(**values, terms=terms, units="dimensionless")

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
        unfolded = self._unfolded
        if of_drive and self._signed:
            unfolded = self.drive.varied(of_drive, checked=False).changes_sign
        if unfolded:
            switches += tuple(period + time for time in switches)
            scale, period = scale or period, 2.0 * period
        return Numbers(np.concatenate([device, q]), period, switches, scale)

    @cached_property
    def _device(self) -> Floats:
        """The numbers of actuator and terms, in the units of the numerics; room for scratch."""
        own = self.inner_actuator.to_array()
        if not self._composed:
            return own
        of_terms = [each for term in self.actuator.terms for each in term.numbers(self._scales)]
        scratch = np.zeros(self._scratch)
        return np.concatenate([own, of_terms, scratch])

    @property
    def _composed(self) -> bool:
        """Whether its equations are put together, and need scratch; the paper's alone do not."""
        return bool(self._kinds)

    @property
    def _scratch(self) -> int:
        """How many numbers of scratch there are."""
        return SCRATCH * len(self.states)

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
