"""Equilibria within one mode."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.sparse import csr_array
from scipy.sparse.csgraph import structural_rank

from mems_impact._util.arrays import Floats
from mems_impact.errors import OrbitError
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.differences import sixth_order_difference
from mems_impact.hybrid.variational.derivatives import free_components
from mems_impact.orbits.family import Family
from mems_impact.orbits.newton import solve_at
from mems_impact.orbits.spectrum import eigenvalues_stable

DIFFERENCE_STEPS = (1e-2, 1e-3, 1e-4, 1e-5)  # relative to a value, or to 1 if that is larger
CANCELLATION_RTOL = 1e-11  # error of an entry by the basis, relative to the largest of its row
ROUNDING_SAFETY = 10.0  # factor on estimates of the rounding errors of differences
FLOW_ERROR = 1e-9
EQUILIBRIUM_MARGIN_TOLERANCE = 1e-9  # tolerated violation of a margin by an admissible equilibrium


@dataclass(frozen=True, eq=False)
class EquilibriumEvaluation:
    """One evaluation of the equations of an equilibrium: the flow is zero.

    Attributes
    ----------
    unknowns : float array, shape (f,)
        The components of the state that are not cyclic.
    values : float array, shape (k,)
        Values of the active parameters.
    residual : float array, shape (f,)
        Their time derivatives. In a mode with a constraint manifold: those at the projected state,
        plus the change by the projection, so that distances from the manifold decay at rate one.
    jacobian : float array, shape (f, f)
    by_parameter : float array, shape (f, k)
    """

    unknowns: Floats
    values: Floats
    residual: Floats
    jacobian: Floats
    by_parameter: Floats


@dataclass(frozen=True)
class EquilibriumEquations:
    """The equations of the equilibria of one mode, in a family.

    Parameters
    ----------
    family : Family
    mode : int
    active : tuple of str, optional
        Names of the parameters by which to differentiate.
    """

    family: Family
    mode: int
    active: tuple[str, ...] = ()

    @cached_property
    def automaton(self) -> Automaton:
        """The automaton of the family."""
        return self.family.automaton

    @cached_property
    def free(self) -> tuple[int, ...]:
        """The components of the state that are not cyclic."""
        return tuple(free_components(self.automaton))

    def error(self, point: EquilibriumEvaluation) -> float:
        """Return the error of a flow, whose terms may cancel."""
        return FLOW_ERROR

    def state(self, unknowns: Floats) -> Floats:
        """Return the whole state, shape (n,); cyclic components are zero."""
        y = np.zeros(len(self.automaton.states))
        y[list(self.free)] = unknowns
        return y

    def evaluate(self, unknowns: Floats, values: Floats) -> EquilibriumEvaluation:
        """Evaluate the flow and its derivatives, by differences.

        Raises
        ------
        OrbitError
            If the flow is not defined there.
        """

        def by_state(u: Floats) -> Floats:
            return self._rates(u, parameters)

        def by_change(steps: Floats) -> Floats:
            return self._rates(unknowns, parameters + steps @ directions)

        try:
            parameters = self._parameters(values)
            residual = by_state(unknowns)
            jacobian = differentiate(by_state, unknowns)
            sizes = np.maximum(1.0, np.abs(values))
            directions = sizes[:, None] * self._parameter_rates(values, parameters.size)
            by_parameter = differentiate(by_change, np.zeros(values.size)) / sizes
        except (ArithmeticError, ValueError) as error:
            names, amount = self.family.automaton.states, self.family.amount
            components = zip(self.free, unknowns.tolist(), strict=True)
            location = ", ".join(
                f"{names[i]} = {amount(names[i], value)}" for i, value in components
            )
            raise OrbitError(
                f"the flow is not defined at {location}: {error}", "take another guess"
            ) from error
        return EquilibriumEvaluation(unknowns, values, residual, jacobian, by_parameter)

    def rates_near(self, balance: EquilibriumEvaluation) -> Callable[[Floats], Floats]:
        """Return the time derivatives of the unknowns as a function of a deviation, shape (f,)."""
        parameters = self._parameters(balance.values)
        return lambda deviation: self._rates(balance.unknowns + deviation, parameters)

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
        unknowns = self._projected(balance.unknowns, self._parameters(balance.values))
        return replace(balance, unknowns=unknowns)

    def linearization(self, balance: EquilibriumEvaluation) -> tuple[Floats, int]:
        """Return the derivative of the flow, shape (d, d), and its structural nullity.

        In a mode with a constraint manifold of dimension d the derivative is that in its tangent
        space; otherwise d is f.
        """
        # Structural zeros determine the nullity, since at a fold an eigenvalue is small as well.
        matrix = balance.jacobian
        zero = matrix == 0.0
        if self.mode in self.automaton.constrained:
            parameters, u = self._parameters(balance.values), balance.unknowns
            vectors = self._tangent_space(u, parameters)
            # These components are coordinates of the manifold.
            pivots = qr(vectors.T, mode="r", pivoting=True)[1][: vectors.shape[1]]
            matrix, zero = self._tangential_derivative(u, parameters, vectors, pivots)
            # Entries that contact forces cancel are zero up to rounding. An entry that is zero by
            # coincidence, as at a fold, is nonzero at a nearby state.
            away = u + DIFFERENCE_STEPS[0] * max(1.0, float(np.abs(u).max())) * np.cos(
                np.arange(u.size)
            )
            vectors = self._tangent_space(away, parameters)
            zero &= self._tangential_derivative(away, parameters, vectors, pivots)[1]
        rank = int(structural_rank(csr_array(np.where(zero, 0.0, matrix)))) if matrix.size else 0
        return matrix, len(matrix) - rank

    def _parameter_rates(self, values: Floats, count: int) -> Floats:
        """Return the derivatives of the parameter array by the active parameters."""
        family = self.family.at(**dict(zip(self.active, values.tolist(), strict=True)))
        rates = [family.derivative(name)[0] for name in self.active]
        return np.array(rates).reshape(len(self.active), count)

    def _parameters(self, values: Floats) -> Floats:
        changes = dict(zip(self.active, values.tolist(), strict=True))
        return np.asarray(self.family.numbers(**changes).parameters, dtype=float)

    def _rates(self, unknowns: Floats, parameters: Floats) -> Floats:
        projected = self._projected(unknowns, parameters)
        return self._flow(projected, parameters) + (projected - unknowns)

    def _flow(self, unknowns: Floats, parameters: Floats) -> Floats:
        slope = self.automaton.slope_at(self.mode, 0.0, self.state(unknowns), parameters)
        return slope[list(self.free)]

    def _projected(self, unknowns: Floats, parameters: Floats) -> Floats:
        """Return the unknowns projected onto the constraint manifold of the mode."""
        automaton = self.automaton
        if self.mode not in automaton.constrained:
            return unknowns
        y, code = self.state(unknowns), automaton.projection_code
        _, y = automaton.state_after(self.mode, code, 0.0, y, parameters)
        return y[list(self.free)]

    def _tangent_space(self, unknowns: Floats, parameters: Floats) -> Floats:
        """Return vectors that span the tangent space of the manifold, shape (f, d)."""
        projection = differentiate(lambda u: self._projected(u, parameters), unknowns)
        return np.linalg.svd(projection)[0][:, : round(float(np.trace(projection)))]

    def _tangential_derivative(
        self, unknowns: Floats, parameters: Floats, vectors: Floats, pivots: NDArray[np.int64]
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the derivative on the manifold, and which of its entries are rounding."""
        basis = vectors @ np.linalg.inv(vectors[pivots])
        projected = self._projected(unknowns, parameters)
        rows, errors = _derivatives(lambda u: self._flow(u, parameters), projected)
        rows, errors = rows[pivots], errors[pivots] @ np.abs(basis)
        matrix = rows @ basis
        sizes = (np.abs(rows) @ np.abs(basis)).max(axis=1, keepdims=True, initial=0.0)
        return matrix, np.abs(matrix) <= CANCELLATION_RTOL * sizes + ROUNDING_SAFETY * errors


@dataclass(frozen=True)
class EquilibriumState:
    """An equilibrium of a mode.

    Attributes
    ----------
    family : Family
        The family at the values of the equilibrium.
    mode : int
    balance : EquilibriumEvaluation
    eigenvalues : complex array
        Eigenvalues of the Jacobian of the flow, largest real part first, without the zeros of
        `nullity`; restricted to the constraint manifold if contacts hold or the state slides.
    nullity : int
        Dimension of the continuum of equilibria that contains it, as for a stuck or resting body; 0
        for an isolated equilibrium.
    margins : float array, shape (m,)
        Margins of all guards; positive for guards that are not active in the mode.
    stable : bool or None
        Whether all eigenvalues have negative real parts; None if one is imaginary within its error
        and none has a positive real part.
    """

    family: Family
    mode: int
    balance: EquilibriumEvaluation
    eigenvalues: NDArray[np.complex128]
    nullity: int
    margins: Floats
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
    """Find an equilibrium of a mode near a state, by Newton's method.

    Parameters
    ----------
    family : Family
        Family of an autonomous system.
    mode : int
    guess : float array, shape (n,)

    Raises
    ------
    OrbitError
        If Newton's method finds none near the guess.
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


def differentiate(function: Callable[[Floats], Floats], x: Floats) -> Floats:
    """Return the derivatives of `function` at `x`, shape (len(function(x)), len(x)).

    Central differences of sixth order with several step lengths: of consecutive estimates the pair
    with the least difference is used, between the truncation and the rounding regime.
    """
    return _derivatives(function, x)[0]


def _derivatives(function: Callable[[Floats], Floats], x: Floats) -> tuple[Floats, Floats]:
    """Return the derivatives of `function` at `x`, and estimates of their rounding errors."""
    if not x.size:
        return np.zeros((function(x).size, 0)), np.zeros((function(x).size, 0))
    derivatives, errors = [], []
    for j in range(x.size):
        size, unit = max(1.0, abs(float(x[j]))), np.eye(x.size)[j]
        along = partial(_along, function, x, unit)
        steps = size * np.array(DIFFERENCE_STEPS)
        estimates = np.array([sixth_order_difference(along, step) for step in steps])
        differences = np.abs(np.diff(estimates, axis=0))
        best = np.argmin(differences, axis=0)
        derivatives.append(np.choose(best, estimates[:-1]))
        # Rounding errors of a difference are inverse to its step.
        errors.append((steps[1:, None] * differences).max(axis=0) / steps[best])
    return np.array(derivatives).T, np.array(errors).T


def _along(function: Callable[[Floats], Floats], x: Floats, unit: Floats, step: float) -> Floats:
    return function(x + step * unit)
