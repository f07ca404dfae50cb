"""Impacts as an experimenter counts them: a sequence that ends in rest is one blow."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from mems_impact.actuator.modes import V2
from mems_impact.hybrid import loop
from mems_impact.studies.impacts import is_impact

if TYPE_CHECKING:
    from mems_impact.studies.run import Run

__all__ = ["Blows", "blows"]


@dataclass(frozen=True, kw_only=True)
class Blows:
    """What the blows of a run's window do.

    Attributes
    ----------
    count : int
        Impacts in the window; a sequence that ends in rest counts once, with its first impact.
    per_period : float
        By the length of the window in forcing periods.
    displacement_per_blow : float
        Displacement of the frame over the window by their number, in the units of the device; 0
        without a blow.
    """

    count: int
    per_period: float
    displacement_per_blow: float


def blows(run: Run) -> Blows:
    """Count the blows in the window of a run whose events were kept."""
    log = run.trajectory.events
    struck = is_impact(log)
    rows = np.flatnonzero(struck | (log.kind == loop.ACCUMULATION))
    speeds = np.abs(log.before[:, V2])
    follows = np.zeros(len(log), dtype=bool)
    for end in np.flatnonzero(log.kind == loop.ACCUMULATION):
        # Back from the end, the impacts of the sequence are ever faster.
        previous = rows[rows < end][::-1]
        for here, before in pairwise(previous):
            same = log.guard[here] == log.guard[before] and struck[before]
            if not (same and speeds[before] > speeds[here]):
                break
            follows[here] = True
    first, last = run.window
    when = log.cycle + log.time / run.trajectory.period
    counted = struck & ~follows & (when >= first) & (when < last)
    count = int(counted.sum())
    moved = run.measured.displacement_per_period * run.measured.periods
    each = moved / count if count else (0.0 if moved == 0.0 else math.nan)
    return Blows(
        count=count,
        per_period=count / run.measured.periods,
        displacement_per_blow=float(run.actuator.scales.out(each, "m")),
    )
