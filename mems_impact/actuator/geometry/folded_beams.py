"""Folded beams."""

from __future__ import annotations

from typing import Annotated

from mems_impact.actuator.geometry.base import Beams, Finding, Process
from mems_impact.actuator.parameter_base import NonNegative, Unit


class FoldedBeams(Beams):
    """Folded beams: pairs of equal beams in series, joined by rigid trusses.

    Parameters
    ----------
    count : float
        Number of pairs; 4 for the folded flexure of a resonator, with eight beams.
    length, width : float
        Drawn length and width of each beam [m], > 0.
    truss_area : float, optional
        Drawn area of all trusses [m^2]; they move by half the deflection of the block.

    Raises
    ------
    InvalidParameter
        If a value is out of range.

    See Also
    --------
    CrabLegs, ClampedBeams, Geometry

    Notes
    -----
    Stiffness count E t w^3/(2 L^3), and a mass of 12/35 of the beams and a quarter of the trusses
    (W. C. Tang, T.-C. H. Nguyen, R. T. Howe, *Sens. Actuators* 20, 25 (1989)). Stiffness across the
    motion count/(2 L/(E A) + 17 x^2 L/(280 E I)), to first order of the tension (R. Legtenberg et
    al., *J. Micromech. Microeng.* 6, 320 (1996), without the part of single beams, which is 1 %).
    The trusses release residual stress and tension; they are assumed to be much
    stiffer than the beams.

    Examples
    --------
    >>> import mems_impact as mi
    >>> springs = mi.FoldedBeams(count=4, length="200 um", width="2 um")
    """

    truss_area: Annotated[NonNegative, Unit("m^2")] = 0.0

    def stiffness(self, process: Process) -> Finding:
        """Return the stiffness of the pairs in parallel."""
        length, _, bending, _ = self.beam(process)
        return Finding(
            "stiffness", 6.0 * self.count * bending / length**3, "N/m", "count E t w^3/(2 L^3)",
            "Tang, Nguyen, Howe (1989)", "trusses much stiffer than beams",
        )  # fmt: skip

    def mass(self, process: Process) -> Finding:
        """Return the share of beams and trusses."""
        beams = 2.0 * self.count * self.beam(process).mass(process)
        return Finding(
            "mass of the suspension",
            12.0 / 35.0 * beams + 0.25 * process.mass(self.truss_area),
            "kg", "12/35 beams + 1/4 trusses", "Tang, Nguyen, Howe (1989)",
        )  # fmt: skip

    def side_stiffness(self, process: Process, deflection: float) -> Finding:
        """Return the stiffness across the motion."""
        length, _, bending, stretching = self.beam(process)
        compliance = 2.0 * length / stretching + 17.0 / 280.0 * deflection**2 * length / bending
        return Finding(
            "side stiffness at the stopper", self.count / compliance, "N/m",
            "count/(2 L/(E A) + 17 x^2 L/(280 E I))", "Legtenberg et al. (1996)",
        )  # fmt: skip

    def stress(self, process: Process, deflection: float) -> Finding:
        """Return the bending stress at the ends of the beams."""
        length, depth, _, _ = self.beam(process)
        return Finding(
            "stress at the stopper",
            1.5 * process.youngs_modulus * depth * deflection / length**2,
            "Pa", "3 E w x/(2 L^2)", "beam theory", "no notch", process.strength,
        )  # fmt: skip
