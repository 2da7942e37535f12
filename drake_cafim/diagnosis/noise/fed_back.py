"""The motion that a controller makes of its sensors' noise, which it takes for motion of the joints.

A joint that is held still follows the noise of its velocity: v ≈ −e at low frequencies. A regressor that is evaluated
on this motion is correlated with the noise that the equations leave, so that E[Jᵀz] is not zero where nothing is
missing (closed-loop identification; Ljung, System Identification, 1999, §13.4).
"""

import numpy as np
from scipy.stats import f as fisher

from drake_cafim.diagnosis.thresholds import FEEDBACK_P_VALUE
from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array

DIFFERENCES = 4
"""Order of the differences that leave of a smooth motion nothing but the noise of its samples."""
LAGS = 2
"""Samples that an effort may follow from: the one at which it begins, and the one before."""


def feedback_gains(u: Array, q: Array, v: Array) -> Array:
    """(n, 2, 2) gains of each joint's effort `u` (N, n) by the noise of its own `q` and `v` (N, n) as recorded.

    The axes are the joint, the lag in samples, and position or velocity: u = −Σ (k_p q + k_d v) but for what is smooth.
    Fourth differences of the three are compared by least squares. Zero where an F-test with a p-value of
    `FEEDBACK_P_VALUE` finds no feedback.
    """
    rough = [np.diff(np.nan_to_num(values), DIFFERENCES, axis=0) for values in (u, q, v)]
    gains = np.zeros((u.shape[1], LAGS, 2))
    for j in range(u.shape[1]):
        effort, *motion = (values[:, j] for values in rough)
        columns = np.stack([own[1 - lag : len(own) - lag] for lag in range(LAGS) for own in motion], axis=1)
        size = np.linalg.norm(columns, axis=0)
        columns, effort = columns / np.where(size > 0.0, size, 1.0), effort[1:]
        found = np.linalg.lstsq(columns, effort, rcond=None)[0]
        left, freedom = effort - columns @ found, len(effort) - columns.shape[1]
        explained, remains = float(effort @ effort - left @ left), float(left @ left)
        if freedom <= 0 or not explained > 0.0:
            continue
        ratio = (explained / columns.shape[1]) / max(remains / freedom, np.finfo(float).tiny)
        if fisher.sf(ratio, columns.shape[1], freedom) < FEEDBACK_P_VALUE:
            gains[j] = -(found / np.where(size > 0.0, size, 1.0)).reshape(LAGS, 2)
    return gains


def fed_back_motion(time: Array, gains: Array, noise: tuple[Array, Array], mobility: Array) -> tuple[Array, Array]:
    """Positions and velocities (N, n) that a controller with these `gains` (n, 2, 2) makes of its sensors' noise.

    `noise` (N, n) each is that of the recorded positions and velocities; `mobility` (N, n, n) is M⁻¹ along the motion.
    From M v̇ = −Σ (k_p (q + e_q) + k_d (v + e_v)), by semi-implicit Euler steps from sample to sample, from rest. Other
    forces, as friction, are left out. Not finite where the samples are too far apart for the gains.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        q, v = _respond(time, gains, *(np.ascontiguousarray(part) for part in noise), np.ascontiguousarray(mobility))
    return np.asarray(q), np.asarray(v)


@compiled
def _respond(time: Array, gains: Array, noise_q: Array, noise_v: Array, mobility: Array) -> tuple[Array, Array]:
    N, n = noise_q.shape
    q, v, effort = np.zeros((N, n)), np.zeros((N, n)), np.zeros(n)
    for k in range(N - 1):
        step = time[k + 1] - time[k]
        for j in range(n):
            effort[j] = 0.0
            for lag in range(min(gains.shape[1], k + 1)):
                effort[j] -= gains[j, lag, 0] * (noise_q[k - lag, j] + q[k - lag, j])
                effort[j] -= gains[j, lag, 1] * (noise_v[k - lag, j] + v[k - lag, j])
        for j in range(n):
            v[k + 1, j] = v[k, j]
            for other in range(n):
                v[k + 1, j] += step * mobility[k, j, other] * effort[other]
            q[k + 1, j] = q[k, j] + 0.5 * step * (v[k, j] + v[k + 1, j])
    return q, v
