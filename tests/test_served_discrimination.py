"""Motions that tell explanations apart are commands where a servo drives the joint."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim.discrimination.closed_loop import measured, simulated
from drake_cafim.discrimination.hypotheses import named_pair
from drake_cafim.discrimination.motions import Limits, Motion, Shape, plan
from drake_cafim.discrimination.outcome import log_odds
from drake_cafim.discrimination.planned import noise_of, problem_of
from drake_cafim.errors import InputError
from drake_cafim.scene.scene import Scene
from tests.test_discrimination import ARM

SERVED = """model: arm.urdf
weld: [{body: base}]
channels: {q: {std: 4.4e-4}}
servo: {kp: {elbow: 20.0}, kv: {elbow: 1.0}}
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    folder = tmp_path_factory.mktemp("served")
    (folder / "arm.urdf").write_text(ARM)
    (folder / "scenario.yaml").write_text(SERVED)
    return Scene.load(folder / "scenario.yaml")


def _planned(scene: Scene) -> tuple[Limits, Motion]:
    shape, limits = Shape(), Limits.of(scene.tree)
    return limits, plan(shape, limits, scene.physics, np.random.default_rng(3).uniform(-0.4, 0.4, (shape.points, 2)))


def test_the_nominal_robot_follows_its_commands_as_planned(scene: Scene) -> None:
    limits, planned = _planned(scene)
    run = simulated(scene.physics, scene.physics, limits, planned)
    assert np.max(np.abs(run.q - planned.q)) < 2e-3
    recording = measured(scene, scene.physics, run, noise_of(scene), np.random.default_rng(0), "run")
    assert set(recording.columns) == {"q.shoulder", "q.elbow", "u.shoulder", "cmd.elbow"}


def test_the_truth_is_told_from_its_rival(scene: Scene) -> None:
    pair = named_pair(scene, "servo_gain_error@elbow", "servo_dead_band@elbow")
    limits, planned = _planned(scene)
    for number, (truth, sign) in enumerate(((pair.first, 1.0), (pair.second, -1.0))):
        physics = truth.physics(scene)
        run = simulated(physics, scene.physics, limits, planned)
        recording = measured(scene, physics, run, noise_of(scene), np.random.default_rng(number), "run")
        assert sign * log_odds(problem_of(scene, [recording]), pair) > 3.0


def test_a_gain_that_only_a_recording_knows_is_refused(scene: Scene, tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    text = SERVED.replace("kp: {elbow: 20.0}", "kp: {column: gain, scale: 0.2}")
    (tmp_path / "scenario.yaml").write_text(text)
    other = Scene.load(tmp_path / "scenario.yaml")
    with pytest.raises(InputError, match=r"servo\.kp is a multiple of the column gain, which a planned motion"):
        _planned(other)
