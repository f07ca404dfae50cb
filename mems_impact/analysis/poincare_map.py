"""Poincaré map of a system around a fixed point, by integration through all events."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mems_impact._util.arrays import Complexes, Floats
from mems_impact.analysis.equilibrium import Equilibrium
from mems_impact.analysis.orbit import Orbit
from mems_impact.errors import InvalidParameter, OrbitError, RunError
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational.derivatives import free_components
from mems_impact.orbits.equilibrium import differentiate
from mems_impact.orbits.monodromy import reduced_components, reduced_monodromy
from mems_impact.systems.base import HybridSystem

UPWARDS = 1  # direction in which a motion crosses the section at its returns
SEARCH_RATIO = 1.3  # length of a run in search of a return, relative to the time between returns
MAX_SEARCHES = 40  # such runs, after which a motion counts as not returning
START_RATIO = 1e-9  # time after which a crossing is not the start, relative to that time
OUTSIDE_MARGIN = -1e-12  # margin of an impact below which a state is outside
EQUILIBRIUM_GROWTH = 1.5  # logarithm of the growth over the time step of an equilibrium's map
MULTIPLIER_RTOL = 1e-4  # difference of multipliers by which a map is not differentiable


@dataclass(frozen=True)
class PoincareMap:
    """The map from one return of a motion to a later one.

    Returns are the starts of forcing periods, upward crossings of the section, or the ends of equal
    time steps.
    """

    system: HybridSystem
    problem: Problem
    count: int  # of returns that make one application of the map
    step: float  # time between returns, in periods of the problem; approximate on a section
    on_section: bool

    def times(self, count: int) -> PoincareMap:
        """Return the map applied `count` times."""
        return replace(self, count=count * self.count)

    def image(self, start: HybridState) -> HybridState:
        """Return the image of a state.

        Raises RunError if the run fails, OrbitError if the motion does not return to the section.
        """
        if not self.on_section:
            final = run(self.problem, start, self.count * self.step).final
            return replace(final, cycle=0, time=start.time, remembered=(), switched=False)
        at, missing = start, self.count
        for _ in range(MAX_SEARCHES):
            result = run(self.problem, at, (missing + 0.5) * SEARCH_RATIO * self.step)
            log = result.events.crossings(UPWARDS)
            when = log.cycle + log.time / self.problem.period
            since = when - (at.cycle + at.time / self.problem.period)
            log = log[since > (START_RATIO * self.step if at is start else 0.0)]
            if len(log) >= missing:
                mode, y = int(log.mode_after[missing - 1]), log.after[missing - 1].copy()
                return HybridState(0, 0.0, mode, y)
            missing -= len(log)
            at = result.final
        raise OrbitError(
            "the motion from a state near the manifold does not return to the section",
            "take a section that motions cross again",
        )


class FixedPoint(NamedTuple):
    """A fixed point of a Poincaré map, with the coordinates and the derivative of the map there."""

    map: PoincareMap
    instant: HybridState
    components: tuple[int, ...]  # of the state that vary on the section: the coordinates of the map
    embedding: Floats  # derivatives of the state by the coordinates, shape (n, k)
    matrix: Floats  # derivative of the map, shape (k, k)

    @property
    def multipliers(self) -> Complexes:
        """Eigenvalues of the derivative, largest first."""
        values = np.linalg.eigvals(self.matrix).astype(complex)
        return np.asarray(values[np.argsort(-np.abs(values))])

    @property
    def position(self) -> Floats:
        """The coordinates of the fixed point."""
        return np.asarray(self.instant.y[list(self.components)])

    def state(self, x: Floats) -> HybridState:
        """Return the state with coordinates `x`, in the mode that it has."""
        y = self.instant.y + self.embedding @ (x - self.position)
        y[list(self.components)] = x
        system, problem, mode = self.map.system, self.map.problem, self.instant.mode
        if len(problem.automaton.modes) > 1 and not system.state_space.fits(mode, y, problem):
            mode = system.state_space.mode_of(y, self.instant.time, problem, mode)
        return replace(self.instant, mode=mode, y=y)

    def margins(self, at: HybridState) -> tuple[Floats, Floats]:
        """Return the margins of all guards at a state, and their rates."""
        problem = self.map.problem
        p = np.asarray(problem.parameters, dtype=float)
        return problem.automaton.margins_at(at.mode, at.time, at.y, p)

    def is_outside(self, at: HybridState) -> bool:
        """Return whether a state lies beyond the guard of an impact."""
        guards = self.map.problem.automaton.guards
        pairs = zip(guards, self.margins(at)[0], strict=True)
        return any(guard.impact and margin < OUTSIDE_MARGIN for guard, margin in pairs)

    def coordinates(self, at: HybridState) -> Floats:
        """Return the coordinates of a state."""
        return np.asarray(at.y[list(self.components)])


def fixed_points(solution: Orbit | Equilibrium) -> list[FixedPoint]:
    """Return the points of an orbit, or an equilibrium, as fixed points of a Poincaré map.

    An orbit of n periods has n points. Autonomous systems need a section: raises InvalidParameter
    without one that the orbit crosses. Raises OrbitError if the orbit is inadmissible, or the map
    is not differentiable there.
    """
    if isinstance(solution, Equilibrium):
        return [_of_equilibrium(solution)]
    if solution.numeric.touches:
        raise OrbitError(
            "the orbit touches a guard at zero rate, where its Poincaré map has no derivative",
            "take the orbit at another value of a parameter",
        )
    if not solution.admissible:
        raise OrbitError(
            f"the orbit is inadmissible: {solution.defects[0]}", "take an admissible orbit"
        )
    if solution.system.forced:
        return _of_forced_orbit(solution)
    return _of_cycle(solution)


def _of_equilibrium(equilibrium: Equilibrium) -> FixedPoint:
    system = equilibrium.system
    problem = system.problem(equilibrium.numeric.family.problem().options)
    eigenvalues = equilibrium.numeric.eigenvalues
    if equilibrium.nullity or not eigenvalues.size:
        raise OrbitError(
            "the equilibrium is one of a continuum, and no saddle", "take an isolated equilibrium"
        )
    step = EQUILIBRIUM_GROWTH / float(np.abs(eigenvalues.real).max() or 1.0) / problem.period
    flow = PoincareMap(system, problem, 1, step, on_section=False)
    start = HybridState(0, 0.0, equilibrium.numeric.mode, np.array(equilibrium.numeric.state))
    keep = free_components(problem.automaton)
    return _differentiated(flow, start, keep, np.exp(eigenvalues * step * problem.period))


def _of_forced_orbit(orbit: Orbit) -> list[FixedPoint]:
    system, solution = orbit.system, orbit.numeric
    problem = system.problem(solution.problem.options)
    keep = reduced_components(solution.shooting, solution.point)
    if not keep:
        raise OrbitError(
            "no component of the state is free at the start of the orbit",
            "shift the phase of the forcing",
        )
    free = solution.shooting.free
    components = tuple(free[c] for c in keep)
    embedding = np.zeros((len(system.states), len(keep)))
    embedding[list(components)] = np.eye(len(keep))
    for c, factors in solution.shooting.pinned.items():
        embedding[free[c]] = -np.array(factors)[keep]
    returns = PoincareMap(system, problem, orbit.periods, 1.0, on_section=False)
    first = FixedPoint(
        returns,
        orbit.returns[0],
        components,
        embedding,
        reduced_monodromy(solution.shooting, solution.point),
    )
    others = (
        _differentiated(returns, at, components, orbit.numeric.multipliers, embedding)
        for at in orbit.returns[1:]
    )
    return [first, *others]


def _of_cycle(orbit: Orbit) -> list[FixedPoint]:
    system = orbit.system
    if system.section is None:
        refusal = "the system has no Poincaré section: give section= of the System"
        raise InvalidParameter("orbit", None, "", problem=refusal)
    problem = system.problem(orbit.options)
    starts = orbit.returns
    if not starts:
        name = system.states[system.section[0]]
        refusal = f"it does not cross the section in {name}"
        raise InvalidParameter("orbit", None, "", problem=refusal)
    step = float(orbit.numeric.point.period) / problem.period / len(starts)
    returns = PoincareMap(system, problem, len(starts), step, on_section=True)
    free = free_components(problem.automaton)
    keep = tuple(i for i in free if i != system.section[0])
    for start in starts:
        if start.mode in problem.automaton.constrained:
            raise OrbitError(
                f"the section lies in the mode {system.modes[start.mode]!r}, whose constraints "
                "leave fewer components free",
                "take a section in another mode",
            )
    return [_differentiated(returns, at, keep, orbit.numeric.multipliers) for at in starts]


def _differentiated(
    returns: PoincareMap,
    at: HybridState,
    components: tuple[int, ...],
    multipliers: Complexes,
    embedding: Floats | None = None,
) -> FixedPoint:
    """Return a fixed point with the derivative of its map by differences.

    Raises OrbitError if the map has no value nearby, or its derivative not the given eigenvalues.
    """
    k = len(components)
    if embedding is None:
        embedding = np.zeros((at.y.size, k))
        embedding[list(components)] = np.eye(k)
    point = FixedPoint(returns, at, components, embedding, np.eye(k))

    def image(x: Floats) -> Floats:
        return point.coordinates(returns.image(point.state(x)))

    try:
        matrix = differentiate(image, point.position)
    except (RunError, OrbitError) as error:
        raise _undifferentiable() from error
    differentiated = point._replace(matrix=matrix)
    largest = abs(complex(multipliers[0]))
    values = [
        np.sort_complex(each[: min(k, multipliers.size)])
        for each in (differentiated.multipliers, multipliers)
    ]
    if np.abs(values[0] - values[1]).max() > MULTIPLIER_RTOL * max(1.0, largest):
        raise _undifferentiable()
    return differentiated


def _undifferentiable() -> OrbitError:
    return OrbitError(
        "the Poincaré map could not be differentiated at the orbit",
        "take a point farther from a grazing, or another section",
    )
