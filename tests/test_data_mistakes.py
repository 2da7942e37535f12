"""Mistakes of the data are told from physics, and physics is not taken for one."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.data_mistakes import data_mistakes
from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.stated_noise import noise_of
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.scene import Scene
from drake_cafim.typing import Array
from tests.concealed.make import simulate

Columns = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, list[Recording]]:
    """Three recordings of a two-joint arm that lacks nothing."""
    folder = tmp_path_factory.mktemp("arm")
    simulate("null", "arm2", 1014).write(folder)
    return Scene.load(folder / "scenario.yaml"), [recordings.read(folder / f"train_{k}.parquet") for k in (1, 2, 3)]


def _changed(arm: tuple[Scene, list[Recording]], change: Callable[[Columns], Columns]) -> list[Recording]:
    return [replace(one, columns={**one.columns, **change(dict(one.columns))}) for one in arm[1]]


def _told(scene: Scene, changed: list[Recording]) -> tuple[str, ...]:
    return data_mistakes(scene, changed, noise_of(scene, changed)[0])


def test_a_turned_effort_is_told(arm: tuple[Scene, list[Recording]]) -> None:
    name = arm[0].tree.joint_names[1]
    changed = _changed(arm, lambda columns: {f"u.{name}": -columns[f"u.{name}"]})
    assert _told(arm[0], changed) == (f"the sign of u.{name} is turned",)


def test_a_turned_axis_is_told(arm: tuple[Scene, list[Recording]]) -> None:
    name = arm[0].tree.joint_names[0]
    changed = _changed(arm, lambda columns: {f"{kind}.{name}": -columns[f"{kind}.{name}"] for kind in "qv"})
    assert _told(arm[0], changed) == (f"the sign of q.{name} and v.{name} is turned",)


def test_swapped_joints_are_told(arm: tuple[Scene, list[Recording]]) -> None:
    a, b = arm[0].tree.joint_names
    changed = _changed(arm, lambda columns: {f"u.{a}": columns[f"u.{b}"], f"u.{b}": columns[f"u.{a}"]})
    assert _told(arm[0], changed) == (f"u of the joints {a} and {b} are swapped",)


def test_a_mistake_leaves_no_room_for_physics(arm: tuple[Scene, list[Recording]]) -> None:
    name = arm[0].tree.joint_names[1]
    changed = _changed(arm, lambda columns: {f"u.{name}": -columns[f"u.{name}"]})
    verdict = diagnose(arm[0], changed)
    assert verdict.kind == "unexplained" and verdict.explanation == ()
    assert str(verdict).startswith("The recordings themselves look wrong: the sign of u.")


def test_friction_and_a_weak_drive_are_no_mistakes(arm: tuple[Scene, list[Recording]]) -> None:
    assert _told(*arm) == ()
    for joint in arm[0].tree.joint_names:
        rubbing = _changed(
            arm, lambda columns, j=joint: {f"u.{j}": columns[f"u.{j}"] + 2.0 * np.sign(columns[f"v.{j}"])}
        )
        assert _told(arm[0], rubbing) == ()
        weak = _changed(arm, lambda columns, j=joint: {f"u.{j}": 2.0 * columns[f"u.{j}"]})
        assert _told(arm[0], weak) == ()


def test_efforts_without_gravity_are_told(arm: tuple[Scene, list[Recording]]) -> None:
    scene, runs = arm
    changed = []
    for one in runs:
        holding = -_gravity(scene, one)
        without = {f"u.{name}": one[f"u.{name}"] - holding[:, j] for j, name in enumerate(scene.tree.joint_names)}
        changed.append(replace(one, columns={**one.columns, **without}))
    assert _told(scene, changed) == ("gravity is already taken out of the efforts u",)


def _gravity(scene: Scene, run: Recording) -> Array:
    """Drake's own generalized forces of gravity (N, n) at the recorded positions."""
    plant, context = scene.plant, scene.plant.CreateDefaultContext()
    forces = []
    for q in run.matrix("q", scene.tree.joint_names):
        plant.SetPositions(context, q)
        forces.append(plant.CalcGravityGeneralizedForces(context))
    return np.array(forces)
