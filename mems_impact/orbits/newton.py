"""Newton's method: the one corrector of orbits, branches and curves."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mems_impact.errors import OrbitError
from mems_impact.hybrid.trajectory import Floats
from mems_impact.orbits.shooting import ACCEPTED, Point, Shooting

TOLERANCE = 1e-11  # of a Newton step
LARGEST = 1e6  # a longer step leads nowhere
ITERATIONS = 20
NEARER = (
    "take a guess nearer to an orbit: let transients die out (transient=300), or change periods"
)
NEARER_CYCLE = (
    "let transients die out (transient=…, in units of time) or give a guess nearer to a cycle; a "
    "chaotic motion comes close to where it was and leaves again"
)

# From unknowns: the equations there, all residuals, the matrix of their derivatives.
Equations = Callable[[Floats], tuple[Point, Floats, Floats]]


class Solution(NamedTuple):
    """What Newton's method found.

    Attributes
    ----------
    unknowns : float array
    point : Point
        The equations there.
    iterations : int
        Newton steps until the next one was as small as the error of the integration.
    """

    unknowns: Floats
    point: Point
    iterations: int


def newton(
    equations: Equations,
    guess: Floats,
    *,
    reason: str,
    remedy: str,
    iterations: int = ITERATIONS,
) -> Solution:
    """Correct `guess` until the equations hold.

    Done is where the next step would be below `TOLERANCE`, or where steps no longer shrink while no
    residual is above `ACCEPTED`: they are at the level of the integration error then.

    Raises
    ------
    OrbitError
        With `reason` and `remedy` if that does not come about; the last `Point` is in it.
    """
    unknowns, previous, needed = guess, np.inf, iterations
    point, residual, matrix = equations(unknowns)
    for iteration in range(iterations):
        if not (np.isfinite(matrix).all() and np.isfinite(residual).all()):
            break
        try:
            change = np.linalg.solve(matrix, -residual)
        except np.linalg.LinAlgError:
            change = np.linalg.lstsq(matrix, -residual)[0]
        size = float(np.abs(change).max())
        if size < ACCEPTED:
            needed = min(needed, iteration)
        stalled = size >= previous and float(np.abs(residual).max()) < ACCEPTED
        if size < TOLERANCE or stalled:
            return Solution(unknowns, point, min(needed, iteration))
        if not size <= LARGEST:
            break
        previous = size
        try:
            unknowns = unknowns + change
            point, residual, matrix = equations(unknowns)
        except OrbitError:
            break  # the iteration has left what can be integrated
    worst = float(np.abs(residual).max())
    raise OrbitError(f"{reason} (the residual stays at {worst:.2g})", remedy, point)


def solve(shooting: Shooting, unknowns: Floats, values: Floats) -> Point:
    """Correct the unknowns of an orbit at fixed parameters.

    Raises
    ------
    OrbitError
        If the iteration does not converge; the last `Point` is in it.
    """

    def equations(u: Floats) -> tuple[Point, Floats, Floats]:
        point = shooting.evaluate(u, values)
        return point, point.residual, point.jacobian

    return newton(
        equations,
        unknowns,
        reason="no orbit with this signature near the guess",
        remedy=NEARER if shooting.phase is None else NEARER_CYCLE,
    ).point
