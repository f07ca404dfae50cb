"""Basin entropy and uncertainty exponent: how mixed the basins of attraction on a grid are."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from mems_impact._util.arrays import Floats
from mems_impact.errors import InvalidParameter
from mems_impact.systems.state import whole
from mems_impact.systems.statistics import FAILED

MIN_SIDE = 10  # points along an axis from which an exponent can be estimated
LARGEST_DISTANCE_RATIO = 0.1  # of the shortest axis, of the perturbations
MIN_LARGEST_DISTANCE = 4  # grid steps
DISTANCES = 12  # perturbations of a fit, at most


class BasinEntropy(NamedTuple):
    """Entropies of basins of attraction on a grid of boxes.

    Attributes
    ----------
    basin : float
        Mean entropy of all boxes, Sb.
    boundary : float
        Mean entropy of the boxes with at least two attractors, Sbb; NaN if there is none. Above
        log 2 the boundary is fractal.
    boxes : int
    boundary_boxes : int
        Number of boxes with at least two attractors.
    """

    basin: float
    boundary: float
    boxes: int
    boundary_boxes: int


class UncertaintyExponent(NamedTuple):
    """Uncertainty exponent of basins of attraction on a grid.

    Attributes
    ----------
    exponent : float
        1 for a smooth boundary, near 0 for intermingled basins; NaN if the grid has fewer than two
        distances with uncertain points. The boundary has the dimension of the grid minus it.
    error : float
        Variation between halves of the range of distances (root mean square).
    distances : array of int, shape (k,)
        Perturbations in grid steps.
    fractions : array, shape (k,)
        Fraction of points that are uncertain at each distance.
    """

    exponent: float
    error: float
    distances: NDArray[np.int64]
    fractions: Floats


def basin_entropy(grid: NDArray[Any], box: int) -> BasinEntropy:
    """Return the entropies of a grid of attractors, in boxes of `box` points a side."""
    box = whole("box", box, 2)
    if min(grid.shape) < box:
        allowed = f"at most {min(grid.shape)}, the points along the shortest axis"
        raise InvalidParameter("box", box, allowed)
    codes = _codes(grid)
    counts = [side // box for side in grid.shape]
    whole_boxes = codes[tuple(slice(count * box) for count in counts)]
    sides = [number for count in counts for number in (count, box)]
    inner = range(1, 2 * len(counts), 2)
    rows = np.moveaxis(whole_boxes.reshape(sides), inner, range(-len(counts), 0))
    rows = rows.reshape(math.prod(counts), box ** len(counts))
    points = np.stack([(rows == code).sum(axis=1) for code in range(codes.max() + 1)], axis=1)
    totals = points.sum(axis=1)
    points, totals = points[totals > 0], totals[totals > 0]
    shares = points / totals[:, None]
    entropies = -(shares * np.log(np.where(shares > 0.0, shares, 1.0))).sum(axis=1)
    mixed = (points > 0).sum(axis=1) > 1
    return BasinEntropy(
        float(entropies.mean()) if totals.size else math.nan,
        float(entropies[mixed].mean()) if mixed.any() else math.nan,
        totals.size,
        int(mixed.sum()),
    )


def uncertainty_exponent(grid: NDArray[Any], largest: int | None) -> UncertaintyExponent:
    """Return the uncertainty exponent of a grid of attractors."""
    shortest = min(grid.shape)
    if shortest < MIN_SIDE:
        problem = f"an axis of the grid has {shortest} points: give at least {MIN_SIDE}"
        raise InvalidParameter("largest", largest, "", problem=problem)
    if largest is None:
        largest = max(MIN_LARGEST_DISTANCE, int(LARGEST_DISTANCE_RATIO * shortest))
    largest = whole("largest", largest, 2)
    if 2 * largest >= shortest:
        raise InvalidParameter(
            "largest", largest, f"below {shortest / 2:g}, half the shortest axis"
        )
    codes = _codes(grid)
    distances = np.unique(np.rint(np.geomspace(1, largest, DISTANCES)).astype(np.int64))
    # The same points at all distances, so that fractions differ by the distance alone.
    inner = (slice(largest, -largest),) * codes.ndim
    valid = codes[inner] >= 0
    if not valid.any():
        return UncertaintyExponent(math.nan, math.nan, distances, np.zeros(distances.size))
    fractions = np.array([_uncertain(codes, k)[inner][valid].mean() for k in distances.tolist()])
    exponent, error = _slope(distances[fractions > 0.0], fractions[fractions > 0.0])
    return UncertaintyExponent(exponent, error, distances, fractions)


def _codes(grid: NDArray[Any]) -> NDArray[np.int64]:
    """Return a number for each attractor, -1 for failed points."""
    names, codes = np.unique(grid, return_inverse=True)
    is_attractor = names != FAILED
    numbers = np.where(is_attractor, np.cumsum(is_attractor) - 1, -1)
    return np.asarray(numbers[codes].reshape(grid.shape), dtype=np.int64)


def _uncertain(codes: NDArray[np.int64], distance: int) -> NDArray[np.bool_]:
    """Return whether each point has another attractor within a distance along each axis."""
    side, beyond = 2 * distance + 1, codes.max() + 1
    largest = maximum_filter(codes, side)
    smallest = minimum_filter(np.where(codes < 0, beyond, codes), side)
    return np.asarray(largest > smallest)


def _slope(distances: NDArray[np.int64], fractions: Floats) -> tuple[float, float]:
    """Return the slope of the logarithms, and how much it varies between halves of the range."""
    if len(distances) < 2:
        return math.nan, math.nan
    x, y = np.log(distances), np.log(fractions)
    slope = float(np.polyfit(x, y, 1)[0])
    half = max(2, len(x) // 2)
    halves = [slice(first, first + half) for first in range(len(x) - half + 1)]
    slopes = np.array([np.polyfit(x[part], y[part], 1)[0] for part in halves])
    return slope, float(np.sqrt(np.mean((slopes - slope) ** 2)))
