"""Onto the branch of doubled period."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mems_impact.continuation.corrector import correct
from mems_impact.continuation.monitors import NEAR
from mems_impact.errors import OrbitError
from mems_impact.hybrid.trajectory import Floats
from mems_impact.orbits.orbit import PeriodicOrbit, make_orbit
from mems_impact.orbits.shooting import Shooting
from mems_impact.orbits.signature import Guess

DISTANCES = (1e-3, 3e-3, 1e-2, 3e-2)  # from the orbit that doubles, in the space of unknowns
CLEAR = 1e-7  # relative change of the parameter by which the side is no matter of rounding


def twice(orbit: PeriodicOrbit) -> Guess:
    """Return an orbit traversed twice.

    A cycle begins once all the same: its second pass goes on in the segment that ended the first.
    """
    segments, point = orbit.segments, orbit.point
    states, _ = orbit.shooting.unpack(point.unknowns)
    if orbit.shooting.phase is None:
        later = tuple(replace(s, cycle=s.cycle + orbit.periods) for s in segments)
        return Guess(segments + later, np.tile(states, (2, 1)), np.tile(point.ends, 2))
    times = np.concatenate([point.ends[:-1], point.period + point.ends])
    return Guess(segments[:-1] + segments, np.vstack([states, states[1:]]), times)


def doubled(orbit: PeriodicOrbit, parameter: str) -> tuple[PeriodicOrbit, float]:
    """Return an orbit of twice the period next to `orbit`, and on which side of it.

    Parameters
    ----------
    orbit : PeriodicOrbit
        At a period doubling.
    parameter : str

    Returns
    -------
    orbit : PeriodicOrbit
        The first one of the branch that leaves `orbit`.
    side : float
        1 where the parameter grows along that branch, else -1: the `direction` in which to follow.

    Raises
    ------
    OrbitError
        If the orbit does not double its period.
    """
    guess = twice(orbit)
    shooting = orbit.equations((parameter,), guess.segments)
    unknowns = shooting.pack(guess)
    value = np.array([orbit.family.values[parameter]])
    point = shooting.evaluate(unknowns, value)
    vectors = np.linalg.svd(point.jacobian)[2]
    if np.abs(orbit.multipliers + 1.0).min() > NEAR:
        raise OrbitError("the orbit has no multiplier -1", "locate a period doubling first", orbit)
    # The null vector of the doubled equations: one way in the first pass, the other in the second.
    away = np.append(vectors[-1], 0.0)
    return beside(shooting, np.append(unknowns, value), away, DISTANCES)


def beside(
    shooting: Shooting, start: Floats, away: Floats, distances: Sequence[float]
) -> tuple[PeriodicOrbit, float]:
    """Return an orbit of the branch that leaves a point, and the side to which its parameter goes.

    Parameters
    ----------
    shooting : Shooting
        The equations of that branch, with one active parameter.
    start, away : float array, shape (unknowns + 1,)
        The point, and the direction in which the branch leaves it.
    distances : sequence of float
        At which it is looked for: the first one where the side is no matter of rounding.

    Raises
    ------
    OrbitError
        If there is none at the first distance.
    """
    value = float(start[-1])
    found, change = None, 0.0
    for distance in distances:
        try:
            first = correct(shooting, start + distance * away, away).point
        except OrbitError:
            if found is None:
                raise
            break
        farther = make_orbit(shooting, first)
        if found is not None and found.admissible and not farther.admissible:
            break
        found, change = farther, float(first.values[0] - value)
        if abs(change) > CLEAR * abs(value):
            break
    assert found is not None
    return found, math.copysign(1.0, change)
