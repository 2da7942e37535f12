"""Mistakes of the poses of thrown bodies are reported as such, by file, and what is missing in their physics is not."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.diagnose import diagnose, estimate
from drake_cafim.diagnosis.tosses.data_mistakes import data_mistakes
from drake_cafim.diagnosis.tosses.preparation import prepare_tosses
from drake_cafim.dynamics.rotations import product
from drake_cafim.effects.body import AerodynamicDrag
from drake_cafim.effects.contact_friction import ContactAnisotropicFriction
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.link import Payload
from drake_cafim.effects.surface import SurfaceOffset
from drake_cafim.recordings.recording import POSE_COMPONENTS, Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.tosses import BALL, BLOCK, SCENARIO, thrown, thrown_scene

UNSTATED = SCENARIO.replace("channels: {pose.body: {std: {position: 2.0e-4, rotation: 2.0e-3}}}\n", "")


def _with(recording: Recording, **changed: Array) -> Recording:
    columns = {f"pose.body.{axis}": values for axis, values in changed.items()}
    return replace(recording, columns={**recording.columns, **columns})


def _scaled(recording: Recording, factor: float, *axes: str) -> Recording:
    return _with(recording, **{axis: factor * recording[f"pose.body.{axis}"] for axis in axes})


def _scalar_last(recording: Recording) -> Recording:
    w, x, y, z = (recording[f"pose.body.{axis}"] for axis in ("qw", "qx", "qy", "qz"))
    return _with(recording, qw=x, qx=y, qy=z, qz=w)


def _in_frame(recording: Recording, matrix: Array, quaternion: Array) -> Recording:
    """The poses in a frame V, by R_VW as a matrix and as a quaternion."""
    pose = recording.matrix("pose.body", POSE_COMPONENTS)
    seen = np.column_stack([pose[:, :3] @ matrix.T, product(quaternion[None], pose[:, 3:])])
    return _with(recording, **{axis: seen[:, k] for k, axis in enumerate(POSE_COMPONENTS)})


def _y_up(recording: Recording) -> Recording:
    half = np.sqrt(0.5)
    # right, up, towards us: x_V = x_W, y_V = z_W, z_V = -y_W
    return _in_frame(recording, np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]), np.array([half, -half, 0.0, 0.0]))


def _z_down(recording: Recording) -> Recording:
    return _in_frame(recording, np.diag([1.0, -1.0, -1.0]), np.array([0.0, 1.0, 0.0, 0.0]))


MISTAKES: dict[str, Callable[[Recording], Recording]] = {
    "pose.body.x, y and z of {} have values in millimetres, expected m": lambda r: _scaled(r, 1e3, "x", "y", "z"),
    "pose.body.qw, qx, qy and qz of {} are in the order x, y, z, w, expected w, x, y, z": _scalar_last,
    "pose.body.qw, qx, qy and qz of {} are of the inverse rotation, expected body to world": lambda r: _scaled(
        r, -1.0, "qx", "qy", "qz"
    ),
    "pose.body of {} has the y axis up, expected z": _y_up,
    "pose.body of {} has the z axis down, expected up": _z_down,
    "pose.body.z of {} has its sign turned": lambda r: _scaled(r, -1.0, "z"),
    "pose.body.x of {} has its sign turned": lambda r: _scaled(r, -1.0, "x"),
}


SHAPES = [pytest.param(BALL, id="ball"), pytest.param(BLOCK, id="block", marks=pytest.mark.long)]


@pytest.fixture(scope="module", params=SHAPES)
def throws(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, list[Recording]]:
    scene = thrown_scene(tmp_path_factory.mktemp("thrown"), request.param)
    return scene, thrown(scene.physics, 3, count=2)


@pytest.mark.parametrize("sentence", MISTAKES)
def test_a_mistake_is_told_of_the_file_that_has_it(sentence: str, throws: tuple[Scene, list[Recording]]) -> None:
    scene, (first, second) = throws
    assert data_mistakes(scene, [first, MISTAKES[sentence](second)], "body") == (sentence.format("toss_1"),)


def test_a_mistake_that_all_files_share_is_told_of_all(throws: tuple[Scene, list[Recording]]) -> None:
    scene, both = throws
    (told,) = data_mistakes(scene, [_scalar_last(recording) for recording in both], "body")
    assert told.startswith("pose.body.qw, qx, qy and qz of toss_0 and toss_1 are in the order x, y, z, w")


@pytest.mark.long
def test_two_mistakes_of_one_file_are_told(throws: tuple[Scene, list[Recording]]) -> None:
    scene, (first, second) = throws
    told = data_mistakes(scene, [first, _scalar_last(_scaled(second, 1e3, "x", "y", "z"))], "body")
    assert sorted(sentence.split(" of ")[0] for sentence in told) == [
        "pose.body.qw, qx, qy and qz",
        "pose.body.x, y and z",
    ]


def test_noise_that_is_not_stated_is_that_of_the_corrected_poses(tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path, scenario=UNSTATED)
    first, second = thrown(scene.physics, 3, count=2)
    told = data_mistakes(scene, [first, _scaled(second, 1e3, "x", "y", "z")], "body")
    assert told == ("pose.body.x, y and z of toss_1 have values in millimetres, expected m",)


PHYSICS: list[Effect] = [
    Payload("body", {"mass": 0.15, "x": 0.02, "y": 0.01, "z": -0.02}),
    AerodynamicDrag("body", {"coefficient": 0.2}),
    ContactAnisotropicFriction("body/ground", {"friction_1": 0.9, "friction_2": 0.1, "angle": 0.4}),
    SurfaceOffset("ground", {"offset": -0.1}),
    SurfaceOffset("ground", {"offset": 0.05}),
]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("effect", PHYSICS, ids=lambda effect: f"{effect.name} {effect.vector[0]}")
def test_missing_physics_is_no_mistake(effect: Effect, shape: str, tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path, shape)
    assert data_mistakes(scene, thrown(scene.physics.with_effects([effect]), 3, count=2), "body") == ()


@pytest.mark.long
def test_a_mistake_leaves_no_room_for_physics(tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path)
    first, second = thrown(scene.physics, 3, count=2)
    verdict = diagnose(scene, [first, _scalar_last(second)])
    assert verdict.kind == "unexplained" and verdict.explanation == ()
    assert str(verdict).startswith("The recordings themselves look wrong: pose.body.qw, qx, qy and qz of toss_1")
    found = estimate(scene, [first, _scaled(second, -1.0, "z")])
    assert found.data_mistakes == ("pose.body.z of toss_1 has its sign turned",)


def test_a_mistake_of_what_is_held_out_is_a_note(tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path)
    first, second = thrown(scene.physics, 3, count=2)
    prepared = prepare_tosses(scene, [first], [_scaled(second, -1.0, "z")], ())
    assert prepared.mistakes == ()
    assert "held out: pose.body.z of toss_1 has its sign turned" in prepared.notes
