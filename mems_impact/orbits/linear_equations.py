"""Linear equations of multiple shooting: mostly zeros, with one block per segment.

Small matrices are factorized densely. Beyond `SPARSE_SIZE` the sparse factorization is quicker by
orders of magnitude, since its fill grows with the number of segments only.
"""

from __future__ import annotations

import math

import numpy as np

from mems_impact._util.arrays import Floats

SPARSE_SIZE = 64  # least size of a matrix that is factorized sparsely
# Least size of a matrix whose null vector is that of a bordered matrix: a singular value
# decomposition then takes more than half of the time of a branch.
BORDERED_SIZE = 12
MAX_DENSITY = 0.2  # largest part of nonzeros of such a matrix
INVERSE_ITERATIONS = 4  # for a smallest singular value
MAX_BORDERED_NORM = 1.01  # of the null vector in units of a unit border that is nearly parallel


class Linearization:
    """Equations at a point with their derivatives, by the unknowns and the active parameters."""

    unknowns: Floats
    derivatives: Floats

    @property
    def jacobian(self) -> Floats:
        """Derivatives by the unknowns; square."""
        return self.derivatives[:, : self.unknowns.size]

    @property
    def by_parameter(self) -> Floats:
        """Derivatives by the active parameters, shape (len(unknowns), k)."""
        return self.derivatives[:, self.unknowns.size :]


class SparseFactorization:
    """LU factorization of a sparse square matrix, given as an array.

    Raises LinAlgError if the matrix is singular.
    """

    def __init__(self, matrix: Floats) -> None:
        from scipy.sparse import csc_matrix  # imported on first use
        from scipy.sparse.linalg import splu

        try:
            self._lu = splu(csc_matrix(matrix))
        except RuntimeError as error:
            raise np.linalg.LinAlgError(str(error)) from error

    def solve(self, right: Floats, *, transposed: bool = False) -> Floats:
        """Return the solution for a right-hand side."""
        return np.asarray(self._lu.solve(right, "T" if transposed else "N"))

    @property
    def sign(self) -> float:
        """Sign of the determinant."""
        pivots = np.sign(self._lu.U.diagonal()).prod()
        return float(pivots * _parity(self._lu.perm_r) * _parity(self._lu.perm_c))

    def smallest_singular_value(self) -> float:
        """Return the smallest singular value, by inverse iteration."""
        x = np.ones(self._lu.shape[0])
        for _ in range(INVERSE_ITERATIONS):
            x = self.solve(self.solve(x / np.linalg.norm(x), transposed=True))
        return float(np.linalg.norm(x) ** -0.5)


def _parity(permutation: np.ndarray) -> float:
    """Return the sign of a permutation."""
    visited, sign = np.zeros(permutation.size, dtype=bool), 1.0
    for start in range(permutation.size):
        length, position = 0, start
        while not visited[position]:
            visited[position], position, length = True, permutation[position], length + 1
        if length and length % 2 == 0:
            sign = -sign
    return sign


def is_sparse(matrix: Floats) -> bool:
    """Return whether a matrix is large and has mostly zeros."""
    if len(matrix) < SPARSE_SIZE:
        return False
    return bool(np.count_nonzero(matrix) <= MAX_DENSITY * matrix.size)


def solve_linear(matrix: Floats, right: Floats) -> Floats:
    """Solve a system of linear equations; raise LinAlgError if the matrix is singular."""
    if is_sparse(matrix):
        return SparseFactorization(matrix).solve(right)
    return np.asarray(np.linalg.solve(matrix, right), dtype=float)


def null_vector(matrix: Floats) -> Floats:
    """Return a unit null vector of a matrix with one row less than columns, of arbitrary sign."""
    if len(matrix) >= BORDERED_SIZE:
        border = last = np.eye(matrix.shape[1])[-1]
        # Where the border is almost normal to the null vector, the solution is long, and all the
        # more parallel to it. It is the better border: the matrix is then as regular as can be.
        for _ in range(2):
            try:
                vector = solve_linear(np.vstack([matrix, border]), last)
            except np.linalg.LinAlgError:
                break
            size = float(np.linalg.norm(vector))
            if not math.isfinite(size):
                break
            border = vector / size
        else:
            if size < MAX_BORDERED_NORM:
                return border
    # The last right singular vector
    return np.asarray(np.linalg.svd(matrix)[2][-1])
