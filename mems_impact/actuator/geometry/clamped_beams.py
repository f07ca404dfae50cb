"""Clamped beams."""

from __future__ import annotations

from typing import Literal

from mems_impact.actuator.geometry.base import GUIDED_MASS, Beams, Finding, Process


class ClampedBeams(Beams):
    """Straight beams between anchors and block, which stretch as they bend.

    Parameters
    ----------
    count : float
        Number of beams, each from an anchor to the block; 2 for a beam with the block in its
        middle.
    length, width : float
        Drawn length and width of each beam [m], > 0.
    axially : {"held", "free"}, optional
        "free" if the block can follow the shortening of the beams, as with beams on one side: then
        they neither stretch nor keep residual stress.

    Raises
    ------
    InvalidParameter
        If a value is out of range.

    See Also
    --------
    FoldedBeams, CrabLegs, CubicStiffness, Geometry

    Notes
    -----
    Stiffness count (E t w^3/L^3 + 6 s A/(5 L)) with the residual stress s, within 1 % from s A =
    -5 E I/L^2 to 10 E I/L^2, and 3 % up to 40 E I/L^2; beams buckle at -pi^2 E I/L^2 (S.
    Timoshenko, J. M. Gere, *Theory of Elastic Stability*, 1961). Cubic stiffness 18/25 count E
    A/L^3, the first order of the stretching; the force is too large by less than 1 % at a
    deflection of the width, by 5 % at two widths, by 10 % at three.

    Examples
    --------
    >>> import mems_impact as mi
    >>> springs = mi.ClampedBeams(count=2, length="240 um", width="3 um")
    """

    axially: Literal["held", "free"] = "held"

    def _residual_stress(self, process: Process) -> float:
        return process.residual_stress if self.axially == "held" else 0.0

    def stiffness(self, process: Process) -> Finding:
        """Return the stiffness, with the residual stress to first order."""
        length, _, bending, stretching = self.beam(process)
        tension = stretching * self._residual_stress(process) / process.youngs_modulus
        each = 12.0 * bending / length**3 + 1.2 * tension / length
        return Finding(
            "stiffness", self.count * each, "N/m", "count (E t w^3/L^3 + 6 s A/(5 L))",
            "Timoshenko, Gere (1961)", "-5 E I/L^2 < s A < 40 E I/L^2",
        )  # fmt: skip

    def cubic_stiffness(self, process: Process) -> Finding | None:
        """Return the cubic stiffness; None if beams can shorten freely."""
        if self.axially == "free":
            return None
        length, _, _, stretching = self.beam(process)
        return Finding(
            "cubic stiffness", 0.72 * self.count * stretching / length**3, "N/m^3",
            "18/25 count E A/L^3", "energy of the stretching", "x < 2 w",
        )  # fmt: skip

    def mass(self, process: Process) -> Finding:
        """Return the share of the beams."""
        mass = GUIDED_MASS * self.count * self.beam(process).mass(process)
        return Finding("mass of the suspension", mass, "kg", "13/35 beams", "Rayleigh's quotient")

    def side_stiffness(self, process: Process, deflection: float) -> Finding:
        """Return the stiffness across the motion."""
        length, _, bending, stretching = self.beam(process)
        compliance = length / stretching + deflection**2 * length / (700.0 * bending)
        return Finding(
            "side stiffness at the stopper", self.count / compliance, "N/m",
            "count/(L/(E A) + x^2 L/(700 E I))", "beam-column theory",
        )  # fmt: skip

    def stress(self, process: Process, deflection: float) -> Finding:
        """Return the stress of bending, stretching and process at the ends of the beams."""
        length, depth, _, _ = self.beam(process)
        stretch = 0.6 * deflection**2 if self.axially == "held" else 0.0
        strain = (3.0 * depth * deflection + stretch) / length**2
        return Finding(
            "stress at the stopper",
            process.youngs_modulus * strain + self._residual_stress(process),
            "Pa", "E (3 w x + 3 x^2/5)/L^2 + s", "beam theory", "no notch", process.strength,
        )  # fmt: skip
