"""Plates with holes."""

from __future__ import annotations

import math
from typing import Annotated, Self

from pydantic import model_validator

from mems_impact.actuator.geometry.base import DrawnPart, Process
from mems_impact.actuator.geometry.squeezed_films import RectangularFilm, film_below
from mems_impact.actuator.parameter_base import NonNegative, Positive, Unit
from mems_impact.errors import InvalidParameter


class Plate(DrawnPart):
    """Rectangular plates of the block, with rectangular etch holes.

    Parameters
    ----------
    length, width : float
        Drawn sides [m], > 0.
    count : float, optional
        Number of such plates.
    holes : float, optional
        Number of holes in each plate.
    hole_length, hole_width : float, optional
        Drawn sides of the holes [m].

    Raises
    ------
    InvalidParameter
        If a value is out of range, or the holes are larger than the plate.

    See Also
    --------
    Geometry, FoldedBeams

    Notes
    -----
    The mass is density thickness (length width - holes hole_length hole_width), with sides that
    shrink, and holes that grow, by twice the undercut.

    Examples
    --------
    >>> import mems_impact as mi
    >>> spine = mi.Plate(length="860 um", width="20 um", holes=60, hole_length="8 um",
    ...                  hole_width="8 um")
    """

    length: Annotated[Positive, Unit("m")]
    width: Annotated[Positive, Unit("m")]
    count: Positive = 1.0
    holes: NonNegative = 0.0
    hole_length: Annotated[NonNegative, Unit("m")] = 0.0
    hole_width: Annotated[NonNegative, Unit("m")] = 0.0

    lines = ("width", "length")

    @model_validator(mode="after")
    def _check_holes(self) -> Self:
        if self.holes * self.hole_length * self.hole_width >= self.length * self.width:
            raise InvalidParameter("holes", self.holes, "with less area than the plate")
        return self

    def area(self, process: Process) -> float:
        """Return the area of the plates after the process."""
        outer = process.line(self.length) * process.line(self.width)
        hole = process.space(self.hole_length) * process.space(self.hole_width)
        return self.count * (outer - self.holes * hole)

    def film(self, process: Process, gap: float) -> RectangularFilm:
        """Return the films below the plates, with holes as square as their area."""
        sides = process.line(self.length), process.line(self.width)
        hole = process.space(self.hole_length) * process.space(self.hole_width)
        film = film_below(process, gap, sides, self.holes, math.sqrt(hole) if self.holes else 0.0)
        return film._replace(number=self.count, holes=self.count * film.holes)

    def smallest_line(self, process: Process) -> tuple[str, float]:
        """Return the shorter side; 0 if the holes consume the plate."""
        name, line = super().smallest_line(process)
        return name, min(line, max(self.area(process), 0.0))
