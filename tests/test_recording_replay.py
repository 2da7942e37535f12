"""The replay of a recording beside its simulations: geometry, arrows of forces, and the contents from a report."""

import json
import re
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import Meshcat

from drake_cafim.commands.replay import replay_command
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.predict.stepper import State, advance
from drake_cafim.diagnosis.rows.samples import samples_of
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointSpring
from drake_cafim.errors import InputError
from drake_cafim.recordings import write
from drake_cafim.recordings.recording import Recording
from drake_cafim.report.link_geometry import extent, link_shapes
from drake_cafim.report.recording_motion import (
    frame_times,
    lacking_arrows,
    poses_at,
    recorded_frames,
    simulated_frames,
)
from drake_cafim.report.recording_replay import RecordingReplay, render, write_recording_replay
from drake_cafim.report.replay import make_meshcat
from drake_cafim.scene.scene import Scene

ARM = """<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 -0.2"/><mass value="2"/>
    <inertia ixx="0.03" iyy="0.03" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0 0 -0.15"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="50" velocity="20"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.4"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="20"/></joint>
</robot>
"""
SCENARIO = """model: arm.urdf
weld: [{body: base}]
channels: {q: {std: 1.0e-4}, v: {std: 1.0e-3}, u: {std: 0.0}}
"""
SPRING = {"stiffness": 3.0, "rest": -0.4}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scenario, a recording of it with a spring that it lacks, and a report that says so."""
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.urdf").write_text(ARM)
    (folder / "scenario.yaml").write_text(SCENARIO)
    spring = (
        f"effects: [{{effect: joint_spring, at: elbow, stiffness: {SPRING['stiffness']}, rest: {SPRING['rest']}}}]\n"
    )
    (folder / "scenario.corrected.yaml").write_text(SCENARIO + spring)
    report = {
        "schema": "drake_cafim.report/1",
        "sentence": "The model lacks a spring (quite stiff).",
        "mismatch": {"locations": [{"name": "elbow", "share": 0.6}, {"name": "elbow", "share": 0.3}]},
        "explanation": [{"effect": "joint_spring", "at": "elbow"}],
        "parameters": [],
        "files": {"corrected_scenario": "scenario.corrected.yaml"},
    }
    (folder / "report.json").write_text(json.dumps(report))
    write(_recorded(Scene.load(folder / "scenario.yaml")), folder / "a.parquet")
    return folder


def _recorded(scene: Scene) -> Recording:
    """Three seconds under slow torques, without noise."""
    effects: list[Effect] = [JointSpring("elbow", SPRING)]
    physics = Model(scene.priors.mean).with_effects(effects).physics(scene)
    time = 0.005 * np.arange(600)
    u = np.stack([2.0 * np.sin(2.0 * time), 0.6 * np.sin(3.1 * time + 1.0)], axis=1)
    state = State(np.array([[0.2, -0.1]]), np.zeros((1, 2)))
    trail = []
    for effort in u:
        trail.append(np.concatenate([state.q[0], state.v[0]]))
        state = advance(physics, state, effort[None], np.array([0.005]))
    states = np.array(trail)
    names = ("q.shoulder", "q.elbow", "v.shoulder", "v.elbow")
    columns = {name: states[:, k] for k, name in enumerate(names)} | {"u.shoulder": u[:, 0], "u.elbow": u[:, 1]}
    return Recording("a.parquet", time, columns)


@pytest.fixture(scope="module")
def replay(folder: Path) -> RecordingReplay:
    scene = Scene.load(folder / "scenario.yaml")
    recording = _recorded(scene)
    std = {
        f"{kind}.{name}": value
        for kind, value in (("q", 1e-4), ("v", 1e-3), ("u", 0.0))
        for name in ("shoulder", "elbow")
    }
    weak = WeakForm(samples_of(scene, recording, std), ())
    corrected = Scene.load(folder / "scenario.corrected.yaml").physics
    return RecordingReplay(scene, weak, scene.physics, corrected, {"elbow": 0.9}, "It lacks <a spring>.")


@pytest.fixture(scope="module")
def meshcat() -> Meshcat:
    return make_meshcat()


def test_simulations_start_from_the_recording_and_only_the_right_one_follows_it(replay: RecordingReplay) -> None:
    weak = replay.weak
    frames = frame_times(weak.samples.time)
    recorded = recorded_frames(weak, frames)
    nominal = simulated_frames(weak, replay.nominal, frames)
    assert replay.corrected is not None
    corrected = simulated_frames(weak, replay.corrected, frames)
    just_started = (frames > 1.05) & (frames < 1.10)  # windows start 50 ms into the recording
    np.testing.assert_allclose(nominal[just_started], recorded[just_started], atol=0.01)
    assert np.max(np.abs(nominal - recorded)) > 0.1
    assert np.max(np.abs(corrected - recorded)) < 0.005


def test_arrows_show_the_missing_torque_as_a_push_on_its_link(replay: RecordingReplay) -> None:
    weak = replay.weak
    frames = frame_times(weak.samples.time)
    moving = poses_at(replay.nominal, recorded_frames(weak, frames))
    (arrow,) = lacking_arrows(weak, replay.nominal, moving, frames, extent(moving), beside=replay.nominal)
    assert arrow.name == "elbow"
    lever = arrow.points - moving.p_WJ[:, 1]
    np.testing.assert_allclose(np.linalg.norm(lever, axis=1), 0.15, atol=1e-12)
    torque = np.cross(lever, arrow.vectors)[:, 1]
    spring = -SPRING["stiffness"] * (moving.q[:, 1] - SPRING["rest"])
    inner = slice(5, -5)
    assert np.corrcoef(torque[inner], spring[inner])[0, 1] > 0.999
    assert replay.corrected is not None
    assert lacking_arrows(weak, replay.corrected, moving, frames, extent(moving), beside=replay.nominal) == []


def test_a_model_without_visuals_is_drawn(replay: RecordingReplay) -> None:
    moving = poses_at(replay.nominal, np.zeros((2, 2)))
    shapes = link_shapes(replay.scene, moving, extent(moving))
    assert {shape.joint for shape in shapes} == {0, 1}
    assert len(shapes) >= 6  # two joints, two bars at least, two masses


def test_page_stands_alone(tmp_path: Path, replay: RecordingReplay, meshcat: Meshcat) -> None:
    write_recording_replay(tmp_path / "replay.html", replay, meshcat)
    page = (tmp_path / "replay.html").read_text()
    assert not re.search(r'<(script|link)[^>]*(src|href)="https?://', page)
    assert "elbow: 90 % of the misfit" in page
    assert "It lacks &lt;a spring&gt;." in page
    for name in ("recording/joint1", "nominal/joint0", "corrected/joint0", "lacking/arrow0", "places/place0"):
        assert meshcat.HasPath(f"/replay/{name}")


def test_nothing_of_an_earlier_replay_stays(replay: RecordingReplay, meshcat: Meshcat) -> None:
    render(RecordingReplay(replay.scene, replay.weak, replay.nominal), meshcat)
    assert not meshcat.HasPath("/replay/corrected")
    assert not meshcat.HasPath("/replay/places")


def test_command_takes_report_or_its_folder(tmp_path: Path, folder: Path) -> None:
    scenario, recording = str(folder / "scenario.yaml"), str(folder / "a.parquet")
    for report in (folder, folder / "report.json"):
        result = replay_command(scenario, recording, report, tmp_path / "replay.html")
        assert result["corrected"] is True
        assert result["shares"] == {"elbow": pytest.approx(0.9)}
    assert "The model lacks a spring." in (tmp_path / "replay.html").read_text()


def test_command_refuses_what_is_no_report(tmp_path: Path, folder: Path) -> None:
    scenario, recording = str(folder / "scenario.yaml"), str(folder / "a.parquet")
    with pytest.raises(InputError, match="it is no JSON"):
        replay_command(scenario, recording, folder / "arm.urdf", tmp_path / "replay.html")
    other = tmp_path / "other.json"
    other.write_text('{"schema": "something/1"}')
    with pytest.raises(InputError, match="expected a report"):
        replay_command(scenario, recording, other, tmp_path / "replay.html")
    with pytest.raises(InputError, match=r"expected a page, \.html"):
        replay_command(scenario, recording, None, tmp_path / "replay")
    assert not (tmp_path / "replay.html").exists()


@pytest.mark.long
def test_live_replay_serves_this_machine_until_it_is_interrupted(tmp_path: Path, folder: Path) -> None:
    arguments = ["replay", str(folder / "scenario.yaml"), str(folder / "a.parquet"), "--live", "--out", "replay.html"]
    command = [sys.executable, "-c", "from drake_cafim.cli import run_cli; run_cli()", *arguments]

    def heard() -> None:
        # what runs in the background may have been told to ignore it, and hands that on
        signal.signal(signal.SIGINT, signal.SIG_DFL)

    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True, preexec_fn=heard) as running:
        assert running.stderr is not None
        address = next(found[0] for line in running.stderr if (found := re.match(r"http://localhost:\d+", line)))
        with urllib.request.urlopen(address) as page:
            assert "MeshCat" in page.read().decode()
        running.send_signal(signal.SIGINT)
        assert running.wait(timeout=30) == 0
    assert (tmp_path / "replay.html").is_file()
