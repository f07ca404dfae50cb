"""Fingers of comb drives."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated

from mems_impact.actuator.geometry.base import Finding, Process
from mems_impact.actuator.geometry.breakdown import breakdown
from mems_impact.actuator.geometry.fingers import Fingers, line_capacitance
from mems_impact.actuator.parameter_base import Positive, Unit
from mems_impact.actuator.terms.base import Term
from mems_impact.actuator.terms.comb_drive import CombDrive

EDGES = "fringe ((r+1) ln(r+1) - (r-1) ln(r-1))/pi, r = 1 + w/g"


class CombFingers(Fingers):
    """Comb fingers, which slide between fixed fingers.

    Parameters
    ----------
    count : float
        Number of fingers of the block at an electrode, each between two fixed fingers; > 0.
    length, width : float
        Drawn length and width of the fingers [m], > 0.
    gap : float
        Drawn gap between neighbouring fingers [m], > 0.
    overlap : float
        Drawn length over which the fingers overlap at rest [m], > 0.
    sides : {"both", "right", "left"}, optional
        The electrodes that are combs.
    tip_gap : float
        Drawn distance from the tips to the opposite electrode [m], above the travel; `d`.

    Raises
    ------
    InvalidParameter
        If a value is out of range.

    See Also
    --------
    GapClosingFingers, CombDrive, Geometry

    Notes
    -----
    Capacitance 2 count (overlap + x) times that of a gap per length, permittivity (t/g + ((r + 1)
    ln(r + 1) - (r - 1) ln(r - 1))/pi), r = 1 + w/g: the exact field of a periodic array of fingers
    of a thickness above the gap, by conformal mapping; fields of tips and of the substrate are
    neglected. The block snaps to a side where 2 count permittivity t (overlap + x) v^2/g^3 exceeds
    the side stiffness (R. Legtenberg et al., *J. Micromech. Microeng.* 6, 320 (1996)). The gas
    between the fingers is sheared: viscosity/(1 + 2 Kn) area/gap (T. Veijola, M. Turowski, *J.
    Microelectromech. Syst.* 10, 263 (2001)).

    Examples
    --------
    >>> import mems_impact as mi
    >>> comb = mi.CombFingers(count=100, length="40 um", width="3 um", gap="3 um",
    ...                       overlap="20 um", tip_gap="15 um")
    """

    tip_gap: Annotated[Positive, Unit("m")]

    def block_gap(self, process: Process) -> float:
        """Return the gap at the tips."""
        return process.space(self.tip_gap)

    def comb(self, process: Process) -> CombDrive:
        """Return the term of the capacitance, with a thickness that includes the fringing."""
        gap, width = process.space(self.gap), process.line(self.width)
        return CombDrive(
            fingers=self.count,
            gap=gap,
            thickness=gap * line_capacitance(process, gap, width) / process.permittivity,
            permittivity=process.permittivity,
            overlap=process.line(self.overlap),
            sides=self.sides,
        )

    def terms(self, process: Process, travel: float) -> tuple[Term, ...]:
        """Return the term of the capacitance."""
        return (self.comb(process),)

    def damping(self, process: Process) -> Finding:
        """Return the damping of the sheared gas between the fingers."""
        gap = process.space(self.gap)
        area = (
            2.0 * self.electrode_count * self.count * process.thickness * process.line(self.overlap)
        )
        return Finding(
            "damping between fingers", process.sliding_viscosity(gap) * area / gap, "N s/m",
            "viscosity/(1 + 2 Kn) area/gap", "Veijola, Turowski (2001)",
            "gas above and at the tips neglected",
        )  # fmt: skip

    def findings(self, process: Process, travel: float, side_stiffness: float) -> Iterator[Finding]:
        """Yield the slope of the capacitance, and the voltage of the side instability."""
        comb = self.comb(process)
        slope = 2.0 * comb.fingers * process.permittivity * comb.thickness / comb.gap
        yield Finding(
            "slope of the capacitance", slope, "F/m", f"2 count permittivity (t/g + {EDGES})",
            "Schwarz-Christoffel map", "t > g; no substrate",
        )  # fmt: skip
        area = comb.fingers * process.thickness * (comb.overlap + travel)
        yield Finding(
            "side instability at the stopper",
            math.sqrt(0.5 * side_stiffness * comb.gap**3 / (process.permittivity * area)), "V",
            "v^2 = k_side g^3/(2 count permittivity t (overlap + x))",
            "Legtenberg et al. (1996)", "centred fingers",
        )  # fmt: skip
        yield breakdown(comb.gap)
