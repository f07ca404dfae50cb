"""Beginning a cycle elsewhere on the way along a branch."""

from __future__ import annotations

from mems_impact.continuation.corrector import tangent
from mems_impact.hybrid.trajectory import Floats
from mems_impact.orbits.cycles import begun_anew
from mems_impact.orbits.newton import solve
from mems_impact.orbits.shooting import Point, Shooting


def anew(shooting: Shooting, point: Point, along: Floats) -> tuple[Shooting, Point, Floats]:
    """Return a cycle begun clear of its events, with the direction of its branch.

    Raises
    ------
    OrbitError
        If it cannot be corrected there.
    """
    other, unknowns = begun_anew(shooting, point)
    there = solve(other, unknowns, point.values)
    onward = tangent(there)
    # How the period and the parameter change does not depend on where the cycle begins.
    same = float(onward[-2:] @ along[-2:]) >= 0.0
    return other, there, onward if same else -onward
