"""Linear algebra of large shooting equations, against dense factorizations."""

import numpy as np
import pytest

from mems_impact.orbits.linear_equations import (
    SPARSE_SIZE,
    SparseFactorization,
    is_sparse,
    null_vector,
    solve_linear,
)


def cyclic(segments, size=4, seed=1):
    """Return the matrix of multiple shooting: a block and an identity for each segment."""
    rng = np.random.default_rng(seed)
    matrix = np.zeros((segments * size, segments * size))
    for i in range(segments):
        rows = slice(i * size, (i + 1) * size)
        after = (i + 1) % segments * size
        matrix[rows, rows] = rng.normal(size=(size, size))
        matrix[rows, after : after + size] = -np.eye(size)
    return matrix


@pytest.mark.parametrize("seed", range(6))
def test_determinant_and_smallest_singular_value(seed):
    matrix = cyclic(20, seed=seed)
    assert is_sparse(matrix)
    factors, sizes = SparseFactorization(matrix), np.linalg.svd(matrix, compute_uv=False)
    assert factors.sign == np.linalg.slogdet(matrix)[0]
    assert factors.smallest_singular_value() == pytest.approx(sizes[-1], rel=0.2)
    right = np.arange(len(matrix), dtype=float)
    assert solve_linear(matrix, right) == pytest.approx(np.linalg.solve(matrix, right), rel=1e-9)
    assert factors.solve(right, transposed=True) @ matrix == pytest.approx(right, abs=1e-9)


@pytest.mark.parametrize("segments", [1, 4, 20])
@pytest.mark.parametrize("last", [1.0, 0.0])
def test_null_vector(last, segments):
    """Also at a fold, where its last component is zero."""
    matrix = cyclic(segments)
    column = np.arange(1.0, len(matrix) + 1.0)[:, None]
    vector = np.append(np.linalg.solve(matrix, -column), 1.0)
    if last == 0.0:
        flat = np.sin(np.arange(len(matrix)))
        for rows in range(0, len(matrix), 4):
            part = flat[rows : rows + 4]
            missed = matrix[rows : rows + 4] @ flat
            matrix[rows : rows + 4, rows : rows + 4] -= np.outer(missed, part) / (part @ part)
        vector = np.append(flat, 0.0)
    assert is_sparse(matrix) == (segments == 20)
    found = null_vector(np.hstack([matrix, column]))
    vector /= np.linalg.norm(vector)
    assert np.abs(np.hstack([matrix, column]) @ found).max() < 1e-12 * len(matrix)
    assert abs(found @ vector) == pytest.approx(1.0, abs=1e-12)


def test_a_null_vector_almost_without_its_last_component(monkeypatch):
    """As that of a long orbit, whose parameter is small: a singular value decomposition is slow."""
    matrix = cyclic(20)
    column = np.arange(1.0, len(matrix) + 1.0)[:, None]
    vector = np.append(np.linalg.solve(matrix, -column), 1e-10)
    monkeypatch.delattr(np.linalg, "svd")
    found = null_vector(np.hstack([matrix, 1e10 * column]))
    assert abs(found @ vector) == pytest.approx(np.linalg.norm(vector), rel=1e-12)


def test_a_singular_matrix():
    matrix = np.eye(SPARSE_SIZE)
    matrix[3, 3] = 0.0
    with pytest.raises(np.linalg.LinAlgError):
        solve_linear(matrix, np.ones(SPARSE_SIZE))
