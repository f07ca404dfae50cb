"""Whether a motion has gone where no orbit can be found."""

from __future__ import annotations

import numpy as np

from mems_impact.errors import OrbitError
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.trajectory import Instant
from mems_impact.hybrid.variational import free_components
from mems_impact.orbits.shooting import ACCEPTED

LARGEST = ACCEPTED / float(np.finfo(float).eps)
"""Of a state: beyond it rounding alone is more than a residual may be."""
DIVERGED = "the motion has diverged"
BOUNDED = (
    "give a guess near an orbit, without a transient that leads away from it, or parameters at "
    "which motions stay bounded"
)


def farthest(problem: Problem, at: Instant) -> int | None:
    """Return the component that is largest where a motion has diverged; None where it has not."""
    free = list(free_components(problem.automaton))
    sizes = np.nan_to_num(np.abs(at.y[free]), nan=np.inf)
    return free[int(np.argmax(sizes))] if sizes.size and sizes.max() > LARGEST else None


def check_bounded(problem: Problem, at: Instant) -> None:
    """Raise OrbitError, with the instant, if a motion has diverged."""
    if farthest(problem, at) is not None:
        raise OrbitError(DIVERGED, BOUNDED, at)
