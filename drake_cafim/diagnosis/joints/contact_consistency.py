"""Tells a wrong contact law from a wrong sensor: under a wrong law, sensor and joints miss the same force."""

import numpy as np

from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.diagnosis.thresholds import MEASURED_FORCE_EXCESS_SHARE_LEFT, SENSOR_MISS_IN_STDS
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


def wrong_contact(problem: WeakFormRows, physics: Physics) -> str | None:
    """The name of the contact whose law is wrong; None where the sensor is, or unless there is one of each.

    A contact force that differs from the prediction shows at the sensor and at the joints alike: with the sensor's
    reading instead of the prediction, the joints' equations hold. A wrong sensor does not affect the joints.
    """
    if not _reads_contact(problem, physics):
        return None
    squares = [_squares(run, physics) for run in problem.runs]
    at_joints, with_reading, at_sensor = (
        sum(max(part[k].sum() - part[k].size, 0.0) for part in squares) for k in range(3)
    )
    seen = sum(part[2].size for part in squares)
    missed = at_sensor > SENSOR_MISS_IN_STDS * np.sqrt(2.0 * seen)
    return physics.contacts[0].name if missed and with_reading < MEASURED_FORCE_EXCESS_SHARE_LEFT * at_joints else None


def with_reading(problem: WeakFormRows, physics: Physics) -> tuple[Array, Array] | None:
    """(n,) excess χ² of each joint's equation with the predicted contact force, and with the sensor's reading of it.

    None unless there are one contact and one sensor.
    """
    if not _reads_contact(problem, physics):
        return None
    squares = [_squares(run, physics) for run in problem.runs]
    own, instead = (np.sum([np.sum(part[k] - 1.0, axis=0) for part in squares], axis=0) for k in range(2))
    return own, instead


def _reads_contact(problem: WeakFormRows, physics: Physics) -> bool:
    return len(physics.contacts) == 1 and len(problem.runs[0].weak.sensors) == 1


def _squares(run: Run, physics: Physics) -> tuple[Array, Array, Array]:
    """Rows² over their variances: (M, n) at the joints with the predicted contact force, and with the sensor's reading.

    Then (M, 6) those of the sensor's own rows.
    """
    weak = run.weak
    rows, covariance = run.noisy_rows(physics), run.covariance
    sensed = slice(weak.dynamic.stop, weak.dynamic.stop + 6)
    # sensor rows are reading less prediction, and forces enter the dynamic rows with a minus sign
    across = -_at_joints(run, physics)
    instead = rows[:, weak.dynamic] + np.einsum("mjk,mk->mj", across, rows[:, sensed])
    own_block = covariance[:, weak.dynamic, weak.dynamic]
    mixed = np.einsum("mjk,mkl->mjl", across, covariance[:, sensed, weak.dynamic])
    noise = own_block + mixed + np.swapaxes(mixed, 1, 2)
    noise = noise + across @ covariance[:, sensed, sensed] @ np.swapaxes(across, 1, 2)
    pairs = ((rows[:, weak.dynamic], own_block), (instead, noise), (rows[:, sensed], covariance[:, sensed, sensed]))
    own, read, sensor = (values**2 / np.diagonal(block, axis1=1, axis2=2) for values, block in pairs)
    return own, read, sensor


def _at_joints(run: Run, physics: Physics) -> Array:
    """(M, n, 6) generalized forces by a unit wrench on the sensor, in its frame, at the middle of each window."""
    weak, sensor = run.weak, run.weak.sensors[0]
    moving = weak.motion(physics)
    middle = np.searchsorted(weak.samples.time, weak.samples.windows.centers)
    force = moving.force_at(sensor.joint, sensor.p_JS)[middle]
    R_WS = (moving.R_WJ[:, sensor.joint] @ sensor.R_JS)[middle]
    turning = moving.twists(sensor.joint)[middle, :, :3]
    return np.concatenate([force @ R_WS, turning @ R_WS], axis=2) / physics.effort_gains[:, None]
