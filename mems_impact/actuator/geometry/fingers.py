"""Fingers of electrodes: what combs and gap-closing fingers have in common."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from mems_impact.actuator.geometry.base import DrawnPart, Finding, Process
from mems_impact.actuator.parameter_base import Positive, Unit
from mems_impact.actuator.terms.base import Term


class Fingers(DrawnPart):
    """Base of electrodes with fingers."""

    count: Positive
    length: Annotated[Positive, Unit("m")]
    width: Annotated[Positive, Unit("m")]
    gap: Annotated[Positive, Unit("m")]
    overlap: Annotated[Positive, Unit("m")]
    sides: Literal["both", "right", "left"] = "both"

    lines = ("width", "overlap")
    vertical: ClassVar[bool] = False

    @property
    def electrode_count(self) -> int:
        """Number of electrodes with such fingers."""
        return 2 if self.sides == "both" else 1

    def mass(self, process: Process) -> float:
        """Return the mass of the fingers of the block; their tips recede as their roots do."""
        area = self.length * process.line(self.width)
        return self.electrode_count * self.count * process.mass(area)

    @abstractmethod
    def block_gap(self, process: Process) -> float:
        """Return the gap d that the block closes."""

    @abstractmethod
    def terms(self, process: Process, travel: float) -> tuple[Term, ...]:
        """Return the terms of capacitance and film, for a travel to the stoppers."""

    @abstractmethod
    def damping(self, process: Process) -> Finding:
        """Return the constant part of the damping."""

    @abstractmethod
    def findings(self, process: Process, travel: float, side_stiffness: float) -> Iterator[Finding]:
        """Yield the quantities of electrodes, and the voltages that limit them."""


def line_capacitance(process: Process, gap: float, width: float) -> float:
    """Return the capacitance of a gap between fingers per length [F/m].

    The fields at upper and lower edges of a periodic array of deep fingers add, each,

        ((r + 1) ln(r + 1) - (r - 1) ln(r - 1))/(2 pi),        r = 1 + width/gap

    by a Schwarz-Christoffel map, in units of the permittivity.
    """
    ratio = 1.0 + width / gap
    edge = (ratio + 1.0) * math.log(ratio + 1.0) - (ratio - 1.0) * math.log(ratio - 1.0)
    return process.permittivity * (process.thickness / gap + edge / math.pi)
