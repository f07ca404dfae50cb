"""Onto the branch of cycles that leaves a Hopf point."""

from __future__ import annotations

import math

import numpy as np

from mems_impact.continuation.equilibria import frequency
from mems_impact.continuation.switching import beside
from mems_impact.errors import OrbitError, RunError
from mems_impact.hybrid.run import run
from mems_impact.hybrid.trajectory import Floats, Instant
from mems_impact.hybrid.variational import free_components
from mems_impact.orbits.equilibrium import StationaryState
from mems_impact.orbits.family import Family
from mems_impact.orbits.orbit import PeriodicOrbit
from mems_impact.orbits.phase import Phase
from mems_impact.orbits.shooting import Shooting
from mems_impact.orbits.signature import BOUNDARY, Segment

AMPLITUDES = (1e-3, 3e-3, 1e-2, 3e-2)  # of the first cycle, in parts of the state or of one


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
    size = max(1.0, float(np.abs(center).max()))
    family = _suited(equilibrium, center + size * AMPLITUDES[-1] * along, period)
    shooting = Shooting(family, segments, (parameter,), phase=phase)
    # Around the equilibrium, once in the period of its rotation, and at its parameter: what changes
    # first with the amplitude is the state alone.
    middle = np.array([*center, period / phase.unit, value])
    away = np.array([*along, 0.0, 0.0])
    return beside(shooting, middle, away, [size * amplitude for amplitude in AMPLITUDES])


def _suited(equilibrium: StationaryState, beside: Floats, period: float) -> Family:
    """Return the family, integrated by the method that suits one turn from beside the point."""
    family, y = equilibrium.family, np.array(equilibrium.state)
    problem = family.problem().counted_in(period)
    y[list(free_components(problem.automaton))] = beside
    try:
        return family.suited(run(problem, Instant(0, 0.0, equilibrium.mode, y), 1.0).stiff)
    except RunError:
        return family.suited(False)


def _plane(vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two orthogonal unit vectors: where a rotation is at its widest, and where it goes."""
    # The eigenvector turned so that its real and imaginary part are orthogonal, the longer first.
    turn = 0.5 * np.angle(np.sum(vector * vector))
    vector = vector * np.exp(-1j * turn)
    wide, onward = vector.real, -vector.imag
    return wide / np.linalg.norm(wide), onward / np.linalg.norm(onward)
