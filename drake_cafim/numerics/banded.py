"""Products with a lower triangular band matrix, and with its inverse, compiled.

LAPACK's `dtbtrs` solves for the columns of the right-hand side one after the other, each by short updates in memory.
Stored by rows, L takes part in sums over its rows, four columns at a time.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from drake_cafim.numerics.compiled import compiled_sums
from drake_cafim.typing import Array


@dataclass(frozen=True)
class LowerBand:
    """L (R, R) as its `rows` (R, b + 1): the last number of row i is L_ii, the one before it L_i,i−1 and so on."""

    rows: Array

    @property
    def diagonal(self) -> Array:
        """(R,)"""
        return self.rows[:, -1]

    def block(self, start: int, stop: int) -> "LowerBand":
        """The square block of the rows and columns from `start` to `stop` − 1."""
        return LowerBand(self.rows[start:stop])

    def full(self) -> sp.csr_matrix:
        """(R, R) L, without the entries that are zero."""
        row, entry = np.nonzero(self.rows)
        at = (row, row - self.rows.shape[1] + 1 + entry)
        return sp.csr_matrix((self.rows[row, entry], at), shape=(len(self.rows), len(self.rows)))

    def solve(self, right: Array) -> Array:
        """L⁻¹ `right`, for (R,) or (R, k)."""
        columns = right.reshape(len(right), -1).T
        count = len(columns)
        # two or three columns take longer by themselves than four
        solved = np.zeros((count + (-count % 4 if count % 4 > 1 else 0), len(right)))
        solved[:count] = columns
        _solve(self.rows, solved)
        return solved[:count].T.reshape(right.shape)

    def solve_transposed(self, right: Array) -> Array:
        """L⁻ᵀ `right`, for (R,) or (R, k)."""
        columns = _columns(right)
        _solve_transposed(self.rows, columns)
        return columns.T.reshape(right.shape)

    def times(self, right: Array) -> Array:
        """L `right`, for (R,) or (R, k)."""
        columns = _columns(right)
        return np.asarray(_multiply(self.rows, columns).T.reshape(right.shape))


def _columns(right: Array) -> Array:
    """(k, R) a copy of the columns of `right` (R,) or (R, k)."""
    return np.array(right.reshape(len(right), -1).T, dtype=float, order="C")


@compiled_sums
def _solve(rows: Array, x: Array) -> None:
    """Solves L y = x for each row of `x` (k, R), in place: y_i = (x_i − Σ_j<i L_ij y_j)/L_ii."""
    R, b, k = len(rows), rows.shape[1] - 1, len(x)
    for c in range(0, k - 3, 4):
        for i in range(R):
            n = min(b, i)
            row, start = rows[i, b - n : b], i - n
            first, second, third, fourth = x[c, start:i], x[c + 1, start:i], x[c + 2, start:i], x[c + 3, start:i]
            by_first, by_second, by_third, by_fourth = 0.0, 0.0, 0.0, 0.0
            for j in range(n):
                by_first += row[j] * first[j]
                by_second += row[j] * second[j]
                by_third += row[j] * third[j]
                by_fourth += row[j] * fourth[j]
            x[c, i] = (x[c, i] - by_first) / rows[i, b]
            x[c + 1, i] = (x[c + 1, i] - by_second) / rows[i, b]
            x[c + 2, i] = (x[c + 2, i] - by_third) / rows[i, b]
            x[c + 3, i] = (x[c + 3, i] - by_fourth) / rows[i, b]
    for c in range(k - k % 4, k):
        for i in range(R):
            n = min(b, i)
            row, known = rows[i, b - n : b], x[c, i - n : i]
            total = 0.0
            for j in range(n):
                total += row[j] * known[j]
            x[c, i] = (x[c, i] - total) / rows[i, b]


@compiled_sums
def _solve_transposed(rows: Array, x: Array) -> None:
    """Solves Lᵀ y = x for each row of `x` (k, R), in place: from the last on, y_i L_ij is taken off the x_j before."""
    R, b = len(rows), rows.shape[1] - 1
    for c in range(len(x)):
        for i in range(R - 1, -1, -1):
            n = min(b, i)
            row, before = rows[i, b - n : b], x[c, i - n : i]
            found = x[c, i] / rows[i, b]
            x[c, i] = found
            for j in range(n):
                before[j] -= row[j] * found


@compiled_sums
def _multiply(rows: Array, x: Array) -> Array:
    """(k, R) L x for each row x of `x` (k, R)."""
    R, b = len(rows), rows.shape[1] - 1
    product = np.empty_like(x)
    for c in range(len(x)):
        for i in range(R):
            n = min(b, i)
            row, known = rows[i, b - n :], x[c, i - n : i + 1]
            total = 0.0
            for j in range(n + 1):
                total += row[j] * known[j]
            product[c, i] = total
    return product
