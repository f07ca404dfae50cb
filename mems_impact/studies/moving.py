"""Moving an orbit to other parameters, as far as it is the same orbit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mems_impact.analysis.orbit import Orbit, orbit_of
from mems_impact.continuation.branch import OrbitBranch, points_of
from mems_impact.errors import OrbitError
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.problem import Numbers, Problem
from mems_impact.orbits.family import Family
from mems_impact.orbits.newton import solve
from mems_impact.orbits.orbit import PeriodicOrbit, make_orbit
from mems_impact.orbits.shooting import Shooting

__all__ = ["BIFURCATIONS", "moved"]

BIFURCATIONS = ("G", "CF", "PD", "NS", "BP", "?")
"""Labels of special points at which an orbit becomes another one, or loses its stability."""
PART = "part"
FARTHEST = 0.3  # part of the size of an orbit by which its states may move in one stride
REMEDY = "take a shorter way"


@dataclass(frozen=True)
class _Line:
    """The problems on a straight line in the space of parameters, from 0 to 1."""

    family: Family
    target: Mapping[str, float]

    def __call__(self, values: Mapping[str, float]) -> Problem:
        return self._at(values).problem()

    def numbers(self, values: Mapping[str, float]) -> Numbers:
        return self._at(values).numbers()

    @cached_property
    def automaton(self) -> Automaton:
        return self.family.automaton

    def _at(self, values: Mapping[str, float]) -> Family:
        part, start = values[PART], self.family.values
        way = {name: start[name] + part * (end - start[name]) for name, end in self.target.items()}
        return self.family.at(**way)


def moved(orbit: Orbit, values: Mapping[str, float]) -> Orbit:
    """Return an orbit at other values of parameters: in one stride, or followed on a straight way.

    On the way events may pass from one forcing period to the next, or past each other. It ends
    where an impact is grazed, or at a fold, or where the orbit loses its stability.

    Parameters
    ----------
    orbit : Orbit
    values : mapping of str to float
        In the units of the system.

    Raises
    ------
    OrbitError
        If the way ends before: at what, its `reason` says.
    """
    system, found = orbit.system, orbit.found
    target = {name: system.into(name, value) for name, value in values.items()}
    try:
        there = _solved(found, target, found)
        if there.admissible and _is_near(found, there):
            return orbit_of(system, there)
    except OrbitError:
        pass
    return orbit_of(system, _solved(_followed(orbit, target), target, found))


def _solved(
    near: PeriodicOrbit, target: Mapping[str, float], found: PeriodicOrbit
) -> PeriodicOrbit:
    """Return the orbit of the signature of `near`, in the family of `found`."""
    shooting = Shooting(
        found.family.at(**target), near.segments, (), near.shooting.pinned, near.shooting.phase
    )
    return make_orbit(shooting, solve(shooting, near.point.unknowns, np.zeros(0)))


def _is_near(one: PeriodicOrbit, other: PeriodicOrbit) -> bool:
    """Return whether the states of an orbit have moved by a small part of their size."""
    here, there = (each.shooting.unpack(each.point.unknowns)[0] for each in (one, other))
    return bool(np.abs(there - here).max() < FARTHEST * np.abs(here).max())


def _followed(orbit: Orbit, target: Mapping[str, float]) -> PeriodicOrbit:
    """Return the orbit at the end of a straight way, still in the family of that way."""
    found = orbit.found
    line = Family(_Line(found.family, dict(target)), {PART: 0.0})
    shooting = Shooting(line, found.segments, (), found.shooting.pinned, found.shooting.phase)
    branch = OrbitBranch(PART)
    begin = replace(found, family=line, shooting=shooting)
    for point in points_of(branch, begin, low=0.0, high=1.0):
        passed = [each for each in branch.special_points if each.label in BIFURCATIONS]
        if passed:
            raise OrbitError(f"{passed[0].kind} on the way", REMEDY)
        if point.value == 1.0:
            return point.orbit
    raise OrbitError(branch.ended, REMEDY)
