"""The border of the values at which a run has one sequence of events, to first order."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.bisection import bisect

BACK = 0.5  # distance behind the origin from which the border is seen, by that of the wanted point
HALVINGS = 6  # of this distance, until it does not lie beyond another border
SPREAD = 0.5  # tangent of the angle between the directions in which the border is found
PRECISION = 1e-3  # of the distance of the border


def nearest_within(
    inside: Callable[[Floats], bool], wanted: Floats
) -> tuple[Floats, Floats] | None:
    """Return the point nearest to another one on this side of a border, and its outer normal.

    `inside` says whether a point, shape (n,), is on this side, as the origin is; `wanted` is on the
    other. None where there is no border on the way to it.
    """
    size = float(np.linalg.norm(wanted))
    behind = (-BACK * 0.5**i * wanted for i in range(HALVINGS))
    base = next((each for each in behind if inside(each)), None)
    if base is None or inside(wanted):
        return None
    ahead = wanted / size
    basis = np.linalg.svd(ahead[None])[2][1:]
    directions = [ahead, *((ahead + SPREAD * aside) / np.hypot(1.0, SPREAD) for aside in basis)]
    back = float(np.linalg.norm(base))
    limit = 4.0 * (size + back)
    inverse = []
    for direction in directions:

        def holds(distance: float, direction: Floats = direction) -> bool:
            return inside(base + distance * direction)

        if holds(limit):
            inverse.append(0.0)
        else:
            inverse.append(1.0 / bisect(holds, 0.0, limit, PRECISION * back)[1])
    normal = np.linalg.solve(np.array(directions), np.array(inverse))
    normal_size = float(np.linalg.norm(normal))
    outer = normal / normal_size
    nearest = wanted - (outer @ (wanted - base) - 1.0 / normal_size) * outer
    way = nearest - base
    share = bisect(lambda part: inside(base + part * way), 0.0, 1.0, PRECISION)[0]
    return base + share * way, outer
