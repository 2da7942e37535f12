"""The class `Belief`, a Gaussian distribution of the unknown parameters, and `LawBelief`, one for each contact law."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.stats import norm

from drake_cafim.errors import InputError
from drake_cafim.parameters import Parameters
from drake_cafim.typing import Array

FOUND = 1.0 / 3.0
"""A parameter is found where its std is below this share of the prior's.

A prior that is only cut, since nothing was felt so far, keeps more: .34 of its std if cut two stds below its mean.
"""


@dataclass(frozen=True)
class Belief:
    """θ ~ N(mean, covariance): names of n parameters, mean (n,), covariance (n, n), in the parameters' units."""

    names: tuple[str, ...]
    mean: Array
    covariance: Array

    def __post_init__(self) -> None:
        size = len(self.names)
        if np.shape(self.mean) != (size,) or np.shape(self.covariance) != (size, size):
            raise InputError(
                f"belief over {', '.join(self.names)}: mean of shape {np.shape(self.mean)} and covariance of shape "
                f"{np.shape(self.covariance)}, expected ({size},) and ({size}, {size})"
            )

    @classmethod
    def prior(cls, parameters: Parameters) -> "Belief":
        """The prior of the free parameters, independent of each other."""
        return cls(parameters.names, parameters.mean, np.diag(parameters.std**2))

    @cached_property
    def information(self) -> Array:
        """Σ⁻¹ (n, n), read-only; zero for a parameter without a prior (infinite std)."""
        known = np.isfinite(np.diag(self.covariance))
        result = np.zeros_like(self.covariance)
        result[np.ix_(known, known)] = _inverse(self.covariance[np.ix_(known, known)])
        result.setflags(write=False)
        return result

    @property
    def std(self) -> Array:
        """Standard deviations (n,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def update(self, fisher: Array, mean: Array) -> "Belief":
        """The posterior at the estimate `mean` (n,): Σ⁺ = (F + Σ⁻¹)⁻¹ for the Fisher information F (n, n).

        F holds the data alone; the prior enters here and nowhere else (paper, Eq. 11).
        """
        precision = np.asarray(fisher) + self.information
        return Belief(self.names, np.asarray(mean, dtype=float), _inverse(precision))

    def interval(self, level: float = 0.95) -> Array:
        """Central credible intervals (n, 2), each of probability `level`."""
        half = norm.ppf(0.5 + 0.5 * level) * self.std
        return np.stack([self.mean - half, self.mean + half], axis=-1)

    def entropy(self) -> float:
        """Differential entropy ½ log det(2πe Σ), nats; nan where Σ is not positive definite."""
        sign, logarithm = np.linalg.slogdet(2.0 * np.pi * np.e * self.covariance)
        return float(0.5 * logarithm) if sign > 0 else float("nan")

    def vector(self) -> Array:
        """Mean, then covariance row by row, (n + n²,), as on a Diagram's `belief` ports."""
        return np.concatenate([self.mean, self.covariance.ravel()])

    @classmethod
    def from_vector(cls, names: tuple[str, ...], vector: Array) -> "Belief":
        """The inverse of `vector`."""
        size = len(names)
        return cls(names, np.array(vector[:size]), np.array(vector[size:]).reshape(size, size))


def not_found(prior: Belief, belief: Belief, sought: Array) -> tuple[str, ...]:
    """The names of the sought parameters (n,) bool of which the data have told little: see `FOUND`."""
    little = belief.std > FOUND * prior.std
    return tuple(name for name, there in zip(belief.names, np.logical_and(little, sought), strict=True) if there)


@dataclass(frozen=True)
class LawBelief:
    """Which of several contact laws holds: a belief over each law's own parameters, and the laws' probabilities.

    `log_weight` (m,) are their logarithms up to a constant: log prior probability plus log evidence.
    """

    laws: tuple[str, ...]
    beliefs: tuple[Belief, ...]
    log_weight: Array

    @classmethod
    def prior(cls, parameters: Mapping[str, Parameters]) -> "LawBelief":
        """Equally probable laws, each with the priors of its parameters."""
        beliefs = tuple(Belief.prior(each) for each in parameters.values())
        return cls(tuple(parameters), beliefs, np.zeros(len(beliefs)))

    @property
    def probability(self) -> Array:
        """The laws' probabilities (m,)."""
        likely = np.exp(self.log_weight - self.log_weight.max())
        return np.asarray(likely / likely.sum())

    @property
    def best(self) -> int:
        """The index of the most probable law, the first of equals."""
        return int(np.argmax(self.log_weight))

    @property
    def names(self) -> tuple[tuple[str, ...], ...]:
        """The parameters of each law, by which `from_vector` reads."""
        return tuple(belief.names for belief in self.beliefs)

    def vector(self) -> Array:
        """The laws' beliefs one after the other, then the log weights; of a single law its belief alone."""
        weights = self.log_weight if len(self.laws) > 1 else np.zeros(0)
        return np.concatenate([*(belief.vector() for belief in self.beliefs), weights])

    @classmethod
    def from_vector(cls, laws: tuple[str, ...], names: Sequence[tuple[str, ...]], vector: Array) -> "LawBelief":
        """The inverse of `vector`, for laws with parameters `names`."""
        ends = np.cumsum([len(own) + len(own) ** 2 for own in names])
        *parts, weights = np.split(np.asarray(vector), ends)
        beliefs = tuple(Belief.from_vector(own, part) for own, part in zip(names, parts, strict=True))
        return cls(laws, beliefs, weights if len(laws) > 1 else np.zeros(1))


def _inverse(matrix: Array) -> Array:
    """Inverse (n, n) of a symmetric positive definite matrix, positive definite in spite of rounding.

    One direction may be known 10⁸ times better than another (a corner touched at its tip): there a plain inverse can
    have negative variances. Hence scaling to a unit diagonal, and a lower limit on the eigenvalues.
    """
    scale = 1.0 / np.sqrt(np.diag(matrix))
    values, vectors = np.linalg.eigh(scale[:, np.newaxis] * matrix * scale)
    values = np.maximum(values, 1e-14 * values.max())
    scaled = scale[:, np.newaxis] * vectors
    return np.asarray((scaled / values) @ scaled.T)
