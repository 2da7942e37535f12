"""Recordings of a tracked body: its poses, and how noisy they are."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.noise.differences import noise_std
from drake_cafim.dynamics.rotations import inverse, logarithm, product
from drake_cafim.dynamics.tree import FREE
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import POSE_COMPONENTS, Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


@dataclass(frozen=True)
class PoseNoise:
    """Standard deviation of one sample, `position` m and `rotation` rad per axis; `memory` s each, 0 where white."""

    position: float
    rotation: float
    memory: tuple[float, float] = (0.0, 0.0)

    @property
    def std(self) -> Array:
        """(6,) of position and rotation."""
        return np.array([self.position] * 3 + [self.rotation] * 3)

    @property
    def times(self) -> Array:
        """(6,) correlation times, s."""
        return np.array([self.memory[0]] * 3 + [self.memory[1]] * 3)


@dataclass(frozen=True)
class PoseTrack:
    """X_WB of one recording at the samples that have one: `time` (N,) s, `p` (N, 3) m, `quaternion` (N, 4)."""

    recording: Recording
    time: Array
    p: Array
    quaternion: Array


def tracked_body(scene: Scene, recordings: Sequence[Recording]) -> str:
    """The floating body whose pose all recordings hold.

    Raises `InputError` where there is none.
    """
    floating = [body.name for body in scene.tree.bodies if body.joint == FREE]
    for name in floating:
        if all(f"pose.{name}.x" in one.columns for one in recordings):
            return name
    found = ", ".join(sorted({f"pose.{name}" for one in recordings for name in one.bodies})) or "no pose"
    raise InputError(
        f"{recordings[0].name}: the model floats, so its pose is needed: expected columns pose.{floating[0]}.x, y, z, "
        f"qw, qx, qy, qz, found {found}"
    )


def track_of(recording: Recording, body: str) -> PoseTrack:
    """The recording's poses; a sample in which a number is missing is left out.

    Raises `InputError` where a quaternion is far from unit length or fewer than twelve samples are left.
    """
    pose = recording.matrix(f"pose.{body}", POSE_COMPONENTS)
    whole = np.all(np.isfinite(pose), axis=1)
    time, pose = recording.time[whole], pose[whole]
    length = np.linalg.norm(pose[:, 3:], axis=1)
    if len(time) < 12:
        raise InputError(f"{recording.name}: only {len(time)} whole samples of pose.{body}, expected at least 12")
    if np.any(np.abs(length - 1.0) > 0.05):
        worst = float(length[np.argmax(np.abs(length - 1.0))])
        raise InputError(f"{recording.name}: pose.{body} has a quaternion of length {worst:.3g}, expected 1")
    return PoseTrack(recording, time, pose[:, :3], pose[:, 3:] / length[:, None])


def noise_of_poses(scene: Scene, body: str, tracks: Sequence[PoseTrack]) -> tuple[PoseNoise, tuple[str, ...]]:
    """The noise as the scenario states it or, where it does not, as fourth differences show it; and notes of those.

    Raises `InputError` for a std of zero.
    """
    notes = []
    found = []
    for part, column in (("position", f"pose.{body}.x"), ("rotation", f"pose.{body}.qw")):
        std = scene.std(column)
        if std is None:
            std = float(np.sqrt(np.mean(_estimated(tracks, part) ** 2)))
            notes.append(
                f"channels: no std for the {part} of pose.{body}, {std:.3g} was estimated from fourth differences"
            )
        if not std > 0.0:
            raise InputError(f"{scene.name}: the noise of the {part} of pose.{body} is 0, expected a positive std")
        found.append(std)
    channel = scene.channel(f"pose.{body}.x")
    memory = channel.correlation_time if channel is not None else 0.0
    return PoseNoise(found[0], found[1], (memory, memory)), tuple(notes)


def _estimated(tracks: Sequence[PoseTrack], part: str) -> Array:
    """(3,) std along each axis."""
    values = [(one.time, one.p if part == "position" else unrolled(one.quaternion)) for one in tracks]
    return np.array([noise_std([(time, columns[:, k]) for time, columns in values]) for k in range(3)])


def unrolled(quaternion: Array) -> Array:
    """(N, 3) the sum of the small rotations from sample to sample, world axes: noise of it is that of a rotation."""
    turns = logarithm(product(quaternion[1:], inverse(quaternion[:-1])))
    return np.concatenate([np.zeros((1, 3)), np.cumsum(turns, axis=0)])
