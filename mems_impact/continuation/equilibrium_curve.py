"""Curves of special points of equilibria in two parameters.

Each kind of point adds one equation to those of the equilibrium, whose size does not depend on the
number of states: a fold the last unknown of the bordered Jacobian, a Hopf point the trace of the
Jacobian on the invariant plane of its pair, a boundary equilibrium the margin of its guard.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.linalg import schur, solve_sylvester

from mems_impact._util.arrays import Complexes, Floats
from mems_impact.continuation.arclength import (
    CONTINUATION_ERRORS,
    SHORTER_STEP_REMEDY,
    Continuation,
    Corrector,
    LocatedEvents,
    PredictorStep,
    StepControl,
    reason_of,
    tangent,
)
from mems_impact.continuation.branch import CurveEvent, EquilibriumCurve, EquilibriumEvent
from mems_impact.continuation.branch_point_curve import (
    UNFOLDS,
    correct_branch_point,
    curve_tangent,
    unfolding,
)
from mems_impact.continuation.codim1_curve import correct_condition, curve_direction
from mems_impact.continuation.equilibrium_branch import (
    BOUNDARY,
    EQUILIBRIUM_LABELS,
    HOPF,
    MIN_IMAGINARY_RATIO,
    EquilibriumProblem,
)
from mems_impact.continuation.higher_derivatives import lyapunov_coefficient
from mems_impact.continuation.test_functions import BRANCH_POINT, FOLD, MULTIPLIER_TOLERANCE
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.orbits.equilibrium import (
    EquilibriumEquations,
    EquilibriumEvaluation,
    EquilibriumState,
    make_equilibrium,
)
from mems_impact.orbits.shooting import RESIDUAL_TOLERANCE

__all__ = ["branch_event", "follow_equilibrium_curve"]

MAX_ZERO_RATIO = 1e-3  # largest ratio of a test function at a zero to its values at the step's ends
END_RATIO = 1.0 - 1e-4  # part of a step to a loss at which test functions are evaluated


def branch_event(curve: EquilibriumCurve, state: EquilibriumState) -> EquilibriumEvent:
    """Return a point of the curve as a special point of the branch through it."""
    first = curve.parameters[0]
    near = EquilibriumEquations(state.family, state.mode, (first,)).evaluate(
        state.balance.unknowns, np.array([state.family.values[first]])
    )
    label, value = EQUILIBRIUM_LABELS[curve.kind], float(near.values[0])
    return EquilibriumEvent(curve.kind, label, value, state, tangent(near), guard=curve.guard)


# --- Defining systems


class EquilibriumCondition(ABC):
    """The equation that a special point of equilibria adds.

    Parameters
    ----------
    equations : EquilibriumEquations
        With two active parameters.
    """

    kind: ClassVar[str]

    def __init__(self, equations: EquilibriumEquations) -> None:
        self.equations = equations

    @abstractmethod
    def value(self, point: EquilibriumEvaluation) -> float:
        """Return the value of the equation, zero on the curve."""


class ScalarCondition(EquilibriumCondition):
    """One equation with its gradient."""

    derived = False

    @abstractmethod
    def gradient(self, point: EquilibriumEvaluation) -> Floats:
        """Return the derivatives by unknowns and parameters."""

    @abstractmethod
    def set_reference(self, point: EquilibriumEvaluation) -> None:
        """Set the point near which the next points lie."""


class EquilibriumFoldCondition(ScalarCondition):
    """A singular Jacobian: the last unknown of the equations bordered by null vectors."""

    kind = FOLD

    def __init__(self, equations: EquilibriumEquations) -> None:
        super().__init__(equations)
        self._rows: Floats | None = None  # factors of the rows of the Jacobian
        self._border = np.zeros(0), np.zeros(0)

    def set_reference(self, point: EquilibriumEvaluation) -> None:
        """Set rows and borders to the values at a point."""
        sizes = np.abs(point.jacobian).max(axis=1)
        self._rows = 1.0 / np.where(sizes > 0.0, sizes, 1.0)
        vectors, _, rows = np.linalg.svd(self._rows[:, None] * point.jacobian)
        left, border = vectors[:, -1], self._border[0]
        # Singular vectors have arbitrary signs; that of the left one is that of the curvature.
        if border.size and left @ border < 0.0:
            left = -left
        self._border = left, rows[-1]

    def value(self, point: EquilibriumEvaluation) -> float:
        """Return the last unknown of the bordered equations."""
        return self._vectors(point)[2]

    def gradient(self, point: EquilibriumEvaluation) -> Floats:
        """Return the derivatives -w F_xx v and -w F_xp v."""
        w, v, _ = self._vectors(point)
        return np.asarray(-w @ self.equations.derivatives_along(point, v))

    def curvature(self, point: EquilibriumEvaluation) -> float:
        """Return w F_xx v v, zero at a cusp."""
        w, v, _ = self._vectors(point)
        return float(w @ self.equations.derivatives_along(point, v)[:, : v.size] @ v)

    def _vectors(self, point: EquilibriumEvaluation) -> tuple[Floats, Floats, float]:
        """Return the left and right null vectors of the bordered equations, and the value."""
        if self._rows is None:
            self.set_reference(point)
        assert self._rows is not None
        size = point.unknowns.size
        matrix = np.zeros((size + 1, size + 1))
        matrix[:size, :size] = self._rows[:, None] * point.jacobian
        matrix[:size, size], matrix[size, :size] = self._border
        unit = np.eye(size + 1)[size]
        right, left = np.linalg.solve(matrix, unit), np.linalg.solve(matrix.T, unit)
        return left[:size] * self._rows, right[:size], float(right[size])


class HopfCondition(ScalarCondition):
    """A pair of eigenvalues with sum zero: the trace of the Jacobian on its invariant plane.

    The pair is the one whose product is nearest to that at the last point. Trace and product are
    smooth also where the pair becomes real.
    """

    kind = HOPF

    def __init__(self, equations: EquilibriumEquations) -> None:
        super().__init__(equations)
        self._product, self._scale = 0.0, 0.0

    def set_reference(self, point: EquilibriumEvaluation) -> None:
        """Set the product of the most neutral pair to its value at a point."""
        pair = self.pair(point)
        self._product = pair.product
        self._scale = self._scale or np.sqrt(abs(pair.product))

    def pair(self, point: EquilibriumEvaluation) -> EigenvaluePair:
        """Return the critical pair."""
        values = np.linalg.eigvals(point.jacobian).astype(complex)
        pairs = eigenvalue_pairs(values)
        if not pairs:
            raise OrbitError("no pair of eigenvalues is on the imaginary axis", SHORTER_STEP_REMEDY)
        if not self._scale:
            rotating = [pair for pair in pairs if pair.rotates]
            return min(rotating or pairs, key=lambda pair: pair.offset)
        return min(pairs, key=lambda pair: abs(pair.product - self._product) + pair.total**2)

    def value(self, point: EquilibriumEvaluation) -> float:
        """Return the sum of the pair, relative to the frequency at the start of the curve."""
        return self.pair(point).total / self._scale

    def gradient(self, point: EquilibriumEvaluation) -> Floats:
        """Return the derivatives trace(W F_xx V) and trace(W F_xp V) on the invariant plane."""
        right, left = self._plane(point)
        by_unknowns = [
            w @ self.equations.derivatives_along(point, v)
            for w, v in zip(left.T, right.T, strict=True)
        ]
        return np.asarray(sum(by_unknowns)) / self._scale

    def _plane(self, point: EquilibriumEvaluation) -> tuple[Floats, Floats]:
        """Return bases V and W of the right and left invariant planes, ``W^T V = 1``."""
        matrix, pair = point.jacobian, self.pair(point)
        pair_values = np.linalg.eigvals(matrix)[[pair.first, pair.second]]

        def selected(real: float, imaginary: float) -> bool:
            return bool(np.abs(pair_values - complex(real, imaginary)).min() < pair.tolerance)

        form, basis, count = schur(matrix, sort=selected)
        if count != 2:
            raise OrbitError("the plane of the pair could not be separated", SHORTER_STEP_REMEDY)
        right, left = basis[:, :2], basis[:, :2]
        if len(matrix) > 2:
            coupled = solve_sylvester(form[:2, :2], -form[2:, 2:], form[:2, 2:])
            left = basis[:, :2] + basis[:, 2:] @ coupled.T
        return right, left

    def coefficient(self, point: EquilibriumEvaluation) -> float | None:
        """Return the first Lyapunov coefficient; None if the pair is real."""
        pair = self.pair(point)
        if not pair.rotates:
            return None
        omega = float(np.sqrt(pair.product))
        values, vectors = np.linalg.eig(point.jacobian)
        i = int(np.argmin(np.abs(values - 1j * omega)))
        right = vectors[:, i]
        lefts, left_vectors = np.linalg.eig(point.jacobian.T)
        left = np.conj(left_vectors[:, int(np.argmin(np.abs(lefts - 1j * omega)))])
        left = left / np.conj(np.conj(left) @ right)
        return lyapunov_coefficient(
            partial(self.equations.derivatives_along, point), point.jacobian, right, left, omega
        )


class BoundaryCondition(ScalarCondition):
    """The margin of a guard."""

    kind = BOUNDARY

    def __init__(self, equations: EquilibriumEquations, guard: int) -> None:
        super().__init__(equations)
        self.guard = guard

    def set_reference(self, point: EquilibriumEvaluation) -> None:
        """Do nothing: the margin is defined everywhere."""

    def value(self, point: EquilibriumEvaluation) -> float:
        """Return the margin."""
        return float(self.equations.margins(point)[self.guard])

    def gradient(self, point: EquilibriumEvaluation) -> Floats:
        """Return its derivatives."""
        return self.equations.margin_gradient(point, self.guard)


class BranchPointCondition(EquilibriumCondition):
    """A rank-deficient Jacobian by unknowns and parameter.

    The condition is g = 0 of `branch_points`, which has two components.
    """

    kind = BRANCH_POINT

    def value(self, point: EquilibriumEvaluation) -> float:
        """Return the residual of the branch point condition at a solution."""
        return unfolding(point)


def condition_of(kind: str, equations: EquilibriumEquations, guard: str) -> EquilibriumCondition:
    """Return the defining system of a kind of special points.

    Raises
    ------
    InvalidParameter
        If points of this kind have no normal form.
    """
    if kind == FOLD:
        return EquilibriumFoldCondition(equations)
    if kind == HOPF:
        return HopfCondition(equations)
    if kind == BRANCH_POINT:
        return BranchPointCondition(equations)
    if kind == BOUNDARY:
        names = [each.name for each in equations.automaton.guards]
        return BoundaryCondition(equations, names.index(guard))
    allowed = "a fold, Hopf point, branch point or boundary equilibrium, which have curves"
    raise InvalidParameter("special", kind, allowed)


# --- Pairs of eigenvalues


class EigenvaluePair(NamedTuple):
    """Two eigenvalues with a real sum and a real product.

    Attributes
    ----------
    first, second : int
        Their indices.
    total, product : float
    size : float
        The largest eigenvalue of the matrix.
    """

    first: int
    second: int
    total: float
    product: float
    size: float

    @property
    def offset(self) -> float:
        """Sum relative to the size of the pair, zero on the imaginary axis."""
        return abs(self.total) / max(np.sqrt(abs(self.product)), 1e-300)

    @property
    def rotates(self) -> bool:
        """Whether the pair is complex."""
        return self.product - 0.25 * self.total**2 > (MIN_IMAGINARY_RATIO * self.total) ** 2

    @property
    def tolerance(self) -> float:
        """Rounding error of an eigenvalue that two computations of a matrix have."""
        return 1e-12 * max(self.size, 1e-300)


def eigenvalue_pairs(values: Complexes) -> list[EigenvaluePair]:
    """Return the pairs among eigenvalues that are conjugate, or both real."""
    size, pairs = float(np.abs(values).max(initial=0.0)), []
    for i, j in itertools.combinations(range(values.size), 2):
        a, b = complex(values[i]), complex(values[j])
        if a.imag == 0.0 == b.imag or a == b.conjugate():
            pairs.append(EigenvaluePair(i, j, (a + b).real, (a * b).real, size))
    return pairs


# --- Test functions of points of codimension two


@dataclass(frozen=True)
class CodimensionTwoTest(ABC):
    """A test function on a curve of equilibria.

    Attributes
    ----------
    name : str
        Name of a zero.
    """

    __test__ = False  # keeps pytest from collecting the class

    name: str

    @abstractmethod
    def value(self, condition: EquilibriumCondition, point: EquilibriumEvaluation) -> float | None:
        """Return the value at a point of the curve; None where it is undefined."""

    def is_zero(self, condition: EquilibriumCondition, point: EquilibriumEvaluation) -> bool:
        """Return whether a change of sign is a zero."""
        return True


@dataclass(frozen=True)
class ZeroEigenvalueTest(CodimensionTwoTest):
    """The product of the eigenvalues besides the critical ones of the curve."""

    def value(self, condition: EquilibriumCondition, point: EquilibriumEvaluation) -> float:
        """Return the product of the eigenvalues relative to their sizes."""
        values = np.linalg.eigvals(point.jacobian).astype(complex)
        if isinstance(condition, HopfCondition):
            pair = condition.pair(point)
            values = np.delete(values, [pair.first, pair.second])
        # Of order one, and smooth at zero, as the matrix is not zero at a double zero.
        factors = values / (np.abs(values) + np.linalg.norm(point.jacobian))
        if isinstance(condition, EquilibriumFoldCondition):
            # The product of the others, as a derivative of the characteristic polynomial at zero:
            # smooth also at a double zero.
            others = [np.prod(np.delete(factors, k)) for k in range(factors.size)]
            return float(np.sum(others).real)
        return float(np.prod(factors).real)

    def is_zero(self, condition: EquilibriumCondition, point: EquilibriumEvaluation) -> bool:
        """Return whether another eigenvalue is zero."""
        sizes = np.abs(np.linalg.eigvals(point.jacobian))
        return bool(sizes.min() < MULTIPLIER_TOLERANCE * np.linalg.norm(point.jacobian))


@dataclass(frozen=True)
class ImaginaryPairTest(CodimensionTwoTest):
    """The sums of pairs of eigenvalues besides the critical ones of the curve."""

    def value(self, condition: EquilibriumCondition, point: EquilibriumEvaluation) -> float:
        """Return the signed sum that is nearest to zero, relative to its size."""
        values = self._others(condition, point)
        sums = np.array([a + b for a, b in itertools.combinations(values.tolist(), 2)])
        sizes = np.array([abs(a) + abs(b) for a, b in itertools.combinations(values.tolist(), 2)])
        if not sums.size:
            return 1.0
        factors = sums / np.maximum(sizes, 1e-300)
        signs = np.abs(factors)
        if not signs.all():
            return 0.0
        return float(np.prod(factors / signs).real * signs.min())

    def is_zero(self, condition: EquilibriumCondition, point: EquilibriumEvaluation) -> bool:
        """Return whether the pair is complex."""
        values = self._others(condition, point)
        pairs = [pair for pair in eigenvalue_pairs(values) if pair.rotates]
        return any(pair.offset < MULTIPLIER_TOLERANCE for pair in pairs)

    def _others(self, condition: EquilibriumCondition, point: EquilibriumEvaluation) -> Complexes:
        values = np.linalg.eigvals(point.jacobian).astype(complex)
        if isinstance(condition, HopfCondition):
            pair = condition.pair(point)
            return np.delete(values, [pair.first, pair.second])
        if isinstance(condition, EquilibriumFoldCondition | BranchPointCondition):
            return np.delete(values, np.argmin(np.abs(values)))
        return values


@dataclass(frozen=True)
class RealPairTest(CodimensionTwoTest):
    """The product of the pair of a Hopf curve, zero where the pair becomes real."""

    def value(self, condition: EquilibriumCondition, point: EquilibriumEvaluation) -> float:
        """Return the product, the square of the frequency."""
        assert isinstance(condition, HopfCondition)
        return condition.pair(point).product


@dataclass(frozen=True)
class LyapunovTest(CodimensionTwoTest):
    """The first Lyapunov coefficient, zero at a Bautin point."""

    def value(self, condition: EquilibriumCondition, point: EquilibriumEvaluation) -> float | None:
        """Return the coefficient."""
        assert isinstance(condition, HopfCondition)
        return condition.coefficient(point)


@dataclass(frozen=True)
class CurvatureTest(CodimensionTwoTest):
    """The quadratic coefficient of a fold, zero at a cusp."""

    def value(self, condition: EquilibriumCondition, point: EquilibriumEvaluation) -> float:
        """Return the coefficient."""
        assert isinstance(condition, EquilibriumFoldCondition)
        return condition.curvature(point)


@dataclass(frozen=True)
class MarginTest(CodimensionTwoTest):
    """The margin of another guard."""

    guard: int

    def value(self, condition: EquilibriumCondition, point: EquilibriumEvaluation) -> float | None:
        """Return the margin; None if the guard is not active."""
        margin = float(condition.equations.margins(point)[self.guard])
        return margin if np.isfinite(margin) else None


CUSP, BOGDANOV_TAKENS, ZERO_HOPF, BAUTIN, HOPF_HOPF = (
    "cusp",
    "Bogdanov-Takens",
    "zero-Hopf",
    "Bautin",
    "Hopf-Hopf",
)
BOUNDARY_NAMES = {
    FOLD: "boundary-fold",
    HOPF: "boundary-Hopf",
    BRANCH_POINT: "boundary-branch point",
    BOUNDARY: "double boundary",
}
"""Names of points at which an equilibrium meets a guard, by the kind of the curve."""
CODIMENSION_TWO_TESTS: dict[str, tuple[CodimensionTwoTest, ...]] = {
    FOLD: (
        CurvatureTest(CUSP),
        ZeroEigenvalueTest(BOGDANOV_TAKENS),
        ImaginaryPairTest(ZERO_HOPF),
    ),
    HOPF: (
        RealPairTest(BOGDANOV_TAKENS),
        ZeroEigenvalueTest(ZERO_HOPF),
        ImaginaryPairTest(HOPF_HOPF),
        LyapunovTest(BAUTIN),
    ),
    BRANCH_POINT: (ImaginaryPairTest("branch point-Hopf"),),
    BOUNDARY: (
        ZeroEigenvalueTest(BOUNDARY_NAMES[FOLD]),
        ImaginaryPairTest(BOUNDARY_NAMES[HOPF]),
    ),
}
"""Test functions by the kind of the curve."""


# --- The curve


def follow_equilibrium_curve(
    equilibrium: EquilibriumState,
    curve: EquilibriumCurve,
    *,
    low: float,
    high: float,
    direction: float,
    steps: StepControl,
    progress: Callable[[float], None] | None = None,
) -> EquilibriumCurve:
    """Continue a special point of equilibria in two parameters.

    Parameters
    ----------
    equilibrium : EquilibriumState
        At the special point.
    curve : SolutionCurve
        The curve without points.
    low, high : float
        Bounds of the second parameter.
    direction : float
        Sign of the first step in the second parameter.
    steps : StepControl
    progress : callable, optional
        Called with every value of the second parameter.

    Returns
    -------
    SolutionCurve
        The same.

    Raises
    ------
    InvalidParameter
        If points of this kind have no curves.
    """
    family = equilibrium.family
    equations = EquilibriumEquations(family, equilibrium.mode, curve.parameters)
    condition = condition_of(curve.kind, equations, curve.guard)
    values = np.array([family.value(name) for name in curve.parameters])
    try:
        near = equations.evaluate(equilibrium.balance.unknowns, values)
        problem = (
            _ScalarConditionCurve(curve, condition, (low, high))
            if isinstance(condition, ScalarCondition)
            else _BranchPointCurve(curve, condition, (low, high))
        )
        first_direction = problem.tangent(near, direction * np.eye(near.unknowns.size + 2)[-1])
        start = np.concatenate([near.unknowns, values])
        point = problem.corrector(near)(start, first_direction, start).point
        problem.begin(point, first_direction)
    except CONTINUATION_ERRORS as error:
        curve.ended = f"the first point could not be corrected: {reason_of(error, family)}"
        return curve
    try:
        for solution in Continuation(
            problem, point, first_direction, low=low, high=high, steps=steps
        ):
            if progress is not None:
                progress(solution.family.value(curve.parameters[1]))
    except CONTINUATION_ERRORS as error:
        curve.ended = reason_of(error, family)
    return curve


class _EquilibriumCurveProblem(EquilibriumProblem[EquilibriumState, CurveEvent[EquilibriumState]]):
    """Equilibria at which one condition holds, in two parameters."""

    noun = "curve"

    def __init__(
        self,
        curve: EquilibriumCurve,
        condition: EquilibriumCondition,
        bounds: tuple[float, float],
    ) -> None:
        self.branch, self.condition, self.bounds = curve, condition, bounds
        self.equations = condition.equations
        self.family, self.parameters = self.equations.family, curve.parameters
        own_guard = condition.guard if isinstance(condition, BoundaryCondition) else -1
        name = BOUNDARY_NAMES[condition.kind]
        self._tests = [
            *CODIMENSION_TWO_TESTS[condition.kind],
            *(
                MarginTest(name, j)
                for j, guard in enumerate(self.equations.automaton.guards)
                if j != own_guard and not guard.records
            ),
        ]

    def record(self, point: EquilibriumEvaluation, direction: Floats) -> None:
        """Append an equilibrium to the curve."""
        self.branch.points.append(make_equilibrium(self.equations, point))

    def tests(
        self, point: EquilibriumEvaluation, direction: Floats
    ) -> dict[CodimensionTwoTest, float]:
        """Return the test functions for points of codimension two."""
        values = {test: test.value(self.condition, point) for test in self._tests}
        return {test: value for test, value in values.items() if value is not None}

    def locate(
        self,
        step: PredictorStep[EquilibriumEvaluation],
        length: float,
        before: Mapping[CodimensionTwoTest, float],
        after: Mapping[CodimensionTwoTest, float],
    ) -> LocatedEvents[EquilibriumEvaluation, CurveEvent[EquilibriumState]]:
        """Locate points of codimension two in a step, up to one that ends the curve."""
        loss: tuple[float, CurveEvent[EquilibriumState]] | None = None
        for test in before:
            if isinstance(test, RealPairTest) and after[test] < 0.0:
                loss = self._locate(test, step, length, (before[test], after[test]))
                if loss is not None:
                    length = END_RATIO * loss[0]
                    after = self.tests(step.at(length).point, step.direction)
        candidates: list[tuple[float, CurveEvent[EquilibriumState]]] = []
        for test, value in before.items():
            if test in after and value * after[test] < 0.0:
                located = self._locate(test, step, length, (value, after[test]))
                if located is not None:
                    candidates.append(located)
        candidates.sort(key=lambda item: item[0])
        events = [event for _, event in candidates if self._inside(event.values[1])]
        if loss is None or not self._inside(loss[1].values[1]):
            return LocatedEvents(events)
        reason = (
            f"{loss[1].kind}: beyond it, the pair of eigenvalues is real, as of a neutral saddle"
        )
        return LocatedEvents([*events, loss[1]], loss[1], reason)

    def pass_loss(
        self,
        located: LocatedEvents[EquilibriumEvaluation, CurveEvent[EquilibriumState]],
        length: float,
    ) -> str:
        """End the curve at a loss."""
        assert located.loss is not None
        self.branch.points.append(located.loss.solution)
        return located.reason

    def _inside(self, value: float) -> bool:
        return bool(self.bounds[0] <= value <= self.bounds[1])

    def _locate(
        self,
        test: CodimensionTwoTest,
        step: PredictorStep[EquilibriumEvaluation],
        length: float,
        ends: tuple[float, float],
    ) -> tuple[float, CurveEvent[EquilibriumState]] | None:
        """Return the position in a step and the point of a zero of `test`, with values `ends`."""

        def value(point: EquilibriumEvaluation) -> float:
            value_on_curve = test.value(self.condition, point)
            if value_on_curve is None:
                raise ValueError(test)
            return value_on_curve

        try:
            position = step.zero(value, length)
            point = step.at(position).point
        except ValueError as error:
            raise OrbitError(f"{test.name} could not be located", SHORTER_STEP_REMEDY) from error
        if not test.is_zero(self.condition, point):
            return None
        if abs(value(point)) > MAX_ZERO_RATIO * min(map(abs, ends)):
            return None  # a jump
        equilibrium = make_equilibrium(self.equations, point)
        values = float(point.values[0]), float(point.values[1])
        return position, CurveEvent(test.name, values, equilibrium)


class _ScalarConditionCurve(_EquilibriumCurveProblem):
    """Equilibria at which one equation holds, in two parameters."""

    def __init__(
        self, curve: EquilibriumCurve, condition: ScalarCondition, bounds: tuple[float, float]
    ) -> None:
        super().__init__(curve, condition, bounds)
        self._condition = condition
        self._linear: tuple[EquilibriumEvaluation, Floats] | None = None

    def corrector(self, point: EquilibriumEvaluation) -> Corrector[EquilibriumEvaluation]:
        """Return the corrector of a step."""
        return partial(correct_condition, self.equations, self._condition, self._gradient(point))

    def _gradient(self, point: EquilibriumEvaluation) -> Floats:
        """Return the gradient of the condition, whose reference becomes this point."""
        if self._linear is None or self._linear[0] is not point:
            self._condition.set_reference(point)
            self._linear = point, self._condition.gradient(point)
        return self._linear[1]

    def solve(self, guess: Floats) -> EquilibriumEvaluation:
        """Correct a guess at its value of the second parameter."""
        point = self.equations.evaluate(guess[:-2], guess[-2:])
        gradient, fixed = self._gradient(point), np.eye(guess.size)[-1]
        return correct_condition(
            self.equations, self._condition, gradient, guess, fixed, guess
        ).point

    def tangent(self, point: EquilibriumEvaluation, direction: Floats) -> Floats:
        """Return the unit tangent of the curve, oriented along `direction`."""
        vector = curve_direction(point, self._gradient(point))
        return vector if vector @ direction >= 0.0 else -vector


class _BranchPointCurve(_EquilibriumCurveProblem):
    """Equilibria at which another branch crosses, in two parameters."""

    def corrector(self, point: EquilibriumEvaluation) -> Corrector[EquilibriumEvaluation]:
        """Return the corrector of a step."""
        self._near = point
        return partial(correct_branch_point, self.equations, point)

    def solve(self, guess: Floats) -> EquilibriumEvaluation:
        """Correct a guess at its value of the second parameter."""
        point = self.corrector(self._near)(guess, np.eye(guess.size)[-1], guess).point
        if unfolding(point) > RESIDUAL_TOLERANCE:
            raise OrbitError(UNFOLDS, SHORTER_STEP_REMEDY)
        return point

    def tangent(self, point: EquilibriumEvaluation, direction: Floats) -> Floats:
        """Return the unit tangent of the curve, oriented along `direction`."""
        vector = curve_tangent(self.equations, point)
        return vector if vector @ direction >= 0.0 else -vector

    def record(self, point: EquilibriumEvaluation, direction: Floats) -> None:
        """Append an equilibrium to the curve, unless it is no branch point."""
        if unfolding(point) <= RESIDUAL_TOLERANCE:
            super().record(point, direction)

    def end_at(self, point: EquilibriumEvaluation) -> str:
        """Return the reason for an end where the branch point unfolds."""
        if unfolding(point) <= RESIDUAL_TOLERANCE:
            return ""
        name = self.parameters[1]
        location = self.family.amount(name, self.branch.points[-1].family.values[name])
        return f"{UNFOLDS}: at another value of {name} than {location}, no branch crosses"
