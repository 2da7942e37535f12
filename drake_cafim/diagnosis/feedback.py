"""How a controller passes the noise of what it measures on to the efforts."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.typing import Array

_NOTICED = 0.02
"""Share of an effort's roughness that the measurements' must explain."""


@dataclass(frozen=True)
class Feedback:
    """`gains` (n, 4, n): what u takes of q, v now and of q, v one sample ago, by joint; zero where it takes nothing."""

    gains: Array

    @classmethod
    def of(cls, q: Array, v: Array, u: Array) -> "Feedback":
        """By least squares over fourth differences, (N, n) each, in which noise is all that is left of a motion."""
        n = q.shape[1]
        rough = [np.diff(channel, n=4, axis=0) for channel in (*_inputs(q, v), u[1:])]
        regressors, effort = np.concatenate(rough[:4], axis=1), rough[4]
        scale = np.linalg.norm(regressors, axis=0) + 1e-300
        solved = np.linalg.lstsq(regressors / scale, effort, rcond=1e-6)[0] / scale[:, None]
        left = np.sum((effort - regressors @ solved) ** 2, axis=0)
        solved[:, left > (1.0 - _NOTICED) * np.sum(effort**2, axis=0)] = 0.0
        return cls(solved.reshape(4, n, n).transpose(1, 0, 2))

    def passed_on(self, q: Array, v: Array) -> Array:
        """The efforts (N, n) that noise in q and v (N, n) makes."""
        efforts = sum(np.einsum("ij,jk->ik", noise, self.gains[:, k]) for k, noise in enumerate(_inputs(q, v)))
        return np.concatenate([np.zeros((1, q.shape[1])), np.asarray(efforts, dtype=float)])


def _inputs(q: Array, v: Array) -> tuple[Array, Array, Array, Array]:
    return q[1:], v[1:], q[:-1], v[:-1]
