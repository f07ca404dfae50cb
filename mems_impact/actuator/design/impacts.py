"""Impacts among the events of a run, and the steps of the frame that they cause."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mems_impact.actuator import equations as eq
from mems_impact.actuator.composing import layout
from mems_impact.actuator.modes import GUARDS, MODES, RELEASE, SLIP_END, V2, X1, direction_of
from mems_impact.actuator.parameters import Actuator
from mems_impact.hybrid import loop
from mems_impact.hybrid.trajectory import Events, Floats

__all__ = [
    "SLIPPING",
    "contact_loss",
    "energy_lost",
    "frame_steps",
    "is_impact",
    "is_release",
    "yields",
]

SLIPPING = np.array([direction_of(mode) != 0 for mode in range(len(MODES))])
"""Whether the frame slips, by mode."""


def is_impact(events: Events) -> NDArray[np.bool_]:
    """Return where the rows are impacts."""
    return events.impacts_among(GUARDS)


def is_release(events: Events) -> NDArray[np.bool_]:
    """Return where the block leaves a stopper on which it has rested, or which has yielded."""
    return (events.kind == loop.TRANSITION) & (events.guard == RELEASE)


def yields(actuator: Actuator) -> bool:
    """Return whether the stoppers yield, and contacts last."""
    return any(term.instead == "stopper" for term in actuator.terms)


def contact_loss(actuator: Actuator) -> int:
    """Return the place of the state that sums up what contacts with stoppers that yield lose."""
    states = layout([term.kind for term in actuator.terms], 0).states
    return states.index("contact_loss")


def energy_lost(events: Events, actuator: Actuator) -> Floats:
    """Return the energy that each row loses: impacts, and the rest of chatter sequences.

    A contact with a stopper that yields has lost it when the block leaves; NaN if it has not left
    yet.
    """
    if not yields(actuator):
        speeds = events.before[:, V2], events.after[:, V2]
        lost: Floats = eq.impact_loss(actuator.m1, actuator.m2, *speeds)
        return np.where(is_impact(events) | (events.kind == loop.ACCUMULATION), lost, 0.0)
    rows = np.flatnonzero(is_impact(events))
    ends = np.flatnonzero(is_release(events) | (events.kind == loop.ACCUMULATION))
    total = events.after[:, contact_loss(actuator)]
    place = np.searchsorted(ends, rows)
    ended = place < ends.size
    lost = np.zeros(len(events))
    lost[rows] = math.nan
    lost[rows[ended]] = total[ends[place[ended]]] - total[rows[ended]]
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
    # A contact that begins with the frame at rest may move it yet.
    comes = SLIPPING[events.mode_before] | np.isin(events.guard, (RELEASE, SLIP_END))
    rests = ~SLIPPING[events.mode_after] & events.begin_arcs & comes
    ends = np.flatnonzero(impact | rests)
    x1 = events.after[:, X1]
    # An impact that leaves the frame at rest ends its own step, of length zero.
    place = np.searchsorted(ends, rows, side="right")
    steps = np.full(rows.size, math.nan)
    ended = place < ends.size
    steps[ended] = x1[ends[place[ended]]] - x1[rows[ended]]
    struck = events.before[rows, V2] != events.after[rows, V2]  # else a contact begins
    steps[struck & ~SLIPPING[events.mode_after[rows]]] = 0.0
    return rows, steps
