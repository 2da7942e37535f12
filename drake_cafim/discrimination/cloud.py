"""A cloud of candidates that learns its shape from their worth: covariance matrix adaptation (CMA-ES)."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.typing import Array

WIDEST = 1.0
"""Of the scale, in units of half a range: a wider cloud would only pile up at the bounds."""
FLATTEST = 1e-20
"""Of the covariance's eigenvalues."""


@dataclass(frozen=True)
class Cloud:
    """Candidates within [−1, 1]^d, normal about `mean` (d,) with `scale`² times `covariance` (d, d).

    `path` and `scale_path` (d,) remember where the mean went. Hansen, The CMA Evolution Strategy: A Tutorial, 2016,
    eqs. 40–47, with the better half of each generation as parents; candidates beyond the bounds are put onto them.
    """

    mean: Array
    scale: float
    covariance: Array
    path: Array
    scale_path: Array
    generation: int = 0

    @classmethod
    def about(cls, mean: Array, scale: float) -> "Cloud":
        """A round one."""
        zero = np.zeros(len(mean))
        return cls(mean, scale, np.eye(len(mean)), zero, zero)

    def drawn(self, count: int, random: np.random.Generator) -> Array:
        """Candidates (count, d)."""
        steps = random.standard_normal((count, len(self.mean))) @ self._root.T
        return np.asarray(np.clip(self.mean + self.scale * steps, -1.0, 1.0))

    def after(self, candidates: Array, scores: Array) -> "Cloud":
        """The next generation's cloud: nearer to the candidates (N, d) with the larger of `scores` (N,)."""
        d, parents = len(self.mean), len(candidates) // 2
        weights = np.log(parents + 0.5) - np.log(np.arange(1, parents + 1))
        weights = weights / weights.sum()
        mass = 1.0 / float(weights @ weights)  # as many equal parents would weigh as much
        steps = (candidates[np.argsort(-scores)[:parents]] - self.mean) / self.scale
        step = weights @ steps
        generation = self.generation + 1

        keep = (mass + 2.0) / (d + mass + 5.0)
        whitened = np.linalg.solve(self._root, step)
        scale_path = (1.0 - keep) * self.scale_path + np.sqrt(keep * (2.0 - keep) * mass) * whitened
        usual = np.sqrt(d) * (1.0 - 1.0 / (4.0 * d) + 1.0 / (21.0 * d * d))
        length = float(np.linalg.norm(scale_path)) / usual
        damping = 1.0 + keep + 2.0 * max(0.0, np.sqrt((mass - 1.0) / (d + 1.0)) - 1.0)

        follow = (4.0 + mass / d) / (d + 4.0 + 2.0 * mass / d)
        begun = np.sqrt(1.0 - (1.0 - keep) ** (2 * generation))
        steady = float(length / begun < 1.4 + 2.0 / (d + 1.0))
        path = (1.0 - follow) * self.path + steady * np.sqrt(follow * (2.0 - follow) * mass) * step
        one = 2.0 / ((d + 1.3) ** 2 + mass)
        many = min(1.0 - one, 2.0 * (mass - 2.0 + 1.0 / mass) / ((d + 2.0) ** 2 + mass))
        covariance = (
            (1.0 - one - many) * self.covariance + one * np.outer(path, path) + many * (steps.T * weights) @ steps
        )
        return Cloud(
            mean=self.mean + self.scale * step,
            scale=min(self.scale * float(np.exp(keep / damping * (length - 1.0))), WIDEST),
            covariance=covariance,
            path=path,
            scale_path=scale_path,
            generation=generation,
        )

    @property
    def _root(self) -> Array:
        """The symmetric root (d, d) of the covariance."""
        values, vectors = np.linalg.eigh(self.covariance)
        return np.asarray(vectors * np.sqrt(np.maximum(values, FLATTEST)) @ vectors.T)
