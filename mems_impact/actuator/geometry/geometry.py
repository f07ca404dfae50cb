"""The drawing of a device with its process."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, model_validator

from mems_impact._util.formatting import html_table
from mems_impact.actuator.geometry.base import DrawnPart, Finding, Process
from mems_impact.actuator.geometry.clamped_beams import ClampedBeams
from mems_impact.actuator.geometry.comb_fingers import CombFingers
from mems_impact.actuator.geometry.crab_legs import CrabLegs
from mems_impact.actuator.geometry.folded_beams import FoldedBeams
from mems_impact.actuator.geometry.gap_closing_fingers import GapClosingFingers
from mems_impact.actuator.geometry.plate import Plate
from mems_impact.actuator.geometry.plate_electrode import PlateElectrode
from mems_impact.actuator.geometry.squeezed_films import squeeze_film
from mems_impact.actuator.parameter_base import Given, Positive, Unit
from mems_impact.actuator.terms.base import Term
from mems_impact.actuator.terms.cubic_stiffness import CubicStiffness
from mems_impact.errors import InvalidParameter

PREFIX = "geometry."
PARTS: dict[str, type[DrawnPart]] = {
    each.kind(): each
    for each in (
        FoldedBeams, CrabLegs, ClampedBeams, Plate, CombFingers, GapClosingFingers, PlateElectrode,
    )
}  # fmt: skip


def _part(value: Any) -> Any:
    """Return the part of a table of a file; any other value unchanged."""
    if not isinstance(value, Mapping):
        return value
    kind = value.get("kind", Plate.kind())
    if kind not in PARTS:
        raise InvalidParameter("kind", kind, f"one of {', '.join(PARTS)}")
    return PARTS[kind](**{name: each for name, each in value.items() if name != "kind"})


def _plates(value: Any) -> Any:
    value = value if isinstance(value, list | tuple) else (value,)
    return tuple(map(_part, value))


class Geometry(Process):
    """A device as drawn, and the process that makes it: ``Actuator.from_design(geometry=…)``.

    Lengths are drawn lengths. The numbers of the process and of springs and fingers are parameters
    of the device, such as ``"geometry.undercut"`` and ``"geometry.springs.width"``: a change moves
    stiffness, masses, gaps, capacitances and damping together, each by the ratio of its formula.

    Parameters
    ----------
    thickness : float
        Thickness of the layer [m], > 0.
    youngs_modulus, density : float
        Young's modulus in the plane [Pa] and density [kg/m^3] of the layer, > 0.
    undercut : float, optional
        Distance by which etching moves every edge inwards [m]; beams become narrower, and gaps
        wider, by twice this distance.
    residual_stress : float, optional
        Residual stress [Pa], positive in tension; it matters to `ClampedBeams`.
    strength : float, optional
        Stress at which beams may break [Pa]; 1 GPa by default.
    substrate_gap : float, optional
        Distance of the block to the substrate [m]; none by default.
    viscosity : float, optional
        Viscosity of the gas [Pa s]; 1.82e-5 for air by default, 0 for vacuum.
    pressure : float, optional
        Pressure of the gas [Pa].
    free_path_pressure : float, optional
        Mean free path times pressure [Pa m]; 6.7e-3 for air by default.
    relative_permittivity : float, optional
        Permittivity of the gas or liquid in the gaps, relative to that of vacuum; 1 by default.
    springs : FoldedBeams, CrabLegs or ClampedBeams
        The suspension of the block.
    block : Plate, or tuple of Plate
        The block, without fingers.
    electrodes : CombFingers, GapClosingFingers or PlateElectrode
        The electrodes; with the last, the block moves out of the plane.
    travel : float
        Drawn distance from the block to each stopper [m], > 0.

    Raises
    ------
    InvalidParameter
        If a value is out of range, the undercut consumes a line, or crab legs are given for a block
        that moves out of the plane.

    Warns
    -----
    ValidityWarning
        Where the device is made or combined with a drive: if, at the stopper, beams deflect by more
        than a tenth of their length or exceed the strength, fingers bend by a tenth of the gap, the
        comb snaps to a side, or a block above an electrode tilts; if the voltage breaks down the
        gap.

    See Also
    --------
    Actuator, FoldedBeams, Plate, CombFingers, GapClosingFingers, PlateElectrode

    Notes
    -----
    `DataSheet.geometry` lists every computed quantity with formula, source and range. The block
    shears the gas above the substrate: viscosity/(1 + 2 Kn) area/gap (T. Veijola, M. Turowski,
    *J. Microelectromech. Syst.* 10, 263 (2001)); the gas above the block is neglected.

    Examples
    --------
    >>> import mems_impact as mi
    >>> geometry = mi.Geometry(
    ...     thickness="25 um", youngs_modulus="169 GPa", density=2330, undercut="0.2 um",
    ...     substrate_gap="2 um", travel="5 um",
    ...     springs=mi.FoldedBeams(count=4, length="250 um", width="3 um"),
    ...     block=mi.Plate(length="400 um", width="100 um"),
    ...     electrodes=mi.CombFingers(count=60, length="40 um", width="3 um", gap="3 um",
    ...                               overlap="20 um", tip_gap="15 um"),
    ... )
    >>> device = mi.Actuator.from_design(
    ...     geometry=geometry, frame_mass="0.1 mg", friction=0.3, restitution=0.6
    ... )
    >>> corner = device.changed(**{"geometry.undercut": "0.3 um"})
    >>> f"{device.datasheet['frequency']:.0f} Hz, {corner.datasheet['frequency']:.0f} Hz"
    '8723 Hz, 7813 Hz'
    """

    springs: Annotated[FoldedBeams | CrabLegs | ClampedBeams, BeforeValidator(_part)]
    block: Annotated[Given[tuple[Plate, ...]], BeforeValidator(_plates)]
    electrodes: Annotated[CombFingers | GapClosingFingers | PlateElectrode, BeforeValidator(_part)]
    travel: Annotated[Positive, Unit("m")]

    @model_validator(mode="after")
    def _check_lines(self) -> Self:
        if self.vertical and isinstance(self.springs, CrabLegs):
            allowed = "folded_beams or clamped_beams with a plate electrode: crab legs would twist"
            raise InvalidParameter("springs", self.springs.kind(), allowed)
        for part in (self.springs, *self.block, self.electrodes):
            part.check_lines(self)
        gap = self.electrodes.block_gap(self)
        if not 0.0 < self._travel < gap:
            undercut = "" if self.vertical else ", with the undercut at both edges,"
            distance = f"such that {self._travel:g} m{undercut}"
            allowed = f"{distance} is above 0 and below the gap of {gap:g} m"
            raise InvalidParameter("travel", self.travel, allowed)
        return self

    # --- Numbers by name

    @property
    def numbers(self) -> dict[str, float]:
        """Numbers of process, springs and fingers, by the names of parameters."""
        return {f"{PREFIX}{name}": self.number(name) for name in self.names}

    @property
    def number_units(self) -> dict[str, str]:
        """SI units of `numbers`."""
        return {f"{PREFIX}{name}": self.unit(name) for name in self.names}

    def varied(self, values: Mapping[str, float], *, checked: bool = True) -> Self:
        """Return a copy with some numbers changed, by the names of parameters."""
        for name in values:
            if name not in self.numbers:
                allowed = f"one of {', '.join(self.numbers)}"
                raise InvalidParameter("parameter", name, allowed)
        own = {name.removeprefix(PREFIX): value for name, value in values.items()}
        return super().varied(own, checked=checked)

    # --- Numbers of the device

    @property
    def quantities(self) -> dict[str, float]:
        """The quantities of a data sheet that the drawing determines."""
        found = {
            "proof_mass": self._mass,
            "stiffness": self.springs.stiffness(self).value,
            "gap": self._gap,
            "travel": self._travel,
            "damping": sum(each.value for each in self._films()),
        }
        if isinstance(self.electrodes, PlateElectrode):
            found["electrode_constant"] = 0.5 * self.permittivity * self.electrodes.area(self)
        return found

    @property
    def terms(self) -> tuple[Term, ...]:
        """The terms that the drawing determines."""
        cubic = self.springs.cubic_stiffness(self)
        stretching = () if cubic is None else (CubicStiffness(k3=cubic.value),)
        films = [plate.film(self, self._gap) for plate in self.block] if self.vertical else []
        film = () if not (films and self.viscosity) else (squeeze_film(self, films),)
        return (*stretching, *self.electrodes.terms(self, self._travel), *film)

    @property
    def vertical(self) -> bool:  # type: ignore[override]
        """Whether the block moves out of the plane of the layer."""
        return self.electrodes.vertical

    @property
    def _gap(self) -> float:
        return self.electrodes.block_gap(self)

    @property
    def _travel(self) -> float:
        return self.travel if self.vertical else self.space(self.travel)

    @property
    def _mass(self) -> float:
        plates = self.mass(sum(plate.area(self) for plate in self.block))
        return plates + self.electrodes.mass(self) + self.springs.mass(self).value

    def _films(self) -> Iterator[Finding]:
        if isinstance(self.electrodes, PlateElectrode):
            value = sum(plate.film(self, self._gap).holes for plate in self.block)
            yield Finding(
                "damping in the holes of the block", value, "N s/m",
                "8 viscosity A (t + 3 pi r/8) r_c^2/r^4, less at the edges", "Bao et al. (2003)",
                "square holes, slow motion; 20 % below measured (Veijola et al., arXiv:0805.0893)",
            )  # fmt: skip
            return
        yield self.electrodes.damping(self)
        if self.substrate_gap is not None:
            area = sum(plate.area(self) for plate in self.block)
            value = self.sliding_viscosity(self.substrate_gap) * area / self.substrate_gap
            yield Finding(
                "damping below the block", value, "N s/m", "viscosity/(1 + 2 Kn) area/gap",
                "Veijola, Turowski (2001)", "gap below the penetration depth of the flow",
            )  # fmt: skip

    # --- Findings

    def findings(self) -> list[Finding]:
        """Return all computed quantities."""
        side = self.springs.side_stiffness(self, self._travel).value
        mass = Finding(
            "mass of the block", self._mass, "kg", "density t (plates + fingers) + suspension"
        )
        return [
            mass,
            *self.springs.findings(self, self._travel),
            *self.electrodes.findings(self, self._travel, side),
            *self._films(),
        ]

    def as_table(self) -> dict[str, Any]:
        """Return the geometry as the table ``[geometry]`` of a file."""
        values = {name: value for name, value in dict(self).items() if value is not None}
        parts = {name: each.table() for name, each in values.items() if isinstance(each, DrawnPart)}
        return {**values, **parts, "block": [plate.table() for plate in self.block]}

    def _repr_html_(self) -> str:
        rows = {each.quantity: f"{each.value:.6g} {each.unit}" for each in self.findings()}
        return html_table("Geometry", rows)
