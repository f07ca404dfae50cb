"""Eigenvalues of a product of square matrices, from its factors.

Rounding of the product is relative to its largest entry, so that its small eigenvalues are lost.
The periodic Schur form of the factors A_k, ``A_k = Q_(k+1) T_k Q_k^H``, has errors relative to each
factor. The matrices Q_k are unitary, and the first follows the last; T_k are triangular. Each
eigenvalue is the product of diagonal elements (Bojanczyk, Golub and Van Dooren 1992, The periodic
Schur decomposition).
"""

from __future__ import annotations

import numpy as np

from mems_impact._util.arrays import Complexes, Floats

ROUNDING = 8.0 * float(np.finfo(float).eps)  # of an element, relative to its neighbours
SWEEPS = 3  # of orthogonal iteration, which separates eigenvalues of different sizes
MAX_ITERATIONS = 40  # of the QR algorithm for one eigenvalue
TINY = 1e-100
PATIENCE = 8  # iterations after which an element is compared with the largest one, not neighbours


def periodic_schur(factors: Floats) -> Complexes:
    """Return the triangular factors T_k of a product ``A_(P-1) ... A_0``, shape (P, r, r).

    Raises LinAlgError if the iteration does not converge.
    """
    count, size = factors.shape[:2]
    if count == 1:
        from scipy.linalg import schur  # imported on first use, which a run need not wait for

        return np.asarray(schur(factors[0], output="complex")[0])[None]
    t = np.empty(factors.shape, dtype=complex)
    # A generic basis: structural zeros may hide a direction from another one.
    basis = np.linalg.qr(np.random.default_rng(0).standard_normal((size, size)))[0]
    for _ in range(SWEEPS):
        first = basis
        for k in range(count):
            basis, t[k] = np.linalg.qr(factors[k] @ basis)
    t[-1] = first.T @ basis @ t[-1]
    for column in range(size - 2):  # the last factor becomes a Hessenberg matrix
        for i in range(size - 2, column, -1):
            _rotate(t, i, *t[-1, i : i + 2, column])
    last, iterations = size - 1, 0
    while last > 0:
        hessenberg = t[-1]
        diagonal, below = np.abs(hessenberg.diagonal()), np.abs(hessenberg.diagonal(-1))
        limits = diagonal[:-1] + diagonal[1:]
        if iterations >= PATIENCE or not limits.all():
            limits[:] = max(1, iterations) * np.abs(hessenberg).max()
        small = below[:last] <= ROUNDING * limits[:last]
        if small[-1]:
            hessenberg[last, last - 1] = 0.0
            last, iterations = last - 1, 0
            continue
        begin = int(np.flatnonzero(small)[-1]) + 1 if small.any() else 0
        iterations += 1
        if iterations > MAX_ITERATIONS:
            raise np.linalg.LinAlgError("the periodic QR algorithm does not converge")
        shift = 0.0 if iterations % PATIENCE == 0 else _shift(t, begin, last)
        _rotate(t, begin, hessenberg[begin, begin] - shift, hessenberg[begin + 1, begin])
        for i in range(begin + 1, last):
            _rotate(t, i, *hessenberg[i : i + 2, i - 1])
    return np.triu(t)


def _rotate(t: Complexes, i: int, x: complex, y: complex) -> None:
    """Rotate components i and i + 1 at the start of the cycle, so that (x, y) becomes (r, 0).

    All factors but the last remain triangular.
    """
    rotation = _rotation(x, y)
    t[-1, i : i + 2] = rotation @ t[-1, i : i + 2]
    for factor in t[:-1]:
        columns = factor[: i + 2, i : i + 2] @ rotation.conj().T
        factor[: i + 2, i : i + 2] = columns
        rotation = _rotation(columns[i, 0], columns[i + 1, 0])
        factor[i : i + 2, i:] = rotation @ factor[i : i + 2, i:]
        factor[i + 1, i] = 0.0
    t[-1, :, i : i + 2] = t[-1, :, i : i + 2] @ rotation.conj().T


def _rotation(x: complex, y: complex) -> Complexes:
    """Return the unitary matrix that maps (x, y) to (r, 0)."""
    length = float(np.hypot(abs(x), abs(y)))
    if length == 0.0:
        return np.eye(2, dtype=complex)
    c, s = x / length, y / length
    return np.array([[np.conj(c), np.conj(s)], [-s, c]])


def _shift(t: Complexes, begin: int, last: int) -> complex:
    """Return the shift of a step, in units of the product of the first diagonal elements."""
    corner: Complexes = np.eye(2, dtype=complex)
    unit = 1.0 + 0.0j
    for factor in t[:-1]:
        corner = factor[last - 1 : last + 1, last - 1 : last + 1] @ corner
        unit *= factor[begin, begin]
        scale = max(float(np.abs(corner).max()), abs(unit))
        if scale == 0.0:
            return 0.0
        corner, unit = corner / scale, unit / scale
    corner = t[-1, last - 1 : last + 1, last - 1 : last + 1] @ corner
    values = np.linalg.eigvals(corner)
    nearest = values[np.argmin(np.abs(values - corner[1, 1]))]
    return complex(nearest / unit) if abs(unit) > TINY * abs(nearest) else 0.0


def product_eigenvalues(factors: Floats) -> tuple[Complexes, Floats]:
    """Return the eigenvalues of a product, largest first, and their condition numbers.

    The factors, shape (P, r, r), are in the order of their application. A condition number is the
    relative change of the eigenvalue by relative changes of all factors, each in units of its
    largest element. Eigenvalues of real factors are real, or in pairs.
    """
    scales = np.abs(factors).max(axis=(1, 2), initial=0.0)
    scales[scales == 0.0] = 1.0
    t = periodic_schur(factors / scales[:, None, None])
    diagonal = np.diagonal(t, axis1=1, axis2=2)
    sizes = np.abs(diagonal)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
        logarithms = np.log(sizes).sum(axis=0) + np.log(scales).sum()
        units = np.prod(np.where(sizes > 0.0, diagonal / sizes, 1.0), axis=0)
        conditions = (np.abs(t).max(axis=(1, 2))[:, None] / sizes).sum(axis=0)
        order = np.argsort(-logarithms, kind="stable")
        logarithms, units = _conjugate(logarithms[order], units[order])
        return np.exp(logarithms) * units, conditions[order]


def _conjugate(logarithms: Floats, units: Complexes) -> tuple[Floats, Complexes]:
    """Return values of real factors, by logarithm and direction, that are real or in pairs."""
    rest = list(range(units.size))
    units = units.copy()
    while rest:
        i = max(rest, key=lambda j: abs(units[j].imag))
        rest.remove(i)
        distances = [
            abs(np.expm1(logarithms[j] - logarithms[i])) + abs(units[j] - units[i].conj())
            for j in rest
        ]
        if not distances or not min(distances) < 2.0 * abs(units[i].imag):
            units[i] = np.sign(units[i].real) or 1.0
            continue
        j = rest.pop(int(np.argmin(distances)))
        mean = units[i] + units[j].conj()
        units[i], units[j] = mean / abs(mean), mean.conj() / abs(mean)
        logarithms[[i, j]] = 0.5 * (logarithms[i] + logarithms[j])
    return logarithms, units
