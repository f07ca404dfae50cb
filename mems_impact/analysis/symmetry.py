"""Symmetries of a system, and symmetric partners of orbits and equilibria."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, overload

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.analysis.equilibrium import Equilibrium, equilibrium_of
from mems_impact.analysis.orbit import Orbit, find_orbit
from mems_impact.continuation.arclength import (
    CONTINUATION_ERRORS,
    SAME_ORBIT_DISTANCE,
    orbit_distance,
)
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.state import HybridState
from mems_impact.orbits.equilibrium import find_equilibrium
from mems_impact.orbits.newton import Linearized
from mems_impact.orbits.periodic_orbit import PeriodicOrbit
from mems_impact.orbits.symmetry import SignSymmetry, equilibrium_symmetries, orbit_symmetries

MIN_DISTANCE = 3e-4  # of a solution from a branch point, for a significant asymmetry
IMAGE_RTOL = 1e-6  # largest difference between a computed partner and the image of the start


@dataclass(frozen=True, kw_only=True)
class Symmetry:
    """A symmetry of a system: a change of signs of states, with half a forcing period.

    Attributes
    ----------
    signs : dict of str to int
        1 or -1 by state.
    half_period : bool
        Whether the symmetry shifts time by half a forcing period.

    See Also
    --------
    symmetries, switch_branch

    Examples
    --------
    >>> import math
    >>> import mems_impact as mi
    >>> def well(mode, t, y, p):
    ...     return y.v, y.x - y.x**3 - 0.3 * y.v + p.A * math.cos(t)
    >>> system = mi.System(
    ...     states=("x", "v"), flow=well, period=2.0 * math.pi, parameters={"A": 0.1}
    ... )
    >>> right = mi.find_orbit(system, guess={"x": 1.0}, transient=50)
    >>> (symmetry,) = mi.symmetries(right)
    >>> symmetry
    Symmetry((x, v, t) -> (-x, -v, t + T/2))
    >>> left = symmetry.image(right)
    >>> bool(left.state.x < 0.0 < right.state.x), symmetry.keeps(right)
    (True, False)
    """

    signs: dict[str, int]
    half_period: bool
    numeric: SignSymmetry = field(repr=False, compare=False)

    def __repr__(self) -> str:
        names = [*self.signs, *(["t"] if self.half_period else [])]
        images = [f"-{name}" if sign < 0 else name for name, sign in self.signs.items()]
        images += ["t + T/2"] if self.half_period else []
        return f"Symmetry(({', '.join(names)}) -> ({', '.join(images)}))"

    @overload
    def image(self, solution: Orbit) -> Orbit: ...

    @overload
    def image(self, solution: Equilibrium) -> Equilibrium: ...

    def image(self, solution: Orbit | Equilibrium) -> Orbit | Equilibrium:
        """Return the symmetric partner of an orbit or equilibrium; a symmetric solution itself.

        Parameters
        ----------
        solution : Orbit or Equilibrium

        Raises
        ------
        InvalidParameter
            If the symmetry does not map `solution` to a solution.
        """
        if self.keeps(solution):
            return solution
        image = self._image(solution)
        if image is None:
            raise InvalidParameter("solution", solution, f"mapped to a solution by {self}")
        return image

    def keeps(self, solution: Orbit | Equilibrium) -> bool:
        """Return whether an orbit or equilibrium is symmetric: its own image."""
        if isinstance(solution, Equilibrium):
            y = solution.numeric.state
            return _near(self.numeric.state(y), y, y)
        orbit = solution.numeric
        mode, y = self._start(orbit, after=True)
        distance = orbit_distance(orbit.shooting, orbit.point, mode, y)
        return distance < SAME_ORBIT_DISTANCE * _size(y)

    def _start(self, orbit: PeriodicOrbit, *, after: bool) -> tuple[int, Floats]:
        """Return the image of the orbit at the start of a forcing period: mode and state.

        If the forcing switches there, the state belongs `after` the switch, or before.
        """
        if not self.half_period:
            start = orbit.instant
            mode, y = (orbit.segments[0].mode, orbit.state) if after else (start.mode, start.y)
        else:
            point, shooting, time = orbit.point, orbit.shooting, 0.5 * orbit.point.period
            ends = point.ends.tolist()
            i = next(i for i, end in enumerate(ends) if (end > time if after else end >= time))
            mode, y = orbit.segments[i].mode, shooting.arc_to(point, i, time).end
        return self.numeric.modes.get(mode, mode), self.numeric.state(y)

    def _image(self, solution: Orbit | Equilibrium) -> Orbit | Equilibrium | None:
        """Return the image of a solution that is not symmetric; None if there is none."""
        if isinstance(solution, Equilibrium):
            mode = self.numeric.modes.get(solution.numeric.mode, solution.numeric.mode)
            image_state = self.numeric.state(solution.numeric.state)
            state = find_equilibrium(solution.numeric.family, mode, image_state)
            near = _near(state.state, image_state, image_state)
            return equilibrium_of(solution.system, state) if near else None
        system = solution.system
        mode, y = self._start(solution.numeric, after=False)
        guess = system.state_space.state(
            HybridState(0, 0.0, mode, system.state_space.snap(mode, y))
        )
        forced = system.forced
        length: Any = {"periods": solution.periods} if forced else {"period": solution.period}
        try:
            image = find_orbit(system, guess=guess, options=solution.options, **length)
        except CONTINUATION_ERRORS:
            return None
        one, other = (np.sort(np.abs(each.multipliers)) for each in (solution, image))
        same = one.size == other.size and _near(one, other, one)
        begin = self._start(solution.numeric, after=True)
        distance = orbit_distance(image.numeric.shooting, image.numeric.point, *begin)
        return image if same and distance < SAME_ORBIT_DISTANCE * _size(y) else None


def _near(one: Floats, other: Floats, size: Floats) -> bool:
    return float(np.abs(one - other).max(initial=0.0)) < IMAGE_RTOL * _size(size)


def _size(y: Floats) -> float:
    return max(1.0, float(np.abs(y).max(initial=0.0)))


def symmetries(solution: Orbit | Equilibrium) -> tuple[Symmetry, ...]:
    """Find the symmetries of a system that change signs of states.

    Flow and margins are compared with their images at points near a solution. A symmetry maps each
    orbit to an orbit with the same period and multipliers: to itself, or to a partner, such as the
    other half of a pitchfork.

    Parameters
    ----------
    solution : Orbit or Equilibrium

    Returns
    -------
    tuple of Symmetry
        The symmetry with the most changed signs first; empty for a system with more than 12 states.

    See Also
    --------
    Symmetry, switch_branch

    Examples
    --------
    >>> import mems_impact as mi
    >>> def lorenz(mode, t, y, p):
    ...     return 10.0 * (y.y - y.x), y.x * (28.0 - y.z) - y.y, y.x * y.y - 8.0 / 3.0 * y.z
    >>> system = mi.System(states=("x", "y", "z"), flow=lorenz)
    >>> (steady,) = mi.find_equilibria(system, guess={"x": 8.0, "y": 8.0, "z": 27.0})
    >>> mi.symmetries(steady)
    (Symmetry((x, y, z) -> (-x, -y, z)),)
    """
    if isinstance(solution, Orbit):
        result = orbit_symmetries(solution.numeric, solution.system.forced)
    elif isinstance(solution, Equilibrium):
        result = equilibrium_symmetries(solution.numeric)
    else:
        raise InvalidParameter("solution", solution, "an Orbit or an Equilibrium")
    states = solution.system.states
    return tuple(
        Symmetry(
            signs=dict(zip(states, each.signs, strict=True)),
            half_period=each.half_period,
            numeric=each,
        )
        for each in result
    )


def symmetry_of_halves(
    specials: Sequence[Orbit | Equilibrium], solutions: Sequence[Orbit | Equilibrium]
) -> Symmetry | None:
    """Return the symmetry that maps the halves of a branch to each other; else None.

    `specials` are the solutions at the branch points of the branch, `solutions` all of the branch.
    """
    evaluations = [_evaluation(each) for each in solutions]
    for special in specials:
        neighbour = solutions[nearest_beside(_evaluation(special), evaluations)]
        for each in symmetries(special):
            if each.keeps(special) and not each.keeps(neighbour):
                return each
    return None


def _evaluation(solution: Orbit | Equilibrium) -> Linearized:
    """Return the evaluation of the equations at a solution."""
    return solution.numeric.point if isinstance(solution, Orbit) else solution.numeric.balance


def nearest_beside(point: Linearized, points: Sequence[Linearized]) -> int:
    """Return the number of the point nearest to a branch point, but significantly beside it."""
    distances = [
        float(np.abs(each.unknowns - point.unknowns).max(initial=0.0))
        if each.unknowns.size == point.unknowns.size
        else math.inf
        for each in points
    ]
    away = [each if each > MIN_DISTANCE else math.inf for each in distances]
    return int(np.argmin(away))
