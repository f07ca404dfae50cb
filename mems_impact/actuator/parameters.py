"""The eleven parameters of the actuator, and loading of device files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.resources import files
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from mems_impact._util.files import file_path
from mems_impact._util.formatting import html_table, shown, stem
from mems_impact._util.quantities import quantities
from mems_impact._util.units import DIMENSIONLESS, Scales
from mems_impact._util.warning_scopes import warn
from mems_impact.actuator.design.data_sheet_quantities import QUANTITIES
from mems_impact.actuator.parameter_base import Checked, Fraction, NonNegative, Positive, unknown
from mems_impact.actuator.plausibility import check_plausible_device, check_plausible_drive
from mems_impact.actuator.terms.base import Term
from mems_impact.actuator.terms.files import term_names, term_of, term_with
from mems_impact.actuator.toml_files import parse_toml, read_bytes
from mems_impact.actuator.units import (
    PARAMETER_UNITS,
    DeviceScales,
    scaled_fields,
    unscaled_fields,
)
from mems_impact.errors import InvalidFile, InvalidParameter, UnitsWarning

if TYPE_CHECKING:
    from mems_impact.actuator.design.data_sheet import DataSheet
    from mems_impact.actuator.drives.base import Drive
    from mems_impact.actuator.system import ActuatorSystem
    from mems_impact.integrators.options import Options
    from mems_impact.systems.state import State

__all__ = [
    "PARAMETER_MEANINGS",
    "PARAMETER_NAMES",
    "Actuator",
    "actuator_in_file",
    "device_text",
    "load_actuator",
    "numbers_for",
    "parameter_named",
    "preset_names",
]

_DEVICES = files("mems_impact.actuator") / "devices"
MAX_DEVICE_FILE_BYTES = (
    1_000_000  # bytes; far above any device file, far below what fills the memory
)
_LIGHT = 1e-3  # masses below: kilograms of a device in SI; scaled ones are of the order of 1


TERMS_ALLOWED = "a tuple of terms, such as (Tilt(angle=0.05),)"


class Actuator(Checked):
    """The electrostatic impact microactuator: a block in a frame that rests on the ground.

    All parameters are keyword-only, in SI or dimensionless as in the paper, according to `units`.
    States, drives and results are in the same units. An actuator is immutable and hashable;
    `replace` returns a changed copy, `to_dimensionless` and `to_si` convert between the two forms.

    Parameters
    ----------
    m1 : float
        Mass of the frame [kg], > 0. Equation (1).
    m2 : float
        Mass of the block [kg], > 0. Equation (2).
    k : float
        Stiffness of the spring between block and frame [N/m], > 0. Equation (2).
    c : float
        Damping between block and frame [N s/m], >= 0. Equation (2).
    d : float
        Gap between the electrodes without voltage [m], > 0. Equation (2).
    delta : float
        Distance from the block at rest to each stopper [m], 0 < delta < d. An impact is at
        abs(x2) = delta.
    e : float
        Coefficient of restitution [-], 0 <= e <= 1. Equations (5) and (6).
    mu_s : float
        Coefficient of static friction, frame on ground [-], >= mu_d. Equation (4).
    mu_d : float
        Coefficient of dynamic friction, frame on ground [-], >= 0. Equation (3).
    alpha : float
        Half the permittivity times the overlap area of the electrodes [F m], > 0. The
        electrostatic force is alpha v^2 / (d - x2)^2. Equation (2).
    g : float
        Gravity [m/s^2], >= 0; the normal force on the ground is N = (m1 + m2) g. Equation (3).
    units : {"dimensionless", "SI"}, optional
        The units of all of the above, and of the terms.
    terms : tuple of Term, optional
        Additional terms of the model (see `mems_impact.actuator.terms`); none by default.

    Raises
    ------
    InvalidParameter
        If a value is out of range or not a number, or a parameter is missing or unknown; if two
        terms have the same class, or replace the same rule.

    See Also
    --------
    load_actuator, Term, Drive, System

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> softer = actuator.replace(e=0.7)
    >>> softer.e, actuator.e
    (0.7, 0.8)
    >>> system = actuator.under(mi.Sine(amplitude=0.24, omega=0.5))
    >>> system.states
    ('x1', 'v1', 'x2', 'v2')
    """

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
        if not self.delta < self.d:
            unit = " m" if self.units == "SI" else ""
            allowed = f"between 0 and d = {shown(self.d)}{unit} (exclusive)"
            raise InvalidParameter("delta", self.delta, allowed)
        if not self.mu_d <= self.mu_s:
            allowed = f"between 0 and mu_s = {shown(self.mu_s)}"
            raise InvalidParameter("mu_d", self.mu_d, allowed)
        for term in self.terms:
            term.check_on(self)
        return self

    def __iter__(self) -> Any:
        # Iteration and dict() omit terms if there are none, as for the paper's device.
        return ((name, value) for name, value in super().__iter__() if value != ())

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

    def changed(self, /, **values: float) -> Self:
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
        for name, value in values.items():
            owner, dot, number = name.partition(".")
            if dot:
                of_terms.setdefault(owner, {})[number] = value
            else:
                device_changes[parameter_named(name)] = value
        device = self.replace(**device_changes) if device_changes else self
        terms = [term_with(name, self.term(name), numbers) for name, numbers in of_terms.items()]
        return device.adding(*terms) if terms else device

    def term(self, name: str) -> Term | None:
        """Return the term with a name; None if the device has no such term."""
        return next((term for term in self.terms if term.name() == name), None)

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

        A dimensionless device is returned unchanged.
        """
        if self.units == "dimensionless":
            return self
        scales = self.scales
        values = scaled_fields(self, PARAMETER_UNITS, scales)
        terms = tuple(term.scaled(scales) for term in self.terms)
        return self.replace(**values, terms=terms, units="dimensionless")

    def under(self, drive: Drive) -> ActuatorSystem:
        """Return the system of this actuator under a drive.

        The system can replace the two arguments actuator and drive:
        ``simulate(actuator.under(drive))``.
        """
        from mems_impact.actuator.system import ActuatorSystem  # avoids a circular import

        system = ActuatorSystem(self, drive)
        check_plausible_device(self)
        check_plausible_drive(self, drive)
        return system

    @classmethod
    def from_design(cls, *, terms: Sequence[Term] = (), **quantities: Any) -> Actuator:
        """Return the actuator of a data sheet, in SI.

        Any consistent set of quantities that determines the device is accepted: two of
        `stiffness`, `frequency` and `proof_mass`; `damping`, `quality` or `damping_ratio`;
        `electrode_area`, `capacitance`, `pull_in` or `electrode_constant`, and so on.

        Parameters
        ----------
        terms : sequence of Term, optional
            Additional terms of the model.
        **quantities : float or str
            By name, in SI, or as texts with a unit such as ``"1.2 kHz"``: frame_mass, proof_mass,
            total_mass, mass_ratio, stiffness, frequency [Hz] of the block in a held frame, damping,
            quality, damping_ratio, gap, travel (distance to each stopper), spring_force (at the
            stopper), restitution, electrode_area, capacitance, electrode_constant, pull_in and
            release [V], static_friction and dynamic_friction (coefficients; ``friction`` sets both,
            or is a pair), static_friction_force, dynamic_friction_force, gravity (9.80665 by
            default). See `DataSheet`.

        Returns
        -------
        Actuator

        Raises
        ------
        InvalidParameter
            If quantities contradict each other by more than 1e-6, or do not determine the device;
            the message names both values, or the missing quantities.

        See Also
        --------
        DataSheet, load_actuator

        Examples
        --------
        >>> import mems_impact as mi
        >>> device = mi.Actuator.from_design(
        ...     frequency="1.2 kHz", quality=30, proof_mass="0.2 mg", frame_mass="1 mg",
        ...     gap="4 um", travel="2.5 um", pull_in="70 V", friction=(0.35, 0.28),
        ...     restitution=0.65,
        ... )
        >>> round(device.k, 3), round(mi.pull_in_voltage(device), 9)
        (11.37, 70.0)
        """
        from mems_impact.actuator.design.data_sheet import actuator_from_design

        return actuator_from_design(quantities, terms)

    def to_fmu(
        self,
        path: str | PathLike[str],
        drive: Drive,
        *,
        fmi: str = "3.0",
        inputs: Sequence[str] = (),
        initial: State | Mapping[str, float] | None = None,
        options: Options | None = None,
    ) -> Path:
        """Write the device under a drive as a functional mock-up unit (FMU).

        Parameters
        ----------
        path : str or os.PathLike
            Name of the file, usually with the suffix ``.fmu``.
        drive : Drive
        fmi, initial, options
            As for `System.to_fmu`.
        inputs : sequence of str, optional
            Parameters that become inputs. With ``"voltage"`` (and ``"left_voltage"`` for a second
            electrode) the voltage is an input, in place of the drive.

        Returns
        -------
        Path

        Raises
        ------
        InvalidParameter
            If an argument is not allowed.
        FunctionError
            If a function of the drive cannot be translated to C.

        See Also
        --------
        System, simulate

        Examples
        --------
        >>> import mems_impact as mi
        >>> device = mi.load_actuator("mita2003")
        >>> drive = mi.Sine(amplitude="60 V", frequency="100 Hz")
        >>> device.to_fmu("device.fmu", drive, inputs=["voltage"]).name
        'device.fmu'
        """
        return self.under(drive).to_fmu(
            path, fmi=fmi, inputs=inputs, initial=initial, options=options
        )

    def to_verilog_a(self, path: str | PathLike[str], *, electrodes: Literal[1, 2] = 1) -> None:
        """Write the device as a Verilog-A module for circuit simulators, named like the file.

        The ports are ``p``, ``n`` (electrode and block, electrical) and ``block``, ``frame``
        (kinematic: positions above the ground, moved by the forces at the ports). Numbers of device
        and terms, and the initial state, are parameters of the module.

        Parameters
        ----------
        path : str or os.PathLike
            The file, such as ``dev.va``.
        electrodes : {1, 2}, optional
            Number of electrodes; 2 for a module with a port of the left electrode, ``left`` between
            ``p`` and ``n``.

        Raises
        ------
        InvalidParameter
            If the device is dimensionless or has events (it lacks `CompliantStopper` or
            `RegularizedFriction`), or if a term has no Verilog-A form: a term of the source, which
            belongs to the circuit, or a term of your own.

        See Also
        --------
        load_actuator, CompliantStopper, RegularizedFriction

        Notes
        -----
        OpenVAF compiles the module for VACASK or ngspice. `to_fmu` exports impacts, sticking and
        slipping as events.

        Examples
        --------
        >>> import mems_impact as mi
        >>> from pathlib import Path
        >>> actuator = mi.load_actuator("mita2003").adding(
        ...     mi.CompliantStopper(stiffness=500.0), mi.RegularizedFriction(width=1e-5)
        ... )
        >>> actuator.to_verilog_a("dev.va")
        >>> [line for line in Path("dev.va").read_text().splitlines() if line[:6] == "module"]
        ['module dev(p, n, block, frame);']
        """
        from mems_impact.actuator.verilog_a import write_verilog_a

        write_verilog_a(self, path, electrodes)

    @property
    def datasheet(self) -> DataSheet:
        """Parameters and derived quantities, such as quality factor and pull-in voltage.

        Raises
        ------
        InvalidParameter
            If the device is dimensionless.
        """
        from mems_impact.actuator.design.data_sheet import DataSheet

        return DataSheet(self)

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
    name for name in Actuator.model_fields if name not in ("units", "terms")
)
"""The parameters' names, in the order of `Actuator.to_array`."""


def parameter_named(name: str, field: str = "") -> str:
    """Return the parameter that a data sheet calls so: k for "stiffness"; others unchanged.

    Raises
    ------
    InvalidParameter
        If the quantity is derived from several parameters.
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


PARAMETERS_OF_DATA_SHEETS = [each for each in QUANTITIES.items() if each[1].parameter]


class _DeviceFile(Checked):
    """Top-level content of a device file."""

    name: str = ""
    description: str = ""
    units: Literal["dimensionless", "SI"] = "dimensionless"
    parameters: dict[str, Any] = Field(default={})
    design: dict[str, Any] = Field(default={})
    drive: dict[str, Any] | None = None  # for `mems_impact.actuator.drives.files.load_drive`

    @model_validator(mode="before")
    @classmethod
    def _check_table(cls, content: dict[str, Any]) -> dict[str, Any]:
        for name in PARAMETER_NAMES:
            if name in content:
                allowed = "in the table [parameters]"
                raise InvalidParameter(name, content[name], allowed)
        known = (*cls.model_fields, *term_names())
        for name in content:
            if name not in known:
                raise unknown(name, content[name], known)
        if ("parameters" in content) == ("design" in content):
            problem = "missing, must be a table; or give a table [design]"
            if "design" in content:
                problem = "omit it, or the table [design]"
            raise InvalidParameter("parameters", None, "", problem=problem)
        if "design" in content and content.setdefault("units", "SI") != "SI":
            raise InvalidParameter("units", content["units"], '"SI" with a table [design]')
        return content


def numbers_for(actuator: Actuator, field: str, values: Any, unit: str) -> Any:
    """Return arguments in the units of a device, with texts such as "70 V" as numbers.

    Raises
    ------
    InvalidParameter
        If a text has a unit of another kind, or the device is dimensionless.
    """
    return quantities(field, values, unit if actuator.units == "SI" else None, "device")


def preset_names() -> tuple[str, ...]:
    """Return the sorted names of the devices in the package."""
    names = (item.name for item in _DEVICES.iterdir())
    return tuple(sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml")))


def load_actuator(name_or_path: str | PathLike[str]) -> Actuator:
    """Load an actuator by preset name, or from a TOML file.

    Parameters
    ----------
    name_or_path : str or os.PathLike
        One of `preset_names`, or the path of a TOML file with a table ``[parameters]`` that holds
        the eleven parameters of `Actuator`, or a table ``[design]`` with the quantities of
        `Actuator.from_design`, and, optionally, ``name``, ``description`` and ``units``
        ("SI", or "dimensionless" by default) above it, and below it a table for each term
        (``[squeeze_film]``). A preset has priority over a file of the same name; write ``./name``
        for the file.

    Returns
    -------
    Actuator

    Raises
    ------
    InvalidFile
        If there is no such preset or file, or the file cannot be read as TOML.
    InvalidParameter
        If the file holds a wrong, missing or unknown entry; `source` names the file.

    Warns
    -----
    UnitsWarning
        If the file gives no units and its masses look like kilograms; or if a number of a device in
        SI is implausible, as if given in another unit. The second warning is issued once, and may
        also come when the device is combined with a drive.

    See Also
    --------
    Actuator, load

    Examples
    --------
    >>> import mems_impact as mi
    >>> mi.load_actuator("zhao2004").mu_d
    0.27
    >>> mi.load_actuator("mita2003").units
    'SI'
    """
    allowed = "the name of a preset or the path of a TOML file"
    source = file_path(name_or_path, allowed, "name_or_path")
    if isinstance(name_or_path, str) and source in preset_names():
        raw = (_DEVICES / f"{source}.toml").read_bytes()
    else:
        raw = _read(source)
    content = parse_toml(
        raw, source, 'a table [parameters] or [design] of lines like m1 = 5.0 or gap = "4 um"'
    )
    return actuator_in_file(content, source)


def actuator_in_file(content: Mapping[str, Any], source: str) -> Actuator:
    """Return the device of a TOML file."""
    names = term_names()
    tables = {name: content[name] for name in content if name in names}
    try:
        file = _DeviceFile(**{name: content[name] for name in content if name not in names})
        terms = tuple(term_of(name, table, Path(source).parent) for name, table in tables.items())
        if "design" in content:
            actuator = Actuator.from_design(**file.design, terms=terms)
        else:
            if "units" in file.parameters:
                allowed = "above the table [parameters]"
                raise InvalidParameter("units", file.parameters["units"], allowed)
            actuator = Actuator(**file.parameters, units=file.units, terms=terms)
    except InvalidParameter as error:
        raise error.located(source) from None
    if (
        "units" not in content
        and "design" not in content
        and max(actuator.m1, actuator.m2) < _LIGHT
    ):
        message = (
            f"{source}: m1 = {actuator.m1:g} and m2 = {actuator.m2:g} look like kilograms, but "
            'without units they are dimensionless; write units = "SI" above [parameters], or '
            'units = "dimensionless" if they are'
        )
        warn(message, UnitsWarning, source)
    check_plausible_device(actuator)
    return actuator


def names_in_file(name_or_path: str) -> frozenset[str]:
    """Return the names at the top of a TOML file; none for a preset or another file."""
    if name_or_path in preset_names() or not Path(name_or_path).is_file():
        return frozenset()
    try:
        raw = read_bytes(name_or_path, "", kind="TOML file")
        return frozenset(parse_toml(raw, name_or_path, ""))
    except InvalidFile:
        return frozenset()  # the function that loads the file reports the error


def _read(source: str) -> bytes:
    presets = ", ".join(preset_names())
    remedy = f"give the name of a preset ({presets}) or the path of a TOML file"
    looks_like_path = Path(source).name != source or source.endswith(".toml")
    missing = "no such file" if looks_like_path else "no such preset or file"
    return read_bytes(
        source, remedy, largest=MAX_DEVICE_FILE_BYTES, kind="device file", missing=missing
    )


def device_text(name_or_path: str) -> tuple[str, str]:
    """Return name and description of a device; empty texts if its file has none."""
    source = fspath(name_or_path)
    preset = source in preset_names()
    raw = (_DEVICES / f"{source}.toml").read_bytes() if preset else _read(source)
    content = parse_toml(raw, source, "a device file")
    name = source if preset else content.get("name", "") or stem(source)
    return name, content.get("description", "")
