"""Beginning a cycle elsewhere on the way along a branch or a curve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mems_impact.continuation.corrector import correct, tangent
from mems_impact.continuation.monitors import Monitor
from mems_impact.hybrid.trajectory import Floats
from mems_impact.orbits.cycles import begun_anew
from mems_impact.orbits.shooting import Point, Shooting


def anew(shooting: Shooting, point: Point, along: Floats) -> tuple[Shooting, Point, Floats]:
    """Return a cycle of a branch, begun clear of its events, with the direction of the branch.

    Raises
    ------
    OrbitError
        If it cannot be corrected there.
    """
    other, unknowns, _ = begun_anew(shooting, point)
    # Across the branch: in a fold the equations are singular at a fixed value of the parameter.
    across = tangent(other.evaluate(unknowns, point.values))
    there = correct(other, np.concatenate([unknowns, point.values]), across).point
    return other, there, oriented(tangent(there), along)


def oriented(onward: Floats, along: Floats, parameters: int = 1) -> Floats:
    """Return a tangent in the direction of the one before the cycle was begun anew.

    How period and parameters change does not depend on where it begins.
    """
    same = float(onward[-1 - parameters :] @ along[-1 - parameters :]) >= 0.0
    return onward if same else -onward


def renumbered(monitor: Monitor, segments: int, first: int) -> Monitor:
    """Return the test function of a cycle of so many segments, begun in its piece `first`."""
    if not 0 <= monitor.segment < segments - 1:
        return monitor
    return replace(monitor, segment=(monitor.segment - first) % (segments - 1))
