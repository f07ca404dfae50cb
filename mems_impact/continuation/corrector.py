"""Pseudo-arclength steps: tangent, prediction, correction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic

import numpy as np
from scipy.optimize import brentq

from mems_impact.errors import OrbitError
from mems_impact.hybrid.trajectory import Floats
from mems_impact.orbits.newton import Linearised, P, Solution, Solvable, newton
from mems_impact.orbits.shooting import ACCEPTED, NOTHING

ITERATIONS = 8
STRAIGHT = 0.9  # cosine of the angle by which a branch may turn in one step
EASY, HARD = 2, 5  # Newton steps below which a step may grow, above which it shrinks
NODES = 3  # corrections from which another one is guessed
APART = 0.01  # least distance between them, as a part of the longest


@dataclass(frozen=True, kw_only=True)
class Steps:
    """Control of the step length, in the space of unknowns and parameter.

    Attributes
    ----------
    initial, smallest, largest : float
    most : int
        Points that a branch may have.

    See Also
    --------
    continue_orbit, continue_curve

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked(actuator))
    >>> branch = mi.continue_orbit(orbit, "amplitude", stop=0.2, steps=mi.Steps(most=3))
    >>> branch.ended.split(";")[0]
    'the budget of 3 points is used up'
    """

    initial: float = 1e-3
    smallest: float = 1e-7
    largest: float = 0.05
    most: int = 2000

    def within(
        self, low: float, high: float, point: Linearised, along: Floats, length: float
    ) -> float:
        """Return a length, shorter if it went far beyond a bound, where the model may end."""
        ahead = point.values[0] + length * along[-1]
        bound = high if along[-1] > 0.0 else low
        if low <= ahead <= high:
            return length
        return max(1.001 * (bound - point.values[0]) / along[-1], self.smallest)


def tangent(point: Linearised, along: Floats | None = None) -> Floats:
    """Return the unit tangent of the branch at `point`, shape (unknowns + 1,).

    Parameters
    ----------
    point : Point or Balance
        With one active parameter.
    along : float array, optional
        The direction in which to look; without it, the parameter grows.
    """
    # The vector to which all rows are orthogonal: the last right singular vector.
    direction = np.linalg.svd(np.hstack([point.jacobian, point.by_parameter]))[2][-1]
    forward = direction[-1] if along is None else direction @ along
    return np.asarray(direction if forward >= 0.0 else -direction)


def correct(
    equations: Solvable[P], plane: Floats, direction: Floats, guess: Floats | None = None
) -> Solution[P]:
    """Return the solution in the plane through `plane` (unknowns and parameter) across `direction`.

    Parameters
    ----------
    equations : Shooting or Balancing
        With one active parameter.
    plane, direction : float array, shape (unknowns + 1,)
    guess : float array, optional
        A point near the solution; `plane` itself by default.

    Raises
    ------
    OrbitError
        If the correction does not converge.
    """

    def extended(u: Floats) -> tuple[P, Floats, Floats]:
        point = equations.evaluate(u[:-1], u[-1:])
        matrix = np.vstack([np.hstack([point.jacobian, point.by_parameter]), direction])
        return point, np.append(point.residual, direction @ (u - plane)), matrix

    return newton(
        extended,
        plane if guess is None else guess,
        reason="the correction of a step did not converge",
        remedy="take a shorter step",
        iterations=ITERATIONS,
    )


class Step(Generic[P]):
    """The points of a branch or curve across one direction, each corrected once.

    Parameters
    ----------
    correct : callable
        ``correct(plane, along, guess)`` returns the `Solution` in the plane through `plane` across
        `along`.
    point : Point or Balance
        Where the step begins.
    along : float array
        The unit tangent there.
    behind : sequence of float array, optional
        Unknowns and parameters of the points before it.
    """

    def __init__(
        self,
        correct: Callable[[Floats, Floats, Floats], Solution[P]],
        point: P,
        along: Floats,
        behind: Sequence[Floats] = (),
    ) -> None:
        self.start, self.along = np.concatenate([point.unknowns, point.values]), along
        self._correct = correct
        self._found = {0.0: Solution(self.start, point, 0)}
        # How far the branch lies from the tangent over s^2, by s.
        self._bends: dict[float, Floats] = {}
        for earlier in behind:
            s = float((earlier - self.start) @ along)
            if s < 0.0:
                self._learn(s, earlier)

    def at(self, s: float) -> Solution[P]:
        """Return the point at the distance `s` along the tangent.

        Raises
        ------
        OrbitError
            If the correction does not converge, or leads to what lies farther away than the step
            is long: another branch, or another part of this one.
        """
        if s not in self._found:
            plane = self.start + s * self.along
            found = self._correct(plane, self.along, self.expected(s))
            if np.linalg.norm(found.unknowns - plane) > abs(s) + ACCEPTED:
                raise OrbitError("the correction of a step led elsewhere", "take a shorter step")
            self._found[s] = found
            self._learn(s, found.unknowns)
        return self._found[s]

    def expected(self, s: float) -> Floats:
        """Return where the point at the distance `s` lies, by what is known of others."""
        return np.asarray(self.start + s * self.along + s * s * self._bend_at(s))

    def zero(self, test: Callable[[P], float], length: float, begin: float = 0.0) -> float:
        """Return at which distance, from `begin` to `length`, a function of the points is zero.

        Raises
        ------
        OrbitError
            If a point within the step cannot be corrected.
        ValueError
            If the function has one sign at both ends.
        """

        def value(s: float) -> float:
            return test(self.at(s).point)

        return float(brentq(value, begin, length, xtol=1e-14, rtol=1e-14))

    def _learn(self, s: float, unknowns: Floats) -> None:
        """Take over how far the branch lies from the tangent."""
        aside = unknowns - self.start - s * self.along
        # Rounding is no curvature. In a component that the orbit can't determine, which no
        # correction puts right, it would grow from step to step.
        aside[np.abs(aside) < NOTHING] = 0.0
        self._bends[s] = aside / (s * s)

    def _bend_at(self, s: float) -> Floats:
        """Return the polynomial through what is known nearby."""
        bend = np.zeros_like(self.along)
        if not self._bends:
            return bend
        least = APART * max(map(abs, self._bends))
        nodes: list[float] = []
        for node in sorted(self._bends, key=lambda node: abs(node - s)):
            if all(abs(node - other) >= least for other in nodes) and len(nodes) < NODES:
                nodes.append(node)
        for node in nodes:
            weight = 1.0
            for other in nodes:
                if other != node:
                    weight *= (s - other) / (node - other)
            bend += weight * self._bends[node]
        return bend
