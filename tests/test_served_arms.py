"""Robots that are commanded by position, simulated by MuJoCo: diagnosed from commands and quantised positions alone."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.diagnose import diagnose, estimate
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from tests import served_arm
from tests.served_arm import KP, KV, LIMIT, MOTOR, POSITION, QUANTUM, recorded, written

ONE = Settings(most_effects=1)


def test_the_servos_of_an_mjcf_are_enough_and_nothing_is_missing(tmp_path: Path) -> None:
    path = written(tmp_path, shoulder=POSITION, elbow=POSITION)
    verdict = diagnose(Scene.load(path), [recorded(path, 1)], held_out=[recorded(path, 2)], settings=ONE)
    assert verdict.kind == "none", str(verdict)
    assert verdict.held_out is not None
    assert verdict.held_out.corrected.rmse["q.elbow"] < 0.004
    assert any("the scale of the efforts at elbow, which were not recorded, is that of kp" in n for n in verdict.notes)


def test_a_servo_holds_the_estimated_motion_to_its_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, shoulder=POSITION, elbow=POSITION)
    scene = Scene.from_model(path, channels={"q": QUANTUM / np.sqrt(12.0)})
    monkeypatch.setattr(served_arm, "QUANTUM", 1e-9)
    [run] = prepare(scene, [recorded(path, 1)]).problem().runs
    assert run.weak.samples.estimated is not None
    # without the servo's slopes a deviation would grow for ever, and white forces would have to undo it
    assert run.weak.samples.estimated.unmodelled_force[1] < 1e-12


@pytest.mark.long
def test_a_servo_that_is_stated_wrongly_by_thirty_percent_is_named(tmp_path: Path) -> None:
    path = written(tmp_path, shoulder=POSITION, elbow=POSITION)
    verdict = diagnose(Scene.load(path), [recorded(path, seed, stiffer=0.7) for seed in (1, 2)], settings=ONE)
    (found,) = verdict.explanation
    assert (verdict.kind, found.effect.key) == ("explained", ("servo_gain_error", "elbow")), str(verdict)
    assert found.values["gain"].value == pytest.approx(0.7, abs=max(0.005, 4.0 * (found.values["gain"].std or 0.0)))


@pytest.mark.long
def test_a_robot_with_efforts_at_one_joint_and_commands_at_the_other(tmp_path: Path) -> None:
    path = written(tmp_path, shoulder=MOTOR, elbow=POSITION)
    (tmp_path / "scenario.yaml").write_text("model: arm.xml\nchannels: {u: {std: 0.0}}\n")
    runs = [recorded(path, seed, friction=(0.0, 0.12)) for seed in (1, 2)]
    verdict = diagnose(Scene.load(tmp_path / "scenario.yaml"), runs, settings=ONE)
    assert set(runs[0].columns) == {"q.shoulder", "q.elbow", "u.shoulder", "cmd.elbow"}
    (found,) = verdict.explanation
    assert (verdict.kind, found.effect.key) == ("explained", ("joint_coulomb_friction", "elbow")), str(verdict)
    assert found.values["torque"].value == pytest.approx(0.12, rel=0.1)


SERVO = """
model: arm.xml
channels: {{u: {{std: 0.0}}}}
servo: {{kp: {{column: gain, scale: {scale}}}, kv: {kv}, limit: {limit}}}
unknown: [{{parameter: servo_stiffness, joint: elbow, mean: {mean}, std: {std}}}]
"""


def test_runs_with_other_gains_and_without_a_servo_share_one_stiffness(tmp_path: Path) -> None:
    path = written(tmp_path, shoulder=POSITION, elbow=POSITION)
    scale = KP / 100.0
    text = SERVO.format(scale=scale, kv=KV, limit=LIMIT, mean=0.6 * scale, std=0.3 * scale)
    (tmp_path / "scenario.yaml").write_text(text)

    def with_gain(run: Recording, gain: float) -> Recording:
        columns = {**run.columns, "gain": np.full(len(run), gain)}
        return Recording(f"{run.name}, gain {gain}", run.time, columns)

    off = recorded(path, 3, off=True)
    found = estimate(Scene.load(tmp_path / "scenario.yaml"), [with_gain(recorded(path, 1), 100.0), with_gain(off, 1.0)])
    assert "cmd.elbow" not in off.columns
    (stiffness,) = found.parameters
    assert stiffness.value == pytest.approx(scale, rel=0.01), str(found)


def test_a_joint_with_a_servo_and_neither_command_nor_effort_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, shoulder=POSITION, elbow=POSITION)
    run = recorded(path, 1, 0.5)
    columns = {name: values for name, values in run.columns.items() if name != "cmd.elbow"}
    with pytest.raises(InputError, match=r"there is no column cmd\.elbow and no column u\.elbow; expected"):
        diagnose(Scene.load(path), [Recording(run.name, run.time, columns)])
