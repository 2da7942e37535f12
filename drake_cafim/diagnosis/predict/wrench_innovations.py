"""The likelihood of wrench sensors' samples, given the state filtered from the joints' samples."""

import numpy as np

from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.dynamics.motion import motion
from drake_cafim.recordings.recording import WRENCH_COMPONENTS
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

DIFFERENCE = 1e-6
"""Step of finite differences of q, rad (m), and v, rad/s (m/s)."""


def wrench_innovations(weak: WeakForm, physics: Physics, states: Array, covariances: Array) -> Array:
    """The negative log likelihood (N,) of all sensors' six components, ln(2πσ²) included.

    `states` x (N, 2n) are q and v at the samples, with covariances P (N, 2n, 2n). To first order the innovation
    e = y − h(x) has the covariance S = H P Hᵀ + R, with H = ∂h/∂x. Where x is NaN, so is the result.
    """
    samples, memory = weak.samples, weak.contact_memory(physics)
    known = np.flatnonzero(np.isfinite(states[:, 0]))
    filled = np.where(np.isfinite(states), states, np.concatenate([samples.q, samples.v], axis=1))

    def predict(states: Array) -> Array:
        q, v = np.split(states, 2, axis=1)
        return weak.contacts.readings_along(physics, motion(physics.tree, q, v), memory)[known]

    predicted = predict(filled)
    ahead = [predict(filled + DIFFERENCE * shift) for shift in np.eye(states.shape[1])]
    H = (np.stack(ahead, axis=-1) - predicted[..., None]) / DIFFERENCE
    names = [f"wrench.{sensor.name}.{axis}" for sensor in weak.sensors for axis in WRENCH_COMPONENTS]
    R = np.diag([samples.std[name] ** 2 for name in names])
    S = H @ covariances[known] @ np.swapaxes(H, 1, 2) + R
    error = np.concatenate(samples.wrenches, axis=1)[known] - predicted
    solved = np.linalg.solve(S, error[..., None])[..., 0]
    result = np.full(len(samples.time), np.nan)
    result[known] = 0.5 * (np.sum(error * solved, axis=1) + np.linalg.slogdet(2.0 * np.pi * S)[1])
    return result
