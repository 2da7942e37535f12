"""The covariance of the weak form's rows, and the transformation that makes them independent with unit variance."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.linalg import lapack

from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Whitening:
    """The banded Cholesky factor L of the rows' covariance, in lower band storage (b + 1, R)."""

    factor: Array

    def __call__(self, rows: Array) -> Array:
        """L⁻¹ rows, for (R,) or (R, k)."""
        flat = rows.reshape(len(rows), -1)
        solved, info = lapack.dtbtrs(self.factor, flat, uplo="L")
        if info != 0:
            raise ArithmeticError(f"the covariance of the residual is singular at row {info}")
        return np.asarray(solved.reshape(rows.shape), dtype=float)

    @property
    def log_determinant(self) -> float:
        """ln det of the covariance."""
        return float(2.0 * np.sum(np.log(self.factor[0])))


def whitening(weak: WeakForm, physics: Physics) -> tuple[Whitening, sp.csr_matrix, list[tuple[str, slice]]]:
    """The whitening of one recording's rows under `physics`, with the noise Jacobian it was made from."""
    jacobian, labels = weak.noise_jacobian(physics)
    std = np.concatenate([np.full(part.stop - part.start, weak.samples.std[name]) for name, part in labels])
    scaled = jacobian @ sp.diags_array(std)
    covariance = sp.coo_matrix(scaled @ scaled.T)
    lower = covariance.row >= covariance.col
    row, column, value = covariance.row[lower], covariance.col[lower], covariance.data[lower]
    band = np.zeros((int((row - column).max()) + 1, covariance.shape[0]))
    band[row - column, column] = value
    # rounding must not make the factorisation fail where rows are nearly dependent
    band[0] *= 1.0 + 1e-10
    return Whitening(scipy.linalg.cholesky_banded(band, lower=True)), jacobian, labels
