"""The frames of a replay: joint positions of a recording and of its simulations, and arrows for the forces."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.joints.missing_forces import missing_force
from drake_cafim.diagnosis.predict.forecast import Forecast, forecast
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.dynamics.motion import Motion, motion
from drake_cafim.dynamics.tree import FIXED
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

MOST_FRAMES = 1600
FRAMES_PER_SECOND = 32.0
LONGEST_ARROW = 0.4
"""Of the model's size, for the largest force that is shown in one colour."""
SHORTEST_ARROW = 0.02
SMALLEST_SCALE = 0.25
ABOVE_SLIDE = 0.08


@dataclass(frozen=True)
class Arrow:
    """A force over the frames: where it acts, `points` (F, 3) m, and what is drawn of it, `vectors` (F, 3) m, world."""

    name: str
    points: Array
    vectors: Array


def frame_times(time: Array) -> Array:
    """(F,) s from the recording's start to its end, in the recording's own time."""
    count = int(np.clip((time[-1] - time[0]) * FRAMES_PER_SECOND, 2, MOST_FRAMES))
    return np.linspace(time[0], time[-1], count)


def recorded_frames(weak: WeakForm, frames: Array) -> Array:
    """The measured positions (F, n), smoothed over 16 ms."""
    q = weak.samples.smooth_q @ weak.samples.q
    return np.stack([np.interp(frames, weak.samples.time, q[:, j]) for j in range(weak.joints)], axis=1)


def simulated_frames(weak: WeakForm, physics: Physics, frames: Array) -> Array:
    """Positions (F, n) of simulations over 1 s that each start from the measured state; as recorded between them."""
    return _onto_frames(forecast(weak, physics), physics.tree.joint_names, recorded_frames(weak, frames), frames)


def _onto_frames(simulated: Forecast, names: Sequence[str], recorded: Array, frames: Array) -> Array:
    result = recorded.copy()
    for window in np.unique(simulated.window):
        inside = simulated.window == window
        time = simulated.time[inside]
        shown = (frames >= time[0]) & (frames <= time[-1])
        for j, name in enumerate(names):
            result[shown, j] = np.interp(frames[shown], time, simulated.predicted[f"q.{name}"][inside])
    return result


def poses_at(physics: Physics, q: Array) -> Motion:
    """The poses of all joints at positions `q` (F, n); velocities are zero."""
    return motion(physics.tree, q, np.zeros_like(q))


def lacking_arrows(
    weak: WeakForm, physics: Physics, moving: Motion, frames: Array, size: float, *, beside: Physics
) -> list[Arrow]:
    """Arrows for the residual of `physics`: forces at prismatic joints, torques as a force on their link, and readings.

    The longest arrow stands for the largest residual of the model `beside`, or for a quarter of the largest effort or
    reading, if that is larger: otherwise noise alone would fill the picture.
    """
    rows, other, centers = missing_force(weak, physics), missing_force(weak, beside), weak.samples.windows.centers
    arrows = []
    for j, joint in enumerate(physics.tree.joints):
        row = weak.dynamic.start + j
        value = np.interp(frames, centers, rows[:, row])
        largest = max(
            SMALLEST_SCALE * float(np.max(np.abs(weak.samples.u[:, j]))), float(np.max(np.abs(other[:, row])))
        )
        points, direction = _where_it_pushes(moving, j, size)
        arrows.append(Arrow(joint.name, points, LONGEST_ARROW * size / max(largest, 1e-9) * value[:, None] * direction))
    for i, sensor in enumerate(weak.sensors):
        axes = slice(weak.dynamic.stop + 6 * i, weak.dynamic.stop + 6 * i + 3)
        value = np.stack([np.interp(frames, centers, column) for column in rows[:, axes].T], axis=1)
        reading = float(np.nanmax(np.linalg.norm(weak.samples.wrenches[i][:, :3], axis=1)))
        largest = max(SMALLEST_SCALE * reading, float(np.max(np.linalg.norm(other[:, axes], axis=1))))
        scaled = LONGEST_ARROW * size / max(largest, 1e-9) * value
        arrows.append(_at_sensor(weak, i, f"wrench.{sensor.name}", moving, scaled))
    return [arrow for arrow in arrows if np.max(np.linalg.norm(arrow.vectors, axis=1)) > SHORTEST_ARROW * size]


def _where_it_pushes(moving: Motion, j: int, size: float) -> tuple[Array, Array]:
    """Where a force at a joint is shown, (F, 3) m, and which way: above a slide, or across a lever."""
    joint, tree = moving.tree.joints[j], moving.tree
    axis = moving.R_WJ[:, j] @ joint.axis
    here = moving.p_WJ[:, j]
    if joint.prismatic:
        side = np.where(np.abs(axis[:, 2:]) > 0.9, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
        return here + ABOVE_SLIDE * size * side, axis
    ends = [other.p_PF for other in tree.joints if other.parent == j]
    ends += [body.p_JB + body.R_JB @ body.p_BBcm for body in tree.bodies if body.joint == j]
    levers = [np.asarray(end - joint.axis * (joint.axis @ end), dtype=float) for end in ends]
    longest = max(levers, key=lambda lever: float(np.linalg.norm(lever)), default=np.zeros(3))
    if np.linalg.norm(longest) < 1e-3:
        return here, axis  # everything is on the axis: there is no lever, so the torque is drawn along its axis
    lever = moving.R_WJ[:, j] @ longest
    return here + lever, np.cross(axis, lever) / np.linalg.norm(longest)


def contact_arrows(weak: WeakForm, physics: Physics, moving: Motion, frames: Array, size: float) -> list[Arrow]:
    """Contact forces as measured by the wrench sensors; without a sensor, those of the model's contact laws."""
    if weak.sensors:
        time, arrows = weak.samples.time, []
        for i, sensor in enumerate(weak.sensors):
            reading = weak.samples.smooth_q @ weak.samples.wrenches[i][:, :3]
            value = np.stack([np.interp(frames, time, reading[:, k]) for k in range(3)], axis=1)
            largest = max(float(np.nanmax(np.linalg.norm(reading, axis=1))), 1e-9)
            arrows.append(_at_sensor(weak, i, sensor.name, moving, LONGEST_ARROW * size / largest * value))
        return arrows
    arrows = []
    v = np.stack([np.interp(frames, weak.samples.time, weak.samples.v[:, j]) for j in range(weak.joints)], axis=1)
    faster = motion(physics.tree, moving.q, v)
    for contact in physics.contacts:
        force, _ = contact.force(contact.touch(faster))
        scale = LONGEST_ARROW * size / max(float(np.max(np.linalg.norm(force, axis=1))), 1e-9)
        arrows.append(Arrow(contact.name, faster.point(contact.joint, contact.p_JC)[0], scale * force))
    return arrows


def _at_sensor(weak: WeakForm, index: int, name: str, moving: Motion, vector_S: Array) -> Arrow:
    """The arrow at the sensor's origin of a vector (F, 3) given in the sensor's frame S."""
    sensor = weak.sensors[index]
    R_WS = sensor.R_JS if sensor.joint == FIXED else moving.R_WJ[:, sensor.joint] @ sensor.R_JS
    p_WS, _ = moving.point(sensor.joint, sensor.p_JS)
    vector_W = np.einsum("...ij,...j->...i", np.broadcast_to(R_WS, (len(vector_S), 3, 3)), vector_S)
    return Arrow(name, p_WS, vector_W)
