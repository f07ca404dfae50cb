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

GROWN = 2.0  # factor from the shortest period of a branch
SLOW_SPEED_RATIO = 0.05  # speed, in sizes of the cycle a period; its mean is above one
SLOWING_RATIO = (
    0.7  # factor between the slowest speeds of two cycles of which one takes half as long
)
EQUILIBRIUM_DISTANCE = 0.1  # distance of an equilibrium, in sizes of the cycle
SEGMENT_SAMPLES = 64  # into which a segment is cut
AMPLIFIED = 1e6  # factor of an error within a segment: its square times rounding is in multipliers


@dataclass(frozen=True)
class SlowPassage:
    """Where the last cycle of a branch is slowest.

    Attributes
    ----------
    mode : int
    state : float array, shape (n,)
        Of an equilibrium if there is one, else the slowest one of the cycle.
    equilibrium : bool
    periods : tuple of float
        The shortest of the branch, and the last.
    """

    mode: int
    state: Floats
    equilibrium: bool
    periods: tuple[float, float]


def slow_passage(orbits: Sequence[PeriodicOrbit]) -> SlowPassage | None:
    """Return what the last cycle of a branch passes more slowly than those before; None if nothing.

    Parameters
    ----------
    orbits : sequence of PeriodicOrbit
        Those of a branch, in order.
    """
    last = orbits[-1]
    if last.shooting.phase is None:
        return None
    periods = np.array([orbit.point.period for orbit in orbits])
    if not periods[-1] > max(GROWN * periods.min(), 0.9 * periods.max()):
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


def amplified(point: ShootingEvaluation) -> bool:
    """Return whether errors grow within a segment until multipliers are uncertain to 1e-3."""
    return any(np.abs(arc.by_state).max(initial=0.0) > AMPLIFIED for arc in point.arcs)


def _slowest(orbit: PeriodicOrbit) -> tuple[float, int, Floats, Floats]:
    """Return the least speed of a cycle, with mode, state, and the sizes by which it counts."""
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
