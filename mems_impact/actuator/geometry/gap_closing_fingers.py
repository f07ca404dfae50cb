"""Gap-closing fingers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated

import numpy as np

from mems_impact.actuator.geometry.base import Finding, Process
from mems_impact.actuator.geometry.breakdown import breakdown
from mems_impact.actuator.geometry.fingers import Fingers, line_capacitance
from mems_impact.actuator.geometry.squeezed_films import (
    RectangularFilm,
    rectangle_damping,
    squeeze_film,
)
from mems_impact.actuator.parameter_base import OptionalPositive, Unit
from mems_impact.actuator.terms.base import Term
from mems_impact.actuator.terms.squeeze_film import SqueezeFilm
from mems_impact.actuator.terms.tabulated_capacitance import TabulatedCapacitance

POINTS = 41  # of the table of the capacitance
FLAT = 1e-5  # relative slope of the table per point where the back gap would pull more
BENT = 0.1  # deflection of a tip relative to the gap, above which a finger is not rigid


class GapClosingFingers(Fingers):
    """Gap-closing fingers, each between a narrow front gap and a wide back gap.

    Parameters
    ----------
    count : float
        Number of fingers of the block at an electrode; > 0. A single plate is one finger.
    length, width : float
        Drawn length and width of the fingers [m], > 0.
    gap : float
        Drawn front gap [m], above the travel; `d`.
    overlap : float
        Drawn length over which the fingers overlap [m], > 0.
    sides : {"both", "right", "left"}, optional
        The electrodes with such fingers.
    back_gap : float, optional
        Drawn back gap to the next fixed finger [m]; none by default.

    Raises
    ------
    InvalidParameter
        If a value is out of range.

    See Also
    --------
    CombFingers, TabulatedCapacitance, SqueezeFilm, Geometry

    Notes
    -----
    A gap has the capacitance per length of `CombFingers`, exact for equal gaps, and within 0.3 % of
    a field computation for gaps 1 to 12 um wide of fingers 3 to 5 um wide and 30 to 40 um thick.
    The table of capacitances is flat where the back gap would pull more than the front gap. The gas
    in the front gaps is a `SqueezeFilm`, a strip of the same damping as the count of rectangles
    (M. Bao, H. Yang, *Sens. Actuators A* 136, 3 (2007)). A constant damping, that at rest, has the
    films in the back gaps, and the effect of a substrate at a distance h, by the factor (4 g^3 w +
    2 h^3 t)/(g^3 w + 2 h^3 t) (A. M. Rauf et al., *J. Microelectromech. Syst.* 31, 29 (2022)).
    Fingers are rigid; a warning states where they bend.

    Examples
    --------
    >>> import mems_impact as mi
    >>> fingers = mi.GapClosingFingers(count=70, length="86.5 um", width="5 um", gap="4.83 um",
    ...                                back_gap="7.75 um", overlap="76.5 um", sides="right")
    """

    back_gap: Annotated[OptionalPositive, Unit("m")] = None

    def block_gap(self, process: Process) -> float:
        """Return the front gap."""
        return process.space(self.gap)

    def capacitance(self, process: Process, position: float) -> float:
        """Return the capacitance of an electrode at a position of the block towards it."""
        width, gaps = process.line(self.width), [process.space(self.gap) - position]
        if self.back_gap is not None:
            gaps.append(process.space(self.back_gap) + position)
        each = sum(line_capacitance(process, gap, width) for gap in gaps)
        return self.count * process.line(self.overlap) * each

    def _table(self, process: Process, travel: float) -> TabulatedCapacitance:
        gap = self.block_gap(process)
        reach = 0.5 * (gap + travel)  # as compliant stoppers need it
        positions = gap - np.geomspace(gap + reach, gap - reach, POINTS)
        values = np.array([self.capacitance(process, each) for each in positions.tolist()])
        least = int(np.argmin(values))
        values[:least] = values[least] * (1.0 - FLAT * np.arange(least, 0, -1))
        table = {"positions": tuple(positions.tolist()), "capacitances": tuple(values.tolist())}
        return TabulatedCapacitance(**table, sides=self.sides)

    def _sides_of_film(self, process: Process) -> tuple[float, float]:
        sides = process.thickness, process.line(self.overlap)
        return max(sides), min(sides)

    def _film(self, process: Process) -> SqueezeFilm:
        film = RectangularFilm(*self._sides_of_film(process), self.count)
        return squeeze_film(process, [film], "both" if self.sides == "both" else "right")

    def terms(self, process: Process, travel: float) -> tuple[Term, ...]:
        """Return the terms of capacitance and film."""
        film = (self._film(process),) if process.viscosity and self.sides != "left" else ()
        return (self._table(process, travel), *film)

    def _damping_in(self, process: Process, gap: float) -> float:
        """Return the damping of the films of one electrode at a gap, open above and below."""
        each = rectangle_damping(*self._sides_of_film(process)) / gap**3
        return self.count * process.squeezed_viscosity(gap) * each

    def _closure(self, process: Process, gap: float) -> float:
        """Return the factor of the damping by a substrate that hinders the flow below."""
        if process.substrate_gap is None:
            return 1.0
        over = gap**3 * process.line(self.width)
        below = 2.0 * process.substrate_gap**3 * process.thickness
        return (4.0 * over + below) / (over + below)

    def damping(self, process: Process) -> Finding:
        """Return the constant damping of the films, without the film in open front gaps."""
        front = self.block_gap(process)
        value = (self._closure(process, front) - 1.0) * self._damping_in(process, front)
        if self.back_gap is not None:
            back = process.space(self.back_gap)
            value += self._closure(process, back) * self._damping_in(process, back)
        return Finding(
            "damping of back gaps and substrate", self.electrode_count * value, "N s/m",
            "squeezed films, times (4 g^3 w + 2 h^3 t)/(g^3 w + 2 h^3 t)",
            "Bao, Yang (2007); Rauf et al. (2022)", "at rest",
        )  # fmt: skip

    def findings(self, process: Process, travel: float, side_stiffness: float) -> Iterator[Finding]:
        """Yield capacitance, damping of the film at rest, and the voltage that bends fingers."""
        gap = self.block_gap(process)
        yield Finding(
            "capacitance at rest", self.capacitance(process, 0.0), "F",
            "count overlap permittivity (t/g + fringe), front and back gap",
            "Schwarz-Christoffel map", "t > g; no substrate",
        )  # fmt: skip
        yield Finding(
            "damping in front gaps at rest", self.electrode_count * self._damping_in(process, gap),
            "N s/m", "count viscosity L t^3 (1 - 0.63 t/L)/gap^3", "Bao, Yang (2007)",
            "slow motion; flow above and below",
        )  # fmt: skip
        remaining, slenderness = gap - travel, self.length / process.line(self.width)
        pressure = process.youngs_modulus * BENT * remaining / (1.5 * slenderness**3 * self.length)
        yield Finding(
            "bending of fingers at the stopper",
            remaining * math.sqrt(2.0 * pressure / process.permittivity), "V",
            "q L^4/(8 E I) = gap/10, q = permittivity t v^2/(2 gap^2)", "beam theory",
        )  # fmt: skip
        yield breakdown(remaining)
