"""Columns X along which an effect moves the whitened rows, and the products of them by which it is fitted."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Nuisance:
    """What a fit has already: an orthonormal `basis` Q (R + n, p) of its slopes, and its `residual` z beside them."""

    basis: Array
    residual: Array
    _known: dict[object, Array] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def of(cls, fitted: Fit) -> "Nuisance":
        """Of all parameters of a fit."""
        slopes, residual = fitted.jacobian, fitted.residual
        basis = np.linalg.qr(slopes)[0] if slopes.shape[1] else np.zeros((len(residual), 0))
        return cls(basis, residual - basis @ (basis.T @ residual))

    def known(self, key: object, compute: Callable[[], Array]) -> Array:
        """What columns of one kind `compute` of it, once."""
        if key not in self._known:
            self._known[key] = compute()
        return self._known[key]


class Products(NamedTuple):
    """XᵀX (c, c), QᵀX (p, c) and Xᵀz (c,)."""

    together: Array
    along: Array
    score: Array


class Columns(ABC):
    """Columns X (R, c) of the whitened rows, of which the products are known without whitening them."""

    @abstractmethod
    def whitened(self) -> Array:
        """X (R, c)."""

    @abstractmethod
    def times(self, coefficients: Array) -> Array:
        """X b (R,) for coefficients b (c,)."""

    @abstractmethod
    def products(self, nuisance: Nuisance) -> Products:
        """The products of X with itself and with the `nuisance`."""


def products_of(columns: Array | Columns, nuisance: Nuisance) -> Products:
    """The products of columns (R, c), or of more rows (R + n, c)."""
    # the square of a diverged state overflows
    with np.errstate(over="ignore", invalid="ignore"):
        if isinstance(columns, Columns):
            return columns.products(nuisance)
        together, count = columns.T @ columns, len(columns)
        return Products(together, nuisance.basis[:count].T @ columns, columns.T @ nuisance.residual[:count])


def change_by(columns: Array | Columns, coefficients: Array) -> Array:
    """X b (R,) for coefficients b (c,)."""
    return columns.times(coefficients) if isinstance(columns, Columns) else np.asarray(columns @ coefficients)


def whitened(columns: Array | Columns) -> Array:
    """X (R, c)."""
    return columns.whitened() if isinstance(columns, Columns) else columns
