"""Check a monodromy matrix against differences of the simulated map."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.errors import OrbitError
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.orbits.monodromy import reduced_components
from mems_impact.orbits.periodic_orbit import PeriodicOrbit

LARGEST = 1e-2  # step of the differences with which the extrapolation begins
HALVINGS = 24
TOLERANCE = 1e-13  # of the runs, unless the problem asks for a tighter one


@dataclass(frozen=True)
class Audit:
    """A monodromy matrix and the one that simulation gives.

    Attributes
    ----------
    computed, simulated : float array, shape (f, f)
        From variational equations and saltation matrices; from extrapolated central differences
        of runs over the orbit.
    uncertainty : float array, shape (f,)
        Of the columns of `simulated`, as the extrapolation estimates it.
    entry : tuple of int
        Row and column of the worst entry; -1 where the matrices are empty.
    worst : float
        Its difference, relative to the largest entry of `simulated` (or 1).
    """

    computed: Floats
    simulated: Floats
    uncertainty: Floats
    entry: tuple[int, int]
    worst: float


def audit(orbit: PeriodicOrbit) -> Audit:
    """Compare the monodromy matrix of `orbit` with differences of the simulated map.

    The differences are central ones at steps that are halved again and again, extrapolated, and
    taken where two extrapolations agree best; of a cycle with its trivial multiplier. Near a
    grazing, where the map bends like a square root, the steps must be far below the square of the
    impact speed, and near 1e-3 of that speed the integration error drowns them.

    Raises
    ------
    OrbitError
        If the orbit is not admissible: no run follows it.
    """
    if not orbit.admissible:
        raise OrbitError("the orbit is not admissible", "audit one that simulation follows", orbit)
    problem = orbit.problem
    rtol, atol = min(problem.options.rtol, TOLERANCE), min(problem.options.atol, TOLERANCE)
    problem = replace(problem, options=replace(problem.options, rtol=rtol, atol=atol))
    kept = reduced_components(orbit.shooting, orbit.point)
    components = [orbit.shooting.free[c] for c in kept]
    columns = [_column(problem, orbit, c, components) for c in kept]
    computed = orbit.shooting.monodromy(orbit.point)[np.ix_(kept, kept)]
    if not columns:  # nothing is free at the start: the orbit forgets everything
        return Audit(computed, computed, np.zeros(0), (-1, -1), 0.0)
    simulated = np.stack([column for column, _ in columns], axis=1)
    difference = np.abs(computed - simulated)
    row, column = np.unravel_index(np.argmax(difference), difference.shape)
    scale = max(1.0, float(np.abs(simulated).max()))
    return Audit(
        computed=computed,
        simulated=simulated,
        uncertainty=np.array([error for _, error in columns]),
        entry=(int(row), int(column)),
        worst=float(difference[row, column]) / scale,
    )


def _column(
    problem: Problem, orbit: PeriodicOrbit, c: int, components: list[int]
) -> tuple[Floats, float]:
    """Return a column of the differences by Ridders' method, and its estimated error.

    All starts fulfil the constraints of the first mode, and have the sums that the orbit pins.
    """
    start, shooting, automaton = orbit.instant, orbit.shooting, problem.automaton
    p = np.asarray(problem.parameters, dtype=float)

    def end(shift: float) -> Floats:
        y = start.y.copy()
        y[shooting.free[c]] += shift
        for pinned, factors in shooting.pinned.items():
            y[shooting.free[pinned]] -= factors[c] * shift
        if start.mode in automaton.constrained:
            automaton.transition(start.mode, automaton.projection_code, start.time, y, p)
        return np.asarray(run(problem, replace(start, y=y), orbit.periods).final.y[components])

    h, error = LARGEST, np.inf
    best = np.full(len(components), np.nan)
    previous: list[Floats] = []
    for _ in range(HALVINGS):
        row = [(end(h) - end(-h)) / (2.0 * h)]
        for j, coarser in enumerate(previous):
            power = 4.0 ** (j + 1)
            row.append((power * row[j] - coarser) / (power - 1.0))
            doubt = max(np.abs(row[j + 1] - row[j]).max(), np.abs(row[j + 1] - coarser).max())
            if doubt < error:
                error, best = float(doubt), row[j + 1]
        previous = row
        h /= 2.0
    return best, error


def check_closed(orbit: PeriodicOrbit) -> float:
    """Return the closure error of a run along the orbit."""
    problem = orbit.problem
    final = run(problem, orbit.instant, orbit.periods).final
    if final.mode != orbit.instant.mode:
        raise OrbitError("the run along the orbit ends in another mode", "see orbit.defects", orbit)
    free = orbit.shooting.free
    return float(np.abs(final.y[free] - orbit.instant.y[free]).max())
