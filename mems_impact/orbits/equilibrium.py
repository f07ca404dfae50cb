"""Equilibria within one mode."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, qr
from scipy.sparse import csr_array
from scipy.sparse.csgraph import structural_rank

from mems_impact._util.arrays import Floats
from mems_impact.errors import OrbitError
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.differences import sixth_order_difference
from mems_impact.hybrid.variational.derivatives import free_components
from mems_impact.integrators.dual_numbers import copy_for_tangents, derivatives
from mems_impact.orbits.family import Family
from mems_impact.orbits.linear_equations import Linearization
from mems_impact.orbits.newton import solve_at
from mems_impact.orbits.spectrum import eigenvalues_stable

DIFFERENCE_STEPS = (1e-2, 1e-3, 1e-4, 1e-5)  # relative to a value, or to 1 if that is larger
OUTER_STEP = 1e-2  # of differences of derivatives, relative to the point
STRUCTURE_DISTANCE = 1e-4  # to a state with the same structural zeros, relative to the state
CANCELLATION_RTOL = 1e-13  # error of an entry on a manifold, relative to its largest term
FLOW_ERROR = 1e-9
EQUILIBRIUM_MARGIN_TOLERANCE = 1e-9  # tolerated violation of a margin by an admissible equilibrium


@dataclass(frozen=True, eq=False)
class EquilibriumEvaluation(Linearization):
    """One evaluation of the equations of an equilibrium in f unknowns and k active parameters.

    The residual is zero if the flow is: the time derivatives of the unknowns. In a mode with a
    constraint manifold: those at the projected state, plus the change by the projection, so that
    distances from the manifold decay at rate one.
    """

    unknowns: Floats  # components of the state that are not cyclic, shape (f,)
    values: Floats  # of the active parameters, shape (k,)
    residual: Floats
    derivatives: Floats  # by the unknowns and the active parameters, shape (f, f + k)


@dataclass(frozen=True)
class EquilibriumEquations:
    """The equations of the equilibria of one mode, in a family."""

    family: Family
    mode: int
    active: tuple[str, ...] = ()  # names of the parameters by which to differentiate
    tolerance: ClassVar[float] = 0.0  # steps end at rounding: they cost little

    @cached_property
    def automaton(self) -> Automaton:
        """The automaton of the family."""
        return self.family.automaton

    @cached_property
    def free(self) -> tuple[int, ...]:
        """The components of the state that are not cyclic."""
        return tuple(free_components(self.automaton))

    def error(self, point: EquilibriumEvaluation, rate: float) -> float:
        """Return the error of a flow, whose terms may cancel, relative to `rate`."""
        return FLOW_ERROR

    def integration_error(self, point: EquilibriumEvaluation) -> Floats:
        """Return zeros: nothing is integrated."""
        return np.zeros(point.residual.size)

    def state(self, unknowns: Floats) -> Floats:
        """Return the whole state, shape (n,); cyclic components are zero."""
        y = np.zeros(len(self.automaton.states))
        y[list(self.free)] = unknowns
        return y

    def evaluate(self, unknowns: Floats, values: Floats) -> EquilibriumEvaluation:
        """Evaluate the flow and its derivatives; raise OrbitError where the flow is undefined."""
        try:
            x, frame = self._numbers(unknowns, values)
            residual = np.array(self._rates(_original, x.tolist()), dtype=float)
            derivatives = _derivatives(self._rates, x, frame)
        except (ArithmeticError, ValueError) as error:
            names, amount = self.family.automaton.states, self.family.amount
            components = zip(self.free, unknowns.tolist(), strict=True)
            location = ", ".join(
                f"{names[i]} = {amount(names[i], value)}" for i, value in components
            )
            raise OrbitError(
                f"the flow is not defined at {location}: {error}", "take another guess"
            ) from error
        return EquilibriumEvaluation(unknowns, values, residual, derivatives)

    def derivatives_along(self, point: EquilibriumEvaluation, *vectors: Floats) -> Floats:
        """Return a derivative of the equations of second or third order, shape (f, f + k).

        Columns are derivatives by unknowns and parameters of the derivative along the vectors. A
        vector has the shape (f,); that of a second derivative may have the shape (f + k,).
        """
        x, frame = self._numbers(point.unknowns, point.values)
        size = point.unknowns.size
        along = [frame[:, : vector.size] @ vector for vector in vectors]
        second = _derivatives(self._rates, x, frame, *along)
        change = vectors[0][size:]
        if change.any():  # the parameter array may be a nonlinear function of the values

            def moved(step: float) -> Floats:
                return self._numbers(point.unknowns, point.values + step * change)[1]

            h = OUTER_STEP * max(1.0, float(np.abs(point.values).max())) / np.abs(change).max()
            second = second + _derivatives(self._rates, x, sixth_order_difference(moved, h))
        return second

    def is_exact(self, point: EquilibriumEvaluation) -> bool:
        """Return whether the functions take numbers with tangents."""
        try:
            derivatives(
                partial(self._rates, copy_for_tangents),
                *self._numbers(point.unknowns, point.values),
            )
        except Exception:
            return False
        return True

    def margin_gradient(self, point: EquilibriumEvaluation, guard: int) -> Floats:
        """Return the derivatives of a margin by unknowns and parameters, shape (f + k,)."""

        def margin(copy: _Copy, numbers: list[Any]) -> list[Any]:
            margins, rates = ([1.0] * len(self.automaton.guards) for _ in range(2))
            y, p = self._split(numbers)
            copy(self.automaton.margins)(self.mode, 0.0, y, p, margins, rates)
            return [margins[guard]]

        return _derivatives(margin, *self._numbers(point.unknowns, point.values))[0]

    def margins(self, balance: EquilibriumEvaluation) -> Floats:
        """Return the margins of all guards, shape (m,); positive where the mode is admissible."""
        y, p = self.state(balance.unknowns), self._parameters(balance.values)
        margins, _ = self.automaton.margins_at(self.mode, 0.0, y, p, np.inf)
        return margins

    def mode_after(self, balance: EquilibriumEvaluation, guard: int) -> int:
        """Return the mode to which the transition of a guard leads."""
        y, p = self.state(balance.unknowns), self._parameters(balance.values)
        return self.automaton.state_after(self.mode, guard, 0.0, y, p)[0]

    def projected(self, balance: EquilibriumEvaluation) -> EquilibriumEvaluation:
        """Return an evaluation whose unknowns satisfy the constraints of the mode to rounding."""
        x, _ = self._numbers(balance.unknowns, balance.values)
        return replace(balance, unknowns=np.array(self._projected(_original, x.tolist())))

    def linearization(self, balance: EquilibriumEvaluation) -> tuple[Floats, int]:
        """Return the derivative of the flow, shape (d, d), and its structural nullity.

        In a mode with a constraint manifold of dimension d the derivative is that in its tangent
        space; otherwise d is f.
        """
        # Structural zeros determine the nullity, since at a fold an eigenvalue is small as well.
        matrix, zero, coordinates = self._linear(balance)
        if _nullity(zero):
            # An entry that is zero by coincidence, as at a fold, is nonzero at a nearby state.
            u = balance.unknowns
            shift = STRUCTURE_DISTANCE * max(1.0, float(np.abs(u).max()))
            near = self.evaluate(u + shift * np.cos(np.arange(u.size)), balance.values)
            zero &= self._linear(near, coordinates)[1]
        return matrix, _nullity(zero)

    def _linear(
        self, point: EquilibriumEvaluation, coordinates: NDArray[np.int64] | None = None
    ) -> tuple[Floats, NDArray[np.bool_], NDArray[np.int64] | None]:
        """Return the derivative on the manifold, its zeros, and coordinates of the manifold."""
        if self.mode not in self.automaton.constrained:
            return point.jacobian, point.jacobian == 0.0, None
        x, frame = self._numbers(point.unknowns, point.values)
        size = point.unknowns.size
        projection = _derivatives(self._projected, x, frame)[:, :size]
        vectors = np.linalg.svd(projection)[0][:, : round(float(np.trace(projection)))]
        if coordinates is None:
            coordinates = qr(vectors.T, mode="r", pivoting=True)[1][: vectors.shape[1]]
        basis = vectors @ np.linalg.inv(vectors[coordinates])
        x[:size] = self._projected(_original, x.tolist())
        rows = _derivatives(self._flow, x, frame)[coordinates, :size]
        matrix = rows @ basis
        # Entries that contact forces cancel are zero up to rounding.
        sizes = [np.abs(each).max(axis=1, initial=0.0) for each in (rows, basis.T)]
        return matrix, np.abs(matrix) <= CANCELLATION_RTOL * np.outer(*sizes), coordinates

    def _numbers(self, unknowns: Floats, values: Floats) -> tuple[Floats, Floats]:
        """Return unknowns and parameter array, and their derivatives by unknowns and values."""
        parameters = self._parameters(values)
        family = self.family.at(**dict(zip(self.active, values.tolist(), strict=True)))
        rates = [family.derivative(name)[0] for name in self.active]
        columns = np.array(rates).reshape(len(rates), parameters.size).T
        return np.append(unknowns, parameters), block_diag(np.eye(unknowns.size), columns)

    def _parameters(self, values: Floats) -> Floats:
        changes = dict(zip(self.active, values.tolist(), strict=True))
        return np.asarray(self.family.numbers(**changes).parameters, dtype=float)

    # Functions of unknowns and parameter array, which call copies of the automaton's functions.

    def _split(self, numbers: list[Any]) -> tuple[list[Any], list[Any]]:
        """Return the whole state and the parameter array."""
        y: list[Any] = [0.0] * len(self.automaton.states)
        for i, number in zip(self.free, numbers, strict=False):
            y[i] = number
        return y, numbers[len(self.free) :]

    def _rates(self, copy: _Copy, numbers: list[Any]) -> list[Any]:
        if self.mode not in self.automaton.constrained:
            return self._flow(copy, numbers)
        projected = self._projected(copy, numbers)
        rates = self._flow(copy, projected + numbers[len(projected) :])
        return [a + (b - c) for a, b, c in zip(rates, projected, numbers, strict=False)]

    def _flow(self, copy: _Copy, numbers: list[Any]) -> list[Any]:
        y, p = self._split(numbers)
        slope: list[Any] = [0.0] * len(y)
        copy(self.automaton.flow)(self.mode, 0.0, y, p, slope)
        return [slope[i] for i in self.free]

    def _projected(self, copy: _Copy, numbers: list[Any]) -> list[Any]:
        """Return the unknowns projected onto the constraint manifold of the mode."""
        y, p = self._split(numbers)
        if self.mode in self.automaton.constrained:
            code = self.automaton.projection_code
            copy(self.automaton.transition)(self.mode, code, 0.0, y, p)
        return [y[i] for i in self.free]


@dataclass(frozen=True)
class EquilibriumState:
    """An equilibrium of a mode."""

    family: Family  # at the values of the equilibrium
    mode: int
    balance: EquilibriumEvaluation
    # Eigenvalues of the Jacobian of the flow, largest real part first, without the zeros of
    # `nullity`; restricted to the constraint manifold if contacts hold or the state slides.
    eigenvalues: NDArray[np.complex128]
    # Dimension of the continuum of equilibria that contains it, as for a stuck or resting body; 0
    # for an isolated equilibrium.
    nullity: int
    # Of all guards, shape (m,); positive for guards that are not active in the mode.
    margins: Floats
    # Whether all eigenvalues have negative real parts; None if one is imaginary within its error
    # and none has a positive real part.
    stable: bool | None

    @property
    def equations(self) -> EquilibriumEquations:
        """The equations that it solves."""
        return EquilibriumEquations(self.family, self.mode)

    @property
    def state(self) -> Floats:
        """The whole state, shape (n,)."""
        return self.equations.state(self.balance.unknowns)

    @property
    def admissible(self) -> bool:
        """Whether no guard of the mode has a negative margin there; see `violated`."""
        return not self.violated

    @property
    def violated(self) -> tuple[str, ...]:
        """The guards with negative margins, at a virtual equilibrium.

        A guard that waits for a positive margin counts too: whether a guard waits depends on the
        motion that leads to the equilibrium.
        """
        return self._guards_at(-math.inf, -EQUILIBRIUM_MARGIN_TOLERANCE)

    @property
    def boundaries(self) -> tuple[str, ...]:
        """The guards whose margins are zero at a boundary equilibrium."""
        return self._guards_at(-EQUILIBRIUM_MARGIN_TOLERANCE, EQUILIBRIUM_MARGIN_TOLERANCE)

    def _guards_at(self, low: float, high: float) -> tuple[str, ...]:
        guards = zip(self.family.automaton.guards, self.margins.tolist(), strict=True)
        return tuple(
            guard.name for guard, margin in guards if low <= margin < high and not guard.records
        )


def find_equilibrium(family: Family, mode: int, guess: Floats) -> EquilibriumState:
    """Find an equilibrium of a mode of an autonomous system near a state, by Newton's method.

    Raises OrbitError if there is none near the guess.
    """
    equations = EquilibriumEquations(family, mode)
    solution = solve_at(
        equations,
        np.asarray(guess, dtype=float)[list(equations.free)],
        np.zeros(0),
        reason=f"no equilibrium of mode {family.automaton.modes[mode]!r} near the guess",
        remedy="take another guess",
    )
    return make_equilibrium(equations, equations.projected(solution))


def make_equilibrium(
    equations: EquilibriumEquations, balance: EquilibriumEvaluation
) -> EquilibriumState:
    """Return the equilibrium of solved equations, with stability and admissibility."""
    changes = dict(zip(equations.active, balance.values.tolist(), strict=True))
    matrix, nullity = equations.linearization(balance)
    eigenvalues = np.linalg.eigvals(matrix).astype(complex)
    eigenvalues = eigenvalues[np.argsort(np.abs(eigenvalues))][nullity:]
    return EquilibriumState(
        family=equations.family.at(**changes),
        mode=equations.mode,
        balance=balance,
        eigenvalues=eigenvalues[np.lexsort((-eigenvalues.imag, -eigenvalues.real))],
        nullity=nullity,
        margins=equations.margins(balance),
        stable=eigenvalues_stable(matrix, nullity),
    )


_Copy = Callable[[Callable[..., Any]], Callable[..., Any]]


def _original(function: Callable[..., Any]) -> Callable[..., Any]:
    return function


def _nullity(zero: NDArray[np.bool_]) -> int:
    """Return the structural nullity of a matrix by its zeros."""
    return len(zero) - int(structural_rank(csr_array(~zero))) if zero.size else 0


def _derivatives(
    function: Callable[[_Copy, list[Any]], list[Any]], x: Floats, frame: Floats, *along: Floats
) -> Floats:
    """Return derivatives as `dual_numbers.derivatives`; of functions that refuse, differences."""
    try:
        return derivatives(partial(function, copy_for_tangents), x, frame, *along)
    except Exception:  # differences raise the function's own errors
        if along:
            h = OUTER_STEP * max(1.0, float(np.abs(x).max())) / float(np.abs(along[-1]).max())
            return sixth_order_difference(
                lambda step: _derivatives(function, x + step * along[-1], frame, *along[:-1]), h
            )
        sizes = np.ones(frame.shape[1])
        for value, row in zip(x, frame, strict=True):
            moved = row != 0.0
            sizes[moved] = np.maximum(sizes[moved], np.abs(value / row[moved]))
        columns = frame * sizes

        def values(steps: Floats) -> Floats:
            return np.array(function(_original, (x + columns @ steps).tolist()), dtype=float)

        return differentiate(values, np.zeros(sizes.size)) / sizes


def differentiate(function: Callable[[Floats], Floats], x: Floats) -> Floats:
    """Return the derivatives of `function` at `x`, shape (len(function(x)), len(x)).

    Central differences of sixth order with several step lengths: of consecutive estimates the pair
    with the least difference is used, between the truncation and the rounding regime.
    """
    columns = []
    for value, unit in zip(x.tolist(), np.eye(x.size), strict=True):
        along = partial(_along, function, x, unit)
        steps = max(1.0, abs(value)) * np.array(DIFFERENCE_STEPS)
        estimates = np.array([sixth_order_difference(along, step) for step in steps])
        best = np.argmin(np.abs(np.diff(estimates, axis=0)), axis=0)
        columns.append(np.choose(best, estimates[:-1]))
    return np.array(columns).T if columns else np.zeros((function(x).size, 0))


def _along(function: Callable[[Floats], Floats], x: Floats, unit: Floats, step: float) -> Floats:
    return function(x + step * unit)
