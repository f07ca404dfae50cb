"""Stability by the eigenvalues of a matrix whose entries have errors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Complexes, Floats

MULTIPLIER_RTOL = 1e-7  # least error of a monodromy matrix, relative to its largest entry
EIGENVALUE_RTOL = 1e-9  # error of each entry of the Jacobian of a flow, relative to it


def multipliers_stable(
    matrix: Floats, sizes: Floats | float = 1.0, rtol: float = MULTIPLIER_RTOL
) -> bool | None:
    """Return whether all multipliers of a monodromy matrix lie inside the unit circle.

    None if errors of the matrix could place one on either side and none is beyond for certain.
    `sizes` are the magnitudes of the components, `rtol` the error of the matrix of their ratios,
    relative to its largest entry, at least `MULTIPLIER_RTOL`.
    """
    scaled = ratios(matrix, sizes)
    errors = np.full(matrix.shape, max(rtol, MULTIPLIER_RTOL) * np.abs(scaled).max(initial=0.0))
    values = np.linalg.eigvals(scaled).astype(complex)
    moduli = np.abs(values)
    nearest = np.divide(values, moduli, out=np.ones_like(values), where=moduli > 0.0)
    return _stable(scaled, errors, values, moduli < 1.0, nearest)


def ratios(matrix: Floats, sizes: Floats | float) -> Floats:
    """Return a matrix of derivatives between ratios of components to their magnitudes."""
    return np.asarray(matrix * sizes / np.reshape(sizes, (-1, 1)))


def eigenvalues_stable(matrix: Floats, nullity: int) -> bool | None:
    """Return whether all eigenvalues but `nullity` zeros have negative real parts.

    None as for multipliers.
    """
    values = np.linalg.eigvals(matrix).astype(complex)
    values = values[np.argsort(np.abs(values))][nullity:]
    errors = EIGENVALUE_RTOL * np.abs(matrix)
    return _stable(matrix, errors, values, values.real < 0.0, 1j * values.imag)


def _stable(
    matrix: Floats,
    errors: Floats,
    values: Complexes,
    within: NDArray[np.bool_],
    border: Complexes,
) -> bool | None:
    """Return the stability; `border` has the nearest point of the border to each eigenvalue."""
    # On the border another eigenvalue may lie, and does not matter halfway.
    certain = ~_may_be_eigenvalues(border, matrix, errors)
    if not certain.all():
        certain |= ~_may_be_eigenvalues(0.5 * (values + border), matrix, errors)
    if (certain & ~within).any():
        return False
    return True if certain.all() else None


def _may_be_eigenvalues(z: Complexes, matrix: Floats, errors: Floats) -> NDArray[np.bool_]:
    """Return which values a matrix within the errors of the entries may have as eigenvalues.

    A value z is no eigenvalue if the spectral radius of ``|inv(z - matrix)| errors`` is below 1.
    """
    try:
        resolvents = np.abs(np.linalg.inv(z[:, None, None] * np.eye(len(matrix)) - matrix))
        # At most, and exactly if all errors are equal.
        radii = resolvents.sum(axis=(1, 2)) * errors.max(initial=0.0)
        if not (radii < 1.0).all() and np.ptp(errors) > 0.0:
            radii = np.abs(np.linalg.eigvals(resolvents @ errors)).max(axis=1, initial=0.0)
    except np.linalg.LinAlgError:  # of one of them
        if len(z) == 1:
            return np.ones(1, dtype=bool)
        return np.concatenate([_may_be_eigenvalues(each, matrix, errors) for each in z[:, None]])
    return ~(radii < 1.0)
