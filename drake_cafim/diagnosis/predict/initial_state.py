"""Estimation of a joint state and its covariance from the samples just before an instant."""

import numpy as np

from drake_cafim.diagnosis.rows.measurement import Measurement
from drake_cafim.diagnosis.rows.samples import Samples
from drake_cafim.typing import Array

LOOK_BACK = 0.05
"""Length of the interval of samples from which a state is estimated, s."""


def state_at(samples: Samples, measured: Measurement, index: int) -> tuple[Array, Array, Array]:
    """q, v (n,) and the covariance (n, 2, 2) of both for each joint at sample `index`, from the `LOOK_BACK` s before.

    A cubic in time is fitted to each joint's q, and to its v where measured, by least squares weighted by 1/std; at
    least five samples are used, if there are as many.
    """
    time = samples.time
    first = min(int(np.searchsorted(time, time[index] - LOOK_BACK - 1e-9)), max(index - 4, 0))
    t = (time[first : index + 1] - time[index]) / LOOK_BACK
    powers = t[:, None] ** np.arange(4)
    slopes = np.concatenate([np.zeros((len(t), 1)), np.arange(1, 4) * t[:, None] ** np.arange(3)], axis=1) / LOOK_BACK
    n = measured.q.shape[1]
    q, v, covariance = np.empty(n), np.empty(n), np.empty((n, 2, 2))
    names = [name.removeprefix("q.") for name in samples.std if name.startswith("q.")]
    for j, name in enumerate(names[:n]):
        rows, values = (
            [powers / samples.std[f"q.{name}"]],
            [measured.q[first : index + 1, j] / samples.std[f"q.{name}"]],
        )
        if samples.velocity_measured:
            rows.append(slopes / samples.std[f"v.{name}"])
            values.append(measured.v[first : index + 1, j] / samples.std[f"v.{name}"])
        A, y = np.concatenate(rows), np.concatenate(values)
        coefficients = np.linalg.lstsq(A, y, rcond=None)[0]
        information = np.linalg.pinv(A.T @ A, hermitian=True)
        at_end = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0 / LOOK_BACK, 0.0, 0.0]])
        q[j], v[j] = at_end @ coefficients
        covariance[j] = at_end @ information @ at_end.T
    return q, v, covariance
