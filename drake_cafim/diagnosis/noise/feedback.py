"""The linear feedback by which a controller carries measurement noise into the efforts."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.thresholds import FEEDBACK_ROUGHNESS_SHARE
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Feedback:
    """Linear feedback u = Σ K x of q, v now and q, v one sample ago.

    `gains` (n, 4, n): measured joint, which of the four, joint of the effort; zero where there is no feedback.
    """

    gains: Array

    @classmethod
    def of(cls, q: Array, v: Array, u: Array) -> "Feedback":
        """The gains by least squares over fourth differences of q, v and u, (N, n) each, which contain noise alone.

        Gains of a joint's effort are zero where they explain less than `FEEDBACK_ROUGHNESS_SHARE` of its differences.
        """
        n = q.shape[1]
        rough = [np.diff(channel, n=4, axis=0) for channel in (*_inputs(q, v), u[1:])]
        regressors, effort = np.concatenate(rough[:4], axis=1), rough[4]
        scale = np.linalg.norm(regressors, axis=0) + 1e-300
        solved = np.linalg.lstsq(regressors / scale, effort, rcond=1e-6)[0] / scale[:, None]
        unexplained = np.sum((effort - regressors @ solved) ** 2, axis=0)
        solved[:, unexplained > (1.0 - FEEDBACK_ROUGHNESS_SHARE) * np.sum(effort**2, axis=0)] = 0.0
        return cls(solved.reshape(4, n, n).transpose(1, 0, 2))

    def carry_noise(self, q: Array, v: Array) -> Array:
        """The efforts (N, n) that noise in q and v, (N, n) each, causes through the feedback."""
        efforts = sum(np.einsum("ij,jk->ik", noise, self.gains[:, k]) for k, noise in enumerate(_inputs(q, v)))
        return np.concatenate([np.zeros((1, q.shape[1])), np.asarray(efforts, dtype=float)])


def _inputs(q: Array, v: Array) -> tuple[Array, Array, Array, Array]:
    return q[1:], v[1:], q[:-1], v[:-1]
