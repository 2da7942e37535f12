"""Symmetric band matrices, and products A Bᵀ of sparse matrices whose rows cover short runs of columns, compiled.

A general product of sparse matrices visits each pair of entries by itself. Here each row becomes the dense run of
columns that it covers, and each entry of the product a dot product of two runs where they overlap.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from drake_cafim.numerics.banded import LowerBand
from drake_cafim.numerics.compiled import compiled, compiled_sums
from drake_cafim.typing import Array, Indices

LowerEntries = tuple[Indices, Indices, Array]
"""Rows (K,) of the entries of a symmetric matrix on and below its diagonal, how far below it they are, and values."""


@dataclass
class SymmetricBand:
    """A sum of symmetric products (R, R); its `rows` (R, b + 1) are stored as in `LowerBand`."""

    rows: Array

    @classmethod
    def zeros(cls, size: int) -> "SymmetricBand":
        """The empty sum (`size`, `size`)."""
        return cls(np.zeros((size, 1)))

    @classmethod
    def of(cls, matrix: sp.csr_matrix) -> "SymmetricBand":
        """A banded `matrix` (R, R)."""
        found = cls.zeros(matrix.shape[0])
        found.add_entries(1.0, lower_entries(matrix))
        return found

    def copy(self) -> "SymmetricBand":
        """The same sum, to which other terms may be added."""
        return SymmetricBand(self.rows.copy())

    def add(self, scale: float, left: sp.csr_matrix, right: sp.csr_matrix) -> None:
        """Adds `scale` `left` `right`ᵀ, a product of (R, N) and (N, R) that is symmetric."""
        if not left.nnz or not right.nnz:
            return
        runs = _runs(left.indptr, left.indices, left.data), _runs(right.indptr, right.indices, right.data)
        (of_left, first_left, last_left), (of_right, first_right, last_right) = runs
        self._widen(_reach(first_left, last_left, last_right))
        _add(self.rows, scale, of_left, first_left, last_left, of_right, first_right, last_right)

    def add_entries(self, scale: float, entries: LowerEntries) -> None:
        """Adds `scale` times a symmetric matrix (R, R), by its `lower_entries`."""
        row, below, value = entries
        if len(row):
            self._widen(int(below.max()))
            self.rows[row, self.rows.shape[1] - 1 - below] += scale * value

    def _widen(self, reach: int) -> None:
        """Makes room for entries as far below the diagonal as `reach`."""
        if reach >= self.rows.shape[1]:
            wider = np.zeros((len(self.rows), reach + 1))
            wider[:, reach + 1 - self.rows.shape[1] :] = self.rows
            self.rows = wider

    @property
    def diagonal(self) -> Array:
        """(R,) the entries on the diagonal."""
        return self.rows[:, -1]

    def blocks(self, size: int) -> Array:
        """(R / size, size, size) the blocks on the diagonal."""
        found = np.zeros((len(self.rows) // size, size, size))
        for below in range(min(size, self.rows.shape[1])):
            along = self.rows[:, -1 - below].reshape(-1, size)[:, below:]
            at = np.arange(below, size)
            found[:, at, at - below] = found[:, at - below, at] = along
        return found

    def factor(self, more: float | Array = 0.0) -> LowerBand:
        """The lower Cholesky factor of this with `more` on the diagonal.

        Raises `numpy.linalg.LinAlgError` where that is not positive definite, or not finite.
        """
        rows = self.rows.copy()
        rows[:, -1] += more
        if not np.all(np.isfinite(rows)):
            raise np.linalg.LinAlgError("the matrix is not finite")
        # the rows of a lower triangle are the columns of an upper one, as LAPACK stores it, and so are their factors
        scipy.linalg.cholesky_banded(rows.T, overwrite_ab=True, lower=False, check_finite=False)
        return LowerBand(rows)

    def full(self) -> sp.csr_matrix:
        """Both triangles (R, R), without the entries that are zero."""
        R, b = len(self.rows), self.rows.shape[1] - 1
        row, entry = np.nonzero(self.rows)
        column, value = row - b + entry, self.rows[row, entry]
        below = column < row
        rows, columns = np.concatenate([row, column[below]]), np.concatenate([column, row[below]])
        return sp.csr_matrix((np.concatenate([value, value[below]]), (rows, columns)), shape=(R, R))


def lower_entries(symmetric: sp.csr_matrix) -> LowerEntries:
    """The entries of a `symmetric` matrix on and below the diagonal: row, how far below, and value."""
    entries = sp.coo_matrix(symmetric)
    lower = entries.row >= entries.col
    row, column, value = entries.row[lower], entries.col[lower], entries.data[lower]
    return row, row - column, value


def _runs(start: Indices, columns: Indices, values: Array) -> tuple[Array, Indices, Indices]:
    """By row of a sparse matrix: its entries from the first column on (R, w), and its first and last column (R,).

    The last column of an empty row lies before the first one.
    """
    first, last = _ends(start, columns)
    return _dense(start, columns, values, first, int(max(np.max(last - first), 0)) + 1), first, last


@compiled
def _ends(start: Indices, columns: Indices) -> tuple[Indices, Indices]:
    """The first and the last column (R,) of each row; of an empty one 0 and −1."""
    R = len(start) - 1
    first, last = np.zeros(R, dtype=np.int64), np.full(R, -1, dtype=np.int64)
    for i in range(R):
        for k in range(start[i], start[i + 1]):
            column = columns[k]
            if k == start[i] or column < first[i]:
                first[i] = column
            if column > last[i]:
                last[i] = column
    return first, last


@compiled
def _dense(start: Indices, columns: Indices, values: Array, first: Indices, width: int) -> Array:
    """(R, `width`) the entries of each row from its `first` column on."""
    R = len(start) - 1
    dense = np.zeros((R, width))
    for i in range(R):
        for k in range(start[i], start[i + 1]):
            dense[i, columns[k] - first[i]] += values[k]
    return dense


def _reach(first_left: Indices, last_left: Indices, last_right: Indices) -> int:
    """How far below the diagonal the product may have entries: the largest i − j where row i and row j overlap."""
    filled = np.flatnonzero(last_left >= first_left)
    earliest = np.searchsorted(np.maximum.accumulate(last_right), first_left[filled])
    return int(max(np.max(filled - earliest, initial=0), 0))


@compiled_sums
def _add(
    rows: Array,
    scale: float,
    left: Array,
    first_left: Indices,
    last_left: Indices,
    right: Array,
    first_right: Indices,
    last_right: Indices,
) -> None:
    """Adds `scale` times the products of the runs of `left` with those of `right` to the lower triangle `rows`."""
    R, b = len(rows), rows.shape[1] - 1
    for i in range(R):
        if last_left[i] < first_left[i]:
            continue
        for j in range(max(i - b, 0), i + 1):
            begin, end = max(first_left[i], first_right[j]), min(last_left[i], last_right[j]) + 1
            if begin >= end:
                continue
            own, other = left[i, begin - first_left[i] : end - first_left[i]], right[j, begin - first_right[j] :]
            total = 0.0
            for k in range(end - begin):
                total += own[k] * other[k]
            rows[i, b - i + j] += scale * total
