"""Symmetries of a problem that change signs of states, with half a forcing period.

A symmetry maps solutions to solutions. The search is for symmetries ``(y, t) -> (S y, t + tau)``,
where S is diagonal with entries 1 and -1, and tau is zero or half the forcing period. Modes and
guards may change places, as at two opposite stops.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.problem import Problem
from mems_impact.orbits.equilibrium import EquilibriumState
from mems_impact.orbits.periodic_orbit import PeriodicOrbit

MAX_STATES = 12  # of a system whose sign changes are searched
PERTURBATION = 0.1  # of the points of comparison, in sizes of the states
UNKNOWN_SIZE_RATIO = 1e-6  # size of a state, relative to the largest, below which it is unknown
POINTS = 5  # of comparison per segment
RTOL, ATOL = 1e-9, 1e-12  # of flow, margins and states, compared with their images
NO_MARGIN = 1e300  # stands for a margin that does not apply


class Instant(NamedTuple):
    """A point of comparison: mode, time and state."""

    mode: int
    time: float
    y: Floats


@dataclass(frozen=True)
class SignSymmetry:
    """A symmetry of a problem."""

    signs: tuple[int, ...]  # diagonal of S, one entry per state
    half_period: bool  # whether time is shifted by half a forcing period
    modes: dict[int, int] = field(compare=False)  # images of the modes that the solution passes

    def state(self, y: Floats) -> Floats:
        """Return the image of a state."""
        return np.array(self.signs) * y


def orbit_symmetries(orbit: PeriodicOrbit, forced: bool) -> tuple[SignSymmetry, ...]:
    """Return the symmetries of the problem near an orbit, that with most signs changed first."""
    shooting, point = orbit.shooting, orbit.point
    states, _ = shooting.unpack(point.unknowns)
    random = np.random.default_rng(0)
    width = PERTURBATION * _sizes(np.array([*states, *(arc.end for arc in point.arcs)]))
    points = []
    for i, segment in enumerate(shooting.segments):
        for share in np.linspace(0.1, 0.9, POINTS).tolist():
            time = (1.0 - share) * point.starts[i] + share * point.ends[i]
            y = (1.0 - share) * states[i] + share * point.arcs[i].end
            y = y + width * random.standard_normal(y.size)
            points.append(Instant(segment.mode, float(time), y))
    return _symmetries(orbit.problem, points, forced)


def equilibrium_symmetries(equilibrium: EquilibriumState) -> tuple[SignSymmetry, ...]:
    """Return the symmetries of the problem near an equilibrium."""
    random, y = np.random.default_rng(0), equilibrium.state
    sizes = _sizes(y[None])
    points = [
        Instant(equilibrium.mode, 0.0, y + PERTURBATION * sizes * random.standard_normal(y.size))
        for _ in range(3 * POINTS)
    ]
    return _symmetries(equilibrium.family.problem(), points, False)


def _sizes(states: Floats) -> Floats:
    sizes = np.abs(states).max(axis=0)
    largest = float(sizes.max(initial=0.0))
    # A state that is zero may have any size.
    if largest < UNKNOWN_SIZE_RATIO:
        return np.ones_like(sizes)
    return np.where(sizes > UNKNOWN_SIZE_RATIO * largest, sizes, largest)


def _symmetries(
    problem: Problem, points: Sequence[Instant], forced: bool
) -> tuple[SignSymmetry, ...]:
    count = len(problem.automaton.states)
    if count > MAX_STATES:
        return ()
    patterns = sorted(itertools.product((1, -1), repeat=count), key=sum)
    symmetries = []
    for signs in patterns[:-1]:  # the last changes none
        for half in (False, True) if forced else (False,):
            if half and not _switches_repeat(problem):
                continue
            modes = _images(problem, points, np.array(signs), half)
            if modes is not None:
                symmetries.append(SignSymmetry(signs, half, modes))
    return tuple(symmetries)


def _switches_repeat(problem: Problem) -> bool:
    """Return whether the switching times repeat after half a period."""
    times = np.array(problem.switches) % problem.period
    shifted = np.sort((times + 0.5 * problem.period) % problem.period)
    return bool(np.allclose(np.sort(times), shifted, rtol=RTOL, atol=ATOL * problem.period))


def _images(
    problem: Problem, points: Sequence[Instant], signs: Floats, half: bool
) -> dict[int, int] | None:
    """Return the images of the modes under a map of states; None if the map is no symmetry."""
    images: dict[int, int] = {}
    for mode in dict.fromkeys(point.mode for point in points):
        in_mode = [point for point in points if point.mode == mode]
        matching = (
            other
            for other in _likely(problem.automaton, mode)
            if other not in images.values()
            and all(_equal(problem, point, other, signs, half) for point in in_mode)
        )
        image = next(matching, None)
        if image is None:
            return None
        images[mode] = image
    return images


def _likely(automaton: Automaton, mode: int) -> Iterator[int]:
    """Yield the modes to which a mode may be mapped, itself first."""
    yield mode
    yield from (other for other in range(len(automaton.modes)) if other != mode)


def _equal(problem: Problem, point: Instant, mode: int, signs: Floats, half: bool) -> bool:
    """Return whether flow and margins at a point and at its image agree."""
    time = point.time
    if half:
        time = (time + 0.5 * problem.period) % problem.period
    image = Instant(mode, time, signs * point.y)
    try:
        (flow, margins), (other, others) = (_functions(problem, each) for each in (point, image))
    except (ArithmeticError, ValueError):
        return False
    return _close(signs * flow, other) and _close(np.sort(margins), np.sort(others))


def _functions(problem: Problem, at: Instant) -> tuple[Floats, Floats]:
    automaton, p, y = problem.automaton, np.asarray(problem.parameters, dtype=float), at.y
    if at.mode in automaton.constrained:
        _, y = automaton.state_after(at.mode, automaton.projection_code, at.time, y, p)
    margins, _ = automaton.margins_at(at.mode, at.time, y, p, NO_MARGIN)
    return automaton.slope_at(at.mode, at.time, y, p), margins


def _close(one: Floats, other: Floats) -> bool:
    size = float(np.abs(one[one < NO_MARGIN]).max(initial=0.0))
    return bool(np.allclose(one, other, rtol=RTOL, atol=(ATOL + RTOL) * size))
