"""Gas that is squeezed between faces, and below plates with holes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from mems_impact.actuator.geometry.base import Process
from mems_impact.actuator.terms.squeeze_film import SqueezeFilm

MODES = 2000  # of the pressure across a film
SQUARE_HOLE = 0.547  # radius of a pipe with the flow of a square one, by its side
END_LENGTH = 3.0 * math.pi / 8.0  # that the ends add to a pipe, by its radius


class RectangularFilm(NamedTuple):
    """Rectangular films in one gap, and the damping of the flow through holes [N s/m]."""

    length: float
    width: float
    number: float = 1.0
    holes: float = 0.0


def rectangle_damping(length: float, width: float, leak: float = 0.0) -> float:
    """Return the damping of a rectangular film times gap^3 by viscosity.

    By the solution of laplacian(P) - leak P = 12 viscosity v/gap^3 in a sine series across the
    width.
    """
    order = np.arange(1, 2 * MODES, 2)
    root = np.sqrt((np.pi * order / width) ** 2 + leak)
    ends = 1.0 - np.tanh(0.5 * root * length) / (0.5 * root * length)
    return 12.0 * length * width * float(np.sum(8.0 / (np.pi * order * root) ** 2 * ends))


def film_below(
    process: Process, gap: float, sides: tuple[float, float], holes: float, side: float
) -> RectangularFilm:
    """Return the film below a plate with a regular pattern of square holes, for slow motion.

    In each of the cells, as wide as the pitch of the holes, gas flows to the hole, with the damping
    3/2 mu A r_c^2 K/gap^3 of a film of the width r_c (3 K/2)^(1/2), and through it, 8 mu A (t +
    3 pi r/8) r_c^2/r^4, where r and r_c are the radii of hole and cell, b = r/r_c, and K = 4 b^2 -
    b^4 - 4 ln(b) - 3. What escapes at the edges reduces both (M. Bao, H. Yang, Y. Sun, P. J.
    French, *J. Micromech. Microeng.* 13, 795 (2003)).
    """
    length, width = max(sides), min(sides)
    if not holes * side:
        return RectangularFilm(length, width)
    area, radius = length * width, SQUARE_HOLE * side
    cell_squared = area / (math.pi * holes)
    ratio_squared = radius**2 / cell_squared
    form = 4.0 * ratio_squared - ratio_squared**2 - 2.0 * math.log(ratio_squared) - 3.0
    strip = math.sqrt(1.5 * cell_squared * form)
    slip = process.free_path_pressure / process.pressure / radius
    pipes = 8.0 * (process.thickness + END_LENGTH * radius) * area * cell_squared / radius**4
    pipes *= process.viscosity / (1.0 + 4.0 * slip)
    by_gap = process.squeezed_viscosity(gap) / gap**3
    closed = by_gap * area * strip**2 + pipes  # of a plate without edges
    share = by_gap * rectangle_damping(length, width, 12.0 * by_gap * area / closed) / closed
    return RectangularFilm(share * area / strip, strip, 1.0, share * pipes)


def squeeze_film(
    process: Process, films: Sequence[RectangularFilm], sides: Literal["right", "both"] = "right"
) -> SqueezeFilm:
    """Return one film with the damping of all: the only one, or a strip of the widest."""
    widest = max(films, key=lambda each: each.width)
    length, width = widest.length, widest.width
    if len(films) > 1 or widest.number != 1.0:
        total = sum(each.number * rectangle_damping(each.length, each.width) for each in films)
        length = total / width**3 + width * (2.0 - rectangle_damping(2.0, 1.0))
    return SqueezeFilm(
        length=max(length, width),
        width=min(length, width),
        pressure=process.pressure,
        viscosity=process.viscosity,
        free_path_pressure=process.free_path_pressure,
        sides=sides,
    )
