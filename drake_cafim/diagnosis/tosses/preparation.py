"""Preparation of tosses for a diagnosis: tracked body, noise, tracks and their checks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.noise.coloured import Memory, estimate_memories, step_of
from drake_cafim.diagnosis.noise.differences import correct_for_memory
from drake_cafim.diagnosis.output_error.found import Found
from drake_cafim.diagnosis.predict.forecast import Forecast
from drake_cafim.diagnosis.thresholds import MOTION_NOISE_STDS
from drake_cafim.diagnosis.tosses.arcs import arcs_of
from drake_cafim.diagnosis.tosses.data_mistakes import data_mistakes
from drake_cafim.diagnosis.tosses.pose_readings import AXES
from drake_cafim.diagnosis.tosses.poses import (
    PoseNoise,
    PoseTrack,
    measures_turns,
    noise_of_poses,
    track_of,
    tracked_body,
    unroll_rotation,
    why_turns_matter,
)
from drake_cafim.diagnosis.tosses.problem import TossProblem
from drake_cafim.diagnosis.tosses.quality import qualities, toss_forecasts
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.diagnosis.verdict import ChannelNoise, Quality
from drake_cafim.errors import InputError
from drake_cafim.numerics.computation import NotComputable
from drake_cafim.recordings.recording import POSE_COMPONENTS, Recording
from drake_cafim.recordings.usable import check_usable
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

OF_ARCS = "a throw is fitted by its flights, each from a state of its own"
"""Why there is no likelihood of a whole throw."""


@dataclass(frozen=True)
class PreparedTosses:
    """The tracks of one body for training and for the held-out comparison, their noise, and notes on the data."""

    scene: Scene
    body: str
    noise: PoseNoise
    tracks: tuple[PoseTrack, ...]
    held_out: tuple[PoseTrack, ...]
    notes: tuple[str, ...]
    mistakes: tuple[str, ...]
    noise_remarks: tuple[str, ...]

    @property
    def channel_noise(self) -> dict[str, ChannelNoise]:
        """Of x, y, z, and of `pose.<body>.rotation`, rad about each world axis."""
        place, (by_position, by_rotation) = f"pose.{self.body}", self.noise.memory
        stated = [self.scene.std(f"{place}.{last}") is not None for last in ("x", "qw")]
        position = ChannelNoise(self.noise.position, "m", by_position, stated[0])
        rotation = ChannelNoise(self.noise.rotation, "rad", by_rotation, stated[1])
        found = {f"{place}.{axis}": position for axis in AXES}
        return found | {f"{place}.rotation": rotation} if self.noise.turns_measured else found

    def with_noise_beside(self, model: Model) -> None:
        """None: a toss has no efforts whose noise would depend on `model`."""

    def without_overstated(self) -> "PreparedTosses":
        """The same: a thrown body has no joints."""
        return self

    def search_by_simulation(
        self, most_effects: int, progress: Callable[[str], None], trace: Trace, jobs: int = 1
    ) -> None:
        """None: nothing drives a thrown body."""

    @property
    def overstated(self) -> None:
        """None: a thrown body has no joints."""

    @property
    def estimated(self) -> None:
        """None: it has no friction of joints."""

    def with_overstated_unknown(self, overstated: object) -> "PreparedTosses":
        """The same: a thrown body has no joints."""
        return self

    def with_servos_settled(self, found: Found) -> "PreparedTosses":
        """The same: nothing drives a thrown body."""
        return self

    @property
    def moves(self) -> bool:
        """Whether the body moves by more than its noise in any recording."""
        limits = (MOTION_NOISE_STDS * self.noise.position, MOTION_NOISE_STDS * self.noise.rotation)
        return any(
            float(np.max(np.std(values, axis=0))) > limit
            for track in self.tracks
            for values, limit in zip((track.p, unroll_rotation(track.quaternion)), limits, strict=True)
        )

    def problem(self) -> TossProblem:
        """The recordings' likelihood, linearised under the scene's nominal physics."""
        return TossProblem.at_nominal(self.scene, arcs_of(self.tracks, self.noise), self.noise)

    def bounds(self, model: Model, jobs: int = 1) -> Array | NotComputable:
        """Of throws the bound is not reckoned yet."""
        return NotComputable(OF_ARCS)

    def finished(self, fitted: Fit) -> Fit | NotComputable:
        """A throw's rows are its whole flights already."""
        return NotComputable(OF_ARCS)

    def simulated(
        self, model: Model, recordings: Sequence[int], within: tuple[float, float], horizon: float
    ) -> list[Forecast]:
        """The recordings with these numbers, simulated in those windows that begin `within`; windows are of 1 s."""
        tracks = [self.tracks[k] for k in recordings]
        found = toss_forecasts(tracks, self.noise, model.physics(self.scene), self.body)
        return [part for forecast in found if (part := forecast.beginning_within(*within)) is not None]

    def surprisal(
        self, model: Model, covariance: Array, recordings: Sequence[int], within: tuple[float, float]
    ) -> float:
        """NaN: the rows of throws are their innovations already."""
        return float("nan")

    def qualities(self, models: Sequence[tuple[Model, Array]], jobs: int = 1) -> list[list[Quality]]:
        """For each model its quality on the recordings, and on the held-out ones if there are any.

        The covariances (n, n) of their unknowns are not needed for tosses, and one process does it.
        """
        groups = [self.tracks, self.held_out] if self.held_out else [self.tracks]
        return [qualities(groups, self.noise, model.physics(self.scene), self.body) for model, _ in models]


def prepare_tosses(
    scene: Scene, recordings: Sequence[Recording], held_out: Sequence[Recording], notes: Sequence[str]
) -> PreparedTosses:
    """The recordings' poses, with their noise as stated or estimated.

    Positions alone will do of a ball, and of a body that touches nothing. Raises `InputError` for recordings without
    the pose, for scenes with more than one contact, and for sensor effects on channels that are not the body's pose.
    """
    if len(scene.physics.contacts) > 1:
        names = ", ".join(contact.name for contact in scene.physics.contacts)
        raise InputError(f"{scene.name}: a floating body with the contacts {names}: expected at most one")
    body = tracked_body(scene, [*recordings, *held_out])
    for recording in (*recordings, *held_out):
        check_usable(recording, [f"pose.{body}.{component}" for component in POSE_COMPONENTS])
    _check_sensors(scene, body)
    turns = _measure_turns(scene, [*recordings, *held_out], body)
    tracks = tuple(track_of(recording, body, turns=turns) for recording in recordings)
    noise, estimates = noise_of_poses(scene, body, tracks, turns=turns)
    noise, remarks = _with_memory(scene, noise, tracks, body)
    held = tuple(track_of(recording, body, turns=turns) for recording in held_out)
    if not turns:
        notes = (f"pose.{body}: only positions are used; effects that need its rotation are not looked for", *notes)
    of_held = (f"held out: {mistake}" for mistake in (data_mistakes(scene, held_out, body) if held_out else ()))
    mistakes = data_mistakes(scene, recordings, body)
    return PreparedTosses(scene, body, noise, tracks, held, (*estimates, *notes, *of_held), mistakes, remarks)


def _measure_turns(scene: Scene, recordings: Sequence[Recording], body: str) -> bool:
    """Whether all recordings have rotations. Raises `InputError` where one lacks them although they matter."""
    without = [recording for recording in recordings if not measures_turns(recording, body)]
    if not without:
        return True
    priors = scene.priors
    for physics in (scene.physics, scene.physics_at(priors.mean + priors.std)):
        if reason := why_turns_matter(physics):
            raise InputError(
                f"{without[0].name}: pose.{body} has no rotation (columns qw, qx, qy, qz), which is needed because "
                f"{reason}; position alone is enough for a ball tracked at its centre, with its centre of mass there, "
                "and for a body without contact that is tracked at its centre of mass"
            )
    return False


def _check_sensors(scene: Scene, body: str) -> None:
    """Raises `InputError` for a sensor effect of the scenario whose place is not the body's pose."""
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
    """The noise with a correlation time that is estimated where the scenario states none, and remarks on it.

    Fourth differences see only the fast part of correlated noise: an estimated std is corrected for its memory.
    """
    columns = {f"{part}.{axis}": std for part, std in (("position", noise.position), ("rotation", noise.rotation))
               for axis in "xyz" if np.isfinite(std)}  # fmt: skip
    spread = []
    for track in tracks:
        turns = unroll_rotation(track.quaternion)
        values = {f"position.{axis}": track.p[:, k] for k, axis in enumerate("xyz")}
        if noise.turns_measured:
            values |= {f"rotation.{axis}": turns[:, k] for k, axis in enumerate("xyz")}
        spread.append(Recording(track.recording.name, track.time, values))
    estimated = set(columns) if scene.std(f"pose.{body}.x") is None else set()
    stated = {column: Memory(time) for column in columns if (time := noise.memory[column.startswith("rotation")]) > 0.0}
    estimates, found = estimate_memories(spread, columns, stated, estimated)
    memories = stated | estimates
    std = correct_for_memory(columns, memories, estimated, step_of(spread))
    position, rotation = (memories[part].time if part in memories else 0.0 for part in ("position.x", "rotation.x"))
    remarks = tuple(remark.replace("noise of position", f"noise of the position of pose.{body}").replace(
        "noise of rotation", f"noise of the rotation of pose.{body}") for remark in found)  # fmt: skip
    return PoseNoise(std["position.x"], std.get("rotation.x", np.inf), (position, rotation)), remarks
