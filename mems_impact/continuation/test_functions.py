"""Test functions of special points, their defining systems, and points of codimension two."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from mems_impact._util.arrays import Complexes, Floats
from mems_impact.continuation.branch_points import regularity
from mems_impact.errors import OrbitError
from mems_impact.hybrid.automaton import Guard
from mems_impact.hybrid.event_loop.workspace import NONE
from mems_impact.orbits.periodic_orbit import reduced_monodromy
from mems_impact.orbits.shooting import (
    Shooting,
    ShootingEvaluation,
    length_gradient,
    rate_gradient,
    touch_gradient,
)

# --- Test functions: quantities whose zeros along a branch are the points where something
# happens.

GRAZING, FOLD, PERIOD_DOUBLING, NEIMARK_SACKER, BRANCH_POINT, UNEXPLAINED = (
    "grazing",
    "fold",
    "period-doubling",
    "Neimark-Sacker",
    "branch point",
    "unexplained",
)
CHATTER_ONSET = "onset of complete chatter"
MULTIPLIER_TOLERANCE = (
    1e-3  # distance from -1, or from the unit circle, of a multiplier that is taken to be there
)
AT_ZERO = 1e-9  # a margin, or its rate, that is zero but for rounding
VANISHING = 1e-6  # length of a segment below which its margins are those of its end
ORBIT_LABELS = {
    GRAZING: "G",
    FOLD: "CF",
    PERIOD_DOUBLING: "PD",
    NEIMARK_SACKER: "NS",
    BRANCH_POINT: "BP",
    UNEXPLAINED: "?",
    CHATTER_ONSET: "CC",
}


@dataclass(frozen=True)
class TestFunction:
    """One test function.

    Attributes
    ----------
    kind : str
        "fold", "period-doubling", "Neimark-Sacker", "branch point" (another branch crosses),
        "grazing" (of a guard with impacts), or the name of another guard whose margin is touched.
    role : str
        For a guard: "approach" (its smallest margin along the orbit, or in a segment), "rate" (the
        speed at which the guard that ends a segment is reached), "length" (of a segment, zero
        where two events meet) or "choice" (the margin after the event that ends a segment, in a
        mode to which that may lead).
    segment, guard, mode : int
        -1 where it is none or any.
    """

    __test__ = False  # for pytest: this is no test

    kind: str
    role: str = ""
    segment: int = -1
    guard: int = -1
    mode: int = -1


@dataclass(frozen=True)
class ClosestApproach:
    """Where along an orbit a margin is smallest.

    Attributes
    ----------
    value : float
    segment : int
    time : float
        Since the start of the period of the segment.
    inside : bool
        Whether it is a closest approach within the segment, not a value at one of its ends.
    """

    value: float
    segment: int
    time: float
    inside: bool


def closest_approach(
    shooting: Shooting, point: ShootingEvaluation, guard: int, within: int = -1
) -> ClosestApproach | None:
    """Return the smallest value of a margin where it applies; None if it applies nowhere.

    In the segment `within` alone, unless that is -1.

    A gap does not jump, so that its closest approaches are those inside the segments, and where an
    event turns its rate. Another margin may jump, and then its values at the ends of the segments
    count too, but for the one that ends a segment and the one that starts at zero and does not
    fall. Where static friction is no larger than dynamic, such a margin, the speed, starts with a
    rate that is zero but for rounding.
    """
    m = shooting.m
    impact = shooting.automaton.guards[guard].impact
    found: list[ClosestApproach] = []
    for i, segment in enumerate(shooting.segments):
        if within not in (-1, i):
            continue
        arc = point.arcs[i]
        start, end = float(point.starts[i]), float(point.ends[i])
        margin, rate = float(arc.margins[0, guard]), float(arc.rates[0, guard])
        own_start = not impact and abs(margin) < AT_ZERO and rate > -AT_ZERO
        time = float(arc.minima_time[guard])
        if np.isfinite(arc.minima[guard]) and not (own_start and time - start < VANISHING):
            found.append(ClosestApproach(float(arc.minima[guard]), i, time, True))
        own = segment.guard(m)
        if impact:
            following = point.arcs[(i + 1) % len(shooting.segments)]
            turns = arc.rates[1, guard] < 0.0 < following.rates[0, guard]
            if turns and own != guard and point.events[i] is not None:
                found.append(ClosestApproach(float(arc.margins[1, guard]), i, end, False))
            continue
        if own != guard:
            found.append(ClosestApproach(float(arc.margins[1, guard]), i, end, False))
        elif end - start < VANISHING:
            continue  # the event meets another, or the start of a period: see "length"
        if not own_start:
            found.append(ClosestApproach(margin, i, start, False))
    return min(found, key=lambda c: c.value, default=None)


def monitors(
    shooting: Shooting, point: ShootingEvaluation, direction: Floats
) -> dict[TestFunction, float]:
    """Return all test functions at `point`; positive margins and falling rates are admissible."""
    values = {TestFunction(FOLD): float(direction[-1])}
    if direction.size == point.unknowns.size + 1:  # on a branch, not on a curve
        values[TestFunction(BRANCH_POINT)] = regularity(point, direction)
    automaton, m = shooting.automaton, shooting.m
    for i, segment in enumerate(shooting.segments):
        event = point.events[i]
        values[TestFunction("simultaneous events", "length", i)] = float(
            point.ends[i] - point.starts[i]
        )
        guard = segment.guard(m)
        if event is not None and guard != NONE:
            kind = kind_of(automaton.guards[guard])
            values[TestFunction(kind, "rate", i, guard)] = -float(event.rates[guard])
    for j, each in enumerate(automaton.guards):
        smallest = closest_approach(shooting, point, j)
        if smallest is not None:
            values[TestFunction(kind_of(each), "approach", -1, j)] = smallest.value
    return values


def choice_margins(shooting: Shooting, point: ShootingEvaluation, i: int, mode: int) -> Floats:
    """Return the margins in `mode` after the event that ends segment `i`, shape (m,)."""
    event = point.events[i]
    assert event is not None
    variational = shooting.variational(point.setting)
    return variational.margins(mode, float(point.ends[i]), np.array(event.after))[0]


def kind_of(guard: Guard) -> str:
    """Return what it is called when the margin of `guard` is touched."""
    return GRAZING if guard.impact else guard.name


# --- Points of codimension two: what else happens on a curve of special points, and its name.

PLUS, MINUS, PAIR = "multiplier +1", "multiplier -1", "pair of multipliers on the circle"
CUSP, CONTACT = "cusp", "contact"
COSINES = {"1:1": 1.0, "1:2": -1.0, "1:3": -0.5, "1:4": 0.0}
"""Of the angle of a pair on the unit circle, by its resonance."""

NEUTRAL_RESONANCES = ("1:1", "1:2")
"""Resonances beyond which a pair of product one is real."""

FOLLOWED_NAMES = {FOLD: "fold", PERIOD_DOUBLING: "flip", NEIMARK_SACKER: "Neimark-Sacker"}
MULTIPLIER_NAMES = {PLUS: "fold", MINUS: "flip", PAIR: "Neimark-Sacker"}
CODIMENSION_TWO_NAMES = {
    (FOLD, PLUS): "1:1 resonance",
    (PERIOD_DOUBLING, PLUS): "fold-flip",
    (PERIOD_DOUBLING, MINUS): "1:2 resonance",
    (NEIMARK_SACKER, PLUS): "fold-Neimark-Sacker",
    (NEIMARK_SACKER, MINUS): "flip-Neimark-Sacker",
    (NEIMARK_SACKER, PAIR): "double Neimark-Sacker",
}
"""Those that are not put together of what is followed and what is met."""


def multiplier_tests(kind: str) -> tuple[str, ...]:
    """Return the names of the test functions of multipliers on a curve of a kind."""
    return (PLUS, MINUS, PAIR, *(COSINES if kind == NEIMARK_SACKER else ()))


def name_of(kind: str, test: str) -> str:
    """Return what a zero of a test function is called on a curve of a kind."""
    if test in COSINES:
        return f"{test} resonance"
    if test == CUSP:
        return CUSP
    if test == CONTACT:
        return f"degenerate {kind}"
    return CODIMENSION_TWO_NAMES.get(
        (kind, test), f"{FOLLOWED_NAMES.get(kind, kind)}-{MULTIPLIER_NAMES[test]}"
    )


def value_of(kind: str, test: str, multipliers: Complexes) -> float:
    """Return a test function of multipliers, without those that the curve has throughout.

    Of order one however many multipliers there are, and however large.
    """
    if kind == NEIMARK_SACKER:
        i, j, _ = neutral_pair(multipliers)
        if test in COSINES:
            return 0.5 * float((multipliers[i] + multipliers[j]).real) - COSINES[test]
        multipliers = np.delete(multipliers, [i, j])
    if test == PAIR:
        products = np.array([a * b for a, b in itertools.combinations(multipliers.tolist(), 2)])
        factors = (products - 1.0) / (1.0 + np.abs(products))
        sizes = np.abs(factors)
        if not sizes.all():
            return 0.0
        return float(np.prod(factors / sizes).real * sizes.min(initial=1.0))
    target, own = (1.0, FOLD) if test == PLUS else (-1.0, PERIOD_DOUBLING)
    factors = (multipliers - target) / (1.0 + np.abs(multipliers))
    if kind != own:
        return float(np.prod(factors).real)
    # The derivative of the characteristic polynomial, zero where the root is a double one.
    others = [np.prod(np.delete(factors, k)) for k in range(factors.size)]
    return float(np.sum(others).real)


def is_zero(kind: str, test: str, multipliers: Complexes) -> bool:
    """Return whether a sign change of a test function is a zero.

    It may have passed through infinity, or the product of two real multipliers through one.
    """
    if test == PAIR:
        if kind == NEIMARK_SACKER:
            multipliers = np.delete(multipliers, neutral_pair(multipliers)[:2])
        rotating = multipliers[
            np.abs(multipliers.imag) > MULTIPLIER_TOLERANCE
        ]  # no double one at 1 or -1
        return bool(np.any(np.abs(np.abs(rotating) - 1.0) < MULTIPLIER_TOLERANCE))
    targets = {PLUS: 1.0, MINUS: -1.0}
    return test not in targets or bool(
        np.abs(multipliers - targets[test]).min() < MULTIPLIER_TOLERANCE
    )


def neutral_pair(multipliers: Any) -> tuple[int, int, float]:
    """Return which two have a real product closest to one, and how far it is from it."""
    values = np.asarray(multipliers, dtype=complex).tolist()
    products = [
        (i, j, (values[i] * values[j]).real - 1.0)
        for i, j in itertools.combinations(range(len(values)), 2)
        if (values[i] * values[j]).imag == 0.0
    ]
    return min(products, key=lambda pair: abs(pair[2]))


# --- Test functions as equations: what is zero along a curve, and its derivatives.

GRADIENT_STEP = 1e-6  # step of the differences that give the gradient of a test function
NULL_VECTOR_STEP = 1e-4  # of those of the equations' derivatives along their null vector


def condition_of(shooting: Shooting, monitor: TestFunction) -> DefiningSystem:
    """Return what is zero where `monitor` is."""
    by_role = {
        "approach": GrazingCondition,
        "rate": ContactSpeedCondition,
        "length": SegmentLengthCondition,
        "choice": Choice,
    }
    if monitor.role:
        return by_role[monitor.role](shooting, monitor)
    return {FOLD: FoldCondition, PERIOD_DOUBLING: Flip}.get(monitor.kind, Torus)(shooting, monitor)


class DefiningSystem:
    """A test function as one more equation; its gradient is taken by differences.

    Attributes
    ----------
    derived : bool
        Whether the gradient costs no evaluation of the equations.
    """

    derived = False

    def __init__(self, shooting: Shooting, monitor: TestFunction) -> None:
        self.shooting, self.monitor = shooting, monitor

    def value(self, point: ShootingEvaluation) -> float:
        """Return what is zero on the curve."""
        value = monitors(self.shooting, point, np.zeros(1)).get(self.monitor)
        if value is None:
            raise OrbitError("the closest approach is gone", "take a shorter step")
        return value

    def gradient(self, point: ShootingEvaluation) -> Floats:
        """Return the derivatives by unknowns and parameters."""
        u, here = np.concatenate([point.unknowns, point.values]), self.value(point)
        return np.array(
            [
                (self.value(self._at(u + shift)) - here) / GRADIENT_STEP
                for shift in GRADIENT_STEP * np.eye(u.size)
            ]
        )

    def _at(self, u: Floats) -> ShootingEvaluation:
        size = u.size - len(self.shooting.active)
        return self.shooting.evaluate(u[:size], u[size:])


class GrazingCondition(DefiningSystem):
    """A guard's closest approach, whose derivatives the columns of the arc carry with them."""

    derived = True

    def value(self, point: ShootingEvaluation) -> float:
        """Return the smallest margin."""
        touch = self._touch(point)
        if touch is None:
            raise OrbitError("the closest approach is gone", "take a shorter step")
        return touch.value

    def gradient(self, point: ShootingEvaluation) -> Floats:
        """Return its derivatives."""
        touch = self._touch(point)
        if touch is None or not touch.inside:
            return super().gradient(point)
        return touch_gradient(self.shooting, point, touch.segment, self.monitor.guard)

    def _touch(self, point: ShootingEvaluation) -> ClosestApproach | None:
        return closest_approach(self.shooting, point, self.monitor.guard, self.monitor.segment)


class ContactSpeedCondition(DefiningSystem):
    """The speed at which the guard that ends a segment is reached."""

    derived = True

    def gradient(self, point: ShootingEvaluation) -> Floats:
        """Return its derivatives."""
        return -rate_gradient(self.shooting, point, self.monitor.segment, self.monitor.guard)


class SegmentLengthCondition(DefiningSystem):
    """The length of a segment."""

    derived = True

    def gradient(self, point: ShootingEvaluation) -> Floats:
        """Return its derivatives."""
        return length_gradient(self.shooting, point, self.monitor.segment)


class Flip(DefiningSystem):
    """A period doubling: the determinant of the matrix that has the multipliers, plus one."""

    def value(self, point: ShootingEvaluation) -> float:
        """Return it, over the size of that matrix."""
        matrix = reduced_monodromy(self.shooting, point)
        # Multipliers grow as one over an impact speed; their size is no matter here.
        return float(np.linalg.det(matrix + np.eye(len(matrix)))) / max(1.0, np.abs(matrix).max())


class Torus(DefiningSystem):
    """A Neimark-Sacker point: the product of a pair of multipliers is one."""

    def value(self, point: ShootingEvaluation) -> float:
        """Return what the product of the pair that is closest to it has beyond one."""
        return neutral_pair(np.linalg.eigvals(reduced_monodromy(self.shooting, point)))[2]


class Choice(DefiningSystem):
    """The margin that decides to which of two modes an event leads."""

    def value(self, point: ShootingEvaluation) -> float:
        """Return the margin."""
        i, guard, mode = self.monitor.segment, self.monitor.guard, self.monitor.mode
        if guard == NONE or point.events[i] is None:
            raise OrbitError("no margin tells where the event leads", "follow another point")
        return float(choice_margins(self.shooting, point, i, mode)[guard])


class FoldCondition(DefiningSystem):
    """A fold: the last unknown of the equations bordered by their null vectors.

    Zero where the equations are singular, and smooth where the multipliers are not.
    """

    def __init__(self, shooting: Shooting, monitor: TestFunction) -> None:
        super().__init__(shooting, monitor)
        self._border: tuple[Floats, Floats] | None = None
        self._second: tuple[ShootingEvaluation, Floats, Floats, Floats] | None = None

    def value(self, point: ShootingEvaluation) -> float:
        """Return the last unknown of the bordered equations."""
        return float(self._solve(point, transposed=False)[-1])

    def gradient(self, point: ShootingEvaluation) -> Floats:
        """Return its derivatives, with the borders from here on those of `point`.

        With w and v the solutions of the bordered equations to the left and to the right they are
        -w F_uu v and -w F_up v: differences of all derivatives of the equations, along v alone.
        """
        left, null, by_all = self._along_null(point)
        self._border = left, null
        v = self._solve(point, transposed=False)[:-1]
        w = self._solve(point, transposed=True)[:-1]
        return np.asarray(-(w @ by_all) * (v @ null))

    def curvature(self, point: ShootingEvaluation) -> float:
        """Return the quadratic coefficient of the fold, zero at a cusp."""
        left, null, by_all = self._along_null(point)
        # The sign of the singular vectors is arbitrary; the one of their product with the
        # parameter's derivative is not.
        sign = float(np.sign(left @ point.by_parameter[:, 0]))
        return float(left @ by_all[:, : null.size] @ null) * sign

    def _along_null(self, point: ShootingEvaluation) -> tuple[Floats, Floats, Floats]:
        """Return the null vectors, left and right, and how all derivatives change along this."""
        if self._second is None or self._second[0] is not point:
            vectors, _, rows = np.linalg.svd(point.jacobian)
            left, null = vectors[:, -1], rows[-1]
            shift = NULL_VECTOR_STEP * null
            up = self.shooting.evaluate(point.unknowns + shift, point.values)
            down = self.shooting.evaluate(point.unknowns - shift, point.values)
            by_unknown = (up.jacobian - down.jacobian) / (2.0 * NULL_VECTOR_STEP)
            by_parameter = (up.by_parameter - down.by_parameter) / (2.0 * NULL_VECTOR_STEP)
            self._second = point, left, null, np.hstack([by_unknown, by_parameter])
        return self._second[1:]

    def _solve(self, point: ShootingEvaluation, *, transposed: bool) -> Floats:
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
