"""Test functions as equations: what is zero along a curve, and its derivatives."""

from __future__ import annotations

import numpy as np

from mems_impact.continuation.codimension import neutral_pair
from mems_impact.continuation.monitors import (
    FOLD,
    PERIOD_DOUBLING,
    Closest,
    Monitor,
    choice_margins,
    closest,
    monitors,
)
from mems_impact.errors import OrbitError
from mems_impact.hybrid.record import NONE
from mems_impact.hybrid.trajectory import Floats
from mems_impact.orbits.gradients import length_gradient, rate_gradient, touch_gradient
from mems_impact.orbits.orbit import reduced
from mems_impact.orbits.shooting import Point, Shooting

DIFFERENCE = 1e-6  # step of the differences that give the gradient of a test function
ALONG = 1e-4  # of those of the equations' derivatives along their null vector


def condition_of(shooting: Shooting, monitor: Monitor) -> Condition:
    """Return what is zero where `monitor` is."""
    by_role = {"approach": Touch, "rate": Rate, "length": Length, "choice": Choice}
    if monitor.role:
        return by_role[monitor.role](shooting, monitor)
    return {FOLD: Singular, PERIOD_DOUBLING: Flip}.get(monitor.kind, Torus)(shooting, monitor)


class Condition:
    """A test function as one more equation; its gradient is taken by differences.

    Attributes
    ----------
    derived : bool
        Whether the gradient costs no evaluation of the equations.
    """

    derived = False

    def __init__(self, shooting: Shooting, monitor: Monitor) -> None:
        self.shooting, self.monitor = shooting, monitor

    def value(self, point: Point) -> float:
        """Return what is zero on the curve."""
        value = monitors(self.shooting, point, np.zeros(1)).get(self.monitor)
        if value is None:
            raise OrbitError("the closest approach is gone", "take a shorter step")
        return value

    def gradient(self, point: Point) -> Floats:
        """Return the derivatives by unknowns and parameters."""
        u, here = np.concatenate([point.unknowns, point.values]), self.value(point)
        return np.array(
            [
                (self.value(self._at(u + shift)) - here) / DIFFERENCE
                for shift in DIFFERENCE * np.eye(u.size)
            ]
        )

    def _at(self, u: Floats) -> Point:
        size = u.size - len(self.shooting.active)
        return self.shooting.evaluate(u[:size], u[size:])


class Touch(Condition):
    """A guard's closest approach, whose derivatives the columns of the arc carry with them."""

    derived = True

    def value(self, point: Point) -> float:
        """Return the smallest margin."""
        touch = self._touch(point)
        if touch is None:
            raise OrbitError("the closest approach is gone", "take a shorter step")
        return touch.value

    def gradient(self, point: Point) -> Floats:
        """Return its derivatives."""
        touch = self._touch(point)
        if touch is None or not touch.inside:
            return super().gradient(point)
        return touch_gradient(self.shooting, point, touch.segment, self.monitor.guard)

    def _touch(self, point: Point) -> Closest | None:
        return closest(self.shooting, point, self.monitor.guard, self.monitor.segment)


class Rate(Condition):
    """The speed at which the guard that ends a segment is reached."""

    derived = True

    def gradient(self, point: Point) -> Floats:
        """Return its derivatives."""
        return -rate_gradient(self.shooting, point, self.monitor.segment, self.monitor.guard)


class Length(Condition):
    """The length of a segment."""

    derived = True

    def gradient(self, point: Point) -> Floats:
        """Return its derivatives."""
        return length_gradient(self.shooting, point, self.monitor.segment)


class Flip(Condition):
    """A period doubling: the determinant of the matrix that has the multipliers, plus one."""

    def value(self, point: Point) -> float:
        """Return it, over the size of that matrix."""
        matrix = reduced(self.shooting, point)
        # Multipliers grow as one over an impact speed; their size is no matter here.
        return float(np.linalg.det(matrix + np.eye(len(matrix)))) / max(1.0, np.abs(matrix).max())


class Torus(Condition):
    """A Neimark-Sacker point: the product of a pair of multipliers is one."""

    def value(self, point: Point) -> float:
        """Return what the product of the pair that is closest to it has beyond one."""
        return neutral_pair(np.linalg.eigvals(reduced(self.shooting, point)))[2]


class Choice(Condition):
    """The margin that decides to which of two modes an event leads."""

    def value(self, point: Point) -> float:
        """Return the margin."""
        i, guard, mode = self.monitor.segment, self.monitor.guard, self.monitor.mode
        if guard == NONE or point.events[i] is None:
            raise OrbitError("no margin tells where the event leads", "follow another point")
        return float(choice_margins(self.shooting, point, i, mode)[guard])


class Singular(Condition):
    """A fold: the last unknown of the equations bordered by their null vectors.

    Zero where the equations are singular, and smooth where the multipliers are not.
    """

    def __init__(self, shooting: Shooting, monitor: Monitor) -> None:
        super().__init__(shooting, monitor)
        self._border: tuple[Floats, Floats] | None = None
        self._second: tuple[Point, Floats, Floats, Floats] | None = None

    def value(self, point: Point) -> float:
        """Return the last unknown of the bordered equations."""
        return float(self._solve(point, transposed=False)[-1])

    def gradient(self, point: Point) -> Floats:
        """Return its derivatives, with the borders from here on those of `point`.

        With w and v the solutions of the bordered equations to the left and to the right they are
        -w F_uu v and -w F_up v: differences of all derivatives of the equations, along v alone.
        """
        left, null, by_all = self._along_null(point)
        self._border = left, null
        v = self._solve(point, transposed=False)[:-1]
        w = self._solve(point, transposed=True)[:-1]
        return np.asarray(-(w @ by_all) * (v @ null))

    def curvature(self, point: Point) -> float:
        """Return the quadratic coefficient of the fold, zero at a cusp."""
        left, null, by_all = self._along_null(point)
        # The sign of the singular vectors is arbitrary; the one of their product with the
        # parameter's derivative is not.
        sign = float(np.sign(left @ point.by_parameter[:, 0]))
        return float(left @ by_all[:, : null.size] @ null) * sign

    def _along_null(self, point: Point) -> tuple[Floats, Floats, Floats]:
        """Return the null vectors, left and right, and how all derivatives change along this."""
        if self._second is None or self._second[0] is not point:
            vectors, _, rows = np.linalg.svd(point.jacobian)
            left, null = vectors[:, -1], rows[-1]
            shift = ALONG * null
            up = self.shooting.evaluate(point.unknowns + shift, point.values)
            down = self.shooting.evaluate(point.unknowns - shift, point.values)
            by_unknown = (up.jacobian - down.jacobian) / (2.0 * ALONG)
            by_parameter = (up.by_parameter - down.by_parameter) / (2.0 * ALONG)
            self._second = point, left, null, np.hstack([by_unknown, by_parameter])
        return self._second[1:]

    def _solve(self, point: Point, *, transposed: bool) -> Floats:
        if self._border is None:
            self._border = self._along_null(point)[:2]
        left, null = self._border
        size = null.size
        matrix = np.zeros((size + 1, size + 1))
        matrix[:size, :size] = point.jacobian
        matrix[:size, size], matrix[size, :size] = left, null
        unit = np.zeros(size + 1)
        unit[size] = 1.0
        return np.asarray(np.linalg.solve(matrix.T if transposed else matrix, unit))
