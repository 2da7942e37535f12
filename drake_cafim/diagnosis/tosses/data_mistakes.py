"""Finds mistakes of poses that look like physics: a quaternion's order or direction, an axis turned, millimetres."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.fit.data_mistakes import Suspicion, correct, sentences
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.thresholds import MISTAKE_CHI_SQUARE_PER_ROW, MISTAKE_EXCERPT_SAMPLES
from drake_cafim.diagnosis.tosses.arc_rows import innovation_mask
from drake_cafim.diagnosis.tosses.arcs import arcs_of
from drake_cafim.diagnosis.tosses.initial_states import fit_initial_states
from drake_cafim.diagnosis.tosses.poses import QUATERNION, PoseTrack, measures_turns, noise_of_poses, track_of
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.rotations import product, rotation_matrices
from drake_cafim.recordings.recording import POSE_COMPONENTS, Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

MILLIMETRES = 1000.0
"""In a metre."""
HALF = float(np.sqrt(0.5))
FRAMES = {
    "has the y axis up, expected z": np.array([HALF, HALF, 0.0, 0.0]),
    "has the z axis down, expected up": np.array([0.0, 1.0, 0.0, 0.0]),
}
"""Rotations R_WV, as quaternions, of frames V in which poses are written instead of the world frame W."""


def data_mistakes(scene: Scene, recordings: Sequence[Recording], body: str) -> tuple[str, ...]:
    """A sentence for each mistake, with the files that have it; empty where there is none (see `sentences`).

    χ² is of the innovations of arcs under the model as given.
    """
    return sentences([correct(recording.name, _Excerpt.of(scene, recording, body)) for recording in recordings])


@dataclass(frozen=True)
class _Excerpt:
    """The middle of one recording, and its χ² per row under the model as given."""

    scene: Scene
    body: str
    recording: Recording
    chi_square: float

    @classmethod
    def of(cls, scene: Scene, recording: Recording, body: str) -> "_Excerpt":
        """The middle of `recording`."""
        first = max(0, len(recording) - MISTAKE_EXCERPT_SAMPLES) // 2
        part = slice(first, first + MISTAKE_EXCERPT_SAMPLES)
        columns = {name: values[part] for name, values in recording.columns.items()}
        return cls._under_model(scene, replace(recording, time=recording.time[part], columns=columns), body)

    @classmethod
    def _under_model(cls, scene: Scene, recording: Recording, body: str) -> "_Excerpt":
        return cls(scene, body, recording, _chi_square(scene, recording, body))

    def best_correction(self) -> "tuple[Suspicion, _Excerpt] | None":
        """The suspicion whose correction leaves the least χ², and the corrected excerpt; None where all raise it."""
        best: tuple[Suspicion, _Excerpt] | None = None
        for suspicion in _suspicions(self.recording, self.body):
            right = self._under_model(self.scene, suspicion.correct(self.recording), self.body)
            if right.chi_square < (best[1].chi_square if best else self.chi_square):
                best = suspicion, right
            if right.chi_square < MISTAKE_CHI_SQUARE_PER_ROW:
                break
        return best

    def scaled_again(self, suspicion: Suspicion) -> float:
        """χ² per row once the motion that `suspicion` has scaled down is scaled down again."""
        return _chi_square(self.scene, suspicion.scaled_again(self.recording), self.body)


def _chi_square(scene: Scene, recording: Recording, body: str) -> float:
    """χ² per row under the model as given, without its contacts where the body's middle is behind their surface.

    A wrong sign of the height would press the body into the ground, which takes very long to simulate.
    """
    turns = measures_turns(recording, body)
    track = track_of(recording, body, turns=turns)
    noise, _ = noise_of_poses(scene, body, [track], turns=turns)
    physics = Model(scene.priors.mean).physics(scene)
    if any(_is_behind(contact, track) for contact in physics.contacts):
        physics = replace(physics, contacts=())
    arcs = arcs_of([track], noise)
    base = fit_initial_states(arcs, noise, physics, arcs.start)
    rows = base.innovation(base.shot.rows[..., None])[0][innovation_mask(arcs)][:, : noise.rows]
    value = float(np.mean(rows**2)) if rows.size else 0.0
    return value if np.isfinite(value) else float("inf")


def _is_behind(contact: SphereContact, track: PoseTrack) -> bool:
    """Whether the middle of the points that may touch is behind the surface at any sample."""
    middle = rotation_matrices(track.quaternion) @ np.mean(contact.points, axis=0)
    return bool(np.any((track.p + middle - contact.point) @ contact.normal < 0.0))


def _suspicions(recording: Recording, body: str) -> Iterator[Suspicion]:
    """Every mistake that is tested, the commonest first."""
    turns = measures_turns(recording, body)
    pose = {axis: recording.columns[f"pose.{body}.{axis}"] for axis in (POSE_COMPONENTS if turns else "xyz")}

    def suspicion(subject: str, predicate: str, columns: dict[str, Array], scale: float = 1.0) -> Suspicion:
        return Suspicion(subject, predicate, {f"pose.{body}.{k}": values for k, values in columns.items()}, scale)

    whole = f"pose.{body}"
    millimetres = {axis: pose[axis] / MILLIMETRES for axis in "xyz"}
    yield suspicion(f"{whole}.x, y and z", "have values in millimetres, expected m", millimetres, MILLIMETRES)
    if turns:
        x, y, z, w = (pose[axis] for axis in QUATERNION)
        order = {"qw": w, "qx": x, "qy": y, "qz": z}
        yield suspicion(f"{whole}.qw, qx, qy and qz", "are in the order x, y, z, w, expected w, x, y, z", order)
        inverse = {axis: -pose[axis] for axis in QUATERNION[1:]}
        yield suspicion(f"{whole}.qw, qx, qy and qz", "are of the inverse rotation, expected body to world", inverse)
    for words, R_WV in FRAMES.items():
        yield suspicion(whole, words, _in_world(pose, R_WV, turns=turns))
    for axis in "zyx":
        yield suspicion(f"{whole}.{axis}", "has its sign turned", {axis: -pose[axis]})


def _in_world(pose: dict[str, Array], R_WV: Array, *, turns: bool) -> dict[str, Array]:
    """The components of poses that are written in a frame V, in world axes."""
    p_W = np.column_stack([pose[axis] for axis in "xyz"]) @ rotation_matrices(R_WV[None])[0].T
    found = {axis: p_W[:, k] for k, axis in enumerate("xyz")}
    if turns:
        rotated = product(R_WV[None], np.column_stack([pose[axis] for axis in QUATERNION]))
        found |= {axis: rotated[:, k] for k, axis in enumerate(QUATERNION)}
    return found
