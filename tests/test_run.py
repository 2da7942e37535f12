"""`cafim run`: what it writes, that a seed fixes it, and what it refuses."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from drake_cafim.cli import main
from drake_cafim.command_line.arguments import spread_values
from drake_cafim.commands.run import KEPT, RunRequest, load_stage, parse_concealed, run_command
from drake_cafim.commands.run_diagnosis import diagnose_run
from drake_cafim.design.system import CaOed
from drake_cafim.diagrams.concealing import Concealed
from drake_cafim.errors import InputError, OutputError
from drake_cafim.experiment import closed_loop as experiment
from drake_cafim.experiment.closed_loop import Options
from drake_cafim.experiment.joint_recording import joint_recording
from drake_cafim.kept import Kept
from drake_cafim.recordings import read
from drake_cafim.scene.address import DIAGRAMS
from drake_cafim.scene.scene import Scene
from tests.parametrize import long_after


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The packaged hefting, cut to half a second."""
    raw = yaml.safe_load((DIAGRAMS / "hefting.yaml").read_text())
    raw["task"]["periods"] = 10
    path = tmp_path_factory.mktemp("scenario") / "short.yaml"
    path.write_text(yaml.safe_dump(raw))
    return str(path)


def go(scenario: str, out: Path, **chosen: Any) -> dict[str, Any]:
    concealed = chosen.pop("concealed", ())
    diagnosed = chosen.pop("diagnosed", False)
    request = RunRequest(scenario, "model", Options(seed=1, **chosen), concealed=concealed, diagnosed=diagnosed)
    out.mkdir(exist_ok=True)
    return run_command(request, out, lambda text: None)


@pytest.fixture(scope="module")
def finished(short: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("first")
    go(short, out, experiments=2)
    return out


def untimed(path: Path) -> dict[str, Any]:
    record: dict[str, Any] = json.loads(path.read_text())
    for experiment_record in record["experiments"]:
        del experiment_record["planning_ms"]
    return record


def test_files_and_record(finished: Path) -> None:
    record = json.loads((finished / "run.json").read_text())
    assert record["schema"] == "drake_cafim.run/1"
    assert record["world"] == "model" and record["truth"] == {"mass": 0.05}
    assert record["prior"]["mass"]["mean"] == pytest.approx(0.065)
    assert [entry["recording"] for entry in record["experiments"]] == ["experiment_1.parquet", "experiment_2.parquet"]
    named = [record["files"]["replay"], *record["files"]["figures"], *(e["recording"] for e in record["experiments"])]
    assert {path.name for path in finished.iterdir()} == {"run.json", *named}
    assert (finished / "error.svg").read_text().startswith("<?xml")


def test_the_same_seed_gives_the_same_bytes(finished: Path, short: str, tmp_path: Path) -> None:
    go(short, tmp_path, experiments=2)
    assert untimed(tmp_path / "run.json") == untimed(finished / "run.json")
    for name in ("experiment_1.parquet", "experiment_2.parquet", "error.svg", "information.svg"):
        assert (tmp_path / name).read_bytes() == (finished / name).read_bytes(), name


def test_recording_is_one_continuous_motion(short: str) -> None:
    stage = load_stage(short)
    world = stage.world("model", 1)
    (result,) = experiment.run(stage.task, Options(seed=1, experiments=1), world).experiments
    names = Scene.load(short).tree.joint_names
    recording = joint_recording(result, "x", names, step=0.001, std={}, random=np.random.default_rng(0))
    q, v, u = (recording.matrix(kind, names) for kind in "qvu")
    assert recording.time[1] == pytest.approx(0.001) and len(q) == pytest.approx(500, abs=16)
    assert np.abs(v).max() > 0.3
    np.testing.assert_allclose(np.diff(q, axis=0), 0.0005 * (v[1:] + v[:-1]), atol=1e-12)
    assert np.abs(u[:, 4:]).max() <= 12.0  # N m: what acts, after the limits
    assert np.isfinite(recording["force.0"]).sum() == 10


def test_encoders_have_the_stated_noise(finished: Path, short: str) -> None:
    recording = read(finished / "experiment_1.parquet")
    names = Scene.load(short).tree.joint_names
    for kind, std in (("q", 3.0e-4), ("v", 8.0e-3)):
        # third differences take the motion out; of white noise they have 20 times the variance
        rough = np.diff(recording.matrix(kind, names), n=3, axis=0)
        assert np.median(np.abs(rough)) / 0.6745 / np.sqrt(20.0) == pytest.approx(std, rel=0.1)


def test_wrench_and_pose_are_recorded_with_noise(finished: Path) -> None:
    recording = read(finished / "experiment_1.parquet")
    wrench, pose = recording.wrench("palm"), recording.pose("ball")
    # the palm faces up along its x; the ball weighs .05 · 9.81 N, and the sensor's noise is the planner's
    assert np.mean(wrench[:, 0]) == pytest.approx(-0.49, abs=0.15)
    assert np.abs(np.mean(wrench[:, 1:3], axis=0)).max() < 0.15
    rough = np.diff(np.column_stack([wrench, pose[:, :3]]), n=3, axis=0)
    std = [*[0.5] * 3, *[0.025] * 3, *[2.0e-4] * 3]
    np.testing.assert_allclose(np.median(np.abs(rough), axis=0) / 0.6745 / np.sqrt(20.0), std, rtol=0.15)
    np.testing.assert_allclose(np.linalg.norm(pose[:, 3:], axis=1), 1.0, atol=1e-12)


def test_ends_with_the_diagnosis_of_its_recordings(short: str, tmp_path: Path) -> None:
    friction = Concealed("joint_viscous_friction", "joint2", {"coefficient": 8.0})
    record = go(short, tmp_path, experiments=2, concealed=(friction,), diagnosed=True)
    assert record["diagnosis"]["verdict"] == "explained"
    report = json.loads((tmp_path / record["diagnosis"]["report"]).read_text())
    assert report["sentence"] == record["diagnosis"]["sentence"]
    assert [(found["effect"], found["at"]) for found in report["explanation"]] == [("joint_viscous_friction", "joint2")]
    assert report["fit"]["held_out"] is not None


def test_without_a_diagnosis_no_folder_of_one_stays(finished: Path) -> None:
    record = json.loads((finished / "run.json").read_text())
    assert "diagnosis" not in record and not (finished / "diagnosis").exists()


def test_stops_when_sure_enough(short: str, tmp_path: Path) -> None:
    record = go(short, tmp_path, experiments=4, until_std=10.0)
    assert len(record["experiments"]) == 1


def test_an_older_runs_files_go(finished: Path, short: str, tmp_path: Path) -> None:
    (tmp_path / "experiment_9.parquet").write_text("old")
    go(short, tmp_path, experiments=1)
    assert {path.name for path in tmp_path.glob("experiment_*")} == {"experiment_1.parquet"}


@pytest.mark.parametrize(
    "concealed",
    long_after(
        2,
        [
            Concealed("joint_viscous_friction", "joint2", {"coefficient": 8.0}),
            Concealed("joint_coulomb_friction", "joint4", {"torque": 3.0}),
            Concealed("rotor_inertia", "joint2", {"inertia": 0.5}),
            Concealed("payload", "flange", {"mass": 1.0, "z": 0.05}),
            Concealed("actuator_gain_error", "joint2", {"gain": 0.9}),
            Concealed("aerodynamic_drag", "link4", {"coefficient": 40.0}),
        ],
    ),
    ids=lambda effect: effect.effect,
)
def test_concealed_effect_is_in_the_world_and_in_no_model(
    concealed: Concealed, finished: Path, short: str, tmp_path: Path
) -> None:
    record = go(short, tmp_path, experiments=1, concealed=(concealed,))
    assert record["concealed"] == [{"effect": concealed.effect, "at": concealed.at, **concealed.parameters}]
    first, other = (read(folder / "experiment_1.parquet") for folder in (finished, tmp_path))
    names = Scene.load(short).tree.joint_names
    # the controller pushes harder against what it does not know: well above any noise
    assert np.abs(other.matrix("u", names) - first.matrix("u", names)).max() > 1.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["juggling"], "no packaged scenario of that name"),
        (["hefting", "--policy", "bold"], "--policy bold: expected one of contact-aware"),
        (["hefting", "--world", "mujoco"], "expected one of drake, model"),
        (["hefting", "--experiments", "0"], "expected at least 1"),
        (["hefting", "--conceal", "sensor_misalignment@wrist"], "expected one of joint_viscous_friction"),
        (
            ["hefting", "--conceal", "surface_offset@wall"],
            "surface_offset@wall: hefting names no contact that it could act on: its ball is free in the hand",
        ),
        (["pinching_point", "--conceal", "contact_adhesion@jaw/ball"], "have it at left_tip/ball, right_tip/ball"),
        (
            ["pinching_point", "--world", "model", "--conceal", "surface_offset@ball", "offset=0.001"],
            "found --world model, expected drake",
        ),
        (["hefting", "--conceal", "rotor_inertia@elbow", "inertia=1"], "the robot's joints are joint1"),
        (["hefting", "--conceal", "rotor_inertia@joint1", "mass=1"], "found mass, expected inertia"),
        (["hefting", "--conceal", "joint_coulomb_friction@joint1", "torque=-1"], "torque is -1, expected a finite"),
        (["hefting", "--conceal", "joint_spring@joint1", "rest=1"], "found rest, expected stiffness, rest"),
        (["hefting", "--conceal", "rotor_inertia@joint1", "inertia=much"], "inertia=much: expected a number"),
    ],
)
def test_what_cannot_be_run(arguments: list[str], message: str, tmp_path: Path) -> None:
    words = spread_values(["run", *arguments, "--out", str(tmp_path / "out")], ("--conceal",))
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 2
    assert message in result.stderr and "Traceback" not in result.stderr


def test_a_folder_that_holds_files_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("keep")
    result = CliRunner().invoke(main, ["run", "hefting", "--out", str(tmp_path)])
    assert result.exit_code == 2 and "not empty" in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_model_without_a_world(tmp_path: Path) -> None:
    scenario = tmp_path / "arm.yaml"
    scenario.write_text("model: arm.urdf\n")
    with pytest.raises(InputError, match="no section diagram, expected a world that can be run"):
        run_command(RunRequest(str(scenario)), tmp_path / "out", lambda text: None)


def test_concealed_words() -> None:
    words = spread_values(
        ["run", "--conceal", "payload@flange", "mass=1", "z=0.1", "hefting", "--seed", "1"], ("--conceal",)
    )
    assert words[-3:] == ["hefting", "--seed", "1"]
    given = parse_concealed([word for word in words[:-3] if word not in ("run", "--conceal")])
    assert given == (Concealed("payload", "flange", {"mass": 1.0, "z": 0.1}),)
    with pytest.raises(InputError, match="expected EFFECT@PLACE"):
        parse_concealed(["mass=1"])


def test_a_run_that_was_ended_goes_on_with_the_next_experiment(
    finished: Path, short: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    request = RunRequest(short, "model", Options(seed=1, experiments=2), diagnosed=False)

    def stop(progress: Any, number: int, total: int, result: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr("drake_cafim.commands.run._show_progress", stop)
        run_command(request, tmp_path, lambda text: None)
    carried_out: list[int] = []
    begin = CaOed.begin_experiment

    def begin_and_count(self: CaOed, context: Any, experiment: int, **more: Any) -> None:
        carried_out.append(experiment)
        begin(self, context, experiment, **more)

    monkeypatch.setattr(CaOed, "begin_experiment", begin_and_count)
    run_command(request, tmp_path, lambda text: None, resume=True)
    assert carried_out == [1]
    assert untimed(tmp_path / "run.json") == untimed(finished / "run.json")
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in finished.iterdir()}
    for name in ("experiment_1.parquet", "experiment_2.parquet", "error.svg", "information.svg"):
        assert (tmp_path / name).read_bytes() == (finished / name).read_bytes(), name
    # killed after its last file
    Kept.open(tmp_path / KEPT, {}, resume=False).write("experiment_1", [1.0])
    run_command(request, tmp_path, lambda text: None, resume=True)
    assert not (tmp_path / KEPT).exists() and carried_out == [1]


def test_a_guarded_run_goes_on_with_what_its_guard_has_learned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = load_stage("pinching_point")
    task = replace(stage.task, periods=6)
    options = Options(seed=1, experiments=2, force_guard=True)
    whole = experiment.run(task, options, stage.world("model", 1))

    def ended(number: int, result: Any) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        experiment.run(task, options, stage.world("model", 1), ended, Kept.open(tmp_path, {}, resume=False))
    kept = Kept.open(tmp_path, {}, resume=True)
    again = experiment.run(task, options, stage.world("model", 1), kept=kept)
    for before, after in zip(whole.experiments, again.experiments, strict=True):
        assert np.array_equal(before.commands, after.commands) and np.array_equal(before.fisher, after.fisher)
    # what is of another task is carried out anew
    other = experiment.run(replace(task, periods=7), options, stage.world("model", 1), kept=kept)
    assert [len(result.commands) for result in other.experiments] == [7, 7]


def test_another_run_is_not_taken_for_this_one(finished: Path, short: str) -> None:
    arguments = ["run", short, "--world", "model", "--experiments", "2", "--no-diagnosis", "--resume", "--seed"]
    result = CliRunner().invoke(main, [*arguments, "1", "--out", str(finished)])
    assert result.exit_code == 0, result.stderr
    result = CliRunner().invoke(main, [*arguments, "2", "--out", str(finished)])
    assert result.exit_code == 2 and "it holds a run with seed 1 instead of 2" in result.stderr


@pytest.mark.long
def test_a_diagnosis_is_the_same_in_every_folder(finished: Path, short: str, tmp_path: Path) -> None:
    found = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        shutil.copy(finished / "experiment_1.parquet", tmp_path / name)
        entry = diagnose_run(short, tmp_path / name, ["experiment_1.parquet"], lambda text: None, replay=False)
        assert entry["report"] == "diagnosis/report.json"
        found.append({path.name: path.read_bytes() for path in (tmp_path / name / "diagnosis").iterdir()})
    assert found[0] == found[1]
    command = json.loads(found[0]["diagnosis.json"])["command"]
    scenario = os.path.relpath(short, tmp_path / "a")
    assert command == ["cafim", "diagnose", scenario, "--recording", "experiment_1.parquet"]


def test_a_full_disk_is_no_lack_of_a_diagnosis(
    finished: Path, short: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fill(*_: Any, **__: Any) -> None:
        raise OutputError("report.json: it cannot be written (No space left on device)")

    monkeypatch.setattr("drake_cafim.commands.diagnose.write_artifacts", fill)
    shutil.copy(finished / "experiment_1.parquet", tmp_path)
    with pytest.raises(OutputError):
        diagnose_run(short, tmp_path, ["experiment_1.parquet"], lambda text: None, replay=False)
