"""Covariance matrix adaptation (CMA-ES): a normal distribution of candidates, adapted to their scores."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.typing import Array

WIDEST = 1.0
"""Largest scale, in units of half a range: with a larger one most candidates would be clipped to the bounds."""
FLATTEST = 1e-20
"""Smallest eigenvalue of the covariance, against rounding below zero."""


@dataclass(frozen=True)
class Cloud:
    """The normal distribution of candidates: `mean` (d,), covariance `scale`² · `covariance` (d, d), in [−1, 1]^d.

    `path` and `scale_path` (d,) are CMA-ES's evolution paths. Hansen, The CMA Evolution Strategy: A Tutorial, 2016,
    eqs. 40–47, with the better half of each generation as parents; candidates are clipped to the bounds.
    """

    mean: Array
    scale: float
    covariance: Array
    path: Array
    scale_path: Array
    generation: int = 0

    @classmethod
    def about(cls, mean: Array, scale: float) -> "Cloud":
        """The initial isotropic distribution about `mean` (d,)."""
        zero = np.zeros(len(mean))
        return cls(mean, scale, np.eye(len(mean)), zero, zero)

    def drawn(self, count: int, random: np.random.Generator) -> Array:
        """Random candidates (count, d), clipped to [−1, 1]."""
        steps = random.standard_normal((count, len(self.mean))) @ self._root.T
        return np.asarray(np.clip(self.mean + self.scale * steps, -1.0, 1.0))

    def after(self, candidates: Array, scores: Array) -> "Cloud":
        """The next generation's distribution, updated by candidates (N, d) with `scores` (N,), larger is better."""
        d, parents = len(self.mean), len(candidates) // 2
        weights = np.log(parents + 0.5) - np.log(np.arange(1, parents + 1))
        weights = weights / weights.sum()
        mass = 1.0 / float(weights @ weights)  # effective number of parents, μ_eff
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
        settling = np.sqrt(1.0 - (1.0 - keep) ** (2 * generation))
        steady = float(length / settling < 1.4 + 2.0 / (d + 1.0))
        path = (1.0 - follow) * self.path + steady * np.sqrt(follow * (2.0 - follow) * mass) * step
        c_1 = 2.0 / ((d + 1.3) ** 2 + mass)
        c_mu = min(1.0 - c_1, 2.0 * (mass - 2.0 + 1.0 / mass) / ((d + 2.0) ** 2 + mass))
        covariance = (
            (1.0 - c_1 - c_mu) * self.covariance + c_1 * np.outer(path, path) + c_mu * (steps.T * weights) @ steps
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
        """The symmetric square root (d, d) of `covariance`."""
        values, vectors = np.linalg.eigh(self.covariance)
        return np.asarray(vectors * np.sqrt(np.maximum(values, FLATTEST)) @ vectors.T)
