"""Homoclinic ends of branches of limit cycles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mems_impact._util.arrays import Complexes, Floats
from mems_impact.continuation.arclength import CONTINUATION_ERRORS
from mems_impact.orbits.equilibrium import EquilibriumState, find_equilibrium
from mems_impact.orbits.periodic_orbit import PeriodicOrbit
from mems_impact.orbits.shooting import ShootingEvaluation

MIN_PERIOD_GROWTH = 2.0  # least ratio of the last period to the shortest one of a branch
SLOW_SPEED_RATIO = 0.05  # speed, in sizes of the cycle per passage; the mean is above one
SLOW_RATIO, FAST_RATIO = 3.0, 10.0  # speeds in and between slow passages, in the least speed
SLOWING_RATIO = 0.7  # largest ratio of the least speeds of a cycle and one of half its period
REST_SPEED = 1e-9  # speed at an equilibrium, to the errors of integration
EQUILIBRIUM_DISTANCE = 0.1  # distance of an equilibrium, in sizes of the cycle
ZERO_RATIO = 1e-12  # component of an equilibrium that counts as zero, in sizes of the cycle
SEGMENT_SAMPLES = 64  # least number of intervals per segment
SHORTEST_PERIOD_SAMPLES = 8  # least number of intervals in a time of the shortest period
MAX_ERROR_GROWTH = 1e6  # error growth in a segment, as past a saddle


@dataclass(frozen=True)
class SlowPassage:
    """Slowest point of the last limit cycle of a branch."""

    mode: int
    state: Floats  # the state of an equilibrium nearby, or else the state of slowest motion
    equilibrium: EquilibriumState | None  # the one nearby
    periods: tuple[float, float]  # the shortest and the last period of the branch
    # Number of slow passages in a period: two if a symmetric cycle approaches both homoclinic
    # orbits of a symmetric pair.
    passages: int = 1


def slow_passage(orbits: Sequence[PeriodicOrbit]) -> SlowPassage | None:
    """Return the slow passage of a branch whose period grows beyond bounds, else None.

    The orbits are in the order of the branch.
    """
    last = orbits[-1]
    if last.shooting.phase is None:
        return None
    periods = np.array([orbit.point.period for orbit in orbits])
    if not periods[-1] > max(MIN_PERIOD_GROWTH * periods.min(), 0.9 * periods.max()):
        return None
    shorter = orbits[int(np.argmin(np.abs(periods - 0.5 * periods[-1])))]
    try:
        (speed, mode, state, sizes, passages), (before, *_) = (
            _slowest(orbit, float(periods.min())) for orbit in (last, shorter)
        )
        slower = speed < max(SLOWING_RATIO * before, REST_SPEED)
        if not (slower and speed < SLOW_SPEED_RATIO * passages):
            return None
    except CONTINUATION_ERRORS:
        return None
    extremes = float(periods.min()), float(periods[-1])
    try:
        equilibrium = find_equilibrium(last.family, mode, state)
    except CONTINUATION_ERRORS:
        return SlowPassage(mode, state, None, extremes, passages)
    free = last.shooting.free
    if np.abs((equilibrium.state - state)[free] / sizes).max() > EQUILIBRIUM_DISTANCE:
        return SlowPassage(mode, state, None, extremes, passages)
    rest = equilibrium.state.copy()
    rest[free] = np.where(np.abs(rest[free]) < ZERO_RATIO * sizes, 0.0, rest[free])
    return SlowPassage(mode, rest, equilibrium, extremes, passages)


def has_large_error_growth(point: ShootingEvaluation) -> bool:
    """Return whether errors grow within a segment as they do past a saddle."""
    return any(np.abs(arc.by_state).max(initial=0.0) > MAX_ERROR_GROWTH for arc in point.arcs)


def _slowest(orbit: PeriodicOrbit, fast: float) -> tuple[float, int, Floats, Floats, int]:
    """Return the least speed of a cycle, its mode, state and scales, and the slow passages.

    The samples resolve motions as long as a cycle of the period `fast`.
    """
    shooting, point = orbit.shooting, orbit.point
    variational, free = shooting.variational(point.parameter_point), shooting.free
    modes, states, slopes = [], [], []
    for piece in shooting.pieces(point):
        length = piece.end - piece.start
        count = max(SEGMENT_SAMPLES, math.ceil(SHORTEST_PERIOD_SAMPLES * length / fast))
        times = np.linspace(piece.start, piece.end, count + 1)
        slowest = piece.state
        for begin, end in pairwise(times.tolist()):
            arc = variational.arc(piece.mode, slowest, begin, end)
            modes.append(piece.mode)
            states.append(arc.end)
            slopes.append(arc.slope_end[free])
            slowest = arc.end
    sizes = np.ptp(np.array(states)[:, free], axis=0)
    sizes[sizes == 0.0] = 1.0
    speeds = np.linalg.norm(np.array(slopes) / sizes, axis=1) * point.period
    k = int(np.argmin(speeds))
    return float(speeds[k]), modes[k], states[k], sizes, _passages(speeds / speeds[k])


def _passages(speeds: Floats) -> int:
    """Return the number of slow passages along a cycle, from its speeds in the least one."""
    begun, slow = 0, True  # the profile begins at the least speed
    for speed in np.roll(speeds, -int(np.argmin(speeds))):
        if slow and speed > FAST_RATIO:
            slow = False
            begun += 1
        slow = slow or speed < SLOW_RATIO
    return max(1, begun)


# --- The homoclinic orbit and the cycles near it

NEUTRAL_RATIO = 1e-6  # least ratio of the saddle quantity to the leading eigenvalues with a sign


def leading(eigenvalues: Complexes) -> tuple[Complexes, Complexes] | None:
    """Return the leading stable and unstable eigenvalues of a saddle; None of another equilibrium.

    The leading eigenvalues are closest to the imaginary axis on either side, real or a pair.
    """
    stable, unstable = eigenvalues[eigenvalues.real < 0.0], eigenvalues[eigenvalues.real > 0.0]
    if not stable.size or not unstable.size or stable.size + unstable.size < eigenvalues.size:
        return None
    nearest = stable.real.max(), unstable.real.min()
    close = (np.isclose(stable.real, nearest[0]), np.isclose(unstable.real, nearest[1]))
    return stable[close[0]], unstable[close[1]]


def saddle_quantity(eigenvalues: Complexes) -> float:
    """Return the sum of the real parts of both leading eigenvalues; NaN unless of a saddle."""
    pair = leading(eigenvalues)
    return math.nan if pair is None else float(pair[0][0].real + pair[1][0].real)


def cycles_beside(eigenvalues: Complexes) -> str:
    """Return which cycles a homoclinic orbit to a saddle has nearby; empty if that is undecided.

    Kuznetsov, Elements of Applied Bifurcation Theory, theorems 6.1 to 6.6 (Andronov and Leontovich;
    Shilnikov).
    """
    pair = leading(eigenvalues)
    quantity = saddle_quantity(eigenvalues)
    if pair is None or abs(quantity) <= NEUTRAL_RATIO * abs(pair[1][0].real):
        return ""
    stable, unstable = (bool(np.any(each.imag != 0.0)) for each in pair)
    # Along the weaker of the leading directions the orbit may spiral.
    if (stable if quantity > 0.0 else unstable) or (stable and unstable):
        return "infinitely many cycles"
    attracting = quantity < 0.0 and np.count_nonzero(eigenvalues.real > 0.0) == 1
    return "one stable cycle" if attracting else "one unstable cycle"


def homoclinic_value(values: Floats, periods: Floats, rate: float) -> tuple[float, float]:
    """Extrapolate the parameter of cycles to an infinite period, with an estimate of the error.

    The distance to the homoclinic orbit decays as ``exp(-rate T)`` with the period T, or the time
    between slow passages. `values` and `periods`, shape (points,), are along the branch; `rate` is
    the smaller of the absolute real parts of the leading eigenvalues.
    """

    def estimate(i: int) -> tuple[float, int]:
        """Extrapolate from a point and an earlier one, whose distance is twice as large."""
        j = int(np.argmin(np.abs(periods[:i] - (periods[i] - math.log(2.0) / rate))))
        share = math.exp(-rate * (periods[i] - periods[j]))
        return float((values[i] - share * values[j]) / (1.0 - share)), j

    estimated, before = estimate(len(values) - 1)
    if before == 0:
        return estimated, abs(estimated - float(values[-1]))
    return estimated, abs(estimated - estimate(before)[0])
