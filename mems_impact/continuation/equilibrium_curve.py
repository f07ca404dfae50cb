"""Curves of special points of equilibria in two parameters.

Each kind of point adds one equation to those of the equilibrium, whose size does not depend on the
number of states: a fold the last unknown of the bordered Jacobian, a Hopf point the trace of the
Jacobian on the invariant plane of its pair, a boundary equilibrium the margin of its guard.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.linalg import schur, solve_sylvester

from mems_impact._util.arrays import Complexes, Floats
from mems_impact.continuation.arclength import (
    SHORTER_STEP_REMEDY,
    LocatedEvents,
    PredictorStep,
    StepControl,
    tangent,
)
from mems_impact.continuation.branch import CurveEvent, EquilibriumCurve, EquilibriumEvent
from mems_impact.continuation.curve import BranchPointCurve, CurveProblem, follow
from mems_impact.continuation.equilibrium_branch import (
    BOUNDARY,
    EQUILIBRIUM_LABELS,
    HOPF,
    MIN_IMAGINARY_RATIO,
    EquilibriumProblem,
)
from mems_impact.continuation.higher_derivatives import lyapunov_coefficient
from mems_impact.continuation.test_functions import (
    BRANCH_POINT,
    FOLD,
    MULTIPLIER_TOLERANCE,
    BoundaryTest,
    CurveTest,
    CuspTest,
    DefiningSystem,
    TestFunction,
    sign_changes,
)
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.hybrid.event_loop.workspace import NONE
from mems_impact.orbits.equilibrium import (
    EquilibriumEquations,
    EquilibriumEvaluation,
    EquilibriumState,
    make_equilibrium,
)

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


class EquilibriumFoldCondition(DefiningSystem):
    """A singular Jacobian: the last unknown of the equations bordered by null vectors."""

    def __init__(self, equations: EquilibriumEquations, monitor: TestFunction) -> None:
        super().__init__(equations, monitor)
        self._rows: Floats | None = None  # factors of the rows of the Jacobian
        self._border = np.zeros(0), np.zeros(0)

    def _set_borders(self, point: EquilibriumEvaluation) -> None:
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
        """Return the derivatives -w F_xx v and -w F_xp v; set the borders at `point`."""
        self._set_borders(point)
        w, v, _ = self._vectors(point)
        return np.asarray(-w @ self.equations.derivatives_along(point, v))

    def curvature(self, point: EquilibriumEvaluation) -> float:
        """Return w F_xx v v, zero at a cusp."""
        w, v, _ = self._vectors(point)
        return float(w @ self.equations.derivatives_along(point, v)[:, : v.size] @ v)

    def _vectors(self, point: EquilibriumEvaluation) -> tuple[Floats, Floats, float]:
        """Return the left and right null vectors of the bordered equations, and the value."""
        if self._rows is None:
            self._set_borders(point)
        assert self._rows is not None
        size = point.unknowns.size
        matrix = np.zeros((size + 1, size + 1))
        matrix[:size, :size] = self._rows[:, None] * point.jacobian
        matrix[:size, size], matrix[size, :size] = self._border
        unit = np.eye(size + 1)[size]
        right, left = np.linalg.solve(matrix, unit), np.linalg.solve(matrix.T, unit)
        return left[:size] * self._rows, right[:size], float(right[size])


class HopfCondition(DefiningSystem):
    """A pair of eigenvalues with sum zero: the trace of the Jacobian on its invariant plane.

    The pair has the product nearest to the product at the last point. Trace and product are
    smooth also where the pair becomes real.
    """

    def __init__(self, equations: EquilibriumEquations, monitor: TestFunction) -> None:
        super().__init__(equations, monitor)
        self._product, self._scale = 0.0, 0.0

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
        """Return the derivatives trace(W F_xx V) and trace(W F_xp V) on the invariant plane.

        The pair of the next points is the pair at `point`.
        """
        self._product = self.pair(point).product
        self._scale = self._scale or np.sqrt(abs(self._product))
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


class BoundaryCondition(DefiningSystem):
    """The margin of a guard."""

    monitor: BoundaryTest

    def gradient(self, point: EquilibriumEvaluation) -> Floats:
        """Return the derivatives by unknowns and parameters."""
        gradient: Floats = self.equations.margin_gradient(point, self.monitor.guard)
        return gradient


CONDITIONS: dict[str, type[DefiningSystem]] = {
    FOLD: EquilibriumFoldCondition,
    HOPF: HopfCondition,
    BRANCH_POINT: DefiningSystem,  # whose equation is that of `BranchPointCurve`
    BOUNDARY: BoundaryCondition,
}
"""Defining systems by the kind of special point."""


def condition_of(kind: str, equations: EquilibriumEquations, guard: str) -> DefiningSystem:
    """Return the defining system of a kind of special points.

    Raises InvalidParameter if points of this kind have no curves.
    """
    if kind not in CONDITIONS:
        allowed = "a fold, Hopf point, branch point or boundary equilibrium, which have curves"
        raise InvalidParameter("special", kind, allowed)
    names = [each.name for each in equations.automaton.guards]
    return CONDITIONS[kind](equations, BoundaryTest(kind, names.index(guard) if guard else NONE))


# --- Pairs of eigenvalues


class EigenvaluePair(NamedTuple):
    """Two eigenvalues, by index, with a real sum and a real product."""

    first: int
    second: int
    total: float
    product: float
    size: float  # the largest eigenvalue of the matrix

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


class EigenvalueTest(CurveTest):
    """A test function of the eigenvalues on a curve of equilibria."""

    may_jump: ClassVar[bool] = True


@dataclass(frozen=True)
class ZeroEigenvalueTest(EigenvalueTest):
    """The product of the eigenvalues besides the critical ones of the curve."""

    def on_curve(self, condition: DefiningSystem, point: EquilibriumEvaluation) -> float:
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

    def is_zero(self, condition: DefiningSystem, point: EquilibriumEvaluation) -> bool:
        """Return whether another eigenvalue is zero."""
        sizes = np.abs(np.linalg.eigvals(point.jacobian))
        return bool(sizes.min() < MULTIPLIER_TOLERANCE * np.linalg.norm(point.jacobian))


@dataclass(frozen=True)
class ImaginaryPairTest(EigenvalueTest):
    """The sums of pairs of eigenvalues besides the critical ones of the curve."""

    def on_curve(self, condition: DefiningSystem, point: EquilibriumEvaluation) -> float:
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

    def is_zero(self, condition: DefiningSystem, point: EquilibriumEvaluation) -> bool:
        """Return whether the pair is complex."""
        values = self._others(condition, point)
        pairs = [pair for pair in eigenvalue_pairs(values) if pair.rotates]
        return any(pair.offset < MULTIPLIER_TOLERANCE for pair in pairs)

    def _others(self, condition: DefiningSystem, point: EquilibriumEvaluation) -> Complexes:
        values = np.linalg.eigvals(point.jacobian).astype(complex)
        if isinstance(condition, HopfCondition):
            pair = condition.pair(point)
            return np.delete(values, [pair.first, pair.second])
        if condition.monitor.kind in (FOLD, BRANCH_POINT):
            return np.delete(values, np.argmin(np.abs(values)))
        return values


@dataclass(frozen=True)
class RealPairTest(EigenvalueTest):
    """The product of the pair of a Hopf curve, zero where the pair becomes real."""

    def on_curve(self, condition: DefiningSystem, point: EquilibriumEvaluation) -> float:
        """Return the product, the square of the frequency."""
        assert isinstance(condition, HopfCondition)
        return condition.pair(point).product


@dataclass(frozen=True)
class LyapunovTest(EigenvalueTest):
    """The first Lyapunov coefficient, zero at a Bautin point."""

    def on_curve(self, condition: DefiningSystem, point: EquilibriumEvaluation) -> float | None:
        """Return the coefficient."""
        assert isinstance(condition, HopfCondition)
        return condition.coefficient(point)


@dataclass(frozen=True)
class MarginTest(BoundaryTest):
    """The margin of another guard."""

    may_jump: ClassVar[bool] = True


BOGDANOV_TAKENS, ZERO_HOPF, BAUTIN, HOPF_HOPF = (
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
CODIMENSION_TWO_TESTS: dict[str, tuple[TestFunction, ...]] = {
    FOLD: (
        CuspTest(),
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
    """Continue a special point of equilibria in two parameters; append to `curve` and return it.

    Arguments as in `curve.follow`. Raises InvalidParameter if points of this kind have no curves.
    """
    family = equilibrium.family
    equations = EquilibriumEquations(family, equilibrium.mode, curve.parameters)
    condition = condition_of(curve.kind, equations, curve.guard)

    def begin() -> tuple[EquilibriumCurveProblem, EquilibriumEvaluation]:
        values = np.array([family.value(name) for name in curve.parameters])
        near = equations.evaluate(equilibrium.balance.unknowns, values)
        crossing = curve.kind == BRANCH_POINT
        problem = EquilibriumBranchPointCurve if crossing else EquilibriumCurveProblem
        return problem(curve, condition, (low, high)), near

    return follow(
        curve,
        family,
        begin,
        low=low,
        high=high,
        direction=direction,
        steps=steps,
        progress=progress,
    )


class EquilibriumCurveProblem(
    EquilibriumProblem[EquilibriumState, CurveEvent[EquilibriumState]],
    CurveProblem[EquilibriumEvaluation, EquilibriumState],
):
    """Continuation problem of equilibria at which one condition holds, in two parameters."""

    def __init__(
        self, curve: EquilibriumCurve, condition: DefiningSystem, bounds: tuple[float, float]
    ) -> None:
        self.branch, self.condition, self.bounds = curve, condition, bounds
        self.family, self.parameters = self.equations.family, curve.parameters
        monitor = condition.monitor
        own_guard = monitor.guard if isinstance(monitor, BoundaryTest) else NONE
        self._tests = [
            *CODIMENSION_TWO_TESTS[curve.kind],
            *(
                MarginTest(BOUNDARY_NAMES[curve.kind], j)
                for j, guard in enumerate(self.equations.automaton.guards)
                if j != own_guard and not guard.records
            ),
        ]

    @property
    def equations(self) -> EquilibriumEquations:  # type: ignore[override]
        """The equations of the equilibrium."""
        equations: EquilibriumEquations = self.condition.equations
        return equations

    def solution(self, point: EquilibriumEvaluation) -> EquilibriumState:
        """Return the equilibrium of a point."""
        return make_equilibrium(self.equations, point)

    def name_of(self, test: TestFunction) -> str:
        """Return the name of a zero of `test` on this curve."""
        return test.name

    def tests(self, point: EquilibriumEvaluation, direction: Floats) -> dict[TestFunction, float]:
        """Return the test functions for points of codimension two."""
        values = {test: test.on_curve(self.condition, point) for test in self._tests}
        return {
            test: value
            for test, value in values.items()
            if value is not None and np.isfinite(value)
        }

    def locate(
        self,
        step: PredictorStep[EquilibriumEvaluation],
        length: float,
        before: Mapping[TestFunction, float],
        after: Mapping[TestFunction, float],
    ) -> LocatedEvents[EquilibriumEvaluation, CurveEvent[EquilibriumState]]:
        """Locate points of codimension two in a step, up to the end of the curve."""
        losses = [
            (test, before[test], after[test])
            for test in before
            if isinstance(test, RealPairTest) and after[test] < 0.0
        ]
        loss = next(iter(self.zeros(step, length, losses)), None)
        if loss is not None:
            length = END_RATIO * loss[0]
            after = self.tests(step.at(length).point, step.direction)
        changes = sign_changes(before, after)
        events = [event for _, _, event in self.zeros(step, length, changes)]
        if loss is None:
            return LocatedEvents(events)
        end = loss[2]
        reason = f"{end.kind}: beyond it, the pair of eigenvalues is real, as of a neutral saddle"
        return LocatedEvents([*events, end], end, reason)


class EquilibriumBranchPointCurve(
    BranchPointCurve[EquilibriumEvaluation, EquilibriumState], EquilibriumCurveProblem
):
    """Continuation problem of equilibria at which another branch crosses, in two parameters."""
