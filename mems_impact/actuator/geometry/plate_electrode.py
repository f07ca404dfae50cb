"""An electrode below the block, which moves out of the plane."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar

from mems_impact.actuator.geometry.base import DrawnPart, Finding, Process
from mems_impact.actuator.geometry.breakdown import breakdown
from mems_impact.actuator.parameter_base import OptionalPositive, Positive, Unit
from mems_impact.actuator.terms.base import Term


class PlateElectrode(DrawnPart):
    """An electrode on the substrate, which pulls the block out of the plane of the layer.

    Beams bend in the direction of the thickness; the gas below the block is squeezed, and escapes
    through its holes. Gap and travel are those of the process: no undercut changes them.

    Parameters
    ----------
    length, width : float
        Drawn sides of the electrode [m], > 0.
    gap : float
        Distance of the block to the electrode [m], above the travel; `d`.
    count : float, optional
        Number of such electrodes.
    spread : float, optional
        Distance of the outer springs along the length of the electrode [m], for the warning of a
        block that tilts.

    Raises
    ------
    InvalidParameter
        If a value is out of range.

    See Also
    --------
    GapClosingFingers, Plate, Geometry

    Notes
    -----
    The capacitance is that of a parallel plate without fringing, for sides of many gaps; holes
    narrower than three gaps do not change it. A block on springs at its ends tilts with the
    stiffness k spread^2/4, and the field softens the tilt by length^2/12 of what it softens the
    deflection: a length above sqrt(3) spread tilts before it is pulled in.

    Examples
    --------
    >>> import mems_impact as mi
    >>> electrode = mi.PlateElectrode(length="200 um", width="150 um", gap="2 um", spread="250 um")
    """

    length: Annotated[Positive, Unit("m")]
    width: Annotated[Positive, Unit("m")]
    gap: Annotated[Positive, Unit("m")]
    count: Positive = 1.0
    spread: Annotated[OptionalPositive, Unit("m")] = None

    lines = ("width", "length")
    vertical: ClassVar[bool] = True

    def block_gap(self, process: Process) -> float:
        """Return the gap d that the block closes."""
        return self.gap

    def mass(self, process: Process) -> float:
        """Return the mass on the block: none."""
        return 0.0

    def terms(self, process: Process, travel: float) -> tuple[Term, ...]:
        """Return the terms of the electrode: none, it is a parallel plate."""
        return ()

    def area(self, process: Process) -> float:
        """Return the area of the electrodes after the process."""
        return self.count * process.line(self.length) * process.line(self.width)

    def findings(self, process: Process, travel: float, side_stiffness: float) -> Iterator[Finding]:
        """Yield the capacitance at rest, the tilt, and the breakdown of the gap."""
        yield Finding(
            "capacitance at rest", process.permittivity * self.area(process) / self.gap, "F",
            "permittivity area/gap", "parallel plates", "sides of many gaps; holes below 3 gaps",
        )  # fmt: skip
        if self.spread is not None:
            yield Finding(
                "electrode by the spread of the springs", self.length / self.spread, "",
                "length/spread", "stiffness of tilt", "block on springs at its ends",
                limit=math.sqrt(3.0),
            )  # fmt: skip
        yield breakdown(self.gap - travel)
