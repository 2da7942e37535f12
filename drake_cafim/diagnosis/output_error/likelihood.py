"""The likelihood of errors of simulations, whose size nobody knows and of which few are independent."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.typing import Array

Numbering = np.ndarray[tuple[int], np.dtype[np.int64]]

PHASES = 64
"""Instants of a window at which its errors are compared with those of others."""
TINY = 1e-30
"""rad² (m²): least mean squared error, of a joint that does not move."""


@dataclass(frozen=True)
class ErrorLikelihood:
    """Of c joints, each with N `independent` (c,) errors of an unknown size: −2 ln p = N ln mean e²."""

    independent: Array

    @classmethod
    def of(cls, errors: Array, window: Numbering) -> "ErrorLikelihood":
        """For `errors` (S, c), as independent as these, in windows that are numbered through."""
        return cls(np.array([independent_errors(column, window) for column in errors.T]))

    def costs(self, errors: Array) -> Array:
        """(c,) −2 ln p of errors (S, c)."""
        return np.array([self.cost(column, j) for j, column in enumerate(errors.T)])

    def cost(self, errors: Array, joint: int) -> float:
        """−2 ln p of the errors (S,) of one joint."""
        return float(self.independent[joint] * np.log(max(float(np.mean(errors**2)), TINY)))

    def weight(self, errors: Array, joint: int) -> float:
        """Half of the derivative of −2 ln p by each error of a joint, over that error: what its square counts."""
        return float(self.independent[joint] / max(float(errors @ errors), TINY))


def independent_errors(errors: Array, window: Numbering) -> float:
    """How many independent errors `errors` (S,) of windows count as: degrees of freedom of the sum of their squares.

    Normal errors of W windows with one covariance R have as many as χ² of the same mean and variance (Box, Annals of
    Mathematical Statistics 25(2), 1954), W (tr R)²/tr R². The ratio is one over the mean squared cosine between the
    errors of two windows, which is 1 where all have the same course.
    """
    courses = []
    for w in np.unique(window):
        own = errors[window == w]
        if np.any(own):
            courses.append(np.interp(np.linspace(0.0, 1.0, PHASES), np.linspace(0.0, 1.0, len(own)), own))
    if len(courses) < 2:
        return 1.0
    e = np.stack(courses)
    squares = np.sum(e**2, axis=1)
    cosine = e @ e.T / np.sqrt(np.outer(squares, squares))
    freedom = (len(e) ** 2 - len(e)) / max(float(np.sum(cosine**2)) - len(e), TINY)
    return float(min(freedom, PHASES) * len(e))
