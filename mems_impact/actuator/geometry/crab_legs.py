"""Crab legs."""

from __future__ import annotations

from typing import Annotated

from mems_impact.actuator.geometry.base import GUIDED_MASS, Beams, Finding, Process, Section
from mems_impact.actuator.parameter_base import Positive, Unit


class CrabLegs(Beams):
    """Crab legs: a thigh across the motion, and a shin along the motion to the anchor.

    Parameters
    ----------
    count : float
        Number of legs, usually 4, arranged symmetrically so that the block does not turn.
    length, width : float
        Drawn length and width of the thighs [m], > 0.
    shin_length, shin_width : float
        Drawn length and width of the shins [m], > 0.

    Raises
    ------
    InvalidParameter
        If a value is out of range.

    See Also
    --------
    FoldedBeams, ClampedBeams, Geometry

    Notes
    -----
    Stiffness count E t w^3 (Ls + 4 a L)/(L^3 (Ls + a L))/4 with a = (ws/w)^3, across the motion the
    same with thigh and shin exchanged (G. K. Fedder, *Simulation of Microelectromechanical
    Systems*, thesis, Berkeley, 1994). Beams are inextensible. The shins release most of the
    residual stress, which is neglected, as is the stretching.

    Examples
    --------
    >>> import mems_impact as mi
    >>> springs = mi.CrabLegs(
    ...     count=4, length="150 um", width="2 um", shin_length="60 um", shin_width="2 um"
    ... )
    """

    shin_length: Annotated[Positive, Unit("m")]
    shin_width: Annotated[Positive, Unit("m")]

    lines = ("width", "shin_width")

    def sections(self, process: Process) -> tuple[Section, Section]:
        """Return thigh and shin; one end of each recedes."""
        recess = process.undercut
        thigh = Section.of(process, self.length + recess, process.line(self.width))
        shin = Section.of(process, self.shin_length + recess, process.line(self.shin_width))
        return thigh, shin

    def beam(self, process: Process) -> Section:
        """Return the thigh."""
        return self.sections(process)[0]

    def stiffness(self, process: Process) -> Finding:
        """Return the stiffness along the motion."""
        value = self.count * stiffness_across(*self.sections(process))
        return Finding(
            "stiffness", value, "N/m", "count E t w^3 (Ls + 4 a L)/(4 L^3 (Ls + a L))",
            "Fedder (1994)", "inextensible beams",
        )  # fmt: skip

    def mass(self, process: Process) -> Finding:
        """Return the share of the legs in the shape of their static deflection."""
        thigh, shin = self.sections(process)
        turn = rotation(thigh, shin)
        swing = turn * thigh.length
        thighs = thigh.mass(process)
        shins = shin.mass(process)
        share = (GUIDED_MASS + 13.0 / 210.0 * swing + swing**2 / 105.0) * thighs
        share += (turn * shin.length) ** 2 / 105.0 * shins
        return Finding(
            "mass of the suspension", self.count * share, "kg", "consistent mass of the beams",
            "Rayleigh's quotient",
        )  # fmt: skip

    def side_stiffness(self, process: Process, deflection: float) -> Finding:
        """Return the stiffness across the motion."""
        thigh, shin = self.sections(process)
        return Finding(
            "side stiffness at the stopper", self.count * stiffness_across(shin, thigh), "N/m",
            "as the stiffness, with thigh and shin exchanged", "Fedder (1994)",
            "inextensible beams",
        )  # fmt: skip

    def stress(self, process: Process, deflection: float) -> Finding:
        """Return the bending stress of the thighs at the block."""
        thigh, shin = self.sections(process)
        length, depth, _, _ = thigh
        curvature = (6.0 - 2.0 * rotation(thigh, shin) * length) * deflection / length**2
        return Finding(
            "stress at the stopper", 0.5 * process.youngs_modulus * depth * curvature, "Pa",
            "E w (6 - 2 turn L) x/(2 L^2)", "beam theory", "no notch", process.strength,
        )  # fmt: skip


def rotation(beam: Section, other: Section) -> float:
    """Return the rotation of the knee per deflection of the beam, restrained by the other beam."""
    own = beam.bending / beam.length
    return 1.5 * own / (own + other.bending / other.length) / beam.length


def stiffness_across(beam: Section, other: Section) -> float:
    """Return the stiffness of a beam at a knee that cannot move but turn."""
    return beam.bending / beam.length**3 * (12.0 - 6.0 * rotation(beam, other) * beam.length)
