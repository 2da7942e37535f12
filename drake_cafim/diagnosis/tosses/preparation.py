"""Recordings of tosses made ready for a diagnosis."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.noise.coloured import Memory, estimate_memories, step_of
from drake_cafim.diagnosis.noise.differences import correct_for_memory
from drake_cafim.diagnosis.thresholds import MOTION_NOISE_STDS
from drake_cafim.diagnosis.tosses.arcs import arcs_of
from drake_cafim.diagnosis.tosses.pose_readings import AXES
from drake_cafim.diagnosis.tosses.poses import PoseNoise, PoseTrack, noise_of_poses, track_of, tracked_body, unrolled
from drake_cafim.diagnosis.tosses.problem import TossProblem
from drake_cafim.diagnosis.tosses.quality import qualities
from drake_cafim.diagnosis.verdict import Quality
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import POSE_COMPONENTS, Recording
from drake_cafim.recordings.usable import check_usable
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


@dataclass(frozen=True)
class PreparedTosses:
    """Tracks of one body, those held out, and what was noticed while reading them."""

    scene: Scene
    body: str
    noise: PoseNoise
    tracks: tuple[PoseTrack, ...]
    held_out: tuple[PoseTrack, ...]
    notes: tuple[str, ...]
    mistakes: tuple[str, ...]
    noise_remarks: tuple[str, ...]

    def under(self, model: Model) -> None:
        """None: a throw has no efforts whose noise would depend on `model`."""

    @property
    def moves(self) -> bool:
        """Whether the body moves in any of the recordings, beyond its noise."""
        limits = (MOTION_NOISE_STDS * self.noise.position, MOTION_NOISE_STDS * self.noise.rotation)
        return any(
            float(np.max(np.std(values, axis=0))) > limit
            for track in self.tracks
            for values, limit in zip((track.p, unrolled(track.quaternion)), limits, strict=True)
        )

    def problem(self) -> TossProblem:
        """The recordings' likelihood, white under the scene's own physics."""
        return TossProblem.nominally(self.scene, arcs_of(self.tracks, self.noise), self.noise)

    def qualities(self, model: Model, covariance: Array) -> list[Quality]:
        """How `model` does on the recordings, and on those held out where there are any.

        `covariance` (n, n) is of its unknowns.
        """
        groups = [self.tracks, self.held_out] if self.held_out else [self.tracks]
        return qualities(groups, self.noise, model.physics(self.scene), self.body)


def prepare_tosses(
    scene: Scene, recordings: Sequence[Recording], held_out: Sequence[Recording], notes: Sequence[str]
) -> PreparedTosses:
    """The recordings' poses under the noise that was stated or, where it was not, is seen.

    Raises `InputError` for recordings that lack the pose, and for scenes that are more than a thrown body.
    """
    if len(scene.physics.contacts) > 1:
        names = ", ".join(one.name for one in scene.physics.contacts)
        raise InputError(f"{scene.name}: a floating body with the contacts {names}: expected at most one")
    body = tracked_body(scene, [*recordings, *held_out])
    for recording in (*recordings, *held_out):
        check_usable(recording, [f"pose.{body}.{component}" for component in POSE_COMPONENTS])
    _check_sensors(scene, body)
    tracks = tuple(track_of(one, body) for one in recordings)
    noise, told = noise_of_poses(scene, body, tracks)
    noise, remarks = _with_memory(scene, noise, tracks, body)
    held = tuple(track_of(one, body) for one in held_out)
    return PreparedTosses(scene, body, noise, tracks, held, (*told, *notes), (), remarks)


def _check_sensors(scene: Scene, body: str) -> None:
    """Raises `InputError` for a sensor effect of the scenario that is on nothing that tracks the body."""
    valid = [f"pose.{body}", *(f"pose.{body}.{axis}" for axis in AXES)]
    for effect in scene.physics.sensors:
        if effect.at not in valid:
            raise InputError(
                f"{scene.name}: effects: {effect.name} at {effect.at}: expected, of a thrown body, one of "
                f"{', '.join(valid)}"
            )


def _with_memory(
    scene: Scene, noise: PoseNoise, tracks: Sequence[PoseTrack], body: str
) -> tuple[PoseNoise, tuple[str, ...]]:
    """The noise with the memory that it shows, where the scenario says that it is white.

    Fourth differences see little of a slow noise: what they say is reckoned with its memory, stated or shown.
    """
    columns = {f"{part}.{axis}": std for part, std in (("position", noise.position), ("rotation", noise.rotation))
               for axis in "xyz"}  # fmt: skip
    spread = []
    for track in tracks:
        turns = unrolled(track.quaternion)
        values = {f"position.{axis}": track.p[:, k] for k, axis in enumerate("xyz")}
        values |= {f"rotation.{axis}": turns[:, k] for k, axis in enumerate("xyz")}
        spread.append(Recording(track.recording.name, track.time, values))
    estimated = set(columns) if scene.std(f"pose.{body}.x") is None else set()
    stated = {column: Memory(time) for column in columns if (time := noise.memory[column.startswith("rotation")]) > 0.0}
    seen, told = estimate_memories(spread, columns, stated, estimated)
    memories = stated | seen
    std = correct_for_memory(columns, memories, estimated, step_of(spread))
    position, rotation = (memories[part].time if part in memories else 0.0 for part in ("position.x", "rotation.x"))
    remarks = tuple(one.replace("noise of position", f"noise of the position of pose.{body}").replace(
        "noise of rotation", f"noise of the rotation of pose.{body}") for one in told)  # fmt: skip
    return PoseNoise(std["position.x"], std["rotation.x"], (position, rotation)), remarks
