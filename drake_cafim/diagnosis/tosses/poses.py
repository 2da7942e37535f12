"""Poses of a tracked body from recordings, and the standard deviation of their noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.noise.differences import noise_std
from drake_cafim.diagnosis.tosses.free_body import FreeBody
from drake_cafim.dynamics.rotations import inverse, logarithm, product
from drake_cafim.dynamics.tree import FREE
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import POSE_COMPONENTS, Recording
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

LEVER = 0.05
"""m, the radius of an ordinary ball."""
QUATERNION = POSE_COMPONENTS[3:]
OFF_CENTRE = 1e-3
"""Largest distance from the body's origin that counts as none, as a share of the ball's radius (of √(tr I/m))."""
UNEVEN = 1e-2
"""Largest difference of moments of inertia about a ball's axes that counts as none, as a share of the largest."""


@dataclass(frozen=True)
class PoseNoise:
    """Standard deviations of a sample, `position` m and `rotation` rad per axis, with correlation times `memory` s.

    A correlation time of 0 is white noise; a `rotation` of infinity means that positions alone were measured.
    """

    position: float
    rotation: float
    memory: tuple[float, float] = (0.0, 0.0)

    @property
    def std(self) -> Array:
        """(6,) of position and rotation."""
        return np.array([self.position] * 3 + [self.rotation] * 3)

    @property
    def turns_measured(self) -> bool:
        """Whether rotations were measured, and not positions alone."""
        return bool(np.isfinite(self.rotation))

    @property
    def rows(self) -> int:
        """The number of measurements in a sample: 6 of a pose, 3 of a position."""
        return 6 if self.turns_measured else 3

    @property
    def step_std(self) -> Array:
        """(6,) the std of which a simulation's error is a small share: without rotations, at `LEVER` that of position.

        Unmeasured as it is, a rotation's error becomes one of position at the next touch.
        """
        rotation = self.rotation if self.turns_measured else self.position / LEVER
        return np.array([self.position] * 3 + [rotation] * 3)

    @property
    def times(self) -> Array:
        """(6,) correlation times, s."""
        return np.array([self.memory[0]] * 3 + [self.memory[1]] * 3)


@dataclass(frozen=True)
class PoseTrack:
    """X_WB of one recording at its complete samples: `time` (N,) s, `p` (N, 3) m, unit `quaternion` (N, 4)."""

    recording: Recording
    time: Array
    p: Array
    quaternion: Array


def tracked_body(scene: Scene, recordings: Sequence[Recording]) -> str:
    """The name of the floating body whose pose is in all recordings.

    Raises `InputError` where there is none.
    """
    floating = [body.name for body in scene.tree.bodies if body.joint == FREE]
    for name in floating:
        if all(f"pose.{name}.x" in recording.columns for recording in recordings):
            return name
    found = ", ".join(sorted({f"pose.{name}" for recording in recordings for name in recording.bodies})) or "no pose"
    raise InputError(
        f"{recordings[0].name}: the model floats, so its pose is needed: expected columns pose.{floating[0]}.x, y, z, "
        f"qw, qx, qy, qz, found {found}"
    )


def measures_turns(recording: Recording, body: str) -> bool:
    """Whether the recording has the body's quaternion, or a part of it that asks for the rest."""
    return any(f"pose.{body}.{component}" in recording.columns for component in QUATERNION)


def why_turns_matter(physics: Physics) -> str:
    """Why the body's rotation is needed, as a clause; empty where the path of its origin follows from itself.

    It does in flight where the centre of mass is at the origin, and in contact where besides the body is a ball about
    it with one moment of inertia about all axes: its spin acts by friction, its orientation does not.
    """
    mass, center, inertia, _ = FreeBody(physics).inertial
    contact = physics.contacts[0] if physics.contacts else None
    ball = contact is not None and len(contact.points) == 1 and contact.radius > 0.0
    if contact is not None and not ball:
        return f"the collision shape of {contact.bodies[0]} is not a sphere"
    size = contact.radius if contact is not None else float(np.sqrt(np.trace(inertia) / max(mass, 1e-300)))
    off = float(np.linalg.norm(center))
    if off > OFF_CENTRE * size:
        return f"the centre of mass can be {1e3 * off:.3g} mm from the tracked origin of the body"
    if contact is None:
        return ""
    apart = float(np.linalg.norm(contact.points[0]))
    if apart > OFF_CENTRE * size:
        return f"the sphere's centre is {1e3 * apart:.3g} mm from the tracked origin of the body"
    moments = np.linalg.eigvalsh(inertia)
    if moments[2] - moments[0] > UNEVEN * moments[2]:
        return f"the moments of inertia differ by axis ({moments[0]:.3g} to {moments[2]:.3g} kg m²)"
    return ""


def track_of(recording: Recording, body: str, *, turns: bool = True) -> PoseTrack:
    """The recording's poses without the samples in which a number is missing; quaternions are normalised.

    Without `turns` only positions are read, and all quaternions are that of no rotation. Raises `InputError` where a
    quaternion is far from unit length or fewer than twelve samples are left.
    """
    pose = recording.matrix(f"pose.{body}", POSE_COMPONENTS if turns else POSE_COMPONENTS[:3])
    if not turns:
        pose = np.column_stack([pose, np.tile([1.0, 0.0, 0.0, 0.0], (len(pose), 1))])
    whole = np.all(np.isfinite(pose), axis=1)
    time, pose = recording.time[whole], pose[whole]
    length = np.linalg.norm(pose[:, 3:], axis=1)
    if len(time) < 12:
        raise InputError(f"{recording.name}: only {len(time)} whole samples of pose.{body}, expected at least 12")
    if np.any(np.abs(length - 1.0) > 0.05):
        worst = float(length[np.argmax(np.abs(length - 1.0))])
        raise InputError(f"{recording.name}: pose.{body} has a quaternion of length {worst:.3g}, expected 1")
    return PoseTrack(recording, time, pose[:, :3], pose[:, 3:] / length[:, None])


def noise_of_poses(
    scene: Scene, body: str, tracks: Sequence[PoseTrack], *, turns: bool = True
) -> tuple[PoseNoise, tuple[str, ...]]:
    """The noise stated in the scenario, or else estimated from fourth differences; and a note on each estimate.

    `turns` says whether rotations were measured. Raises `InputError` for a std of zero.
    """
    notes = []
    found = []
    parts = [("position", f"pose.{body}.x"), ("rotation", f"pose.{body}.qw")]
    for part, column in parts if turns else parts[:1]:
        std = scene.std(column)
        if std is None:
            std = float(np.sqrt(np.mean(_estimate_std(tracks, part) ** 2)))
            notes.append(
                f"channels: no std for the {part} of pose.{body}, {std:.3g} was estimated from fourth differences"
            )
        if not std > 0.0:
            raise InputError(f"{scene.name}: the noise of the {part} of pose.{body} is 0, expected a positive std")
        found.append(std)
    channel = scene.channel(f"pose.{body}.x")
    memory = channel.correlation_time if channel is not None else 0.0
    return PoseNoise(found[0], found[1] if turns else np.inf, (memory, memory if turns else 0.0)), tuple(notes)


def _estimate_std(tracks: Sequence[PoseTrack], part: str) -> Array:
    """The standard deviation (3,) along each axis, from fourth differences."""
    values = [(track.time, track.p if part == "position" else unroll_rotation(track.quaternion)) for track in tracks]
    return np.array([noise_std([(time, columns[:, k]) for time, columns in values]) for k in range(3)])


def unroll_rotation(quaternion: Array) -> Array:
    """The sum (N, 3) rad of the small rotations from sample to sample, world axes; its noise is that of a rotation."""
    turns = logarithm(product(quaternion[1:], inverse(quaternion[:-1])))
    return np.concatenate([np.zeros((1, 3)), np.cumsum(turns, axis=0)])
