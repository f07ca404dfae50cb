"""Branch switching at period doublings, branch points and Hopf points."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.continuation.arclength import correct
from mems_impact.continuation.branch import EquilibriumEvent, OrbitEvent
from mems_impact.continuation.branching_equation import CrossingBranch
from mems_impact.continuation.equilibrium_branch import frequency
from mems_impact.continuation.test_functions import BRANCH_POINT, MULTIPLIER_TOLERANCE
from mems_impact.errors import OrbitError, RunError
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational.derivatives import free_components
from mems_impact.orbits.division import MAX_GROWTH, NODE_GROWTH, growth, with_nodes
from mems_impact.orbits.equilibrium import (
    EquilibriumEquations,
    EquilibriumState,
    make_equilibrium,
)
from mems_impact.orbits.family import Family
from mems_impact.orbits.periodic_orbit import PeriodicOrbit, make_orbit
from mems_impact.orbits.shooting import Phase, Shooting
from mems_impact.orbits.signature import BOUNDARY, OrbitGuess, Segment

# Distances of the first orbit from a period doubling, in the space of unknowns, or from a Hopf
# point, relative to the state if above 1.
SWITCH_DISTANCES = (1e-3, 3e-3, 1e-2, 3e-2)
MIN_PARAMETER_CHANGE = 1e-7  # relative change of the parameter of a significant distance


def switched_solutions(
    event: OrbitEvent | EquilibriumEvent, parameter: str, low: float, high: float
) -> tuple[
    list[tuple[Any, float | Floats]],
    OrbitEvent | EquilibriumEvent | None,
]:
    """Return solutions of the branch that emanates from a special point, each with the way to it.

    Of the branch through a branch point there is a solution on each side, or on one if the other
    has none, each with the sign of the change of the parameter away from the branch point, and with
    the branch point as a point of that branch. Of other branches there is one solution with a
    direction of continuation. Raises OrbitError if no other branch is found.
    """
    solution = event.solution
    if event.kind != BRANCH_POINT:
        hopf = isinstance(solution, EquilibriumState)
        switch: Any = switch_at_hopf if hopf else switch_at_period_doubling
        return [switch(solution, parameter)], None
    value = np.array([solution.family.values[parameter]])
    equations, make, unknowns = _equations(solution, parameter)
    point = equations.evaluate(unknowns, value)
    crossing = CrossingBranch(equations, point, event.direction)
    found: list[tuple[Any, float | Floats]] = []
    found += [(make(equations, each.point), each.side) for each in crossing.first_points(low, high)]
    return found, replace(event, direction=crossing.other)


def _equations(
    solution: PeriodicOrbit | EquilibriumState, parameter: str
) -> tuple[Any, Callable[..., Any], Floats]:
    """Return equations of a solution, the function from unknowns to solutions, the unknowns."""
    if isinstance(solution, PeriodicOrbit):
        return solution.equations((parameter,)), make_orbit, solution.point.unknowns
    equations = EquilibriumEquations(solution.family, solution.mode, (parameter,))
    return equations, make_equilibrium, solution.balance.unknowns


# --- Period doublings


def double_cover(orbit: PeriodicOrbit) -> OrbitGuess:
    """Return an orbit traversed twice.

    A limit cycle has one start: its second pass continues the last segment of the first.
    """
    segments, point, nodes = orbit.segments, orbit.point, orbit.shooting.nodes
    states, _ = orbit.shooting.unpack_pieces(point.unknowns)
    if orbit.shooting.phase is None:
        later = tuple(replace(s, cycle=s.cycle + orbit.periods) for s in segments)
        twice, ends = np.tile(states, (2, 1)), np.tile(point.ends, 2)
        return OrbitGuess(segments + later, twice, ends, nodes=nodes + nodes)
    times = np.concatenate([point.ends[:-1], point.period + point.ends])
    if any(nodes):
        # The start of the second pass is a node of the segment that continues across it.
        starts = np.append(0.0, times[:-1])
        passed = [(piece.start, piece.state) for piece in orbit.shooting.pieces(point)]
        passed += [(point.period + time, state) for time, state in passed]
        instants = [
            [each for each in passed if a < each[0] < b] for a, b in zip(starts, times, strict=True)
        ]
        firsts = [next(y for t, y in passed if t >= a) for a in starts]
        nodes, states = with_nodes(np.array(firsts), starts, times, instants)
        return OrbitGuess(segments[:-1] + segments, states, times, nodes=nodes)
    return OrbitGuess(segments[:-1] + segments, np.vstack([states, states[1:]]), times)


def switch_at_period_doubling(orbit: PeriodicOrbit, parameter: str) -> tuple[PeriodicOrbit, Floats]:
    """Return the first orbit of twice the period on the bifurcating branch, and the way to it.

    The way, shape (unknowns + 1,), from the period doubling to this orbit is the `direction` of
    continuation. Raises OrbitError if the orbit has no multiplier -1.
    """
    guess = double_cover(orbit)
    shooting = orbit.equations((parameter,), guess.segments, nodes=guess.nodes)
    unknowns = shooting.pack(guess)
    value = np.array([orbit.family.values[parameter]])
    point = shooting.evaluate(unknowns, value)
    vectors = np.linalg.svd(point.jacobian)[2]
    if np.abs(orbit.multipliers + 1.0).min() > MULTIPLIER_TOLERANCE:
        raise OrbitError("the orbit has no multiplier -1", "locate a period doubling first", orbit)
    # The null vector of the doubled equations has opposite signs in the two passes.
    away = np.append(vectors[-1], 0.0)
    return first_orbit_on_branch(shooting, np.append(unknowns, value), away, SWITCH_DISTANCES)


def first_orbit_on_branch(
    shooting: Shooting, start: Floats, away: Floats, distances: Sequence[float]
) -> tuple[PeriodicOrbit, Floats]:
    """Return an orbit of the branch that leaves a point, and the way to it.

    All orbits may have the parameter of the point, as for piecewise linear maps. The equations are
    those of that branch, with one active parameter; `start`, the point, and `away`, the direction
    of the branch, have the shape (unknowns + 1,). The orbit is corrected at `distances` up to the
    first with a significant change of the parameter. Raises OrbitError if the correction fails at
    the first distance.
    """
    value = float(start[-1])
    switched, onward = None, away
    for distance in distances:
        try:
            first = correct(shooting, start + distance * away, away).point
        except OrbitError:
            if switched is None:
                raise
            break
        farther = make_orbit(shooting, first)
        if switched is not None and switched.admissible and not farther.admissible:
            break
        switched, onward = farther, np.append(first.unknowns, first.values) - start
        if abs(onward[-1]) > MIN_PARAMETER_CHANGE * abs(value):
            break
    assert switched is not None
    return switched, onward


# --- Hopf points


def switch_at_hopf(equilibrium: EquilibriumState, parameter: str) -> tuple[PeriodicOrbit, Floats]:
    """Return the first limit cycle on the branch from a Hopf point, and the way to it.

    The way, shape (unknowns + 1,), from the point to this orbit is the `direction` of continuation.
    Raises OrbitError if no pair of eigenvalues lies on the imaginary axis.
    """
    rate = frequency(equilibrium)
    if rate is None:
        raise OrbitError("no pair of eigenvalues is on the imaginary axis", "locate a Hopf point")
    balance, value = equilibrium.balance, equilibrium.family.values[parameter]
    values, vectors = np.linalg.eig(balance.jacobian)
    direction, across, turned = _plane(vectors[:, np.argmin(np.abs(values - 1j * rate))])
    center = balance.unknowns
    period = 2.0 * math.pi / rate
    phase = Phase(tuple(across.tolist()), float(across @ center), period)
    segments = (Segment(equilibrium.mode, 0, BOUNDARY),)
    size = max(1.0, float(np.abs(center).max()))
    family = _family_with_method(
        equilibrium, center + size * SWITCH_DISTANCES[-1] * direction, period
    )
    count = _piece_count(balance.jacobian, period)
    shares = np.arange(count) / count
    nodes = (tuple(shares[1:].tolist()),)
    shooting = Shooting(family, segments, (parameter,), phase=phase, nodes=nodes)
    # To first order in the amplitude only the state changes, and turns in a plane; period and
    # parameter are those of the linearization.
    middle = np.array([*np.tile(center, count), period / phase.unit, value])
    angles = 2.0 * math.pi * shares[:, None]
    along = np.where(angles > 0.0, np.cos(angles) * direction + np.sin(angles) * turned, direction)
    away = np.array([*along.ravel(), 0.0, 0.0])
    distances = [size * distance for distance in SWITCH_DISTANCES]
    return first_orbit_on_branch(shooting, middle, away, distances)


def _family_with_method(equilibrium: EquilibriumState, beside: Floats, period: float) -> Family:
    """Return the family with the method that suits a run of one period near the equilibrium."""
    family, y = equilibrium.family, np.array(equilibrium.state)
    problem = family.problem().with_time_unit(period)
    y[list(free_components(problem.automaton))] = beside
    try:
        return family.suited(run(problem, HybridState(0, 0.0, equilibrium.mode, y), 1.0).stiff)
    except RunError:
        return family.suited(False)


def _piece_count(jacobian: Floats, period: float) -> int:
    """Return the number of equal pieces of a small cycle in which perturbations grow little."""
    from scipy.linalg import expm  # imported on first use, which a run need not wait for

    count = 1
    while growth(expm(jacobian * (period / count))) > (NODE_GROWTH if count > 1 else MAX_GROWTH):
        count *= 2
    return count


def _plane(vector: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return orthogonal unit vectors along the major axis of a rotation and in its direction.

    The third vector is the image of the first after a quarter of a turn.
    """
    # Rotate the eigenvector so that its real and imaginary parts are orthogonal.
    turn = 0.5 * np.angle(np.sum(vector * vector))
    vector = vector * np.exp(-1j * turn)
    real, onward = vector.real, -vector.imag
    length = np.linalg.norm(real)
    return real / length, onward / np.linalg.norm(onward), onward / length
