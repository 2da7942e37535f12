"""The state at an instant from the samples just before it."""

import numpy as np

from drake_cafim.diagnosis.rows.samples import Samples
from drake_cafim.diagnosis.rows.weak_form import Measurement
from drake_cafim.typing import Array

LOOK_BACK = 0.05
"""s of samples that a state is taken from."""


def state_at(samples: Samples, measured: Measurement, index: int) -> tuple[Array, Array, Array]:
    """q, v (n,) and their covariance (n, 2, 2) at sample `index`, from the `LOOK_BACK` s up to it.

    A cubic in time for each joint, fitted to its q and v (where measured) by their noise.
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
