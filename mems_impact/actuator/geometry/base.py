"""The process of a device, and the base of the parts that are drawn.

Lengths of parts are drawn lengths. An edge recedes by the undercut: lines and plates become smaller
by twice the undercut, spaces wider.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, NamedTuple

from mems_impact.actuator.parameter_base import NonNegative, Number, Positive, Unit, Varied
from mems_impact.actuator.terms.comb_drive import PERMITTIVITY
from mems_impact.actuator.terms.squeeze_film import rarefaction
from mems_impact.errors import InvalidParameter

GUIDED_MASS = 13.0 / 35.0  # of a beam whose end is guided, relative to its mass


class Finding(NamedTuple):
    """A computed quantity with its formula, the source of the formula and its range of validity.

    A voltage is one that a drive must not exceed.
    """

    quantity: str
    value: float
    unit: str
    formula: str
    source: str = ""
    validity: str = ""
    limit: float = float("inf")
    """Limit of the value, beyond which the model ends."""


class Process(Varied):
    """The process and the gas; see `Geometry`."""

    thickness: Annotated[Positive, Unit("m")]
    youngs_modulus: Annotated[Positive, Unit("Pa")]
    density: Annotated[Positive, Unit("kg/m^3")]
    undercut: Annotated[Number, Unit("m")] = 0.0
    residual_stress: Annotated[Number, Unit("Pa")] = 0.0
    strength: Annotated[Positive, Unit("Pa")] = 1e9
    substrate_gap: Annotated[Positive | None, Unit("m")] = None
    viscosity: Annotated[NonNegative, Unit("Pa s")] = 1.82e-5
    pressure: Annotated[Positive, Unit("Pa")] = 101325.0
    free_path_pressure: Annotated[NonNegative, Unit("Pa m")] = 6.7e-3
    relative_permittivity: Positive = 1.0

    vertical: ClassVar[bool] = False
    """Whether the block moves out of the plane of the layer."""

    def line(self, drawn: float) -> float:
        """Return the width of a drawn line."""
        return drawn - 2.0 * self.undercut

    def space(self, drawn: float) -> float:
        """Return the width of a drawn space."""
        return drawn + 2.0 * self.undercut

    def mass(self, area: float) -> float:
        """Return the mass of an area."""
        return self.density * self.thickness * area

    @property
    def permittivity(self) -> float:
        """Permittivity of the medium in the gaps [F/m]."""
        return PERMITTIVITY * self.relative_permittivity

    def squeezed_viscosity(self, gap: float) -> float:
        """Return the viscosity of a squeezed film, with rarefaction."""
        return self.viscosity / rarefaction(self.free_path_pressure / self.pressure / gap)

    def sliding_viscosity(self, gap: float) -> float:
        """Return the viscosity of a sheared film, with slip at both walls."""
        return self.viscosity / (1.0 + 2.0 * self.free_path_pressure / self.pressure / gap)


class DrawnPart(Varied, ABC):
    """Base of the parts of a `Geometry`, each kind in its own file."""

    units: ClassVar[Mapping[str, str]] = {}

    @classmethod
    def kind(cls) -> str:
        """Return the kind in files: the name of the module."""
        return cls.__module__.rpartition(".")[2]

    lines: ClassVar[tuple[str, ...]] = ("width",)
    """Fields of the lines that the undercut narrows."""

    def smallest_line(self, process: Process) -> tuple[str, float]:
        """Return the field of the narrowest line, and its width after the process."""
        name = min(self.lines, key=lambda each: float(getattr(self, each)))
        return name, process.line(getattr(self, name))

    def check_lines(self, process: Process) -> None:
        """Raise InvalidParameter if the process removes a line."""
        name, width = self.smallest_line(process)
        if not width > 0.0:
            allowed = f"above twice the undercut of {process.undercut:g} m"
            raise InvalidParameter(f"{self.kind()}.{name}", getattr(self, name), allowed)

    def table(self) -> dict[str, Any]:
        """Return the part as a table of a file."""
        values = {name: value for name, value in dict(self).items() if value is not None}
        return {"kind": self.kind(), **values}


class Section(NamedTuple):
    """A beam after the process: length, depth along the motion, flexural and axial rigidity."""

    length: float
    depth: float
    bending: float
    stretching: float

    @classmethod
    def of(cls, process: Process, length: float, width: float) -> Section:
        """Return the section of a beam of these sizes."""
        area, modulus = process.thickness * width, process.youngs_modulus
        depth = process.thickness if process.vertical else width
        return cls(length, depth, modulus * area * depth * depth / 12.0, modulus * area)

    def mass(self, process: Process) -> float:
        """Return the mass of the beam."""
        return process.density / process.youngs_modulus * self.stretching * self.length


class Beams(DrawnPart):
    """Base of suspensions of beams that bend along the motion."""

    count: Positive
    length: Annotated[Positive, Unit("m")]
    width: Annotated[Positive, Unit("m")]

    def beam(self, process: Process) -> Section:
        """Return one of the beams that bend, between two edges that recede."""
        return Section.of(process, process.space(self.length), process.line(self.width))

    @abstractmethod
    def stiffness(self, process: Process) -> Finding:
        """Return the stiffness along the motion."""

    @abstractmethod
    def mass(self, process: Process) -> Finding:
        """Return the mass that moves with the block, for the same kinetic energy."""

    @abstractmethod
    def side_stiffness(self, process: Process, deflection: float) -> Finding:
        """Return the stiffness across the motion, at a deflection."""

    @abstractmethod
    def stress(self, process: Process, deflection: float) -> Finding:
        """Return the largest stress at a deflection."""

    def cubic_stiffness(self, process: Process) -> Finding | None:
        """Return the cubic stiffness; None if beams can shorten freely."""
        return None

    def findings(self, process: Process, deflection: float) -> Iterator[Finding]:
        """Yield the quantities of the suspension at a deflection."""
        cubic = self.cubic_stiffness(process)
        yield self.stiffness(process)
        if cubic is not None:
            yield cubic
        yield self.mass(process)
        yield self.side_stiffness(process, deflection)
        yield self.stress(process, deflection)
        yield Finding(
            "deflection at the stopper by length", deflection / self.beam(process).length, "",
            "x/L", "linear beam theory", limit=0.1,
        )  # fmt: skip
