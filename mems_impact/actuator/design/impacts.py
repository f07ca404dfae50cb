"""Impacts among the events of a run, and the steps of the frame that they cause."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mems_impact.actuator.modes import GUARDS, MODES, V2, X1, direction_of
from mems_impact.actuator.parameters import Actuator
from mems_impact.hybrid.trajectory import Events, Floats

__all__ = ["SLIPPING", "energy_lost", "frame_steps", "is_impact"]

SLIPPING = np.array([direction_of(mode) != 0 for mode in range(len(MODES))])
"""Whether the frame slips, by mode."""


def is_impact(events: Events) -> NDArray[np.bool_]:
    """Return where the rows are impacts."""
    return events.impacts_among(GUARDS)


def energy_lost(events: Events, actuator: Actuator) -> Floats:
    """Return the kinetic energy lost in impacts and in the rest of chatter sequences.

    Equations (5) and (6) conserve momentum; what is lost is of the relative motion alone.
    """
    reduced = actuator.m1 * actuator.m2 / (actuator.m1 + actuator.m2)
    before, after = events.before[:, V2], events.after[:, V2]
    lost: Floats = 0.5 * reduced * (before - after) * (before + after)
    return lost


def frame_steps(events: Events) -> tuple[NDArray[np.int64], Floats]:
    """Return the rows of the impacts and the step of the frame after each of them.

    A step is the displacement of the frame from an impact until the frame rests or the next
    impact comes, whichever is first; NaN if neither has come yet.

    Returns
    -------
    rows : int array, shape (k,)
    steps : float array, shape (k,)
    """
    impact = is_impact(events)
    rows = np.flatnonzero(impact)
    rests = ~SLIPPING[events.mode_after] & events.begin_arcs
    ends = np.flatnonzero(impact | rests)
    x1 = events.after[:, X1]
    # An impact that leaves the frame at rest ends its own step, of length zero.
    place = np.searchsorted(ends, rows, side="right")
    steps = np.full(rows.size, math.nan)
    ended = place < ends.size
    steps[ended] = x1[ends[place[ended]]] - x1[rows[ended]]
    steps[rests[rows]] = 0.0
    return rows, steps
