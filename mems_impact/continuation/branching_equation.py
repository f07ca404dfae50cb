"""Branches that cross at a branch point: tangents and first points.

At a branch point x the derivatives G of the equations F by unknowns and parameter have a kernel of
dimension two, with a basis v_1, v_2, and a left null vector w. Tangents ``a_1 v_1 + a_2 v_2`` of
branches solve the algebraic branching equation ``w D2F(a v, a v) = 0`` (Govaerts 2000, Numerical
Methods for Bifurcations, chapter 6). Where it degenerates, the branches are found on a small circle
in the kernel: the zeros of the reduced equation of Lyapunov and Schmidt, solved numerically.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import partial
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
from mems_impact.continuation.branch_points import (
    UNFOLDING_RATIO,
    extended_equations,
    second_derivatives,
)
from mems_impact.errors import OrbitError
from mems_impact.orbits.newton import Linearized, P, Solution, Solvable, newton
from mems_impact.orbits.shooting import RESIDUAL_TOLERANCE

DEGENERATE_RATIO = 1e-6  # largest ratio of a mixed coefficient to its terms that counts as zero
MAX_CHANGE = 0.1  # largest relative change of second derivatives by an error of a branch point
PARALLEL_SINE = 1e-12  # largest sine of the angle between vectors that count as parallel
# Distances of a first point from the branch point, and shorter ones for a strongly curved branch
FIRST_DISTANCES = (1e-3, 3e-3, 1e-2, 3e-2)
SHORT_DISTANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
MIN_PARAMETER_CHANGE = 1e-7  # relative change of the parameter of a significant distance
CONTINUUM_RTOL = 1e-13  # error of the parameter, relative to its value and to the distance
TANGENT_SEPARATION = 0.5  # least distance from the known branch, relative to that of the tangent
CIRCLE_SEPARATION = 1e-5  # least distance from the known branch, relative to that of both
MIN_TURN_COSINE = 0.7  # least cosine of the angle by which a branch turns up to its first point
MAX_ERROR_RATIO = 0.01  # largest error of a first point, relative to its distance
NEGLIGIBLE_RATIO = 1e-6  # of components along and across the known branch, which is straight there
CIRCLE_POINTS = 36  # at which the sign of the reduced equation is determined
ANGLE_XTOL = 1e-6
CONTINUUM = (
    "at the branch point the solutions at one value of the parameter form a continuum, within the "
    "errors of the integration"
)
NO_OTHER_BRANCH = "no other branch was found at the branch point"
ONE_SIDE = "no solution was found on the other side of the branch point"


def branch_direction(step: PredictorStep[P], point: P) -> Floats:
    """Return the direction in which a branch passes a branch point within a step, in the kernel."""
    passed = _whole(point) - step.start
    size = float(np.linalg.norm(passed))
    direction = passed / size if size > RESIDUAL_TOLERANCE else step.direction
    kernel = np.linalg.svd(point.derivatives)[2][-2:]
    projected = kernel.T @ (kernel @ direction)
    size = float(np.linalg.norm(projected))
    return np.asarray(projected / size) if size > 0.0 else direction


class FirstPoint(NamedTuple, Generic[P]):
    """A point of the other branch next to a branch point."""

    point: P
    # 1 if the parameter increases along that branch away from the branch point, else -1.
    side: float


class CrossingBranch(Generic[P]):
    """A branch point with the unit tangents of the two branches that cross there: `own`, `other`.

    `direction` is the approximate one of the known branch, `own`. Where the branching equation is
    `degenerate`, `other` is normal to `own`. The equations have one active parameter.
    """

    def __init__(self, equations: Solvable[P], point: P, direction: Floats) -> None:
        self._equations, self._start = equations, _whole(point)
        left, _, rows = np.linalg.svd(point.derivatives)
        self._left, self._kernel = left[:, -1], rows[-2:]
        first = self._unit(self._kernel @ direction)
        seconds, rate = self._seconds(point), 1.0
        roots = self._roots(seconds, first) if self._is_certain(seconds) else []
        self.degenerate = len(roots) < 2
        if not self.degenerate:
            first, other = sorted(roots, key=lambda a: abs(a[0] * first[1] - a[1] * first[0]))
            rate = abs(float(first @ seconds @ self._kernel.T @ other))
        else:
            other = np.array([-first[1], first[0]])
        self.own, self.other = first @ self._kernel, _oriented(other @ self._kernel)
        self._across = np.array([-first[1], first[0]]) @ self._kernel
        # An error of the equations separates the branches within this radius.
        error = float(np.abs(point.residual).max(initial=0.0)) / rate
        self._radius = UNFOLDING_RATIO * error ** (1.0 / 3.0)

    def first_points(self, low: float, high: float) -> list[FirstPoint[P]]:
        """Return a point of the other branch on each side, or on one if the other has none.

        Their distance is the least of `FIRST_DISTANCES` at which the parameter changes
        significantly, or a shorter one from which on the branch is straight. Raises OrbitError if
        no branch but the known one is found.
        """
        found: list[FirstPoint[P]] = []
        for sign in (1.0, -1.0):
            first = self._first_point(sign, low, high, found)
            found += [] if first is None else [first]
        if not found:
            remedy = "locate it again with shorter steps, or start from a perturbed state"
            raise OrbitError(NO_OTHER_BRANCH, remedy)
        return found

    def _first_point(
        self, sign: float, low: float, high: float, found: list[FirstPoint[P]]
    ) -> FirstPoint[P] | None:
        """Return a point on the side of a sign, away from the points that are known."""
        first: FirstPoint[P] | None = None
        other = sign * self.other
        if self.degenerate and found:
            other = self._start - _whole(found[0].point)
            other = other / np.linalg.norm(other)
        far = [each for each in FIRST_DISTANCES if each > self._radius] or [FIRST_DISTANCES[-1]]
        tried = [(each, self._ahead) for each in (*far, *SHORT_DISTANCES)]
        tried += [(each, self._around) for each in far]
        for distance, directions in tried:
            if first is not None and (distance < far[0] or directions != self._ahead):
                break
            points = self._solved(distance, directions(distance, other))
            point = next(
                (
                    each
                    for each in points
                    if low <= each.values[-1] <= high and not self._is_beside(each, found)
                ),
                None,
            )
            if point is None:
                if first is not None:
                    break
                continue
            away = _whole(point) - self._start
            first = FirstPoint(point, math.copysign(1.0, float(tangent(point, away)[-1])))
            change, value = abs(float(away[-1])), abs(float(self._start[-1]))
            error = abs(float(self._error(point, away)[-1]))
            noise = CONTINUUM_RTOL * (value + distance) + error
            if change > max(MIN_PARAMETER_CHANGE * value, noise):
                break
        if first is not None and change < noise:
            raise OrbitError(CONTINUUM, "add a nonlinear term, or break the symmetry")
        return first

    def _error(self, point: P, direction: Floats) -> Floats:
        """Return the error of a point in the kernel, solved in a plane normal to a direction."""
        x = self._kernel @ direction
        free = np.array([-x[1], x[0]]) @ self._kernel / max(float(np.linalg.norm(x)), PARALLEL_SINE)
        errors = point.residual, self._equations.integration_error(point)
        error = sum(abs(float(self._left @ each)) for each in errors)
        slope = abs(float(self._left @ point.derivatives @ free))
        return np.zeros(free.size) if error == 0.0 else free * np.divide(error, slope)

    def _is_beside(self, point: P, found: list[FirstPoint[P]]) -> bool:
        """Return whether a point lies in the direction of a known point."""
        away = [_whole(each) - self._start for each in (point, *(each.point for each in found))]
        one, *others = (each / np.linalg.norm(each) for each in away)
        return any(one @ other > MIN_TURN_COSINE for other in others)

    def _solved(self, distance: float, directions: Iterable[tuple[Floats, float]]) -> Iterator[P]:
        """Yield points of other branches in directions, to which the branch turns little.

        With each direction comes the least distance there from the known branch.
        """
        for direction, least in directions:
            try:
                guess = self._start + distance * direction
                point = correct(self._equations, guess, direction, tolerance=0.0).point
                turn = float(tangent(point, direction) @ direction)
                error = float(np.linalg.norm(self._error(point, direction)))
                if (
                    turn > MIN_TURN_COSINE
                    and error < MAX_ERROR_RATIO * distance
                    and self._is_other(point, direction, least)
                ):
                    yield point
            except (OrbitError, np.linalg.LinAlgError):
                continue

    def _ahead(self, distance: float, other: Floats) -> Iterator[tuple[Floats, float]]:
        """Yield a direction alone."""
        yield other, TANGENT_SEPARATION * distance * abs(float(self._across @ other))

    def _around(self, distance: float, other: Floats) -> Iterator[tuple[Floats, float]]:
        """Yield the directions in which branches leave a circle, nearest to a direction first."""
        found = []
        for angle in self._zeros(distance):
            away = _whole(self._on_circle(distance, angle).point) - self._start
            found.append(away / np.linalg.norm(away))
        for direction in sorted(found, key=lambda each: -float(each @ other)):
            yield direction, CIRCLE_SEPARATION * distance

    def _is_other(self, point: P, direction: Floats, least: float) -> bool:
        """Return whether a point near the branch point lies on another branch than the known one.

        In the kernel, the point is compared with that of the known branch which has the same
        component along the tangent of the known branch. Their distance exceeds the errors of both.
        """
        away = _whole(point) - self._start
        along, across = float(self.own @ away), float(self._across @ away)
        error = abs(float(self._across @ self._error(point, direction)))
        if abs(along) > NEGLIGIBLE_RATIO * abs(across):
            plane = self._start + along * self.own
            known = correct(self._equations, plane, self.own, tolerance=0.0)
            across -= float(self._across @ (known.unknowns - self._start))
            error += abs(float(self._across @ self._error(known.point, self.own)))
        return abs(across) > max(least, error)

    def _zeros(self, radius: float) -> Iterator[float]:
        """Yield the angles to the known branch at which branches leave the circle."""

        def reduced(angle: float) -> float:
            return float(self._on_circle(radius, angle).unknowns[-1])

        # The known branch has zeros near the angles 0 and pi.
        angles = 2.0 * math.pi * (np.arange(CIRCLE_POINTS + 1) + 0.5) / CIRCLE_POINTS
        values: list[float] = []
        for angle in angles.tolist():
            try:
                values.append(reduced(angle))
            except OrbitError:
                values.append(math.nan)
        for (a, b), (first, last) in zip(pairwise(angles), pairwise(values), strict=True):
            if first * last < 0.0:
                yield float(brentq(reduced, a, b, xtol=ANGLE_XTOL))

    def _on_circle(self, radius: float, angle: float) -> Solution[P]:
        """Solve the equations but for a multiple of the left null vector, the last unknown.

        The projection to the kernel lies on the circle, at the angle to the known branch.
        """
        direction = math.cos(angle) * self.own + math.sin(angle) * self._across
        position = radius * self._kernel @ direction

        def extended(u: Floats) -> tuple[P, Floats, Floats]:
            point = self._equations.evaluate(u[:-2], u[-2:-1])
            size = self._left.size
            matrix = np.zeros((size + 2, size + 2))
            matrix[:size, :-1], matrix[:size, -1] = point.derivatives, self._left
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

    def _seconds(self, point: P) -> Floats:
        """Return the second derivatives along the vectors of the kernel, multiplied by w."""
        along = [second_derivatives(self._equations, point, v) for v in self._kernel]
        return np.array([self._left @ each for each in along])

    def _is_certain(self, seconds: Floats) -> bool:
        """Return whether second derivatives are those at the branch point.

        Where they are zero, Newton's method has located the point inaccurately, and its next step
        changes them.
        """
        extended = partial(extended_equations, self._equations, self._left, self._kernel)
        _, residual, matrix = extended(np.append(self._start, 0.0))
        try:
            x = self._start - np.linalg.solve(matrix, residual)[:-1]
        except np.linalg.LinAlgError:
            return False
        change = self._seconds(self._equations.evaluate(x[:-1], x[-1:])) - seconds
        return bool(np.linalg.norm(change) <= MAX_CHANGE * np.linalg.norm(seconds))

    def _roots(self, seconds: Floats, first: Floats) -> list[Floats]:
        """Return the unit vectors a that solve the branching equation; empty if degenerate.

        In the basis of the kernel vector s without a change of the parameter and the direction d of
        the known branch (`first`), the equation is ``A x^2 + 2 B x y + C y^2 = 0``. In other units
        of states and parameter A, B, C have other factors, and the roots remain. `seconds`, shape
        (2, unknowns + 1), are second derivatives along the vectors of the kernel, multiplied by w.
        """
        quadratic = seconds @ self._kernel.T
        s = self._unit(np.array([-self._kernel[1, -1], self._kernel[0, -1]]))
        across = np.array([-s[1], s[0]])
        d = first if abs(float(first @ across)) > PARALLEL_SINE else across
        basis = np.array([s, d])
        (a, b), (_, c) = 0.5 * basis @ (quadratic + quadratic.T) @ basis.T
        terms = float(np.abs(s @ seconds) @ np.abs(d @ self._kernel))
        if not abs(b) > DEGENERATE_RATIO * terms:
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
