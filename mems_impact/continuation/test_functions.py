"""Test functions of special points, their defining systems, and points of codimension two."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from mems_impact._util.arrays import Complexes, Floats
from mems_impact.continuation.arclength import PredictorStep
from mems_impact.continuation.branch_points import regularity
from mems_impact.continuation.critical_vectors import CriticalVectors
from mems_impact.continuation.higher_derivatives import plain_derivatives
from mems_impact.errors import OrbitError
from mems_impact.hybrid.automaton import Guard
from mems_impact.hybrid.event_loop.workspace import NONE
from mems_impact.orbits.monodromy import monodromy_factors, multipliers_at
from mems_impact.orbits.shooting import (
    Shooting,
    ShootingEvaluation,
    length_gradient,
    rate_gradient,
    touch_gradient,
)

GRAZING, FOLD, PERIOD_DOUBLING, NEIMARK_SACKER, BRANCH_POINT, UNEXPLAINED = (
    "grazing",
    "fold",
    "period-doubling",
    "Neimark-Sacker",
    "branch point",
    "unexplained",
)
CHATTER_ONSET = "onset of complete chatter"
MULTIPLIER_TOLERANCE = 1e-3  # distance from +1, -1 or the unit circle at a bifurcation
MARGIN_ROUNDING = 1e-9  # largest rounding error of a margin, or of its rate
VANISHING_LENGTH = 1e-6  # length of a segment below which its margins are those of its end
ORBIT_LABELS = {
    GRAZING: "G",
    FOLD: "CF",
    PERIOD_DOUBLING: "PD",
    NEIMARK_SACKER: "NS",
    BRANCH_POINT: "BP",
    UNEXPLAINED: "?",
    CHATTER_ONSET: "CC",
}
MEETING = "simultaneous events"
OTHER_POINT_REMEDY = "continue another special point, or take shorter steps"


@dataclass(frozen=True)
class ClosestApproach:
    """Smallest value of a margin along an orbit."""

    value: float
    segment: int
    time: float  # since the start of the period of the segment
    inside: bool  # whether it is a minimum within the segment, not a value at one of its ends


def closest_approach(
    shooting: Shooting, point: ShootingEvaluation, guard: int, segment_number: int = -1
) -> ClosestApproach | None:
    """Return the smallest value of a margin where it is defined; None if it is defined nowhere.

    Only the segment `segment_number` is searched, unless it is -1.

    A gap is continuous: its minima are those inside the segments, and events that reverse its rate.
    Other margins may jump, so their values at the ends of segments count as well, except for that
    of the guard that ends a segment, and for a margin that starts at zero and does not decrease.
    Where static friction does not exceed dynamic friction, such a margin, the speed, starts with
    a rate that is zero up to rounding.
    """
    m = shooting.m
    impact = shooting.automaton.guards[guard].impact
    found: list[ClosestApproach] = []
    for i, segment in enumerate(shooting.segments):
        if segment_number not in (-1, i):
            continue
        arc = point.arcs[i]
        start, end = float(point.starts[i]), float(point.ends[i])
        margin, rate = float(arc.margins[0, guard]), float(arc.rates[0, guard])
        own_start = not impact and abs(margin) < MARGIN_ROUNDING and rate > -MARGIN_ROUNDING
        time = float(arc.minima_time[guard])
        if np.isfinite(arc.minima[guard]) and not (own_start and time - start < VANISHING_LENGTH):
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
        elif end - start < VANISHING_LENGTH:
            continue  # the test function of the segment's length covers this case
        if not own_start:
            found.append(ClosestApproach(margin, i, start, False))
    return min(found, key=lambda c: c.value, default=None)


def choice_margins(shooting: Shooting, point: ShootingEvaluation, i: int, mode: int) -> Floats:
    """Return the margins in `mode` after the event that ends segment `i`, shape (m,)."""
    event = point.events[i]
    assert event is not None
    variational = shooting.variational(point.parameter_point)
    return variational.margins(mode, float(point.ends[i]), np.array(event.after))[0]


def kind_of(guard: Guard) -> str:
    """Return the kind of special point at which the margin of `guard` is zero."""
    return GRAZING if guard.impact else guard.name


# --- Defining systems of curves

GRADIENT_STEP = 1e-6  # difference step of the gradient of a test function
MIN_CONDITION = 1e-3  # of an eigenvalue, below which its gradient loses digits


class DefiningSystem:
    """A test function as an additional equation, with its gradient by differences.

    The equations have two active parameters. `derived` says that the gradient follows from the
    derivatives of a point, without further evaluations.
    """

    derived = False

    def __init__(self, equations: Any, monitor: TestFunction) -> None:
        self.equations, self.monitor = equations, monitor

    def value(self, point: Any) -> float:
        """Return the value of the additional equation, zero on the curve."""
        value = self.monitor.value(self.equations, point, np.zeros(1))
        if value is None:
            raise OrbitError(
                f"the orbit has no {self.monitor.kind} to continue", OTHER_POINT_REMEDY
            )
        return value

    def gradient(self, point: Any) -> Floats:
        """Return the derivatives by unknowns and parameters."""
        u, here = np.concatenate([point.unknowns, point.values]), self.value(point)
        return np.array(
            [
                (self.value(self._at(u + shift)) - here) / GRADIENT_STEP
                for shift in GRADIENT_STEP * np.eye(u.size)
            ]
        )

    def _at(self, u: Floats) -> Any:
        size = u.size - len(self.equations.active)
        return self.equations.evaluate(u[:size], u[size:])


class GrazingCondition(DefiningSystem):
    """The closest approach of a guard; its derivatives follow from the derivatives of the arc."""

    derived = True
    monitor: ClosestApproachTest

    def gradient(self, point: ShootingEvaluation) -> Floats:
        """Return the derivatives by unknowns and parameters."""
        guard = self.monitor.guard
        touch = closest_approach(self.equations, point, guard, self.monitor.segment)
        if touch is None or not touch.inside:
            return super().gradient(point)
        return touch_gradient(self.equations, point, touch.segment, guard)


class ContactSpeedCondition(DefiningSystem):
    """The speed at which the guard that ends a segment is reached."""

    derived = True
    monitor: ContactSpeedTest

    def gradient(self, point: ShootingEvaluation) -> Floats:
        """Return the derivatives by unknowns and parameters."""
        return -rate_gradient(self.equations, point, self.monitor.segment, self.monitor.guard)


class SegmentLengthCondition(DefiningSystem):
    """The length of a segment."""

    derived = True
    monitor: SegmentLengthTest

    def gradient(self, point: ShootingEvaluation) -> Floats:
        """Return the derivatives by unknowns and parameters."""
        return length_gradient(self.equations, point, self.monitor.segment)


class NeimarkSackerCondition(DefiningSystem):
    """A Neimark-Sacker point: the product of a pair of multipliers is one."""

    def __init__(self, equations: Any, monitor: TestFunction) -> None:
        super().__init__(equations, monitor)
        self._vectors: CriticalVectors | None = None

    def value(self, point: ShootingEvaluation) -> float:
        """Return the product of the pair closest to a product of one, minus one."""
        return neutral_pair(multipliers_at(self.equations, point))[2]

    def gradient(self, point: ShootingEvaluation) -> Floats:
        """Return the derivatives by unknowns and parameters."""
        vectors = self.vectors(point)
        if vectors is None or abs(vectors.condition) < MIN_CONDITION:
            return super().gradient(point)
        by_all = vectors.multiplier_gradient()
        return np.asarray(2.0 * (np.conj(vectors.multiplier) * by_all).real)

    def vectors(self, point: ShootingEvaluation) -> CriticalVectors | None:
        """Return the critical vectors; None if the pair is real."""
        if self._vectors is None or self._vectors.point is not point:
            multipliers = multipliers_at(self.equations, point)
            pair = multipliers[list(neutral_pair(multipliers)[:2])]
            multiplier = complex(pair[np.argmax(pair.imag)])
            if multiplier.imag == 0.0:
                return None
            self._vectors = CriticalVectors(self.equations, point, multiplier, plain_derivatives)
        return self._vectors


class ModeChoiceCondition(DefiningSystem):
    """The margin that determines to which of two modes an event leads."""


class BorderedCondition(DefiningSystem):
    """A real critical multiplier: the last unknown of the equations bordered by null vectors.

    The equations are those of a perturbation with this multiplier. The value is zero where they are
    singular, and smooth even where the multipliers are not.
    """

    multiplier: ClassVar[float]

    def __init__(self, equations: Any, monitor: TestFunction) -> None:
        super().__init__(equations, monitor)
        self._border: tuple[Floats, Floats] | None = None
        self._vectors: CriticalVectors | None = None

    def value(self, point: ShootingEvaluation) -> float:
        """Return the last unknown of the bordered equations."""
        return float(self._solve(point, transposed=False)[-1])

    def gradient(self, point: ShootingEvaluation) -> Floats:
        """Return the derivatives by unknowns and parameters; set the borders at `point`.

        With the left and right solutions w and v of the bordered equations they are -w F_uu v and
        -w F_up v, computed by differences of the first derivatives along v.
        """
        vectors = self.vectors(point)
        self._border, null = vectors.null, vectors.null[1]
        v = self._solve(point, transposed=False)[:-1]
        w = self._solve(point, transposed=True)[:-1]
        return np.asarray(-(w @ vectors.by_all) * (v @ null))

    def vectors(self, point: ShootingEvaluation) -> CriticalVectors:
        """Return the critical vectors."""
        if self._vectors is None or self._vectors.point is not point:
            self._vectors = CriticalVectors(
                self.equations, point, self.multiplier, plain_derivatives
            )
        return self._vectors

    def _solve(self, point: ShootingEvaluation, *, transposed: bool) -> Floats:
        vectors = self.vectors(point)
        if self._border is None:
            self._border = vectors.null
        left, null = self._border
        size = null.size
        matrix = np.zeros((size + 1, size + 1))
        matrix[:size, :size] = vectors.matrix(self.multiplier)
        matrix[:size, size], matrix[size, :size] = left, null
        unit = np.zeros(size + 1)
        unit[size] = 1.0
        return np.asarray(np.linalg.solve(matrix.T if transposed else matrix, unit))


class FoldCondition(BorderedCondition):
    """A multiplier +1."""

    multiplier = 1.0

    def curvature(self, point: ShootingEvaluation) -> float:
        """Return the quadratic coefficient of the fold, zero at a cusp."""
        vectors = self.vectors(point)
        left, null = vectors.null
        # Orient the left singular vector, whose sign is arbitrary, by the parameter derivative.
        sign = float(np.sign(left @ point.by_parameter[:, 0]))
        return float(left @ vectors.by_all[:, : null.size] @ null) * sign


class PeriodDoublingCondition(BorderedCondition):
    """A multiplier -1."""

    multiplier = -1.0


# --- Test functions of orbits and equilibria


@dataclass(frozen=True)
class TestFunction(ABC):
    """A quantity that is zero at special points of one kind.

    Test functions are values: comparable, storable, and applicable at any point of a branch. A new
    one is a subclass, listed in `orbit_tests` or `curve_tests`. `kind`, of a zero, is "fold",
    "grazing" (contact of a guard with impacts), …, or the name of another guard whose margin is
    zero.
    """

    __test__ = False  # keeps pytest from collecting the class

    kind: str

    ends_orbits: ClassVar[bool] = False
    """Whether the orbit is inadmissible where the value is negative."""
    may_jump: ClassVar[bool] = False
    """Whether the value may jump through zero along a curve."""
    condition: ClassVar[type[DefiningSystem] | None] = None
    """Class of the defining system of its curves, if it has one."""

    @abstractmethod
    def value(self, equations: Any, point: Any, direction: Floats) -> float | None:
        """Return the value at a solution of the equations; None where it is undefined.

        `direction` is the tangent of the branch.
        """

    def on_curve(self, condition: DefiningSystem, point: Any) -> float | None:
        """Return the value at a point of the curve with this defining system."""
        return self.value(condition.equations, point, np.zeros(1))

    def zero_on_curve(
        self, condition: DefiningSystem, step: PredictorStep[Any], length: float
    ) -> float | None:
        """Return the position of a zero in a step of the curve; None if it is not confirmed.

        Raises ValueError if no zero is found.
        """

        def value(point: Any) -> float:
            found = self.on_curve(condition, point)
            if found is None:
                raise ValueError(self)
            return found

        return step.zero(value, length)

    def is_zero(self, condition: DefiningSystem, point: Any) -> bool:
        """Return whether a change of sign on a curve is a zero."""
        return True

    @property
    def name(self) -> str:
        """Name of a zero on a curve."""
        return self.kind

    def equation(self, shooting: Shooting) -> DefiningSystem:
        """Return the defining system of its curves in two parameters."""
        if self.condition is None:
            raise OrbitError(
                f"points of kind {self.kind!r} cannot be continued in two parameters",
                OTHER_POINT_REMEDY,
            )
        return self.condition(shooting, self)

    def rebased(self, segments: int, first: int) -> Self:
        """Return the test function for a cycle restarted in segment `first` of `segments`."""
        return self


@dataclass(frozen=True)
class FoldTest(TestFunction):
    """The parameter component of the tangent, zero at a fold of the branch."""

    kind: str = FOLD
    condition: ClassVar[type[DefiningSystem]] = FoldCondition

    def value(self, equations: Any, point: Any, direction: Floats) -> float:
        """Return the component."""
        return float(direction[-1])


@dataclass(frozen=True)
class PeriodDoublingTest(TestFunction):
    """The characteristic polynomial of the multipliers at -1."""

    kind: str = PERIOD_DOUBLING
    condition: ClassVar[type[DefiningSystem]] = PeriodDoublingCondition

    def value(self, equations: Any, point: Any, direction: Floats) -> float:
        """Return it, relative to the largest entry of the reduced monodromy matrix.

        Of several factors it is the product of the distances of all multipliers, relative to them.
        """
        factors = monodromy_factors(equations, point)
        if len(factors) > 1:
            multipliers = multipliers_at(equations, point)
            return float(np.prod((multipliers + 1.0) / (1.0 + np.abs(multipliers))).real)
        matrix = factors[0]
        # Multipliers diverge as the inverse of an impact speed; the scaling removes this growth.
        return float(np.linalg.det(matrix + np.eye(len(matrix)))) / max(1.0, np.abs(matrix).max())


@dataclass(frozen=True)
class NeimarkSackerTest(TestFunction):
    """The product of a pair of multipliers, minus one."""

    kind: str = NEIMARK_SACKER
    condition: ClassVar[type[DefiningSystem]] = NeimarkSackerCondition

    def value(self, equations: Any, point: Any, direction: Floats) -> float:
        """Return the value for the pair closest to a product of one."""
        return self.equation(equations).value(point)


@dataclass(frozen=True)
class BranchPointTest(TestFunction):
    """The `regularity` of the equations, zero where another branch crosses."""

    kind: str = BRANCH_POINT

    def value(self, equations: Any, point: Any, direction: Floats) -> float:
        """Return the smallest singular value with the sign of the determinant."""
        return regularity(point, direction)


@dataclass(frozen=True)
class UnexplainedTest(TestFunction):
    """A change of stability without a zero of another test function; it has no value."""

    kind: str = UNEXPLAINED

    def value(self, equations: Any, point: Any, direction: Floats) -> None:
        """Return None."""


class SegmentTest(TestFunction):
    """A test function of one segment."""

    segment: int
    ends_orbits: ClassVar[bool] = True

    def rebased(self, segments: int, first: int) -> Self:
        """Return the test function for a cycle restarted in segment `first` of `segments`."""
        if not 0 <= self.segment < segments - 1:
            return self
        return type(self)(**{**vars(self), "segment": (self.segment - first) % (segments - 1)})


@dataclass(frozen=True)
class ClosestApproachTest(SegmentTest):
    """The smallest margin of a guard along the orbit, or in one segment."""

    guard: int
    segment: int = NONE
    condition: ClassVar[type[DefiningSystem]] = GrazingCondition

    def value(
        self, equations: Shooting, point: ShootingEvaluation, direction: Floats
    ) -> float | None:
        """Return the margin."""
        smallest = closest_approach(equations, point, self.guard, self.segment)
        return None if smallest is None else smallest.value


@dataclass(frozen=True)
class ContactSpeedTest(SegmentTest):
    """The speed at which the guard that ends a segment is reached."""

    guard: int
    segment: int
    condition: ClassVar[type[DefiningSystem]] = ContactSpeedCondition

    def value(
        self, equations: Shooting, point: ShootingEvaluation, direction: Floats
    ) -> float | None:
        """Return that speed, positive towards the guard."""
        event = point.events[self.segment]
        return None if event is None else -float(event.rates[self.guard])


@dataclass(frozen=True)
class SegmentLengthTest(SegmentTest):
    """The length of a segment, zero where two events coincide."""

    segment: int
    condition: ClassVar[type[DefiningSystem]] = SegmentLengthCondition

    def value(self, equations: Shooting, point: ShootingEvaluation, direction: Floats) -> float:
        """Return the length."""
        return float(point.ends[self.segment] - point.starts[self.segment])


@dataclass(frozen=True)
class ModeChoiceTest(SegmentTest):
    """A margin after the event that ends a segment, in a mode to which this event may lead."""

    guard: int
    segment: int
    mode: int = NONE
    condition: ClassVar[type[DefiningSystem]] = ModeChoiceCondition

    def value(
        self, equations: Shooting, point: ShootingEvaluation, direction: Floats
    ) -> float | None:
        """Return the margin."""
        if self.guard == NONE or point.events[self.segment] is None:
            return None
        return float(choice_margins(equations, point, self.segment, self.mode)[self.guard])


@dataclass(frozen=True)
class BoundaryTest(TestFunction):
    """The margin of a guard at an equilibrium."""

    guard: int

    def value(self, equations: Any, point: Any, direction: Floats) -> float:
        """Return the margin."""
        return float(equations.margins(point)[self.guard])


BIFURCATION_TESTS: tuple[TestFunction, ...] = (
    FoldTest(), PeriodDoublingTest(), NeimarkSackerTest(), BranchPointTest(), UnexplainedTest(),
)  # fmt: skip
GUARD_TESTS = (ClosestApproachTest, ContactSpeedTest, SegmentLengthTest, ModeChoiceTest)
ORBIT_TESTS = (*map(type, BIFURCATION_TESTS), *GUARD_TESTS)


def bifurcation_test(kind: str) -> TestFunction:
    """Return the test function of a bifurcation of orbits by its kind."""
    return next(each for each in BIFURCATION_TESTS if each.kind == kind)


def orbit_tests(
    shooting: Shooting, point: ShootingEvaluation, direction: Floats
) -> dict[TestFunction, float]:
    """Return the test functions of an orbit with their values there.

    Closest approaches, contact speeds and lengths are positive on admissible orbits.
    """
    tests: list[TestFunction] = [FoldTest()]
    if direction.size == point.unknowns.size + 1:  # on a branch, not on a curve
        tests.append(BranchPointTest())
    guards = shooting.automaton.guards
    for i, segment in enumerate(shooting.segments):
        tests.append(SegmentLengthTest(MEETING, i))
        guard = segment.guard(shooting.m)
        if guard != NONE:
            tests.append(ContactSpeedTest(kind_of(guards[guard]), guard, i))
    tests += [ClosestApproachTest(kind_of(each), j) for j, each in enumerate(guards)]
    values = {test: test.value(shooting, point, direction) for test in tests}
    return {test: value for test, value in values.items() if value is not None}


def sign_changes(
    before: Mapping[TestFunction, float], after: Mapping[TestFunction, float]
) -> list[tuple[TestFunction, float, float]]:
    """Return the test functions with values of different signs at both ends of a step."""
    pairs = [(test, value, after[test]) for test, value in before.items() if test in after]
    return [(test, value, end) for test, value, end in pairs if value * end < 0.0]


# --- Points of codimension two

CUSP = "cusp"
PLUS, MINUS, PAIR = "multiplier +1", "multiplier -1", "pair of multipliers on the circle"
COSINES = {"1:1": 1.0, "1:2": -1.0, "1:3": -0.5, "1:4": 0.0}
"""Cosine of the angle of a pair on the unit circle, by its resonance."""

NEUTRAL_RESONANCES = ("1:1", "1:2")
"""Resonances beyond which a pair with product one is real."""

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
"""Names that are not composed of the names of curve and test function."""


class CurveTest(TestFunction):
    """A test function that is defined on curves only, for their points of codimension two."""

    def value(self, equations: Any, point: Any, direction: Floats) -> None:
        """Return None."""


@dataclass(frozen=True)
class MultiplierTest(TestFunction):
    """A test function of the multipliers on a curve, for its points of codimension two.

    `kind` is that of the points of the curve.
    """

    test: str  # `PLUS`, `MINUS`, `PAIR`, or a resonance

    @property
    def name(self) -> str:
        """Name of a zero."""
        if self.test in COSINES:
            return f"{self.test} resonance"
        curve, point = FOLLOWED_NAMES.get(self.kind, self.kind), MULTIPLIER_NAMES[self.test]
        return CODIMENSION_TWO_NAMES.get((self.kind, self.test), f"{curve}-{point}")

    def value(self, equations: Any, point: Any, direction: Floats) -> float:
        """Return the value at an orbit of the curve."""
        return self.of(multipliers_at(equations, point))

    def of(self, multipliers: Complexes) -> float:
        """Return the value, excluding the critical multipliers of the curve.

        The value is of order one for any number and size of the multipliers.
        """
        if self.kind == NEIMARK_SACKER:
            i, j, _ = neutral_pair(multipliers)
            if self.test in COSINES:
                return 0.5 * float((multipliers[i] + multipliers[j]).real) - COSINES[self.test]
            multipliers = np.delete(multipliers, [i, j])
        if self.test == PAIR:
            products = np.array([a * b for a, b in itertools.combinations(multipliers.tolist(), 2)])
            factors = (products - 1.0) / (1.0 + np.abs(products))
            sizes = np.abs(factors)
            if not sizes.all():
                return 0.0
            return float(np.prod(factors / sizes).real * sizes.min(initial=1.0))
        target, own = (1.0, FOLD) if self.test == PLUS else (-1.0, PERIOD_DOUBLING)
        factors = (multipliers - target) / (1.0 + np.abs(multipliers))
        if self.kind != own:
            return float(np.prod(factors).real)
        # The derivative of the characteristic polynomial is zero at a double root.
        others = [np.prod(np.delete(factors, k)) for k in range(factors.size)]
        return float(np.sum(others).real)

    def is_zero(self, condition: DefiningSystem, point: Any) -> bool:
        """Return whether a change of sign is a zero.

        The value may change its sign at infinity, or at two real multipliers with product one.
        """
        return self.crosses(multipliers_at(condition.equations, point))

    def crosses(self, multipliers: Complexes) -> bool:
        """Return whether one of the multipliers, or a pair, is at its critical value."""
        if self.test == PAIR:
            if self.kind == NEIMARK_SACKER:
                multipliers = np.delete(multipliers, neutral_pair(multipliers)[:2])
            rotating = multipliers[np.abs(multipliers.imag) > MULTIPLIER_TOLERANCE]
            return bool(np.any(np.abs(np.abs(rotating) - 1.0) < MULTIPLIER_TOLERANCE))
        targets = {PLUS: 1.0, MINUS: -1.0}
        if self.test not in targets:
            return True
        return bool(np.abs(multipliers - targets[self.test]).min() < MULTIPLIER_TOLERANCE)


@dataclass(frozen=True)
class CuspTest(CurveTest):
    """The quadratic coefficient of a fold, zero at a cusp.

    Where only the derivative by the first parameter changes its sign, it jumps.
    """

    kind: str = CUSP
    may_jump: ClassVar[bool] = True

    def on_curve(self, condition: Any, point: Any) -> float:
        """Return the coefficient, by the defining system of the fold."""
        return float(condition.curvature(point))


def curve_tests(kind: str) -> tuple[MultiplierTest | CuspTest, ...]:
    """Return the test functions of multipliers, and of the cusp, on a curve of a kind."""
    names = (PLUS, MINUS, PAIR, *(COSINES if kind == NEIMARK_SACKER else ()))
    found = tuple(MultiplierTest(kind, name) for name in names)
    return (*found, CuspTest()) if kind == FOLD else found


def neutral_pair(multipliers: Any) -> tuple[int, int, float]:
    """Return the indices of the pair with the real product closest to one, and its difference."""
    values = np.asarray(multipliers, dtype=complex).tolist()
    products = [
        (i, j, (values[i] * values[j]).real - 1.0)
        for i, j in itertools.combinations(range(len(values)), 2)
        if (values[i] * values[j]).imag == 0.0
    ]
    return min(products, key=lambda pair: abs(pair[2]))
