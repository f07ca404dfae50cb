"""Critical Floquet vectors of the shooting equations, and the normal form's cubic coefficient.

A perturbation v of all unknowns that is multiplied by mu in every period satisfies
``(F_u + (mu - 1) S) v = 0``. F_u are the derivatives of the shooting equations, and S selects the
first state in the equation that closes the orbit. Derivatives of F_u along v give the gradient of
mu as well as the normal form on the center manifold: no motion near the orbit is solved for.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from mems_impact._util.arrays import Complexes, Floats
from mems_impact.continuation.higher_derivatives import DirectionalDerivatives
from mems_impact.orbits.shooting import Shooting, ShootingEvaluation


class Differentiation(Protocol):
    """A function that differentiates a Jacobian along a vector, as `directional_derivatives`."""

    def __call__(self, jacobian: Any, u: Floats, size: float) -> DirectionalDerivatives:
        """Return the derivatives."""


ENTRY_ERROR = 1e-12  # relative error of an entry of a derivative


class Coefficient(NamedTuple):
    """A coefficient of a normal form."""

    value: float
    error: float  # estimated; NaN if the derivatives have no estimate
    size: float  # sum of the sizes of its terms, which may cancel


@dataclass(frozen=True, eq=False)
class CriticalVectors:
    """Null vectors of the shooting equations for a multiplier, and derivatives along them."""

    shooting: Shooting
    point: ShootingEvaluation
    multiplier: complex  # on the unit circle, or close to it
    differentiate: Differentiation  # as `directional_derivatives`

    @cached_property
    def closure(self) -> Floats:
        """The matrix S."""
        matrix = np.zeros(self.point.jacobian.shape)
        for c, row in enumerate(self.shooting.layout.state_rows[-1].tolist()):
            if c not in self.shooting.pinned:
                matrix[row, c] = 1.0
        return matrix

    def matrix(self, multiplier: complex) -> Any:
        """Return the derivatives of the equations for perturbations with a multiplier."""
        if multiplier.imag == 0.0:
            return self.point.jacobian + (multiplier.real - 1.0) * self.closure
        return self.point.jacobian + (multiplier - 1.0) * self.closure

    @cached_property
    def null(self) -> tuple[Any, Any]:
        """The left and the right null vector, each of unit length."""
        vectors, _, rows = np.linalg.svd(self.matrix(self.multiplier))
        return vectors[:, -1].conj(), rows[-1].conj()

    @cached_property
    def condition(self) -> complex:
        """The product w S v, zero where the multiplier is double."""
        left, right = self.null
        return complex(left @ self.closure @ right)

    @property
    def _weight(self) -> complex:
        """The inverse of the condition, infinite where that is zero."""
        return 1.0 / self.condition if self.condition else complex(np.inf)

    @cached_property
    def _along(self) -> tuple[DirectionalDerivatives, ...]:
        """Derivatives along the real and, if there is one, the imaginary part of v."""
        point, right = self.point, self.null[1]
        size = float(np.abs(self.shooting.unpack(point.unknowns)[0]).max()) or 1.0

        def jacobian(x: Floats) -> Floats:
            at = self.shooting.evaluate(point.unknowns + x, point.values) if x.any() else point
            return at.derivatives

        parts = (right.real, right.imag) if np.iscomplexobj(right) else (right,)
        return tuple(self.differentiate(jacobian, part, size) for part in parts)

    @property
    def by_all(self) -> Any:
        """Derivative along v of the derivatives by all unknowns and parameters."""
        real, *imaginary = self._along
        return real.second + 1j * imaginary[0].second if imaginary else real.second

    def multiplier_gradient(self) -> Complexes:
        """Return the derivatives of the multiplier by unknowns and parameters."""
        return np.asarray(-(self.null[0] @ self.by_all) / self.condition)

    @property
    def error(self) -> float:
        """Error of the multiplier, by those of the entries of the matrix."""
        left, right = self.null
        moved = ENTRY_ERROR * float(np.abs(left) @ np.abs(self.point.jacobian) @ np.abs(right))
        return moved * abs(self._weight)

    def quadratic(self) -> Coefficient:
        """Return the quadratic coefficient at a multiplier 1, x -> x + a x^2."""
        (left, v), (along,) = self.null, self._along
        factor = -0.5 * self._weight.real
        value = factor * float(left @ along.second[:, : v.size] @ v)
        error = abs(factor) * float(np.abs(left).sum()) * along.second_error
        return Coefficient(value, error, abs(value))

    def cubic(self) -> Coefficient:
        """Return the cubic coefficient on the center manifold; v has the length of one.

        c of ``x -> mu x + c x^3`` for a real multiplier, Re(c / mu) of ``z -> mu z + c z |z|^2``
        for a complex one.
        """
        mu, (left, v), n = self.multiplier, self.null, self.point.unknowns.size
        second = self.by_all[:, :n]
        square = -second @ v
        terms = [sum(each.third[:, :n] @ v for each in self._along)]
        if np.iscomplexobj(v):
            mean = np.linalg.solve(self.point.jacobian, -second @ v.conj())
            double = np.linalg.solve(self.matrix(mu * mu), square)
            real, imaginary = (each.second[:, :n] for each in self._along)
            terms += [2.0 * second @ mean, (real - 1j * imaginary) @ double]
            curvature = np.linalg.norm(mean) + np.linalg.norm(double)
            factor = -0.5 * self._weight / mu
        else:
            if mu == 1.0:  # on the complement of v, where the equations are regular
                columns, sizes, rows = np.linalg.svd(self.point.jacobian)
                h = rows[:-1].T @ (columns[:, :-1].T @ square / sizes[:-1])
            else:
                h = np.linalg.solve(self.point.jacobian, square)
            terms.append(3.0 * second @ h)
            curvature = np.linalg.norm(h)
            factor = -self._weight / 6.0
        error = sum(
            each.third_error + 6.0 * each.second_error * (1.0 + curvature) for each in self._along
        )
        return Coefficient(
            value=float((factor * (left @ sum(terms))).real),
            error=float(abs(factor) * np.abs(left).sum() * error),
            size=float(abs(factor) * sum(np.linalg.norm(each) for each in terms)),
        )
