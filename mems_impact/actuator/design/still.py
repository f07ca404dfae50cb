"""When a device has come to stand still."""

from __future__ import annotations

import numpy as np

from mems_impact.actuator.modes import STATES
from mems_impact.actuator.parameters import Actuator
from mems_impact.hybrid.trajectory import Trajectory

__all__ = ["still_after"]

PERIODS = 12  # of which motions that repeat in 1, 2, 3, 4, 6 or 12 periods are told
NEAR = 1e-6


def still_after(trajectory: Trajectory, actuator: Actuator) -> float | None:
    """Return after how many periods of a run the frame stands still; None if it never does.

    That is when, for 12 periods running, frame and block are at the start of each where they were
    12 periods before: to 1e-6 of delta, and of delta times the natural frequency. A block whose
    swing still grows tells that the frame may move yet.

    Parameters
    ----------
    trajectory : Trajectory
    actuator : Actuator
        In the units of the numerics.
    """
    grid = trajectory.samples(per_period=1)
    near = np.array([1.0, (actuator.k / actuator.m2) ** 0.5] * 2) * NEAR * actuator.delta
    own = NEAR * np.abs(grid.y[:, len(STATES) :]).max(axis=0, initial=0.0)  # of terms
    apart = np.abs(grid.y[PERIODS:] - grid.y[:-PERIODS])
    same = (apart <= np.concatenate([near, own])).all(axis=1)
    running = np.convolve(same, np.ones(PERIODS), mode="valid") if same.size >= PERIODS else same
    found = np.flatnonzero(running >= PERIODS)
    if found.size == 0:
        return None
    start = trajectory.start
    cycle = int(grid.cycle[found[0] + 2 * PERIODS - 1])
    return cycle - start.cycle - start.time / trajectory.period
