"""Whether it is a contact that is wrong: its sensor and the joints then miss the same force."""

import numpy as np

from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.diagnosis.thresholds import MEASURED_FORCE_EXCESS_SHARE_LEFT, SENSOR_MISS_IN_STDS
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


def wrong_contact(problem: WeakFormRows, physics: Physics) -> str | None:
    """The contact whose law is wrong, seen by one wrench sensor and one contact; None where the sensor is.

    A contact that pushes otherwise than predicted is missed by the sensor and by the joints alike: with the sensor's
    reading in the prediction's place the joints agree. A sensor that reads wrongly leaves the joints alone.
    """
    if len(physics.contacts) != 1 or len(problem.runs[0].weak.sensors) != 1:
        return None
    found = np.array([_excess(run, physics) for run in problem.runs])
    at_joints, with_reading, at_sensor, seen = found.sum(axis=0)
    missed = at_sensor > SENSOR_MISS_IN_STDS * np.sqrt(2.0 * seen)
    return physics.contacts[0].name if missed and with_reading < MEASURED_FORCE_EXCESS_SHARE_LEFT * at_joints else None


def _excess(run: Run, physics: Physics) -> tuple[float, float, float, int]:
    """χ² beyond the noise at the joints, with the predicted contact and with what the sensor reads instead of it.

    Then that of the sensor itself, and of how many rows.
    """
    weak = run.weak
    rows, covariance = weak.residual(physics), run.covariance
    sensed = slice(weak.dynamic.stop, weak.dynamic.stop + 6)
    # what the sensor misses, as forces at the joints
    across = -_at_joints(run, physics)
    instead = rows[:, weak.dynamic] + np.einsum("mjk,mk->mj", across, rows[:, sensed])
    own_block = covariance[:, weak.dynamic, weak.dynamic]
    mixed = np.einsum("mjk,mkl->mjl", across, covariance[:, sensed, weak.dynamic])
    noise = own_block + mixed + np.swapaxes(mixed, 1, 2)
    noise = noise + across @ covariance[:, sensed, sensed] @ np.swapaxes(across, 1, 2)
    own = _beyond(rows[:, weak.dynamic], own_block)
    sensor = _beyond(rows[:, sensed], covariance[:, sensed, sensed])
    return own, _beyond(instead, noise), sensor, rows[:, sensed].size


def _beyond(rows: Array, noise: Array) -> float:
    return max(float(np.sum(rows**2 / np.diagonal(noise, axis1=1, axis2=2))) - rows.size, 0.0)


def _at_joints(run: Run, physics: Physics) -> Array:
    """(M, n, 6): generalized forces by a unit wrench on the sensor, in its frame, in the middle of each window."""
    weak, sensor = run.weak, run.weak.sensors[0]
    moving = weak.motion(physics)
    middle = np.searchsorted(weak.samples.time, weak.samples.windows.centers)
    force = moving.force_at(sensor.joint, sensor.p_JS)[middle]
    R_WS = (moving.R_WJ[:, sensor.joint] @ sensor.R_JS)[middle]
    turning = np.zeros_like(force)
    for k in np.flatnonzero(physics.tree.supports()[sensor.joint]):
        turning[:, k] = moving.axes[middle, k, :3]
    return np.concatenate([force @ R_WS, turning @ R_WS], axis=2) / physics.effort_gains[:, None]
