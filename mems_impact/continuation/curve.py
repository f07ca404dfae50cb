"""Curves of grazings, folds and period doublings in two parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import brentq

from mems_impact.continuation.branch import SpecialPoint, Steps
from mems_impact.continuation.grazing import contact_coefficient
from mems_impact.continuation.monitors import FOLD, GRAZING, PERIOD_DOUBLING, Monitor, monitors
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.hybrid.trajectory import Floats
from mems_impact.orbits.orbit import PeriodicOrbit, make_orbit, reduced
from mems_impact.orbits.shooting import ACCEPTED, TOLERANCE, Point, Shooting

DIFFERENCE = 1e-6  # step of the differences that give the gradient of the test function
ITERATIONS = 10

MARGIN = "touched: "  # prefix of the tests on margins
# Codimension two: what else is zero there, by the name of the test.
CODIMENSION_TWO = {
    "multiplier +1": "grazing-fold",
    "multiplier -1": "fold-flip",
    "contact": "degenerate grazing",
    "cusp": "cusp",
}


@dataclass(frozen=True)
class CurvePoint:
    """One orbit on a curve.

    Attributes
    ----------
    orbit : PeriodicOrbit
    values : tuple of float
        Of the two parameters.
    """

    orbit: PeriodicOrbit
    values: tuple[float, float]


@dataclass(frozen=True)
class CodimensionTwo:
    """A point of a curve at which a second thing happens.

    Attributes
    ----------
    kind : str
    values : tuple of float
        Of the two parameters.
    orbit : PeriodicOrbit
    """

    kind: str
    values: tuple[float, float]
    orbit: PeriodicOrbit


@dataclass
class OrbitCurve:
    """A curve of special points in two parameters.

    Attributes
    ----------
    kind : str
        Of the special points.
    parameters : tuple of str
    points : list of CurvePoint
    special_points : list of CodimensionTwo
    ended : str
        Why the curve ends.
    """

    kind: str
    parameters: tuple[str, str]
    points: list[CurvePoint] = field(default_factory=list)
    special_points: list[CodimensionTwo] = field(default_factory=list)
    ended: str = ""


def follow_curve(
    special: SpecialPoint,
    parameter: str,
    second: str,
    *,
    low: float,
    high: float,
    direction: float = 1.0,
    steps: Steps | None = None,
    progress: Callable[[float], None] | None = None,
) -> OrbitCurve:
    """Follow a special point of a branch in a second parameter.

    Parameters
    ----------
    special : SpecialPoint
        A grazing, fold or period doubling (or the touching of another guard).
    parameter : str
        The parameter of the branch.
    second : str
        The other one.
    low, high : float
        Bounds of the second parameter.
    direction : float
        Sign of the first step in the second parameter.
    steps : Steps, optional
    progress : callable, optional
        Called with every value of the second parameter.

    Returns
    -------
    OrbitCurve
    """
    if parameter == second:
        raise InvalidParameter(field="second", value=second, allowed=f"another than {parameter}")
    return _Curve(special, parameter, second, (low, high), steps or Steps()).go(direction, progress)


class _Curve:
    """The iteration along a curve."""

    def __init__(
        self,
        special: SpecialPoint,
        parameter: str,
        second: str,
        bounds: tuple[float, float],
        steps: Steps,
    ) -> None:
        orbit = special.orbit
        self.monitor, self.bounds, self.steps = special.monitor, bounds, steps
        self.shooting = Shooting(orbit.family, orbit.segments, (parameter, second))
        self.shooting.pinned = orbit.shooting.pinned
        values = [orbit.family.values[parameter], orbit.family.values[second]]
        self.start = np.concatenate([orbit.point.unknowns, values])
        self.curve = OrbitCurve(special.kind, (parameter, second))
        self.border: tuple[Floats, Floats] | None = None

    def go(self, direction: float, progress: Callable[[float], None] | None) -> OrbitCurve:
        curve, steps = self.curve, self.steps
        u = self.start
        try:
            point, gradient = self._linearize(u)
            along = self._tangent(point, gradient, None)
            along = along if along[-1] * direction >= 0.0 else -along
            u, point = self._correct(u, along, gradient)
        except OrbitError as error:
            curve.ended = f"the first point could not be corrected: {error.reason}"
            return curve
        length = steps.initial
        self._append(point)
        before = self._tests(point)
        while len(curve.points) < steps.most:
            try:
                ahead_u, ahead_point = self._correct(u + length * along, along, gradient)
                ahead_point, ahead_gradient = self._linearize(ahead_u)
                ahead = self._tangent(ahead_point, ahead_gradient, along)
                if ahead @ along < 0.95:
                    raise OrbitError("the curve turns too sharply", "take a shorter step")
                after = self._tests(ahead_point)
                found = self._special(u, along, length, gradient, before, after)
            except OrbitError as error:
                length /= 2.0
                if length < steps.smallest:
                    curve.ended = f"no further step possible: {error.reason}"
                    return curve
                continue
            curve.special_points += [special for special, _ in found]
            lost = next((special for special, ends in found if ends), None)
            if lost is not None:
                curve.points.append(CurvePoint(lost.orbit, lost.values))
                curve.ended = f"{lost.kind}: beyond, the automaton has no such orbit"
                return curve
            if not self.bounds[0] <= ahead_u[-1] <= self.bounds[1]:
                self._finish(u, ahead_u, gradient)
                curve.ended = f"{curve.parameters[1]} reached its bound"
                return curve
            u, point, gradient, along, before = ahead_u, ahead_point, ahead_gradient, ahead, after
            self._append(point)
            if progress is not None:
                progress(float(u[-1]))
            length = min(1.5 * length, steps.largest)
        curve.ended = f"the budget of {steps.most} points is used up"
        return curve

    def _append(self, point: Point) -> None:
        values = (float(point.values[0]), float(point.values[1]))
        self.curve.points.append(CurvePoint(make_orbit(self.shooting, point), values))

    def _evaluate(self, u: Floats) -> Point:
        return self.shooting.evaluate(u[:-2], u[-2:])

    def _condition(self, point: Point) -> float:
        """Return what is zero on the curve."""
        if self.monitor.kind == FOLD and not self.monitor.role:
            # Zero where the equations are singular, and smooth: the last unknown of the system
            # bordered by the null vectors.
            if self.border is None:
                left, _, right = np.linalg.svd(point.jacobian)
                self.border = left[:, -1], right[-1]
            b, c = self.border
            size = point.jacobian.shape[0]
            matrix = np.zeros((size + 1, size + 1))
            matrix[:size, :size] = point.jacobian
            matrix[:size, size], matrix[size, :size] = b, c
            unit = np.zeros(size + 1)
            unit[size] = 1.0
            return float(np.linalg.solve(matrix, unit)[size])
        value = monitors(self.shooting, point, np.zeros(1)).get(self.monitor)
        if value is None:
            raise OrbitError("the closest approach is gone", "take a shorter step")
        if self.monitor.kind == PERIOD_DOUBLING:
            # Multipliers grow as one over an impact speed; their size is no matter here.
            matrix = reduced(self.shooting, point)
            value /= max(1.0, float(np.abs(matrix).max()))
        return value

    def _linearize(self, u: Floats) -> tuple[Point, Floats]:
        """Return the point and the gradient of the condition, by differences."""
        self.border = None
        point = self._evaluate(u)
        here = self._condition(point)
        gradient = np.zeros(u.size)
        for c in range(u.size):
            shift = np.zeros(u.size)
            shift[c] = DIFFERENCE
            there = self._condition(self._evaluate(u + shift))
            gradient[c] = (there - here) / DIFFERENCE
        return point, gradient

    def _tangent(self, point: Point, gradient: Floats, along: Floats | None) -> Floats:
        wide = np.vstack([np.hstack([point.jacobian, point.by_parameter]), gradient])
        direction = np.linalg.svd(wide)[2][-1]
        if along is not None and direction @ along < 0.0:
            direction = -direction
        return np.asarray(direction)

    def _correct(self, guess: Floats, along: Floats, gradient: Floats) -> tuple[Floats, Point]:
        """Correct across `along`, with a gradient of the condition from nearby."""
        u, previous = guess.copy(), np.inf
        for _ in range(ITERATIONS):
            point = self._evaluate(u)
            residual = np.concatenate(
                [point.residual, [self._condition(point), along @ (u - guess)]]
            )
            matrix = np.vstack([np.hstack([point.jacobian, point.by_parameter]), gradient, along])
            try:
                change = np.linalg.solve(matrix, -residual)
            except np.linalg.LinAlgError as error:
                raise OrbitError("the curve has no tangent here", "step over it") from error
            size = float(np.abs(change).max())
            small = float(np.abs(residual).max()) < ACCEPTED
            if size < TOLERANCE or (small and size >= 0.5 * previous):
                return u, point
            if not np.isfinite(size) or size > 1e3:
                break
            previous = size
            u = u + change
        raise OrbitError("the correction of a step did not converge", "take a shorter step")

    def _finish(self, u: Floats, beyond: Floats, gradient: Floats) -> None:
        """Put the last point at the bound."""
        bound = self.bounds[0] if beyond[-1] < self.bounds[0] else self.bounds[1]
        share = (bound - u[-1]) / (beyond[-1] - u[-1])
        fixed = np.zeros(u.size)
        fixed[-1] = 1.0
        guess = u + share * (beyond - u)
        try:
            gradient = self._linearize(guess)[1]  # the one from the last point may be too old
            self._append(self._correct(guess, fixed, gradient)[1])
        except OrbitError:
            return

    def _tests(self, point: Point) -> dict[str, float]:
        """Return the test functions for points of codimension two."""
        matrix = reduced(self.shooting, point)
        identity = np.eye(len(matrix))
        scale = max(1.0, float(np.abs(matrix).max()))
        tests: dict[str, float] = {}
        if self.monitor.kind != FOLD:
            tests["multiplier +1"] = float(np.linalg.det(matrix - identity)) / scale
        else:
            tests["cusp"] = self._second_derivative(point)
        if self.monitor.kind != PERIOD_DOUBLING:
            tests["multiplier -1"] = float(np.linalg.det(matrix + identity)) / scale
        if self.monitor.role == "approach":
            coefficient = contact_coefficient(self.shooting, point, self.monitor, 1)
            if coefficient is not None:
                tests["contact"] = coefficient
        for other, value in monitors(self.shooting, point, np.zeros(1)).items():
            if other.role in ("approach", "rate") and not self._same_contact(other):
                tests[f"{MARGIN}{self._meeting(other)}"] = value
        return tests

    def _meeting(self, other: Monitor) -> str:
        """Return what it is called where the curve meets the touching of a guard."""
        if other.kind == GRAZING and self.monitor.kind == FOLD:
            # Folds of orbits with an impact set in where its speed is zero; those without, where
            # the grazing orbit has a multiplier +1.
            return "degenerate grazing" if other.role == "rate" else "grazing-fold"
        name = self.shooting.automaton.guards[other.guard].name
        where = "" if other.segment < 0 else f" of segment {other.segment}"
        return f"{name} ({other.role}{where})"

    def _same_contact(self, other: Monitor) -> bool:
        """Return whether `other` is zero all along the curve."""
        touching = self.monitor.role in ("approach", "rate")
        return touching and (other == self.monitor or other.kind != GRAZING)

    def _second_derivative(self, point: Point) -> float:
        """Return the quadratic coefficient of a fold, zero at a cusp."""
        left, _, right = np.linalg.svd(point.jacobian)
        null, h = right[-1], 1e-4
        u = np.concatenate([point.unknowns, point.values])
        shift = np.concatenate([h * null, np.zeros(2)])
        up, down = self._evaluate(u + shift), self._evaluate(u - shift)
        second = (up.residual - 2.0 * point.residual + down.residual) / h**2
        # The sign of the singular vectors is arbitrary; the one of their product with the
        # parameter's derivative is not.
        return float(left[:, -1] @ second) * float(np.sign(left[:, -1] @ point.by_parameter[:, 0]))

    def _special(
        self,
        u: Floats,
        along: Floats,
        length: float,
        gradient: Floats,
        before: dict[str, float],
        after: dict[str, float],
    ) -> list[tuple[CodimensionTwo, bool]]:
        """Return the points of codimension two within a step, and whether the curve ends there."""
        found = []
        for name in before.keys() & after.keys():
            if before[name] * after[name] < 0.0:
                special = self._locate(name, u, along, length, gradient)
                if special is not None:
                    found.append((special, name.startswith(MARGIN) and after[name] < 0.0))
        # An impact at zero speed takes with it what follows on it.
        main = [item for item in found if "grazing" in item[0].kind]
        return [
            item
            for item in found
            if item in main
            or not any(np.allclose(item[0].values, other[0].values, atol=1e-6) for other in main)
        ]

    def _locate(
        self, name: str, u: Floats, along: Floats, length: float, gradient: Floats
    ) -> CodimensionTwo | None:
        """Locate a zero of the test `name` within a step."""

        def test(s: float) -> float:
            return self._tests(self._correct(u + s * along, along, gradient)[1])[name]

        try:
            position = brentq(test, 0.0, length, xtol=1e-13, rtol=1e-13)
            point = self._correct(u + position * along, along, gradient)[1]
        except (KeyError, ValueError) as error:
            raise OrbitError(f"{name} could not be located", "take a shorter step") from error
        orbit = make_orbit(self.shooting, point)
        if name.startswith("multiplier"):
            target = 1.0 if name.endswith("+1") else -1.0
            if np.abs(orbit.multipliers - target).min() > 1e-3:
                return None  # a sign change through infinity
        values = (float(point.values[0]), float(point.values[1]))
        kind = CODIMENSION_TWO.get(name, name.removeprefix(MARGIN))
        return CodimensionTwo(kind, values, orbit)


__all__ = ["CodimensionTwo", "CurvePoint", "Monitor", "OrbitCurve", "follow_curve"]
