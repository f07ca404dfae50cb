"""Identity of orbits and equilibria: whether one equals another, or lies on a known branch."""

from __future__ import annotations

import math
from functools import partial
from itertools import pairwise

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.continuation.arclength import (
    CONTINUATION_ERRORS,
    ClosureDetector,
    PredictorStep,
    correct,
)
from mems_impact.continuation.branch import EquilibriumBranch, OrbitBranch, OrbitEvent, OrbitPoint
from mems_impact.continuation.equilibrium_branch import SAME_EQUILIBRIUM_DISTANCE
from mems_impact.continuation.test_functions import FOLD
from mems_impact.orbits.equilibrium import EquilibriumState, find_equilibrium
from mems_impact.orbits.newton import solve
from mems_impact.orbits.periodic_orbit import PeriodicOrbit
from mems_impact.orbits.shooting import Shooting, ShootingEvaluation

SAME_SPECIAL_DISTANCE = 1e-3  # largest distance of the orbits of one special point
NEAR_CHORD_RATIO = 2.0  # distance of an orbit from a step of a branch, in lengths of the step
MIN_STEP_LENGTH = 1e-3  # least length of a step in this comparison
COVER_RTOL = 1e-7  # largest relative difference of the passes of a multiple cover
COVERED_POINTS = 3  # successive covers after which a branch has become one
PERIOD_RTOL = 0.05  # largest relative difference of periods in this comparison


def _at(orbit: PeriodicOrbit, parameter: str) -> tuple[Shooting, ShootingEvaluation]:
    """Return the equations of an orbit with one active parameter, and their solution."""
    shooting = orbit.equations((parameter,))
    value = np.array([orbit.family.value(parameter)])
    return shooting, shooting.evaluate(orbit.point.unknowns, value)


def same_orbit(one: PeriodicOrbit, other: PeriodicOrbit, parameter: str) -> bool:
    """Return whether the orbits of two special points are equal, or one covers the other twice."""
    detector = ClosureDetector(*_at(one, parameter), np.ones(1))
    return detector.lies_on(*_at(other, parameter), SAME_SPECIAL_DISTANCE)


def orbit_on_branch(branch: OrbitBranch, orbit: PeriodicOrbit) -> bool:
    """Return whether an orbit lies on a branch in its parameter.

    The orbit of the branch at the same value is located on each step that contains the value.
    """
    own, point = _at(orbit, branch.parameter)
    detector = ClosureDetector(own, point, np.ones(1))
    value = float(point.values[0])
    for begin, end in pairwise(_with_folds(branch, value)):
        if (begin.value - value) * (end.value - value) > 0.0:
            continue
        if not _is_near(own, point, begin, end):
            continue
        try:
            shooting, here = _between(begin, end, value)
        except CONTINUATION_ERRORS:
            continue
        if detector.lies_on(shooting, here):
            return True
    return False


def _with_folds(branch: OrbitBranch, value: float) -> list[OrbitPoint]:
    """Return the points of a branch and its folds near a value.

    A step across a fold contains orbits at values that are not between the values of its ends.
    """
    points = list(branch.points)
    longest = max((abs(b.value - a.value) for a, b in pairwise(points)), default=0.0)
    folds = [
        (_position(branch, each), each)
        for each in branch.special_points
        if each.kind == FOLD and abs(each.value - value) <= longest
    ]
    for position, each in sorted(folds, key=lambda item: -item[0]):
        i = math.floor(position)
        if position > i:
            added = OrbitPoint(each.solution, each.value, each.direction, points[i].piece)
            points.insert(i + 1, added)
    return points


def _is_near(own: Shooting, point: ShootingEvaluation, begin: OrbitPoint, end: OrbitPoint) -> bool:
    """Return whether an orbit may lie on a step of a branch."""
    one, other = begin.solution, end.solution
    if (own.phase is None) != (one.shooting.phase is None):
        return False
    if own.phase is not None:
        first, last, period = one.point.period, other.point.period, point.period
        ratio = period / (0.5 * (first + last))
        allowed = max(PERIOD_RTOL * period, NEAR_CHORD_RATIO * abs(last - first))
        return abs(ratio - max(1.0, round(ratio))) * period < allowed
    length = MIN_STEP_LENGTH + _distance(one, other)
    state = own.unpack(point.unknowns)[0][0]
    free = list(own.free)
    return any(
        float(np.abs(each - state)[free].max(initial=0.0)) < NEAR_CHORD_RATIO * length
        for orbit in (one, other)
        for each in _starts(orbit)
    )


def _starts(orbit: PeriodicOrbit) -> list[Floats]:
    """Return the states of an orbit at the starts of its forcing periods."""
    states, segments = orbit.shooting.unpack(orbit.point.unknowns)[0], orbit.segments
    return [
        states[i]
        for i, segment in enumerate(segments)
        if i == 0 or segments[i - 1].cycle != segment.cycle
    ]


def _distance(one: PeriodicOrbit, other: PeriodicOrbit) -> float:
    """Return the largest distance of the starts of the periods of successive orbits."""
    pairs = zip(_starts(one), _starts(other), strict=False)
    return max(float(np.abs(a - b).max(initial=0.0)) for a, b in pairs)


def _between(
    begin: OrbitPoint, end: OrbitPoint, value: float
) -> tuple[Shooting, ShootingEvaluation]:
    """Return the orbit of a branch at a value of the parameter between two of its orbits."""
    one, other = begin.solution, end.solution
    shooting = one.shooting
    first = np.append(one.point.unknowns, begin.value)
    last = np.append(other.point.unknowns, end.value)
    same = (shooting.phase, shooting.nodes) == (other.shooting.phase, other.shooting.nodes)
    if one.segments != other.segments or not same:
        near = begin if abs(begin.value - value) < abs(end.value - value) else end
        shooting = near.solution.shooting
        return shooting, solve(shooting, near.solution.point.unknowns, np.array([value]))
    length = float(np.linalg.norm(last - first))
    if length == 0.0:
        return shooting, one.point
    step = PredictorStep(partial(correct, shooting), one.point, (last - first) / length)
    position = step.zero(lambda here: float(here.values[-1]) - value, length)
    return shooting, step.at(position).point


def equilibrium_on_branch(branch: EquilibriumBranch, state: EquilibriumState) -> bool:
    """Return whether an equilibrium lies on a branch in its parameter."""
    parameter = branch.parameter
    value = state.family.value(parameter)
    for begin, end in pairwise(branch.solutions):
        first, last = (each.family.value(parameter) for each in (begin, end))
        if begin.mode != state.mode or (first - value) * (last - value) > 0.0:
            continue
        part = (value - first) / (last - first) if last != first else 0.0
        guess = begin.state + part * (end.state - begin.state)
        size = MIN_STEP_LENGTH + float(np.abs(end.state - begin.state).max(initial=0.0))
        if float(np.abs(guess - state.state).max(initial=0.0)) > NEAR_CHORD_RATIO * size:
            continue
        try:
            here = find_equilibrium(state.family, state.mode, guess)
        except CONTINUATION_ERRORS:
            continue
        if float(np.abs(here.state - state.state).max(initial=0.0)) < SAME_EQUILIBRIUM_DISTANCE:
            return True
    return False


# --- Multiple covers


def up_to_cover(branch: OrbitBranch) -> OrbitBranch:
    """Return a branch up to the point where its orbits become those of a smaller period.

    A grazing may lead to an orbit of a part of the period, which is covered several times.
    """
    covers = [covered_period(orbit) for orbit in branch.solutions]
    first = next((i for i, cover in enumerate(covers) if not cover), len(covers))
    cut = next(
        (
            i
            for i in range(first, len(covers) - COVERED_POINTS + 1)
            if all(covers[i : i + COVERED_POINTS])
        ),
        None,
    )
    if cut is None:
        return branch
    kept = [s for s in branch.special_points if _position(branch, s) <= cut]
    points = branch.points[: cut + 1]
    period = covers[cut]
    ended = f"the orbits of period {period}, which it meets in a {_last_kind(kept)}"
    return OrbitBranch(branch.parameter, points, kept, ended)


def _last_kind(events: list[OrbitEvent]) -> str:
    return events[-1].kind if events else "special point"


def covered_period(orbit: PeriodicOrbit) -> int:
    """Return the smaller period of an orbit that covers another orbit several times, else 0."""
    periods = orbit.periods
    if periods == 1 or orbit.shooting.phase is not None:
        return 0
    starts = np.array(_starts(orbit))[:, list(orbit.shooting.free)]
    allowed = COVER_RTOL * (1.0 + np.abs(starts).max(initial=0.0))
    for part in range(1, periods):
        if periods % part == 0 and len(starts) == periods:
            moved = np.abs(np.roll(starts, part, axis=0) - starts).max(initial=0.0)
            if moved < allowed:
                return part
    return 0


def _position(branch: OrbitBranch, special: OrbitEvent) -> float:
    """Return the position of a special point among the points of its branch, by number."""
    own = np.append(special.solution.point.unknowns, special.value)
    best = (math.inf, 0.0)
    for i, (begin, end) in enumerate(pairwise(branch.points)):
        if special.solution is begin.solution:
            return float(i)
        first, last = (np.append(p.solution.point.unknowns, p.value) for p in (begin, end))
        if not first.size == last.size == own.size:
            continue
        chord = last - first
        part = float(np.clip(chord @ (own - first) / max(chord @ chord, 1e-300), 0.0, 1.0))
        best = min(best, (float(np.linalg.norm(own - first - part * chord)), i + part))
    return best[1]
