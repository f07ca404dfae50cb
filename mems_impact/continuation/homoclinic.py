"""Homoclinic ends of branches of limit cycles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.continuation.arclength import CONTINUATION_ERRORS
from mems_impact.orbits.equilibrium import find_equilibrium
from mems_impact.orbits.periodic_orbit import PeriodicOrbit
from mems_impact.orbits.shooting import ShootingEvaluation

MIN_PERIOD_GROWTH = 2.0  # least ratio of the last period to the shortest one of a branch
SLOW_SPEED_RATIO = 0.05  # speed, in sizes of the cycle per period; the mean is above one
SLOWING_RATIO = 0.7  # largest ratio of the least speeds of a cycle and one of half its period
EQUILIBRIUM_DISTANCE = 0.1  # distance of an equilibrium, in sizes of the cycle
SEGMENT_SAMPLES = 64  # intervals per segment
MAX_ERROR_GROWTH = (
    1e6  # error growth in a segment; multipliers have the error growth^2 times rounding
)


@dataclass(frozen=True)
class SlowPassage:
    """Slowest point of the last limit cycle of a branch.

    Attributes
    ----------
    mode : int
    state : float array, shape (n,)
        The state of an equilibrium nearby if there is one, else that of slowest motion.
    equilibrium : bool
        Whether it is an equilibrium.
    periods : tuple of float
        The shortest and the last period of the branch.
    """

    mode: int
    state: Floats
    equilibrium: bool
    periods: tuple[float, float]


def slow_passage(orbits: Sequence[PeriodicOrbit]) -> SlowPassage | None:
    """Return the slow passage of a branch whose period grows beyond bounds, else None.

    Parameters
    ----------
    orbits : sequence of PeriodicOrbit
        Orbits of the branch, in order.
    """
    last = orbits[-1]
    if last.shooting.phase is None:
        return None
    periods = np.array([orbit.point.period for orbit in orbits])
    if not periods[-1] > max(MIN_PERIOD_GROWTH * periods.min(), 0.9 * periods.max()):
        return None
    shorter = orbits[int(np.argmin(np.abs(periods - 0.5 * periods[-1])))]
    try:
        (speed, mode, state, sizes), (before, *_) = _slowest(last), _slowest(shorter)
        if not (speed < SLOW_SPEED_RATIO and speed < SLOWING_RATIO * before):
            return None
    except CONTINUATION_ERRORS:
        return None
    both = float(periods.min()), float(periods[-1])
    try:
        found = find_equilibrium(last.family, mode, state).state
    except CONTINUATION_ERRORS:
        return SlowPassage(mode, state, False, both)
    free = last.shooting.free
    if np.abs((found - state)[free] / sizes).max() > EQUILIBRIUM_DISTANCE:
        return SlowPassage(mode, state, False, both)
    return SlowPassage(mode, found, True, both)


def has_large_error_growth(point: ShootingEvaluation) -> bool:
    """Return whether error growth within a segment makes multipliers uncertain by 1e-3."""
    return any(np.abs(arc.by_state).max(initial=0.0) > MAX_ERROR_GROWTH for arc in point.arcs)


def _slowest(orbit: PeriodicOrbit) -> tuple[float, int, Floats, Floats]:
    """Return the least speed of a cycle, its mode and state, and the scales of the components."""
    shooting, point = orbit.shooting, orbit.point
    variational, free = shooting.variational(point.setting), shooting.free
    modes, states, slopes = [], [], []
    for i, y in enumerate(shooting.unpack(point.unknowns)[0]):
        times = np.linspace(point.starts[i], point.ends[i], SEGMENT_SAMPLES + 1)
        here = y
        for begin, end in pairwise(times.tolist()):
            arc = variational.arc(shooting.segments[i].mode, here, begin, end)
            modes.append(shooting.segments[i].mode)
            states.append(arc.end)
            slopes.append(arc.slope_end[free])
            here = arc.end
    sizes = np.ptp(np.array(states)[:, free], axis=0)
    sizes[sizes == 0.0] = 1.0
    speeds = np.linalg.norm(np.array(slopes) / sizes, axis=1) * point.period
    k = int(np.argmin(speeds))
    return float(speeds[k]), modes[k], states[k], sizes
