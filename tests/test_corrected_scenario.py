"""Effects in scenario files: what a diagnosis writes is read again, and acts in Drake as stated."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from drake_cafim import recordings
from drake_cafim.commands.run import RunRequest, load_stage, run_command
from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.experiment.closed_loop import Options
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.address import DIAGRAMS
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.parametrize import long_after
from tests.recoveries.cases import CASES, Case
from tests.recoveries.models import ARM, scene_of
from tests.recoveries.recovery import read_back
from tests.recoveries.rig import PERIOD, replayed

DURATION = 0.02
"""s"""


def moved(scene: Scene) -> Array:
    """All channels (columns, N) over `DURATION` under the same efforts or commands, in the middle of what cases do."""
    count, names = round(DURATION / PERIOD), scene.tree.joint_names
    time, rng = 1.3 + PERIOD * np.arange(count), np.random.default_rng(4)
    state = {
        "turn": (0.4, 0.6), "lift": (0.6, 0.5), "elbow": (0.5, -0.4),
        "x": (0.01, 0.05), "y": (0.02, -0.04), "z": (0.0192, 0.01), "roll": (0.3, 0.5),
    }  # fmt: skip
    start = np.array([state[name] for name in names]).T
    if scene.physics.servos:
        # near enough to the positions that the servos do not saturate
        kind, pushes = "cmd", start[0] + rng.uniform(-0.05, 0.05, (count, len(names)))
    else:
        kind, pushes = "u", rng.uniform(5.0, 20.0, (count, len(names)))
    pushing = Recording("pushes", time, {f"{kind}.{name}": pushes[:, j] for j, name in enumerate(names)}, ())
    found = replayed(scene, pushing, start.ravel(), DURATION, 1e-3)
    return np.stack(list(found.columns.values()))


@pytest.mark.parametrize("case", long_after(20, CASES), ids=lambda case: case.name)
def test_what_was_found_is_read_back(case: Case, tmp_path: Path) -> None:
    for name in ("true", "bare"):
        (tmp_path / name).mkdir()
    true, bare = case.scene(tmp_path / "true", True), case.scene(tmp_path / "bare", False)
    corrected = bare.corrected(bare.priors.mean, [case.effect])
    expected = moved(true)
    np.testing.assert_array_equal(moved(corrected), expected)
    np.testing.assert_array_equal(moved(read_back(corrected, tmp_path / "out")), expected)
    assert np.max(np.abs(moved(bare) - expected)) > 1e-6


def test_unknowns_shapes_and_known_effects_are_read_back(tmp_path: Path) -> None:
    unknown = [{"parameter": "mass", "body": "l2", "mean": 1.1, "std": 0.1}]
    brake = {"effect": "joint_coulomb_friction", "at": "lift", "torque": 0.4, "slip_velocity": 0.0015}
    bare = scene_of(tmp_path, ARM, brake, unknown=unknown)
    found = bare.corrected(np.array([1.3]), [CASES[0].effect])
    np.testing.assert_array_equal(moved(read_back(found, tmp_path / "out")), moved(found))
    assert [effect.name for effect in found.physics.joint_forces] == ["joint_coulomb_friction", CASES[0].name]
    for other in (bare, bare.corrected(np.array([1.3]), []), scene_of(tmp_path, ARM, unknown=unknown)):
        assert np.max(np.abs(moved(other) - moved(found))) > 1e-5


def test_a_world_has_the_effects_of_its_scenario(tmp_path: Path) -> None:
    raw = yaml.safe_load((DIAGRAMS / "hefting.yaml").read_text())
    raw["effects"] = [
        {"effect": "joint_viscous_friction", "at": "joint2", "coefficient": 8.0},
        {"effect": "external_disturbance", "at": "link4", "x": 9.0, "interval": [0.1, 0.3]},
        {"effect": "external_disturbance", "at": "link4", "x": 9.0, "interval": [0.1, 0.3], "recording": "old.parquet"},
    ]
    path = tmp_path / "known.yaml"
    path.write_text(yaml.safe_dump(raw))
    effects = load_stage(str(path)).effects
    assert [(effect.effect, effect.at, dict(effect.parameters)) for effect in effects] == [
        ("joint_viscous_friction", "joint2", {"coefficient": 8.0}),
        ("external_disturbance", "link4", {"x": 9.0, "start": 0.1, "stop": 0.3}),  # the other one was in that recording
    ]
    plants = [load_stage(name).diagram("model", 1).GetSubsystemByName("plant") for name in (str(path), "hefting")]
    known, bare = (plant.GetJointByName("joint2").default_damping() for plant in plants)
    assert known - bare == pytest.approx(8.0)


@pytest.mark.long
def test_a_run_of_a_corrected_scenario_is_explained_by_it(tmp_path: Path) -> None:
    """The world has the effects that the file knows, and a diagnosis with the same file finds no others."""
    raw = yaml.safe_load((DIAGRAMS / "hefting.yaml").read_text())
    raw["effects"] = [{"effect": "joint_viscous_friction", "at": "joint2", "coefficient": 8.0}]
    path, out = tmp_path / "known.yaml", tmp_path / "out"
    path.write_text(yaml.safe_dump(raw))
    out.mkdir()
    run_command(RunRequest(str(path), "drake", Options(seed=1, experiments=1), diagnosed=False), out, lambda text: None)
    recording = recordings.read(out / "experiment_1.parquet")
    kinds = [diagnose(Scene.load(name), [recording]).kind for name in (str(path), "hefting")]
    assert kinds == ["none", "explained"]
