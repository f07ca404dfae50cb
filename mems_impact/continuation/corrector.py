"""Pseudo-arclength steps: tangent, prediction, correction."""

from __future__ import annotations

import numpy as np

from mems_impact.errors import OrbitError
from mems_impact.hybrid.trajectory import Floats
from mems_impact.orbits.shooting import ACCEPTED, TOLERANCE, Point, Shooting

ITERATIONS = 8


def tangent(point: Point, along: Floats | None = None) -> Floats:
    """Return the unit tangent of the branch at `point`, shape (unknowns + 1,).

    Parameters
    ----------
    point : Point
        With one active parameter.
    along : float array, optional
        The direction in which to look; without it, the parameter grows.
    """
    wide = np.hstack([point.jacobian, point.by_parameter[:, :1]])
    # The vector to which all rows are orthogonal: the last right singular vector.
    direction = np.linalg.svd(wide)[2][-1]
    forward = direction[-1] if along is None else direction @ along
    return np.asarray(direction if forward >= 0.0 else -direction)


def step(shooting: Shooting, point: Point, direction: Floats, length: float) -> tuple[Point, int]:
    """Go `length` along `direction` from `point` and correct at right angles to it.

    Returns
    -------
    point : Point
    iterations : int
        Newton steps that it took until the next one was as small as the error of the integration.

    Raises
    ------
    OrbitError
        If the correction does not converge.
    """
    start = np.append(point.unknowns, point.values[0])
    return correct(shooting, start + length * direction, direction)


def correct(shooting: Shooting, guess: Floats, direction: Floats) -> tuple[Point, int]:
    """Correct `guess` (unknowns and parameter) in the plane through it across `direction`."""
    unknowns = guess.copy()
    previous, needed = np.inf, ITERATIONS
    for iteration in range(ITERATIONS):
        point = shooting.evaluate(unknowns[:-1], unknowns[-1:])
        matrix = np.vstack([np.hstack([point.jacobian, point.by_parameter[:, :1]]), direction])
        residual = np.append(point.residual, direction @ (unknowns - guess))
        try:
            change = np.linalg.solve(matrix, -residual)
        except np.linalg.LinAlgError as error:
            raise OrbitError(
                "the branch has no single tangent here", "take another step"
            ) from error
        size = float(np.abs(change).max())
        if size < ACCEPTED:
            needed = min(needed, iteration)
        if size < TOLERANCE or (size >= previous and float(np.abs(residual).max()) < ACCEPTED):
            return point, min(needed, iteration)
        if not np.isfinite(size) or size > 1e3 or (iteration > 2 and size > 10.0 * previous):
            break
        previous = size
        unknowns = unknowns + change
    raise OrbitError("the correction of a step did not converge", "take a shorter step")
