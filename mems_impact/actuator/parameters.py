"""The eleven parameters of the actuator, and its terms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from mems_impact._util.formatting import html_table
from mems_impact._util.quantities import quantities
from mems_impact._util.units import DIMENSIONLESS, Scales
from mems_impact.actuator.design.data_sheet_quantities import QUANTITIES
from mems_impact.actuator.geometry.geometry import PREFIX, Geometry
from mems_impact.actuator.model import bounds_of
from mems_impact.actuator.parameter_base import Checked, Fraction, NonNegative, Positive
from mems_impact.actuator.terms.base import Term
from mems_impact.actuator.terms.files import term_with
from mems_impact.actuator.units import PARAMETER_UNITS, DeviceScales, scaled_fields, unscaled_fields
from mems_impact.errors import InvalidParameter

TERMS_ALLOWED = "a tuple of terms, such as (Tilt(angle=0.05),)"


class ActuatorParameters(Checked):
    """The numbers and terms of an actuator; see `Actuator`."""

    m1: Positive
    m2: Positive
    k: Positive
    c: NonNegative
    d: Positive
    delta: Positive
    e: Fraction
    mu_s: NonNegative
    mu_d: NonNegative
    alpha: Positive
    g: NonNegative
    units: Literal["dimensionless", "SI"] = "dimensionless"
    terms: Annotated[tuple[Term, ...], Field(description=TERMS_ALLOWED)] = ()
    geometry: Geometry | None = Field(default=None, description="a Geometry(…)")

    @classmethod
    def unit_of(cls, name: str) -> str:
        """Return the SI unit of a parameter, empty if it has none."""
        return PARAMETER_UNITS.get(name, "")

    @classmethod
    def _check_takes_units(cls, name: str, value: object, values: Mapping[str, Any]) -> None:
        if values.get("units") != "SI" and cls.unit_of(name):
            problem = 'has a unit, but the device is dimensionless; give a number, or units="SI"'
            raise InvalidParameter(name, value, "", problem=problem)

    @model_validator(mode="after")
    def _check_terms(self) -> Self:
        for i, term in enumerate(self.terms):
            if self.units == "dimensionless":
                term.check_without_units()
            for other in self.terms[:i]:
                names = f"{other.name()} and {term.name()}"
                if term.name() == other.name():
                    problem = f"{term.name()} is given twice; give one of them"
                elif shared := [
                    rule for rule in term.replaced_rules if rule in other.replaced_rules
                ]:
                    problem = f"{names} both determine the {shared[0]}; give one of them"
                else:
                    continue
                raise InvalidParameter("terms", None, "", problem=problem)
        return self

    @model_validator(mode="after")
    def _check_pairs(self) -> Self:
        for term in self.terms:
            term.check_on(self)
        self._check_bounds()
        if self.geometry is not None and self.units == "dimensionless":
            raise InvalidParameter("geometry", None, "", problem="in SI, but the device is not")
        return self

    def _check_bounds(self) -> None:
        """Raise InvalidParameter if a number is beyond a bound that others set."""
        p = [*self.to_array().tolist()]
        p += (number for term in self.terms for number in term.numbers(DIMENSIONLESS))
        for bound in bounds_of([term.kind for term in self.terms]):
            owner, _, name = bound.name.rpartition(".")
            term = self.term(owner)
            number = getattr(term or self, name)
            if not bound.holds(number, p):
                unit = (term or self).unit_of(name) if self.units == "SI" else ""
                limit = f"{bound.value(p):.9g} {unit}".rstrip()
                allowed = f"{bound.sign} {limit}, {bound.meaning}"
                raise InvalidParameter(bound.name, number, allowed)

    def __iter__(self) -> Any:
        # Iteration and dict() omit terms and geometry if there are none, as in the paper's device.
        absent = {"terms": (), "geometry": None}
        return (
            (name, value)
            for name, value in super().__iter__()
            if name not in absent or value != absent[name]
        )

    def __repr_args__(self) -> Any:
        return list(self)

    def _repr_html_(self) -> str:
        label = self.scales.label
        rows = {label(name, PARAMETER_UNITS.get(name, "")): value for name, value in self}
        return html_table(type(self).__name__, rows)

    def adding(self, *terms: Term) -> Self:
        """Return the device with additional terms, each in place of a term of the same class.

        Parameters
        ----------
        *terms : Term

        Raises
        ------
        InvalidParameter
            If two terms replace the same rule.

        Examples
        --------
        >>> import mems_impact as mi
        >>> uphill = mi.load_actuator("zhao2004").adding(mi.Tilt(angle=0.05))
        """
        by_name = {getattr(term, "name", str)(): term for term in (*self.terms, *terms)}
        return self.replace(terms=tuple(by_name.values()))

    def without(self, *names: str) -> Self:
        """Return the device without the named terms, or without all terms if none is named.

        Raises
        ------
        InvalidParameter
            If there is no such term.
        """
        present = [term.name() for term in self.terms]
        for name in names:
            if name not in present:
                raise InvalidParameter("term", name, f"one of {', '.join(present) or 'none'}")
        remaining = (term for term in self.terms if names and term.name() not in names)
        return self.replace(terms=tuple(remaining))

    def changed(self, /, **values: float | str) -> Self:
        """Return the device with other values of some numbers, including those of terms.

        Parameters
        ----------
        **values : float or str
            New values by name; a number of a term is named as in ``tilt.angle``. A term that the
            device does not have is added. Parameters may have their names in data sheets (see
            `DataSheet`).

        Raises
        ------
        InvalidParameter
            If a value is not allowed, a name is unknown, or a new term needs more values.

        Examples
        --------
        >>> import mems_impact as mi
        >>> uphill = mi.load_actuator("zhao2004").changed(e=0.7, **{"tilt.angle": 0.05})
        """
        device_changes: dict[str, Any] = {}
        of_terms: dict[str, dict[str, float]] = {}
        for name, value in with_geometry(self, values).items():
            owner, dot, number = name.partition(".")
            if dot:
                of_terms.setdefault(owner, {})[number] = value
            else:
                device_changes[parameter_named(name)] = value
        device = self.replace(**device_changes) if device_changes else self
        terms = [term_with(name, self.term(name), numbers) for name, numbers in of_terms.items()]
        return device.adding(*terms) if terms else device

    @staticmethod
    def _symbol(name: str, field: str = "") -> str:
        """Return the parameter that a data sheet calls so."""
        return parameter_named(name, field)

    def term(self, name: str) -> Term | None:
        """Return the term with a name; None if the device has no such term."""
        return next((term for term in self.terms if term.name() == name), None)

    @property
    def numbers(self) -> dict[str, float]:
        """All numbers by the names of parameters: its own, and those of terms and geometry."""
        found = {name: float(getattr(self, name)) for name in PARAMETER_NAMES}
        for term in self.terms:
            found |= {f"{term.name()}.{name}": getattr(term, name) for name in term.names}
        return found if self.geometry is None else found | self.geometry.numbers

    def to_array(self) -> NDArray[np.float64]:
        """Return the parameters as an array of shape (11,), in the order of `PARAMETER_NAMES`."""
        return np.array([getattr(self, name) for name in PARAMETER_NAMES], dtype=np.float64)

    @property
    def scales(self) -> Scales:
        """The units of the scaled variables of this device; all 1 if it is dimensionless."""
        if self.units == "dimensionless":
            return DIMENSIONLESS
        return DeviceScales.of_device(self.m2, self.k, self.d, self.alpha)

    def to_dimensionless(self) -> Self:
        """Return the same device in its `scales`, in which m2 = k = d = alpha = 1.

        A dimensionless device is returned unchanged. A geometry, which is in SI, is omitted.
        """
        if self.units == "dimensionless":
            return self
        scales = self.scales
        values = scaled_fields(self, PARAMETER_UNITS, scales)
        terms = tuple(term.scaled(scales) for term in self.terms)
        return self.replace(**values, terms=terms, geometry=None, units="dimensionless")

    def to_si(self, scales: Scales) -> Self:
        """Return the same device in SI.

        Parameters
        ----------
        scales : Scales
            The units of this dimensionless device: ``si.to_dimensionless().to_si(si.scales)`` is
            `si` again, to the last rounding.
        """
        if self.units == "SI":
            return self
        values = unscaled_fields(self, PARAMETER_UNITS, scales)
        terms = tuple(term.unscaled(scales) for term in self.terms)
        return self.replace(**values, terms=terms, units="SI")


PARAMETER_MEANINGS = {
    "m1": "mass of the frame",
    "m2": "mass of the block",
    "k": "stiffness",
    "c": "damping",
    "d": "gap",
    "delta": "stopper distance",
    "e": "restitution",
    "mu_s": "static friction",
    "mu_d": "dynamic friction",
    "alpha": "electrode constant",
    "g": "gravity",
    "omega": "angular frequency",
}
"""Short names of the parameters whose symbols are not words, for displays; omega is a drive's."""

PARAMETER_NAMES: tuple[str, ...] = tuple(
    name for name in ActuatorParameters.model_fields if name not in ("units", "terms", "geometry")
)
"""The parameters' names, in the order of `Actuator.to_array`."""


def parameter_named(name: str, field: str = "") -> str:
    """Return the parameter that a data sheet calls so: k for "stiffness"; others unchanged.

    Raises InvalidParameter if the quantity is derived from several parameters.
    """
    entry = QUANTITIES.get(name)
    if entry is None or name in PARAMETER_NAMES:
        return name
    if not entry.parameter:
        names = ", ".join(
            f"{each.parameter} ({quantity})" for quantity, each in PARAMETERS_OF_DATA_SHEETS
        )
        problem = f"a quantity derived from parameters; give one of {names}"
        raise InvalidParameter(field or name, name if field else None, "", problem=problem)
    return entry.parameter


def with_geometry(
    actuator: ActuatorParameters, values: Mapping[str, Any], *, checked: bool = True
) -> dict[str, Any]:
    """Return changes with those of the drawing as changes of the numbers that it determines.

    A number of the device changes by the ratio of its formula, so that measured and fitted numbers
    keep their place. Numbers that are among the changes themselves have these values.
    """
    drawn = {name: value for name, value in values.items() if name.startswith(PREFIX)}
    if not drawn:
        return dict(values)
    if actuator.geometry is None:
        problem = "the device has no geometry"
        raise InvalidParameter(next(iter(drawn)), None, "", problem=problem)
    geometry = actuator.geometry.varied(drawn, checked=checked)
    before, after = _drawn_numbers(actuator.geometry), _drawn_numbers(geometry)
    changes: dict[str, Any] = {"geometry": geometry}
    for name in filter(after.__contains__, before):
        owner, dot, number = name.partition(".")
        owning = actuator.term(owner) if dot else actuator
        if owning is not None:
            present = getattr(owning, number or owner)
            changes[name] = _in_proportion(present, before[name], after[name])
    return {**changes, **{name: value for name, value in values.items() if name not in drawn}}


def _drawn_numbers(geometry: Geometry) -> dict[str, Any]:
    """Return the numbers that a drawing determines, by name, with tables of terms."""
    found = {QUANTITIES[name].parameter: value for name, value in geometry.quantities.items()}
    for term in geometry.terms:
        fields = {name: value for name, value in dict(term).items() if not isinstance(value, str)}
        found |= {f"{term.name()}.{name}": value for name, value in fields.items()}
    return found


def _in_proportion(value: Any, before: Any, after: Any) -> Any:
    """Return a number, or the numbers of a table, times after/before."""
    if value == before:
        return after
    if isinstance(value, tuple):  # a table of another length is the user's own
        same = len(value) == len(before)
        return tuple(map(_in_proportion, value, before, after)) if same else value
    return value * (after / before) if before else value + after


PARAMETERS_OF_DATA_SHEETS = [each for each in QUANTITIES.items() if each[1].parameter]


def numbers_for(actuator: ActuatorParameters, field: str, values: Any, unit: str) -> Any:
    """Return arguments in the units of a device, with texts such as "70 V" as numbers.

    Raises InvalidParameter if a text has a unit of another kind, or the device is dimensionless.
    """
    return quantities(field, values, unit if actuator.units == "SI" else None, "device")
