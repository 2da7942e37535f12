"""`drake_cafim.testing.assert_explained`, for a laboratory's own tests of its robot and model."""

import json
from pathlib import Path

import numpy as np
import pytest

from drake_cafim import InputError, Recording, Scene
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.predict.stepper import State, advance
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointViscousFriction
from drake_cafim.recordings import read, write
from drake_cafim.testing import assert_explained

CART = """<robot name="cart"><link name="rail"/>
  <link name="cart"><inertial><mass value="2"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
    <limit lower="-5" upper="5" effort="50" velocity="20"/></joint>
</robot>"""
STEP, SAMPLES = 0.004, 500


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    path = tmp_path_factory.mktemp("cart") / "cart.urdf"
    path.write_text(CART)
    return Scene.from_model(path, channels={"q": 1e-4, "v": 1e-3, "u": 0.0}, weld=["rail"])


def recorded(scene: Scene, *effects: Effect) -> Recording:
    """Two seconds under a sum of sines, with noise."""
    rng = np.random.default_rng(4)
    physics = Model(scene.priors.mean, effects).physics(scene)
    time = STEP * np.arange(SAMPLES)
    u = 6.0 * np.sin(9.0 * time) + 4.0 * np.cos(23.0 * time)
    state, trail = State(np.zeros((1, 1)), np.zeros((1, 1))), []
    for effort in u:
        trail.append((state.q[0, 0], state.v[0, 0]))
        state = advance(physics, state, np.array([[effort]]), np.array([STEP]))
    q, v = np.array(trail).T
    noisy = {"q.slide": q + rng.normal(0, 1e-4, SAMPLES), "v.slide": v + rng.normal(0, 1e-3, SAMPLES)}
    return Recording("last_night", time, noisy | {"u.slide": u})


FRICTION = JointViscousFriction("slide", {"coefficient": 3.0})


def test_passes_where_robot_and_model_agree(scene: Scene, tmp_path: Path) -> None:
    path = write(recorded(scene), tmp_path / "a.parquet")
    assert assert_explained(scene, path, artifacts=tmp_path / "left").kind == "none"
    assert not (tmp_path / "left").exists()


def test_fails_with_the_sentence_and_leaves_the_pages(scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match=r"The model lacks joint viscous friction at slide \(") as failed:
        assert_explained(scene, [recorded(scene, FRICTION)], artifacts=tmp_path)
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["verdict"] == "explained" and report["sentence"] in str(failed.value)
    assert str(tmp_path / "report.html") in str(failed.value)
    assert (tmp_path / "report.html").stat().st_size > 10_000 and (tmp_path / "replay.html").stat().st_size > 100_000
    again = Scene.load(tmp_path / "scenario.corrected.yaml")
    assert [entry.effect for entry in again.scenario.effects] == ["joint_viscous_friction"]
    assert assert_explained(again, recorded(scene, FRICTION), artifacts=tmp_path / "none").kind == "none"


def test_what_is_allowed_passes_there_alone(scene: Scene, tmp_path: Path) -> None:
    recording = recorded(scene, FRICTION)
    assert_explained(scene, recording, allowed=["joint_viscous_friction@slide"])
    with pytest.raises(AssertionError):
        assert_explained(scene, recording, allowed=["joint_viscous_friction@elsewhere"], artifacts=tmp_path)
    with pytest.raises(InputError, match="joint_friktion: there is no effect of that name; valid: joint_viscous"):
        assert_explained(scene, recording, allowed=["joint_friktion"])


def test_data_mistakes_fail(scene: Scene, tmp_path: Path) -> None:
    good = recorded(scene)
    turned = Recording("turned", good.time, dict(good.columns) | {"u.slide": -good["u.slide"]})
    with pytest.raises(AssertionError, match="The recordings themselves look wrong"):
        assert_explained(scene, turned, allowed=["actuator_gain_error"], artifacts=tmp_path)


def test_residuals_as_channels(scene: Scene, tmp_path: Path) -> None:
    from drake_cafim.diagnosis.diagnose import examine
    from drake_cafim.report.artifacts import replay_of
    from drake_cafim.report.recording_mcap import write_recording_mcap

    recording = recorded(scene, FRICTION)
    verdict, outcome = examine(scene, [recording])
    replay = replay_of(verdict, outcome, recording)
    assert replay is not None
    write_recording_mcap(tmp_path / "a.mcap", replay)
    back = read(tmp_path / "a.mcap")
    assert back["q.slide"].tobytes() == recording["q.slide"].tobytes()
    nominal, corrected = back["residual_nominal_q.slide"], back["residual_corrected_q.slide"]
    assert np.nanstd(corrected) < 1e-3 < 20e-3 < np.nanstd(nominal)
    assert np.isnan(nominal[0]) and np.isfinite(nominal).mean() > 0.45
