"""Products with a lower triangular band matrix, and with its inverse."""

import numpy as np
import pytest
import scipy.linalg

from drake_cafim.numerics.banded import LowerBand

R = 23


def _lower(width: int) -> np.ndarray:
    rng = np.random.default_rng(width)
    full = np.tril(rng.standard_normal((R, R))) + 4.0 * np.eye(R)
    return np.asarray(np.triu(full, 1 - width))


def _stored(lower: np.ndarray, width: int) -> LowerBand:
    rows = np.zeros((R, width))
    for m in range(width):
        rows[m:, width - 1 - m] = np.diagonal(lower, -m)
    return LowerBand(rows)


@pytest.mark.parametrize("width", [1, 2, 6, R])
@pytest.mark.parametrize("columns", [None, 1, 3, 4, 9])
def test_products_are_those_of_the_full_matrix(width: int, columns: int | None) -> None:
    L = _lower(width)
    stored = _stored(L, width)
    right = np.random.default_rng(0).standard_normal(R if columns is None else (R, columns))
    given = right.copy()
    for found, expected in (
        (stored.solve(right), scipy.linalg.solve_triangular(L, right, lower=True)),
        (stored.solve_transposed(right), scipy.linalg.solve_triangular(L.T, right)),
        (stored.times(right), L @ right),
    ):
        assert found.shape == right.shape and np.allclose(found, expected, rtol=1e-10, atol=1e-12)
    assert np.array_equal(right, given) and np.array_equal(stored.diagonal, np.diagonal(L))
    assert np.array_equal(stored.full().toarray(), L)


def test_a_block_is_that_of_the_full_matrix() -> None:
    L = _lower(6)
    right = np.random.default_rng(0).standard_normal((9, 5))
    found = _stored(L, 6).block(7, 16).solve(right)
    assert np.allclose(found, scipy.linalg.solve_triangular(L[7:16, 7:16], right, lower=True), rtol=1e-10)


def test_rows_that_are_not_finite_stay_so() -> None:
    """A simulation that diverged must not look like one that fits."""
    right = np.ones((R, 4))
    right[3] = np.inf
    assert not np.any(np.isfinite(_stored(_lower(6), 6).solve(right)[3]))
