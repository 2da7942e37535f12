"""A recording and its simulations as frames of a replay: where the joints are, and which forces act."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.forecast import Forecast, forecast
from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.dynamics.motion import Motion, motion
from drake_cafim.dynamics.tree import FIXED
from drake_cafim.report.missing import missing
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

MOST_FRAMES = 1600
FRAMES_PER_SECOND = 32.0
LONGEST_ARROW = 0.45
"""Of the model's size, for the largest effort or force of the recording."""


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
    """Positions (F, n) of simulations that start anew every second; as recorded where none runs."""
    return _laid(forecast(weak, physics), physics.tree.joint_names, recorded_frames(weak, frames), frames)


def _laid(one: Forecast, names: Sequence[str], recorded: Array, frames: Array) -> Array:
    result = recorded.copy()
    for window in np.unique(one.window):
        inside = one.window == window
        time = one.time[inside]
        shown = (frames >= time[0]) & (frames <= time[-1])
        for j, name in enumerate(names):
            result[shown, j] = np.interp(frames[shown], time, one.predicted[f"q.{name}"][inside])
    return result


def placed(physics: Physics, q: Array) -> Motion:
    """Poses of all joints at positions `q` (F, n), at rest."""
    return motion(physics.tree, q, np.zeros_like(q))


def lacking_arrows(weak: WeakForm, physics: Physics, moving: Motion, frames: Array, size: float) -> list[Arrow]:
    """What the physics lacks: at each joint along its axis (of a torque, its axis), at each sensor as it reads."""
    rows, centers = missing(weak, physics), weak.samples.windows.centers
    arrows = []
    for j, joint in enumerate(physics.tree.joints):
        value = np.interp(frames, centers, rows[:, weak.dynamic.start + j])
        scale = (
            LONGEST_ARROW * size / max(float(np.max(np.abs(weak.samples.u[:, j]))), float(np.max(np.abs(value))), 1e-9)
        )
        axis = moving.R_WJ[:, j] @ joint.axis
        arrows.append(Arrow(joint.name, moving.p_WJ[:, j], scale * value[:, None] * axis))
    for i, sensor in enumerate(weak.sensors):
        first = weak.dynamic.stop + 6 * i
        value = np.stack([np.interp(frames, centers, rows[:, first + k]) for k in range(3)], axis=1)
        arrows.append(_at_sensor(weak, i, f"wrench.{sensor.name}", moving, value, size))
    return [arrow for arrow in arrows if np.max(np.linalg.norm(arrow.vectors, axis=1)) > 0.02 * size]


def contact_arrows(weak: WeakForm, physics: Physics, moving: Motion, frames: Array, size: float) -> list[Arrow]:
    """Contact forces as the sensors read them; without a sensor, as the model's contact laws have them."""
    if weak.sensors:
        time, arrows = weak.samples.time, []
        for i, sensor in enumerate(weak.sensors):
            reading = weak.samples.smooth_q @ weak.samples.wrenches[i][:, :3]
            value = np.stack([np.interp(frames, time, reading[:, k]) for k in range(3)], axis=1)
            arrows.append(_at_sensor(weak, i, f"wrench.{sensor.name}", moving, value, size))
        return arrows
    arrows = []
    v = np.stack([np.interp(frames, weak.samples.time, weak.samples.v[:, j]) for j in range(weak.joints)], axis=1)
    faster = motion(physics.tree, moving.q, v)
    for contact in physics.contacts:
        force = contact.force(contact.points(faster))
        scale = LONGEST_ARROW * size / max(float(np.max(np.linalg.norm(force, axis=1))), 1e-9)
        arrows.append(Arrow(contact.name, faster.point(contact.joint, contact.p_JC)[0], scale * force))
    return arrows


def _at_sensor(weak: WeakForm, index: int, name: str, moving: Motion, force_S: Array, size: float) -> Arrow:
    """A force (F, 3) in the sensor's frame, at the sensor; the largest reading sets the scale."""
    sensor = weak.sensors[index]
    largest = float(np.nanmax(np.linalg.norm(weak.samples.wrenches[index][:, :3], axis=1)))
    scale = LONGEST_ARROW * size / max(largest, 1e-9)
    R_WS = sensor.R_JS if sensor.joint == FIXED else moving.R_WJ[:, sensor.joint] @ sensor.R_JS
    p_WS, _ = moving.point(sensor.joint, sensor.p_JS)
    force_W = np.einsum("...ij,...j->...i", np.broadcast_to(R_WS, (len(force_S), 3, 3)), force_S)
    return Arrow(name, p_WS, scale * force_W)
