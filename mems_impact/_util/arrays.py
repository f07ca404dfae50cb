"""Types of arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


def distance_to_nearest(values: Floats, targets: Floats) -> Floats:
    """Return the distance of each value to the nearest of ascending targets; inf without any."""
    place, nearest = np.searchsorted(targets, values), np.full(values.size, np.inf)
    for beside in (place - 1, place):
        inside = (beside >= 0) & (beside < targets.size)
        nearest[inside] = np.minimum(
            nearest[inside], np.abs(values[inside] - targets[beside[inside]])
        )
    return nearest
