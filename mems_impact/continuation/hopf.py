"""Onto the branch of cycles that leaves a Hopf point."""

from __future__ import annotations

import math

import numpy as np

from mems_impact.continuation.corrector import correct
from mems_impact.continuation.equilibria import frequency
from mems_impact.errors import OrbitError
from mems_impact.orbits.equilibrium import StationaryState
from mems_impact.orbits.orbit import PeriodicOrbit, make_orbit
from mems_impact.orbits.phase import Phase
from mems_impact.orbits.shooting import Shooting
from mems_impact.orbits.signature import BOUNDARY, Segment

AMPLITUDES = (1e-3, 3e-3, 1e-2, 3e-2)  # of the first cycle, in parts of the state or of one
CLEAR = 1e-7  # relative change of the parameter by which the side is no matter of rounding


def born(equilibrium: StationaryState, parameter: str) -> tuple[PeriodicOrbit, float]:
    """Return a small cycle next to a Hopf point, and on which side of it.

    Parameters
    ----------
    equilibrium : StationaryState
        At a Hopf point.
    parameter : str

    Returns
    -------
    orbit : PeriodicOrbit
        The first one of the branch that leaves the point.
    side : float
        1 where the parameter grows along that branch, else -1: the `direction` in which to follow.

    Raises
    ------
    OrbitError
        If the point bears no cycle.
    """
    rate = frequency(equilibrium)
    if rate is None:
        raise OrbitError("no pair of eigenvalues is on the imaginary axis", "locate a Hopf point")
    balance, value = equilibrium.balance, equilibrium.family.values[parameter]
    values, vectors = np.linalg.eig(balance.jacobian)
    along, across = _plane(vectors[:, np.argmin(np.abs(values - 1j * rate))])
    center = balance.unknowns
    period = 2.0 * math.pi / rate
    phase = Phase(tuple(across.tolist()), float(across @ center), period)
    segments = (Segment(equilibrium.mode, 0, BOUNDARY),)
    shooting = Shooting(equilibrium.family, segments, (parameter,), phase=phase)
    # Around the equilibrium, once in the period of its rotation, and at its parameter: what changes
    # first with the amplitude is the state alone.
    middle = np.array([*center, period / phase.unit, value])
    away = np.array([*along, 0.0, 0.0])
    size = max(1.0, float(np.abs(center).max()))
    found, change = None, 0.0
    for amplitude in AMPLITUDES:
        try:
            point = correct(shooting, middle + amplitude * size * away, away).point
        except OrbitError:
            if found is None:
                raise
            break
        orbit = make_orbit(shooting, point)
        if found is not None and found.admissible and not orbit.admissible:
            break
        found, change = orbit, float(point.values[0] - value)
        if abs(change) > CLEAR * max(abs(value), CLEAR):
            break
    assert found is not None
    return found, math.copysign(1.0, change)


def _plane(vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two orthogonal unit vectors: where a rotation is at its widest, and where it goes."""
    # The eigenvector turned so that its real and imaginary part are orthogonal, the longer first.
    turn = 0.5 * np.angle(np.sum(vector * vector))
    vector = vector * np.exp(-1j * turn)
    wide, onward = vector.real, -vector.imag
    return wide / np.linalg.norm(wide), onward / np.linalg.norm(onward)
