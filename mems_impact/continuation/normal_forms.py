"""Normal forms of bifurcations: coefficients and criticality.

Equilibria: with A, B and C the first to third derivatives of the flow, ``A q = mu q``,
``p A = mu p`` and ``<p, q> = 1``, the flow on the center manifold follows from Kuznetsov,
*Elements of Applied Bifurcation Theory*, 3rd edition (2004), section 5.4. The derivatives are
exact.

Orbits: the same for the map of all unknowns of the shooting equations (`CriticalVectors`). Second
and third derivatives are extrapolated differences of the Jacobian of these equations. At points of
codimension two the Poincaré map along the signature of an orbit is defined by the shooting
equations without the equation that closes the orbit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig

from mems_impact._util.arrays import Complexes, Floats
from mems_impact.continuation.critical_vectors import ENTRY_ERROR, CriticalVectors
from mems_impact.continuation.equilibrium_branch import HOPF
from mems_impact.continuation.higher_derivatives import (
    DirectionalDerivatives,
    directional_derivatives,
)
from mems_impact.continuation.test_functions import (
    BRANCH_POINT,
    FOLD,
    NEIMARK_SACKER,
    PERIOD_DOUBLING,
)
from mems_impact.errors import OrbitError
from mems_impact.orbits.equilibrium import EquilibriumState
from mems_impact.orbits.monodromy import multipliers_at, reduced_components
from mems_impact.orbits.shooting import STEP_TOLERANCE, Shooting, ShootingEvaluation

SUPERCRITICAL, SUBCRITICAL = "supercritical", "subcritical"


SIGNIFICANCE = 3.0  # multiple of its error that a coefficient must exceed to have a sign

Differentiation = Callable[[Floats], DirectionalDerivatives]
"""A function that returns derivatives along a vector."""

# --- The return map of an orbit.

MAX_MAP_ITERATIONS = 12
MAP_TOLERANCE = 1e-11


class ReturnMap:
    """The map from the start of an orbit's period to its end, along the orbit's signature.

    Coordinates are deviations from the orbit `point` of the components of the state that the first
    mode leaves free, in the plane of the phase condition if the system is autonomous.
    """

    def __init__(self, shooting: Shooting, point: ShootingEvaluation) -> None:
        self.shooting, self.point = shooting, point
        f = self._width = len(shooting.free)
        keep = reduced_components(shooting, point)
        embedding = np.eye(f)[:, keep]
        for c, factors in shooting.pinned.items():
            embedding[c] = -np.array(factors)[keep]
        self._rows = keep
        self._plane: Floats = np.eye(len(keep))
        if shooting.phase is not None and keep:
            normal = np.array(shooting.phase.normal)[keep]
            self._plane = np.linalg.qr(normal[:, None], mode="complete")[0][:, 1:]
        self._embedding = embedding @ self._plane
        self._last: tuple[Floats, Floats] | None = None
        self.size = float(np.abs(shooting.unpack(point.unknowns)[0]).max())
        self._jacobian, self._along = self._linearize(point)

    @property
    def dimension(self) -> int:
        """Number of coordinates."""
        return self._embedding.shape[1]

    @property
    def jacobian(self) -> Floats:
        """The first derivative at the orbit."""
        return self._jacobian

    def jacobian_at(self, x: Floats) -> Floats:
        """Return the first derivative at coordinates `x`.

        Raises OrbitError if no motion with the signature of the orbit starts there.
        """
        return self._linearize(self._motion(x)[0])[0] if x.any() else self._jacobian

    def value_at(self, x: Floats) -> Floats:
        """Return the coordinates to which `x` is mapped; the same errors are raised."""
        f, rows = self._width, self.shooting.layout.state_rows[-1]
        point, change = self._motion(x)
        moved = point.unknowns[:f] - point.residual[rows] - self.point.unknowns[:f]
        moved = moved + self._after(point)[:, f:] @ change
        return np.asarray(self._plane.T @ moved[self._rows], dtype=float)

    def _motion(self, x: Floats) -> tuple[ShootingEvaluation, Floats]:
        """Return the motion that starts at `x`, and the last change of the other unknowns."""
        f, shift = self._width, self._embedding @ x
        unknowns = self.point.unknowns.copy()
        unknowns[:f] += shift
        unknowns[f:] += self._along @ x
        for _ in range(MAX_MAP_ITERATIONS):
            point = self.shooting.evaluate(unknowns, self.point.values)
            if unknowns.size == f:
                return point, np.zeros(0)
            residual, matrix = self._open(point)
            change = np.asarray(np.linalg.solve(matrix[:, f:], -residual), dtype=float)
            unknowns = unknowns.copy()
            unknowns[f:] += change
            if np.abs(change).max() < MAP_TOLERANCE * max(1.0, float(np.abs(unknowns).max())):
                return point, change
        raise OrbitError("the motion near an orbit could not be solved", "take shorter steps")

    def by_parameter(self) -> Floats:
        """Return the derivatives of the map by the active parameters, shape (k, parameters)."""
        f, point = self._width, self.point
        rows = self.shooting.layout.state_rows[-1]
        after, across = self._after(point), -point.by_parameter[rows]
        if point.unknowns.size > f:
            _, matrix = self._open(point)
            open_rows = self._open_rows(point)
            change = -point.by_parameter[open_rows]
            if self.shooting.phase is not None:
                change[-1] = -np.array(self.shooting.phase.normal) @ across
            across = across + after[:, f:] @ np.linalg.solve(matrix[:, f:], change)
        return np.asarray(self._plane.T @ across[self._rows])

    def _after(self, point: ShootingEvaluation) -> Floats:
        """Return the derivatives of the state at the end by the unknowns."""
        after = -point.jacobian[self.shooting.layout.state_rows[-1]]
        after[:, : self._width] += np.eye(self._width)
        return after

    def _open_rows(self, point: ShootingEvaluation) -> NDArray[np.int64]:
        return np.setdiff1d(np.arange(point.unknowns.size), self.shooting.layout.state_rows[-1])

    def _open(self, point: ShootingEvaluation) -> tuple[Floats, Floats]:
        """Return residual and derivatives of the equations that do not close the orbit.

        The period of an autonomous system ends in the plane of the phase condition.
        """
        open_rows, shooting = self._open_rows(point), self.shooting
        residual, matrix = point.residual[open_rows], point.jacobian[open_rows]
        if shooting.phase is not None:
            normal, event = np.array(shooting.phase.normal), point.events[-1]
            end = point.arcs[-1].end if event is None else event.after
            residual[-1] = normal @ end[shooting.free] - shooting.phase.level
            matrix[-1] = normal @ self._after(point)
        return residual, matrix

    def _linearize(self, point: ShootingEvaluation) -> tuple[Floats, Floats]:
        """Return the derivatives of the map, and of the other unknowns, by the coordinates."""
        f, after = self._width, self._after(point)
        along: Floats = np.zeros((point.unknowns.size - f, self.dimension))
        moved: Floats = after[:, :f] @ self._embedding
        if point.unknowns.size > f:
            _, matrix = self._open(point)
            along[:] = np.linalg.solve(matrix[:, f:], -matrix[:, :f] @ self._embedding)
            moved = moved + after[:, f:] @ along
        return np.asarray(self._plane.T @ moved[self._rows], dtype=float), along


# --- Normal forms on the center manifold.


@dataclass(frozen=True)
class NormalForm:
    """The normal form of a bifurcation on its center manifold.

    Attributes
    ----------
    equation : str
        The normal form, with the names of the coefficients. x and y are real coordinates, z and w
        complex coordinates along the critical eigenvectors, which have length one.
    coefficients : dict of str to float or complex
        By name, in the units of the integration: the units of the system, or its typical sizes.
    errors : dict of str to float
        Estimated errors of the coefficients.
    criticality : str
        "supercritical" if the orbit, curve or cycle that bifurcates is stable on the center
        manifold, "subcritical" if unstable; empty for a fold or a transcritical branch point, if
        the coefficient is zero within three times its error, or if the critical eigenvalue is
        double, as without damping.

    See Also
    --------
    SpecialPoint, continue_solution

    Notes
    -----
    Kuznetsov, *Elements of Applied Bifurcation Theory*, 3rd edition (2004), section 5.4. The
    Poincaré map includes impacts and other events through the shooting equations.

    Examples
    --------
    >>> import mems_impact as mi
    >>> def vanderpol(mode, t, y, p):
    ...     return y.v, -y.x + (p.m - y.x**2) * y.v
    >>> system = mi.System(states=("x", "v"), flow=vanderpol, parameters={"m": -0.5})
    >>> (rest,) = mi.find_equilibria(system, guess={"x": 0.0})
    >>> (hopf,) = mi.continue_solution(rest, "m", stop=0.5).special_points
    >>> form = hopf.normal_form
    >>> form.equation, round(form.coefficient, 6), form.criticality
    ("z' = i omega z + l z |z|^2", -0.25, 'supercritical')
    """

    equation: str
    coefficients: dict[str, float | complex]
    errors: dict[str, float]
    criticality: str = ""

    @property
    def coefficient(self) -> float:
        """The first coefficient, which is real; at codimension one the only coefficient."""
        return float(next(iter(self.coefficients.values())).real)

    @property
    def error(self) -> float:
        """Estimated error of the first coefficient."""
        return next(iter(self.errors.values()))


class _Critical(NamedTuple):
    """A critical eigenvalue with its right and left eigenvectors, ``conj(p) q = 1``.

    The relative error of the left one is at least one for an eigenvalue that is not simple.
    """

    value: complex
    right: Complexes
    left: Complexes
    error: float


def _critical(matrix: Floats, target: complex) -> _Critical:
    """Return the eigenvalue that is nearest to `target`, with its eigenvectors."""
    values, left, right = eig(matrix, left=True)
    i = int(np.argmin(np.abs(values - target)))
    q = right[:, i] / np.linalg.norm(right[:, i])
    with np.errstate(divide="ignore", invalid="ignore"):
        p = left[:, i] / np.conj(np.conj(left[:, i]) @ q)
        moved = ENTRY_ERROR * float(np.abs(p) @ np.abs(matrix) @ np.abs(q))
        separation = np.abs(np.delete(values, i) - values[i]).min(initial=np.inf)
        error = (moved + abs(values[i] - target)) / separation
    return _Critical(
        complex(values[i]), q, p, float(np.nan_to_num(error, nan=np.inf, posinf=np.inf))
    )


def _real(matrix: Floats) -> tuple[Floats, Floats, float]:
    """Return the right and left eigenvectors of the eigenvalue zero, and the error of the left one.

    The largest entry of the right one is positive.
    """
    vectors = _critical(matrix, 0.0)
    phase = vectors.right[np.argmax(np.abs(vectors.right))]
    turn = np.conj(phase) / abs(phase)
    q = (vectors.right * turn).real
    return q, (vectors.left * turn).real, vectors.error


def _bordered(matrix: Floats, q: Floats, p: Floats, right: Floats) -> Floats:
    """Solve ``matrix x = right`` with p x = 0, up to a multiple of q.

    p and q are null vectors of the matrix. A component of `right` along q has no effect.
    """
    size = q.size
    bordered = np.zeros((size + 1, size + 1))
    bordered[:size, :size], bordered[:size, size], bordered[size, :size] = matrix, q, p
    right = np.append(right, 0.0)
    try:
        return np.asarray(np.linalg.solve(bordered, right)[:size])
    except np.linalg.LinAlgError:  # a double eigenvalue, where errors of q and p are unbounded
        return np.asarray(np.linalg.lstsq(bordered, right)[0][:size])


def fold_coefficient(along: Differentiation, matrix: Floats) -> NormalForm:
    """Return the quadratic coefficient of a fold of equilibria: a = <p, B(q, q)> / 2."""
    q, p, _ = _real(matrix)
    derivatives = along(q)
    a, error = 0.5 * float(p @ derivatives.second @ q), 0.5 * _gain(p) * derivatives.second_error
    return NormalForm("x' = a x^2", {"a": a}, {"a": error})


def _cubic(
    along: DirectionalDerivatives, q: Floats, p: Floats, h: Floats, relative: float
) -> tuple[float, float]:
    """Return <p, C(q, q, q) + 3 B(q, h)> / 6 and its error; `relative` belongs to p."""
    c = float(p @ (along.third @ q + 3.0 * along.second @ h)) / 6.0
    error = _gain(p) * (along.third_error + 6.0 * along.second_error * (1.0 + _norm(h))) / 6.0
    return c, error + abs(c) * relative


def cubic_coefficient(along: Differentiation, matrix: Floats) -> NormalForm:
    """Return the cubic coefficient of a pitchfork: c = <p, C(q, q, q) + 3 B(q, h)> / 6.

    ``h`` solves -A h = B(q, q) on the complement of q. Supercritical if c is negative.
    """
    q, p, relative = _real(matrix)
    derivatives = along(q)
    h = _bordered(-matrix, q, p, derivatives.second @ q)
    c, error = _cubic(derivatives, q, p, h, relative)
    return NormalForm("x' = c x^3", {"c": c}, {"c": error}, criticality_of(c, error))


def crossing_coefficient(along: Differentiation, matrix: Floats) -> NormalForm:
    """Return the normal form of a branch point: transcritical (quadratic) or pitchfork (cubic)."""
    quadratic = fold_coefficient(along, matrix)
    if abs(quadratic.coefficient) > SIGNIFICANCE * quadratic.error:
        return quadratic
    return cubic_coefficient(along, matrix)


def hopf_coefficient(along: Differentiation, matrix: Floats, target: complex) -> NormalForm:
    """Return the cubic coefficient of a Hopf bifurcation: the first Lyapunov coefficient.

    l = Re(<p, C(q, q, q*) + 2 B(q, h11) + B(q*, h20)>) / 2, with -A h11 = B(q, q*) and
    (2 i omega - A) h20 = B(q, q). Supercritical if l is negative: the cycle is stable on the center
    manifold.
    """
    vectors = _critical(matrix, target)
    omega = vectors.value.imag

    c, error = _resonant_cubic(
        along, vectors, _resolvent(matrix, 0.0), _resolvent(matrix, 2j * omega)
    )
    coefficient = 0.5 * float(c.real)
    criticality = criticality_of(coefficient, error)
    equation = "z' = i omega z + l z |z|^2"
    return NormalForm(equation, {"l": coefficient}, {"l": 0.5 * error}, criticality)


def _resolvent(matrix: Floats, shift: complex) -> Complexes:
    return np.asarray(np.linalg.inv(shift * np.eye(len(matrix)) - matrix), dtype=complex)


def _resonant_cubic(
    along: Differentiation, vectors: _Critical, mean: Complexes, double: Complexes
) -> tuple[complex, float]:
    """Return <p, C(q, q, q*) + 2 B(q, h11) + B(q*, h20)> and its error.

    h11 and h20 are the products of `mean` and `double` with B(q, q*) and B(q, q).
    """
    u, v = vectors.right.real.copy(), vectors.right.imag.copy()
    # Rotated so that real and imaginary part are orthogonal: neither then is short.
    angle = 0.5 * math.atan2(2.0 * float(u @ v), float(u @ u - v @ v))
    turn = np.exp(-1j * angle)
    q, p = vectors.right * turn, vectors.left * turn
    u, v = q.real, q.imag
    along_u, along_v = along(u), along(v)

    def second(x: Complexes) -> Complexes:
        """Return B(q, x)."""
        return np.asarray(along_u.second @ x + 1j * (along_v.second @ x))

    def conjugate_second(x: Complexes) -> Complexes:
        """Return B(q*, x)."""
        return np.asarray(along_u.second @ x - 1j * (along_v.second @ x))

    h11, h20 = mean @ second(np.conj(q)), double @ second(q)
    third = along_u.third @ (u + 1j * v) + along_v.third @ (u + 1j * v)
    value = np.conj(p) @ (third + 2.0 * second(h11) + conjugate_second(h20))
    error = along_u.third_error + along_v.third_error
    error += (along_u.second_error + along_v.second_error) * (
        1.0 + 4.0 * _norm(h11) + 2.0 * _norm(h20)
    )
    return complex(value), float(_gain(p) * error)


def _norm(vector: NDArray[np.inexact]) -> float:
    return float(np.linalg.norm(vector))


def _gain(p: NDArray[np.inexact]) -> float:
    """Return the factor by which a left eigenvector amplifies the error of an entry."""
    return float(np.abs(p).sum())


def criticality_of(cubic: float, error: float) -> str:
    """Return the criticality that the sign of a cubic coefficient has, if it has one."""
    if not abs(cubic) > SIGNIFICANCE * error:
        return ""
    return SUPERCRITICAL if cubic < 0.0 else SUBCRITICAL


def orbit_normal_form(
    kind: str, shooting: Shooting, point: ShootingEvaluation, *, doubled: bool = False
) -> NormalForm | None:
    """Return the normal form of a bifurcation of a periodic orbit; None for kinds without one.

    `doubled` says that the orbit of a period doubling is given at twice the period. Raises
    OrbitError if the return map cannot be differentiated.
    """
    if kind not in (FOLD, PERIOD_DOUBLING, NEIMARK_SACKER, BRANCH_POINT):
        return None
    values = multipliers_at(shooting, point)
    if kind == NEIMARK_SACKER:
        off_axis = values[values.imag > 0.0]
        if not off_axis.size:
            return None  # neutral saddle
        target = complex(off_axis[np.argmin(np.abs(np.abs(off_axis) - 1.0))])
        target /= abs(target)
    else:
        target = complex(-1.0 if kind == PERIOD_DOUBLING and not doubled else 1.0)
    vectors = CriticalVectors(shooting, point, target, directional_derivatives)
    start = vectors.null[1][reduced_components(shooting, point)]
    length = float(np.linalg.norm(start))
    if target == 1.0 and kind in (FOLD, BRANCH_POINT):
        quadratic = vectors.quadratic()
        turn = math.copysign(1.0, start[np.argmax(np.abs(start))].real)
        a, error = turn * quadratic.value / length, quadratic.error / length
        if kind == FOLD or abs(a) > SIGNIFICANCE * error:
            return NormalForm("x -> x + a x^2", {"a": a}, {"a": error})
    cubic = vectors.cubic()
    c, error = cubic.value / length**2, cubic.error / length**2
    i = int(np.argmin(np.abs(values - target)))
    separation = np.abs(np.delete(values, i) - values[i]).min(initial=np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        error += abs(c) * np.divide(vectors.error + abs(values[i] - target), separation)
    error = float(np.nan_to_num(error, nan=np.inf, posinf=np.inf))
    if kind == NEIMARK_SACKER:
        equation = "z -> exp(i theta) z (1 + d |z|^2)"
        return NormalForm(equation, {"d": c}, {"d": error}, criticality_of(c, error))
    equation = "x -> x + c x^3" if target == 1.0 else "x -> -x + c x^3"
    return NormalForm(equation, {"c": c}, {"c": error}, criticality_of(target.real * c, error))


def equilibrium_normal_form(kind: str, state: EquilibriumState) -> NormalForm | None:
    """Return the normal form of a bifurcation of an equilibrium; None without a normal form.

    Raises OrbitError if the flow cannot be differentiated.
    """
    equations, balance = state.equations, replace(state.balance, values=np.zeros(0))
    if kind not in (FOLD, HOPF, BRANCH_POINT):
        return None

    def jacobian(x: Floats) -> Floats:
        return equations.evaluate(balance.unknowns + x, balance.values).jacobian

    def exact(u: Floats) -> DirectionalDerivatives:
        second, third = (equations.derivatives_along(balance, *k * (u,)) for k in (1, 2))
        largest, error = float(np.abs(second).max()), ENTRY_ERROR * float(np.abs(third).max())
        # The equilibrium itself has an error.
        moved = STEP_TOLERANCE / ENTRY_ERROR * error
        return DirectionalDerivatives(second, third, ENTRY_ERROR * largest + moved, error)

    matrix, size = balance.jacobian, max(1.0, float(np.abs(balance.unknowns).max()))
    differences = partial(directional_derivatives, jacobian, size=size)
    along: Differentiation = exact if equations.is_exact(balance) else differences
    if kind == FOLD:
        return fold_coefficient(along, matrix)
    if kind == BRANCH_POINT:
        return crossing_coefficient(along, matrix)
    values = np.linalg.eigvals(matrix)
    rotating = values[values.imag > 0.0]
    return hopf_coefficient(along, matrix, complex(rotating[np.argmin(np.abs(rotating.real))]))
