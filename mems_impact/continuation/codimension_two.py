"""Normal forms of points of codimension two.

On the center manifold of a fixed point with critical multipliers mu_i and eigenvectors q_i, the map
is ``w -> N(w)`` with resonant monomials only. Coefficients up to the third order follow from the
homological equation (Kuznetsov and Meijer 2005), one algorithm for all simple multipliers. Double
multipliers +1 and -1, the 1:1 and 1:2 resonances, have generalized eigenvectors. The fifth order of
a generalized flip follows from derivatives along a line, that of a Chenciner point from values of
the map on circles around the fixed point.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig

from mems_impact._util.arrays import Complexes, Floats
from mems_impact.continuation.higher_derivatives import (
    LARGEST_LINE_RATIO,
    STEP_RATIO,
    DirectionalDerivatives,
    directional_derivatives,
    least_changing,
    line_derivatives,
)
from mems_impact.continuation.normal_forms import NormalForm, ReturnMap, criticality_of
from mems_impact.errors import OrbitError
from mems_impact.orbits.shooting import Shooting, ShootingEvaluation

RESONANCE_DISTANCE = 1e-6  # of a product of multipliers from a multiplier that it equals
MULTIPLIER_DISTANCE = 1e-3  # largest distance of a multiplier from its critical value

Vector = NDArray[Any]  # real or complex
Coefficient = float | complex
Term = tuple[int, tuple[int, ...]]
"""The component of a monomial, and its factors, as indices of critical multipliers."""


@dataclass(frozen=True)
class ResonantForm:
    """Kind of a normal form with simple critical multipliers."""

    equation: str
    terms: Mapping[str, Term]  # coefficients by name
    # Critical multipliers that are fixed; those of positive imaginary part are followed by their
    # conjugate.
    values: tuple[complex, ...] = ()
    # Number of further pairs on the unit circle, of any angle, in order of the angle.
    rotating: int = 0
    phase: str = ""  # coefficient that the choice of the eigenvector makes real and positive


RESONANT_FORMS = {
    "cusp": ResonantForm("x -> x + c x^3", {"c": (0, (0, 0, 0))}, (1.0,)),
    "fold-flip": ResonantForm(
        "x -> x + a x^2 + b y^2 + c x^3 + d x y^2, y -> -y + e x y + f x^2 y + g y^3",
        {
            "a": (0, (0, 0)), "b": (0, (1, 1)), "c": (0, (0, 0, 0)), "d": (0, (0, 1, 1)),
            "e": (1, (0, 1)), "f": (1, (0, 0, 1)), "g": (1, (1, 1, 1)),
        },
        (1.0, -1.0),
    ),
    "1:3 resonance": ResonantForm(
        "z -> exp(2 pi i/3) z + b conj(z)^2 + c z |z|^2",
        {"b": (0, (1, 1)), "c": (0, (0, 0, 1))},
        (complex(-0.5, math.sqrt(0.75)),),
        phase="b",
    ),
    "1:4 resonance": ResonantForm(
        "z -> i z + d conj(z)^3 + c z |z|^2",
        {"d": (0, (1, 1, 1)), "c": (0, (0, 0, 1))},
        (1j,),
        phase="d",
    ),
    "fold-Neimark-Sacker": ResonantForm(
        "x -> x + a x^2 + b |z|^2 + c x^3 + d x |z|^2, "
        "z -> exp(i theta) z + e x z + f x^2 z + g z |z|^2",
        {
            "a": (0, (0, 0)), "b": (0, (1, 2)), "c": (0, (0, 0, 0)), "d": (0, (0, 1, 2)),
            "e": (1, (0, 1)), "f": (1, (0, 0, 1)), "g": (1, (1, 1, 2)),
        },
        (1.0,),
        1,
    ),
    "flip-Neimark-Sacker": ResonantForm(
        "x -> -x + a x^3 + b x |z|^2, z -> exp(i theta) z + c x^2 z + d z |z|^2",
        {"a": (0, (0, 0, 0)), "b": (0, (0, 1, 2)), "c": (1, (0, 0, 1)), "d": (1, (1, 1, 2))},
        (-1.0,),
        1,
    ),
    "double Neimark-Sacker": ResonantForm(
        "z -> exp(i theta) z + a z |z|^2 + b z |w|^2, w -> exp(i phi) w + c |z|^2 w + d w |w|^2",
        {"a": (0, (0, 0, 1)), "b": (0, (0, 2, 3)), "c": (2, (0, 1, 2)), "d": (2, (2, 2, 3))},
        (),
        2,
    ),
}  # fmt: skip
RESONANT_FORMS["flip-fold"] = RESONANT_FORMS["fold-flip"]


def codimension_two_form(
    kind: str, shooting: Shooting, point: ShootingEvaluation
) -> NormalForm | None:
    """Return the normal form of a point of codimension two; None for kinds without a normal form.

    Raises OrbitError if the return map cannot be differentiated, or its multipliers do not fit the
    kind.
    """
    functions = {"1:1 resonance": _double_plus, "1:2 resonance": _double_minus}
    functions |= {"generalized flip": _generalized_flip, "Chenciner": _chenciner}
    if kind not in RESONANT_FORMS and kind not in functions:
        return None
    returns = ReturnMap(shooting, point)
    if kind in functions:
        return functions[kind](returns)
    return _resonant(returns, RESONANT_FORMS[kind])


# --- Derivatives along the critical vectors


class CriticalDerivatives:
    """Second and third derivatives of a return map along the span of critical vectors, columns."""

    def __init__(self, returns: ReturnMap, vectors: Vector) -> None:
        spread: Floats = np.hstack([vectors.real, vectors.imag])
        columns, sizes, _ = np.linalg.svd(spread, full_matrices=False)
        self._basis: Floats = columns[:, sizes > MULTIPLIER_DISTANCE * sizes[0]]
        count = self._basis.shape[1]
        size = returns.size or 1.0

        def along(u: Floats) -> DirectionalDerivatives:
            return directional_derivatives(returns.jacobian_at, u, size)

        single = [along(self._basis[:, i]) for i in range(count)]
        self._second = np.array([each.second for each in single])
        self._third = np.zeros((count, *self._second.shape))
        self._errors = [sum(each.second_error for each in single)]
        errors = [each.third_error for each in single]
        for i, each in enumerate(single):
            self._third[i, i] = each.third
        for i, j in itertools.combinations(range(count), 2):
            sums = along(self._basis[:, i] + self._basis[:, j])
            mixed = 0.5 * (sums.third - single[i].third - single[j].third)  # polarization
            self._third[i, j] = self._third[j, i] = mixed
            errors.append(sums.third_error)
        self._errors.append(sum(errors))

    def bilinear(self, q: Vector, x: Vector) -> Vector:
        """Return B(q, x) for a critical vector q."""
        return np.asarray(np.einsum("i,ijk,k->j", self._basis.T @ q, self._second, x))

    def trilinear(self, q: Vector, r: Vector, x: Vector) -> Vector:
        """Return C(q, r, x) for critical vectors q and r."""
        inner, outer = self._basis.T @ q, self._basis.T @ r
        return np.asarray(np.einsum("i,j,ijkl,l->k", inner, outer, self._third, x))

    def error(self, p: Vector, order: int, size: float = 0.0) -> float:
        """Return the error of a coefficient with the left vector p.

        `size` is the norm of the second derivatives of the center manifold.
        """
        second, third = self._errors
        amount = second if order == 2 else third + 6.0 * second * (1.0 + size)
        return float(np.abs(p).sum() * amount)


def _bordered(matrix: Vector, columns: Vector, rows: Vector, right: Vector) -> Complexes:
    """Solve ``matrix x = right`` on the complement of null vectors."""
    size, count = columns.shape
    bordered = np.zeros((size + count, size + count), dtype=complex)
    bordered[:size, :size], bordered[:size, size:], bordered[size:, :size] = matrix, columns, rows
    return np.asarray(np.linalg.solve(bordered, np.append(right, np.zeros(count)))[:size])


# --- Simple multipliers


def _resonant(returns: ReturnMap, form: ResonantForm) -> NormalForm:
    """Return a normal form of simple critical multipliers, by the homological equation."""
    values, right, left = _critical(returns.jacobian, form)
    count, matrix = values.size, returns.jacobian
    derivatives = CriticalDerivatives(returns, right)
    manifold: dict[tuple[int, ...], Complexes] = {}
    quadratic: dict[tuple[int, ...], Complexes] = {}
    for i, j in itertools.combinations_with_replacement(range(count), 2):
        product = values[i] * values[j]
        same = np.abs(values - product) < RESONANCE_DISTANCE
        quadratic[i, j] = derivatives.bilinear(right[:, i], right[:, j])
        rest = quadratic[i, j] - right[:, same] @ (left[same] @ quadratic[i, j])
        shifted = product * np.eye(len(matrix)) - matrix
        manifold[i, j] = _bordered(shifted, right[:, same], left[same], rest)
    size = max(float(np.linalg.norm(each)) for each in manifold.values())
    coefficients: dict[str, Coefficient] = {}
    errors: dict[str, float] = {}
    for name, (component, factors) in form.terms.items():
        if len(factors) == 2:
            image = quadratic[factors]
        else:
            i, j, k = factors
            image = derivatives.trilinear(right[:, i], right[:, j], right[:, k])
            for one, pair in ((i, (j, k)), (j, (i, k)), (k, (i, j))):
                image = image + derivatives.bilinear(right[:, one], manifold[pair])
        repeats = math.prod(math.factorial(factors.count(each)) for each in set(factors))
        value = complex(left[component] @ image) / repeats
        real = values[component].imag == 0.0
        coefficients[name] = abs(value) if name == form.phase else value.real if real else value
        errors[name] = derivatives.error(left[component], len(factors), size) / repeats
    return NormalForm(form.equation, coefficients, errors)


def _critical(matrix: Floats, form: ResonantForm) -> tuple[Complexes, Complexes, Complexes]:
    """Return the critical multipliers with their right (columns) and left (rows) vectors."""
    values, left, right = eig(matrix, left=True)
    chosen: list[tuple[complex, int]] = []
    for value in form.values:
        i = int(np.argmin(np.abs(values - value)))
        chosen.append((complex(value), i))
    upper = [i for i in np.argsort(np.abs(np.abs(values) - 1.0)).tolist() if values[i].imag > 0.0]
    rotating = sorted(upper[: form.rotating], key=lambda i: float(np.angle(values[i])))
    chosen += [(complex(values[i] / abs(values[i])), i) for i in rotating]
    if len(chosen) < len(form.values) + form.rotating or any(
        abs(values[i] - value) > MULTIPLIER_DISTANCE for value, i in chosen
    ):
        raise OrbitError("the multipliers do not fit the kind of the point", "take shorter steps")
    eigenvalues: list[complex] = []
    columns: list[Complexes] = []
    rows: list[Complexes] = []
    for value, i in chosen:
        q = right[:, i] / np.linalg.norm(right[:, i])
        if value.imag == 0.0:
            q = q.real if np.sum(q.real) >= 0.0 else -q.real
        p = np.conj(left[:, i])
        p = p / (p @ q)
        for each in (value, value.conjugate())[: 1 if value.imag == 0.0 else 2]:
            eigenvalues.append(each)
            columns.append(q.astype(complex) if each == value else np.conj(q))
            rows.append(p if each == value else np.conj(p))
    return np.array(eigenvalues), np.array(columns).T, np.array(rows)


# --- Double multipliers


def _chains(matrix: Floats, value: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Return q0, q1, p0, p1 of a double multiplier.

    (A - mu) q0 = 0, (A - mu) q1 = q0, p0 (A - mu) = 0, p1 (A - mu) = p0; q0 has length one,
    p0 q1 = p1 q0 = 1 and p1 q1 = 0.
    """
    shifted = matrix - value * np.eye(len(matrix))
    columns, sizes, rows = np.linalg.svd(shifted)
    q0, p0 = rows[-1], columns[:, -1]
    if sizes[-1] > MULTIPLIER_DISTANCE * max(1.0, sizes[0]) or abs(p0 @ q0) > MULTIPLIER_DISTANCE:
        raise OrbitError("the multiplier of the point is not double", "take shorter steps")
    q0 = q0 if q0.sum() >= 0.0 else -q0
    size = len(matrix)
    bordered = np.zeros((size + 1, size + 1))
    bordered[:size, :size], bordered[:size, size], bordered[size, :size] = shifted, p0, q0
    q1 = np.linalg.solve(bordered, np.append(q0, 0.0))[:size]
    p0 = p0 / (p0 @ q1)
    p1 = np.linalg.solve(bordered.T, np.append(p0, 0.0))[:size]
    return q0, q1, p0, p1 - (p1 @ q1) * p0


def _double_plus(returns: ReturnMap) -> NormalForm:
    """Return the normal form of a 1:1 resonance."""
    q0, q1, p0, p1 = _chains(returns.jacobian, 1.0)
    derivatives = CriticalDerivatives(returns, np.stack([q0, q1], axis=1))
    square, mixed = (derivatives.bilinear(q0, q).real for q in (q0, q1))
    a, b = 0.5 * float(p0 @ square), float(p0 @ mixed + p1 @ square)
    errors = {"a": 0.5 * derivatives.error(p0, 2)}
    errors["b"] = derivatives.error(p0, 2) * float(np.linalg.norm(q1)) + derivatives.error(p1, 2)
    return NormalForm("x -> x + y, y -> y + a x^2 + b x y", {"a": a, "b": b}, errors)


def _double_minus(returns: ReturnMap) -> NormalForm:
    """Return the normal form of a 1:2 resonance."""
    q0, q1, p0, p1 = _chains(returns.jacobian, -1.0)
    d = CriticalDerivatives(returns, np.stack([q0, q1], axis=1))
    regular = np.eye(q0.size) - returns.jacobian
    h20 = np.linalg.solve(regular, d.bilinear(q0, q0).real)
    h11 = np.linalg.solve(regular, d.bilinear(q0, q1).real + h20)
    cube = (d.trilinear(q0, q0, q0) + 3.0 * d.bilinear(q0, h20)).real
    mixed = d.trilinear(q0, q0, q1) + 2.0 * d.bilinear(q0, h11) + d.bilinear(q1, h20)
    a = float(p0 @ cube) / 6.0
    b = 0.5 * float(p0 @ mixed.real + p1 @ cube)
    size = max(float(np.linalg.norm(each)) for each in (h20, h11))
    longest = max(1.0, float(np.linalg.norm(q1)))
    errors = {"a": d.error(p0, 3, size) / 6.0}
    errors["b"] = 0.5 * (d.error(p0, 3, size) * longest + d.error(p1, 3, size))
    return NormalForm("x -> -x + y, y -> -y + a x^3 + b x^2 y", {"a": a, "b": b}, errors)


# --- Generalized flip


def _generalized_flip(returns: ReturnMap) -> NormalForm:
    """Return the coefficient of the fifth order of a period doubling whose cubic one is zero."""
    form = ResonantForm("", {}, (-1.0,))
    _, right, left = _critical(returns.jacobian, form)
    q, p, matrix = right[:, 0].real.copy(), left[0].real.copy(), returns.jacobian
    identity, size = np.eye(q.size), returns.size or 1.0
    # Derivatives of the Jacobian along q, and along the curvature h2 of the center manifold.
    (b, c, d, e), error = line_derivatives(returns.jacobian_at, q, size)
    h2: Floats = np.linalg.solve(identity - matrix, b @ q).astype(float)
    b2, c2, error2 = np.zeros_like(matrix), np.zeros_like(matrix), 0.0
    if np.linalg.norm(h2) > RESONANCE_DISTANCE:
        (b2, c2, *_), error2 = line_derivatives(returns.jacobian_at, h2, size)
    cube = c @ q + 3.0 * b @ h2
    h3 = _bordered(matrix + identity, q[:, None], p[None], q * (p @ cube) - cube).real
    fourth = d @ q + 6.0 * c @ h2 + 4.0 * b @ h3 + 3.0 * b2 @ h2
    h4 = np.linalg.solve(identity - matrix, fourth)
    fifth = e @ q + 10.0 * d @ h2 + 15.0 * c2 @ q + 10.0 * (c @ h3 + b2 @ h3) + 5.0 * b @ h4
    value = float(p @ fifth) / 120.0
    largest = 1.0 + float(np.linalg.norm(h4))
    bound = float(np.abs(p).sum()) * (error * largest + 15.0 * error2) / 120.0
    return NormalForm("x -> -x + d x^5", {"d": value}, {"d": bound}, criticality_of(-value, bound))


# --- Chenciner point

ANGLES = 16  # of the values on a circle
RADII = np.array([1.0, 0.85, 0.7, 0.55])  # of the circles, relative to the largest


def _chenciner(returns: ReturnMap) -> NormalForm:
    """Return the coefficients of a Neimark-Sacker bifurcation whose cubic one has no real part.

    The largest circle is that at which the coefficient of the fifth order changes least.
    """
    values, right, left = _critical(returns.jacobian, ResonantForm("", {}, (), 1))

    def terms(radius: float) -> tuple[complex, complex]:
        return _rotating_terms(returns, values[0], right[:, 0], left[0], radius)

    longest = STEP_RATIO * LARGEST_LINE_RATIO * (returns.size or 1.0)
    (cubic, quintic), error = least_changing(terms, longest)
    turn = np.conj(values[0])
    a, b = complex(turn * cubic), complex(turn * quintic)
    amplitude = b.real + 0.5 * a.imag**2
    return NormalForm(
        "z -> exp(i theta) z (1 + i c |z|^2 + b |z|^4), |z| -> |z| (1 + d |z|^4)",
        {"d": amplitude, "c": a.imag, "b": b},
        {"d": error, "c": error, "b": error},
        criticality_of(amplitude, error),
    )


def _rotating_terms(
    returns: ReturnMap, value: complex, q: Complexes, p: Complexes, largest: float
) -> tuple[complex, complex]:
    """Return the coefficients of z |z|^2 and z |z|^4 of a map on its center manifold.

    The manifold x(z) = z q + sum over j, k of h[j, k] z^j conj(z)^k, and its complex conjugates,
    obeys map(x(z)) = x(N(z)). Order by order, the residual of the equation, as Fourier series over
    circles and polynomials in their radii, determines the h and the terms of N.
    """
    matrix, cubic, quintic = returns.jacobian, 0j, 0j
    manifold: dict[tuple[int, int], Complexes] = {(1, 0): q, (0, 1): np.conj(q)}
    angles = 2.0 * math.pi * np.arange(ANGLES) / ANGLES
    # Of order m + 2 i, the terms of one frequency have the factor radius^(m + 2 i).
    powers = np.linalg.inv(np.vander(RADII**2, increasing=True))[0]

    def manifold_state(z: complex) -> Floats:
        terms = (h * z**j * z.conjugate() ** k for (j, k), h in manifold.items())
        return np.asarray(sum(terms), dtype=complex).real

    for order in range(2, 6):
        missing = np.zeros((RADII.size, ANGLES, q.size))
        for i, radius in enumerate(largest * RADII):
            for n, angle in enumerate(angles.tolist()):
                z = radius * complex(math.cos(angle), math.sin(angle))
                image = z * (value + cubic * abs(z) ** 2)
                missing[i, n] = (
                    returns.value_at(manifold_state(z)) - manifold_state(image)
                ) / radius**order
        series = np.fft.fft(missing, axis=1) / ANGLES
        for j in range(order + 1):
            k = order - j
            term = powers @ series[:, (j - k) % ANGLES]
            shifted = value**j * np.conj(value) ** k * np.eye(q.size) - matrix
            if abs(j - k) != 1:
                manifold[j, k] = np.linalg.solve(shifted, term)
                continue
            own, dual = (q, p) if j > k else (np.conj(q), np.conj(p))
            along = complex(dual @ term)
            if j > k and order == 3:
                cubic = along
            elif j > k:
                quintic = along
            manifold[j, k] = _bordered(shifted, own[:, None], dual[None], term - own * along)
    return cubic, quintic
