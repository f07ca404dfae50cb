"""Branches that cross at a branch point: tangents and first points.

At a branch point x the derivatives G of the equations F by unknowns and parameter have a kernel of
dimension two, with a basis v_1, v_2, and a left null vector w. Tangents ``a_1 v_1 + a_2 v_2`` of
branches solve the algebraic branching equation ``w D2F(a v, a v) = 0`` (Govaerts 2000, Numerical
Methods for Bifurcations, chapter 6). Where it degenerates, the branches are found on a small circle
in the kernel: the zeros of the reduced equation of Lyapunov and Schmidt, solved numerically.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Generic, NamedTuple

import numpy as np
from scipy.optimize import brentq

from mems_impact._util.arrays import Floats
from mems_impact.continuation.arclength import (
    MAX_CORRECTOR_ITERATIONS,
    SHORTER_STEP_REMEDY,
    PredictorStep,
    correct,
    tangent,
)
from mems_impact.continuation.branch_points import UNFOLDING_RATIO, second_derivatives
from mems_impact.errors import OrbitError
from mems_impact.orbits.newton import Linearized, P, Solution, Solvable, newton
from mems_impact.orbits.shooting import RESIDUAL_TOLERANCE

DEGENERATE_RATIO = 1e-6  # largest ratio of a mixed coefficient to its terms that counts as zero
PARALLEL_SINE = 1e-12  # largest sine of the angle between vectors that count as parallel
FIRST_DISTANCES = (1e-3, 3e-3, 1e-2, 3e-2)  # of the first point from the branch point
SHORT_DISTANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)  # where no point is found at the others
MIN_PARAMETER_CHANGE = 1e-7  # relative change of the parameter of a significant distance
CONTINUUM_CHANGE = 1e-11  # largest change of the parameter along a continuum at one value
MIN_ANGLE = 0.1  # between the first point and the known branch, seen from the branch point
CIRCLE_POINTS = 36  # at which the sign of the reduced equation is determined
ANGLE_XTOL = 1e-6
CONTINUUM = "at the branch point the solutions at one value of the parameter form a continuum"
NO_OTHER_BRANCH = "no other branch was found at the branch point"


def branch_direction(step: PredictorStep[P], point: P) -> Floats:
    """Return the direction in which a branch passes a branch point within a step, in the kernel."""
    passed = _whole(point) - step.start
    size = float(np.linalg.norm(passed))
    direction = passed / size if size > RESIDUAL_TOLERANCE else step.direction
    kernel = np.linalg.svd(_derivatives(point))[2][-2:]
    projected = kernel.T @ (kernel @ direction)
    size = float(np.linalg.norm(projected))
    return np.asarray(projected / size) if size > 0.0 else direction


class FirstPoint(NamedTuple, Generic[P]):
    """A point of the other branch next to a branch point.

    Attributes
    ----------
    point : ShootingEvaluation or EquilibriumEvaluation
    side : float
        1 if the parameter increases along that branch away from the branch point, else -1.
    distance : float
        From the branch point, in the space of unknowns and parameter.
    """

    point: P
    side: float
    distance: float


class CrossingBranch(Generic[P]):
    """A branch point with the tangents of the two branches that cross there.

    Parameters
    ----------
    equations : Shooting or EquilibriumEquations
        With one active parameter.
    point : ShootingEvaluation or EquilibriumEvaluation
        The branch point.
    direction : float array
        Approximate direction of the known branch.

    Attributes
    ----------
    own, other : float array
        Unit tangents of the known branch and of the other branch. Where the branching equation is
        degenerate, `other` is normal to `own`.
    degenerate : bool
    """

    def __init__(self, equations: Solvable[P], point: P, direction: Floats) -> None:
        self._equations, self._start = equations, _whole(point)
        self._error = float(np.abs(point.residual).max(initial=0.0))
        left, _, rows = np.linalg.svd(_derivatives(point))
        self._left, self._kernel = left[:, -1], rows[-2:]
        first = self._unit(self._kernel @ direction)
        seconds = [second_derivatives(equations, point, v) for v in self._kernel]
        roots = self._roots(np.array([self._left @ each for each in seconds]), first)
        self.degenerate = len(roots) < 2
        if not self.degenerate:
            first, other = sorted(roots, key=lambda a: abs(a[0] * first[1] - a[1] * first[0]))
        else:
            other = np.array([-first[1], first[0]])
        self.own, self.other = first @ self._kernel, _oriented(other @ self._kernel)

    def first_point(self) -> FirstPoint[P]:
        """Return a point of the other branch.

        Its distance is the least of `FIRST_DISTANCES` at which the parameter changes significantly.

        Raises
        ------
        OrbitError
            If no branch but the known one is found.
        """
        first: FirstPoint[P] | None = None
        significant = MIN_PARAMETER_CHANGE * abs(self._start[-1])
        # An error of the equations separates the branches within this radius.
        radius = UNFOLDING_RATIO * self._error ** (1.0 / 3.0)
        distances = [each for each in FIRST_DISTANCES if each > radius]
        # Far along a strongly curved branch a point is nearer to the known one.
        shorter = [each for each in SHORT_DISTANCES if each > radius]
        for distance in [*(distances or FIRST_DISTANCES[-1:]), *shorter]:
            if first is not None and distance < first.distance:
                break
            try:
                point = self._at(distance)
            except OrbitError:
                if first is not None:
                    break
                continue
            away = _whole(point) - self._start
            first = FirstPoint(point, self._side(point, away), float(np.linalg.norm(away)))
            change = abs(float(away[-1]))
            if change > max(significant, CONTINUUM_CHANGE):
                return first
        if first is None:
            remedy = "locate it again with shorter steps, or start from a perturbed state"
            raise OrbitError(NO_OTHER_BRANCH, remedy)
        if change < CONTINUUM_CHANGE:
            raise OrbitError(CONTINUUM, "add a nonlinear term, or break the symmetry")
        return first

    def _side(self, point: P, away: Floats) -> float:
        return math.copysign(1.0, float(tangent(point, away)[-1]))

    def _at(self, distance: float) -> P:
        """Return a point of the other branch at a distance."""
        try:
            guess = self._start + distance * self.other
            point = correct(self._equations, guess, self.other).point
            if self._is_other(point):
                return point
        except OrbitError:
            pass
        for angle in self._zeros(distance) if distance >= FIRST_DISTANCES[0] else ():
            point = self._on_circle(distance, angle).point
            guess = _whole(point)
            away = guess - self._start
            point = correct(self._equations, guess, away / np.linalg.norm(away)).point
            if self._is_other(point):
                return point
        raise OrbitError(NO_OTHER_BRANCH, SHORTER_STEP_REMEDY)

    def _is_other(self, point: P) -> bool:
        """Return whether a point near the branch point lies on another branch than the known one.

        The projection of the point to the kernel has a larger component along the tangent of the
        other branch; where the equation is degenerate, it is at an angle to the known branch.
        """
        away = self._kernel @ (_whole(point) - self._start)
        tangents = self._kernel @ np.array([self.own, self.other]).T
        along, across = np.abs(np.linalg.solve(tangents, away))
        return bool(across > (math.tan(MIN_ANGLE) * along if self.degenerate else along))

    def _zeros(self, radius: float) -> Iterator[float]:
        """Yield the angles to the known branch at which others leave the circle."""

        def reduced(angle: float) -> float:
            return float(self._on_circle(radius, angle).unknowns[-1])

        # The known branch is bent: its zero is near the angles 0 and pi.
        angles = MIN_ANGLE + 2.0 * math.pi * np.arange(CIRCLE_POINTS + 1) / CIRCLE_POINTS
        values: list[float] = []
        for angle in angles.tolist():
            try:
                values.append(reduced(angle))
            except OrbitError:
                values.append(math.nan)
        for (a, b), (first, last) in zip(pairwise(angles), pairwise(values), strict=True):
            if first * last < 0.0:
                angle = float(brentq(reduced, a, b, xtol=ANGLE_XTOL))
                if abs(math.sin(angle)) > math.sin(MIN_ANGLE):
                    yield angle

    def _on_circle(self, radius: float, angle: float) -> Solution[P]:
        """Solve the equations but for a multiple of the left null vector, the last unknown.

        The projection to the kernel lies on the circle, at the angle to the known branch.
        """
        x = self._kernel @ self.own
        across = np.array([-x[1], x[0]])
        position = radius * (math.cos(angle) * x + math.sin(angle) * across)

        def extended(u: Floats) -> tuple[P, Floats, Floats]:
            point = self._equations.evaluate(u[:-2], u[-2:-1])
            size = self._left.size
            matrix = np.zeros((size + 2, size + 2))
            matrix[:size, :-1], matrix[:size, -1] = _derivatives(point), self._left
            matrix[size:, :-1] = self._kernel
            residual = point.residual + u[-1] * self._left
            rest = self._kernel @ (u[:-1] - self._start) - position
            return point, np.concatenate([residual, rest]), matrix

        return newton(
            extended,
            np.append(self._start + position @ self._kernel, 0.0),
            reason="the reduced equation could not be solved near the branch point",
            remedy=SHORTER_STEP_REMEDY,
            iterations=MAX_CORRECTOR_ITERATIONS,
        )

    def _roots(self, seconds: Floats, first: Floats) -> list[Floats]:
        """Return the unit vectors a that solve the branching equation; empty if degenerate.

        In the basis of the kernel vector s without a change of the parameter and the direction d of
        the known branch, the equation is ``A x^2 + 2 B x y + C y^2 = 0``. In other units of states
        and parameter A, B, C have other factors, and the roots remain.

        Parameters
        ----------
        seconds : float array, shape (2, unknowns + 1)
            Second derivatives along the vectors of the kernel, multiplied by w.
        first : float array, shape (2,)
            The direction of the known branch.
        """
        quadratic = seconds @ self._kernel.T
        s = self._unit(np.array([-self._kernel[1, -1], self._kernel[0, -1]]))
        across = np.array([-s[1], s[0]])
        d = first if abs(float(first @ across)) > PARALLEL_SINE else across
        basis = np.array([s, d])
        (a, b), (_, c) = 0.5 * basis @ (quadratic + quadratic.T) @ basis.T
        terms = float(np.abs(s @ seconds) @ np.abs(d @ self._kernel))
        if not (np.abs(quadratic).max() > DEGENERATE_RATIO and abs(b) > DEGENERATE_RATIO * terms):
            return []
        discriminant = b * b - a * c
        if not discriminant > 0.0:
            return []
        q = -(b + math.copysign(math.sqrt(discriminant), b))
        x, y = self._unit(q * s + a * d), self._unit(c * s + q * d)
        return [x, y] if abs(x[0] * y[1] - x[1] * y[0]) > PARALLEL_SINE else []

    def _unit(self, vector: Floats) -> Floats:
        size = float(np.linalg.norm(vector))
        return vector / size if size > 0.0 else np.array([1.0, 0.0])


def _oriented(direction: Floats) -> Floats:
    """Orient a tangent: the parameter increases, or else the largest component is positive."""
    leading = direction[-1] if abs(direction[-1]) > DEGENERATE_RATIO else 0.0
    if leading == 0.0:
        leading = direction[np.argmax(np.abs(direction))]
    return direction if leading > 0.0 else -direction


def _whole(point: Linearized) -> Floats:
    return np.concatenate([point.unknowns, point.values])


def _derivatives(point: Linearized) -> Floats:
    return np.hstack([point.jacobian, point.by_parameter])
