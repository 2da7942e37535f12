"""Products A Bᵀ of sparse matrices whose rows cover short runs of columns."""

import numpy as np
import pytest
import scipy.sparse as sp

from drake_cafim.numerics.row_products import SymmetricBand, lower_entries

R, N = 20, 50


def _rows(rng: np.random.Generator, each: int, unsorted: bool = False) -> sp.csr_matrix:
    """Windows that move on by two columns every second row; some rows are empty."""
    full = np.zeros((R, N))
    for i in range(R):
        if i % 5 != 2:
            begin = 4 * (i // 2)
            full[i, begin : begin + each] = rng.standard_normal(min(each, N - begin))
    matrix = sp.csr_matrix(full)
    if unsorted:
        for i in range(R):
            row = slice(matrix.indptr[i], matrix.indptr[i + 1])
            matrix.indices[row], matrix.data[row] = matrix.indices[row][::-1].copy(), matrix.data[row][::-1].copy()
        matrix.has_sorted_indices = False
    return matrix


@pytest.mark.parametrize("unsorted", [False, True])
@pytest.mark.parametrize("order", [(3, 12), (12, 3)])
def test_the_sum_is_that_of_full_products(order: tuple[int, int], unsorted: bool) -> None:
    """The second product may reach further from the diagonal than the first, or less far."""
    rng, found, expected = np.random.default_rng(0), SymmetricBand.zeros(R), np.zeros((R, R))
    for scale, each in zip((0.5, 2.0), order, strict=True):
        part = _rows(rng, each, unsorted)
        found.add(scale, part, part)
        expected += scale * (part @ part.T).toarray()
    assert np.allclose(found.full().toarray(), expected, rtol=1e-12, atol=1e-12)
    assert found.full().nnz == np.count_nonzero(expected)


def test_correlated_noise_reaches_from_row_to_row() -> None:
    rng = np.random.default_rng(0)
    rows = _rows(rng, 6)
    alike = sp.csr_matrix(np.where(np.abs(np.subtract.outer(np.arange(N), np.arange(N))) < 9, 0.3, 0.0) + np.eye(N))
    found = SymmetricBand.zeros(R)
    found.add(1.0, sp.csr_matrix(rows @ alike), rows)
    assert np.allclose(found.full().toarray(), (rows @ alike @ rows.T).toarray(), rtol=1e-12, atol=1e-12)


def test_nothing_is_added_by_columns_without_noise() -> None:
    found = SymmetricBand.zeros(R)
    found.add(1.0, sp.csr_matrix((R, N)), sp.csr_matrix((R, N)))
    assert found.full().nnz == 0 and found.full().shape == (R, R)


def _banded(width: int) -> sp.csr_matrix:
    rng = np.random.default_rng(width)
    lower = np.triu(np.tril(rng.standard_normal((R, R))), 1 - width) + 4.0 * np.eye(R)
    return sp.csr_matrix(lower @ lower.T)


def test_matrices_of_other_widths_are_added_and_the_first_stays_as_it_was() -> None:
    first, second = _banded(2), _banded(5)
    begun = SymmetricBand.of(first)
    found = begun.copy()
    found.add_entries(0.5, lower_entries(second))
    found.add_entries(1.0, lower_entries(sp.csr_matrix((R, R))))
    found.add_entries(2.0, lower_entries(first))
    assert np.allclose(found.full().toarray(), (3.0 * first + 0.5 * second).toarray(), rtol=1e-12, atol=1e-12)
    assert np.array_equal(found.diagonal, np.diagonal(found.full().toarray()))
    assert np.allclose(begun.full().toarray(), first.toarray(), rtol=1e-14, atol=0.0)


@pytest.mark.parametrize(("width", "size"), [(2, 5), (5, 4), (1, 2), (5, 1)])
def test_blocks_on_the_diagonal_are_those_of_the_full_matrix(width: int, size: int) -> None:
    full = _banded(width).toarray()
    expected = np.stack([full[at : at + size, at : at + size] for at in range(0, R, size)])
    assert np.allclose(SymmetricBand.of(sp.csr_matrix(full)).blocks(size), expected, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("width", [1, 2, 6, R])
def test_a_factor_is_the_full_matrix_s(width: int) -> None:
    """It is exact, and taken of a copy; of what has none, the error is NumPy's."""
    matrix = _banded(width)
    band = SymmetricBand.of(matrix)
    before = band.rows.copy()
    more = np.linspace(0.1, 0.2, R)
    expected = np.linalg.cholesky(matrix.toarray() + np.diag(more))
    assert np.allclose(band.factor(more).full().toarray(), expected, rtol=1e-10, atol=1e-12)
    assert np.array_equal(band.rows, before)
    for wrong in (-100.0, np.nan):
        with pytest.raises(np.linalg.LinAlgError):
            band.factor(wrong)
