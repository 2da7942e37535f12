"""Effects in scenario files: what a diagnosis writes is read back, and does in Drake what it says."""

from pathlib import Path

import numpy as np
import pytest
from recoveries.cases import CASES, Case
from recoveries.models import ARM, scene_of
from recoveries.rig import PERIOD, replayed

from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.scenario_yaml import as_yaml
from drake_cafim.scenario.scene import Scene
from drake_cafim.typing import Array

DURATION = 0.02
"""s"""


def read_back(scene: Scene, folder: Path) -> Scene:
    """The scene of the file that says what this one is."""
    folder.mkdir()
    path = folder / "scenario.corrected.yaml"
    path.write_text(as_yaml(scene.scenario, scene.folder, folder))
    return Scene.load(path)


def moved(scene: Scene) -> Array:
    """All channels (columns, N) over `DURATION` under the same efforts, in the middle of what cases do."""
    count, names = round(DURATION / PERIOD), scene.tree.joint_names
    efforts = np.random.default_rng(4).uniform(5.0, 20.0, (count, len(names)))
    time = 1.3 + PERIOD * np.arange(count)
    pushing = Recording("efforts", time, {f"u.{name}": efforts[:, j] for j, name in enumerate(names)}, ())
    state = {
        "turn": (0.4, 0.6), "lift": (0.6, 0.5), "elbow": (0.5, -0.4),
        "x": (0.01, 0.05), "y": (0.02, -0.04), "z": (0.0192, 0.01), "roll": (0.3, 0.5),
    }  # fmt: skip
    start = np.array([state[name] for name in names]).T.ravel()
    found = replayed(scene, pushing, start, DURATION, 1e-3)
    return np.stack(list(found.columns.values()))


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_what_was_found_is_read_back(case: Case, tmp_path: Path) -> None:
    for name in ("true", "bare"):
        (tmp_path / name).mkdir()
    true, bare = case.scene(tmp_path / "true", True), case.scene(tmp_path / "bare", False)
    corrected = bare.corrected(np.zeros(0), [case.effect])
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
    assert [one.name for one in found.physics.joint_forces] == ["joint_coulomb_friction", CASES[0].name]
    for other in (bare, bare.corrected(np.array([1.3]), []), scene_of(tmp_path, ARM, unknown=unknown)):
        assert np.max(np.abs(moved(other) - moved(found))) > 1e-5
