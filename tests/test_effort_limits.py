"""Efforts above the limit that a model's file states: it acts, or the recordings show that it does not."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim import InputError, Recording, Scene, diagnose, write
from drake_cafim.commands import replay
from drake_cafim.diagnosis.diagnose import examine
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.report.artifacts import write_artifacts, write_scene
from drake_cafim.report.recording_replay import RecordingReplay

DOOR = """<robot name="door"><link name="base"/><link name="leaf"><inertial><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="leaf"/><axis xyz="0 0 1"/>
<limit effort="2" velocity="200"/></joint></robot>"""
SCENARIO = """model: door.urdf
gravity: [0, 0, 0]
weld: [{body: base}]
channels: {q: {std: 1.0e-4}, v: {std: 1.0e-3}, u: {std: 0.0}}
unknown: [{parameter: inertia, body: leaf, mean: 1.0, std: 0.2}]
"""


def _swing(limit: float, size: float, friction: float, seed: int = 1) -> Recording:
    """4 s of a leaf of .1 kg m² that commands of up to `size` N m turn to and fro, with dry and viscous friction."""
    rng, step, substeps = np.random.default_rng(seed), 0.002, 20
    time = step * np.arange(2000)
    command = size * np.sin(2.0 * np.pi * 1.1 * time + 0.4) * np.cos(2.0 * np.pi * 0.23 * time)
    q, v, states = 0.0, 0.0, []
    for u in np.clip(command, -limit, limit):
        states.append((q, v))
        for _ in range(substeps):
            change = (u - friction * np.tanh(v / 0.005) - 0.05 * v) / 0.1 * step / substeps
            q, v = q + (v + 0.5 * change) * step / substeps, v + change
    found = np.array(states)
    columns = {
        "q.hinge": found[:, 0] + rng.normal(0.0, 1e-4, len(time)),
        "v.hinge": found[:, 1] + rng.normal(0.0, 1e-3, len(time)),
        "u.hinge": command,
    }
    return Recording(f"swing {seed}", time, columns)


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    (tmp_path / "door.urdf").write_text(DOOR, encoding="utf-8")
    (tmp_path / "scenario.yaml").write_text(SCENARIO, encoding="utf-8")
    return Scene.load(tmp_path / "scenario.yaml")


ACTS = "commands above the model's effort limits act at the limits (hinge)"
IGNORED = "the recordings follow commands above the model's effort limits, which are ignored (hinge)"


@pytest.mark.parametrize("size, friction", [(2.2, 0.5), (4.0, 0.0), (4.0, 1.0), (20.0, 0.3)])
def test_a_limit_acts_where_the_motion_says_so(scene: Scene, size: float, friction: float) -> None:
    bounded, free = (prepare(scene, [_swing(limit, size, friction)]) for limit in (2.0, np.inf))
    assert ACTS in bounded.notes and IGNORED not in bounded.notes
    assert bounded.scene.limited == ("hinge",) and not bounded.scene.scenario.unlimited
    assert IGNORED in free.notes and ACTS not in free.notes
    assert not free.scene.limited and free.scene.scenario.unlimited == ["hinge"]


def test_a_limit_that_acts_a_little_higher_than_stated_acts(scene: Scene) -> None:
    """A seventh of what is commanded beyond it is there: far more than noise, and far less than all."""
    assert ACTS in prepare(scene, [_swing(2.3, 4.0, 0.3)]).notes


@pytest.mark.parametrize("seed", range(1, 7))
def test_what_hardly_goes_beyond_a_limit_cannot_refute_it(scene: Scene, seed: int) -> None:
    # the largest command is 2.0004 N m
    assert ACTS in prepare(scene, [_swing(np.inf, 2.0004 / 0.97145, 0.1, seed)]).notes


def test_below_the_limit_there_is_nothing_to_tell(scene: Scene) -> None:
    found = prepare(scene, [_swing(2.0, 1.9, 0.2)])
    assert not {ACTS, IGNORED} & set(found.notes) and not found.scene.limited


def test_a_limit_that_does_not_act_hides_no_friction(scene: Scene, tmp_path: Path) -> None:
    verdict = diagnose(scene, [_swing(np.inf, 6.0, 0.4)], held_out=[_swing(np.inf, 6.0, 0.4, 2)])
    named = {finding.effect.name: finding.effect for finding in verdict.explanation}
    assert set(named) == {"joint_coulomb_friction", "joint_viscous_friction"}
    assert named["joint_coulomb_friction"].values["torque"] == pytest.approx(0.4, rel=0.02)
    # and so it stays in the corrected scene, which a simulation reads again
    write_scene(verdict.corrected, tmp_path)
    again = Scene.load(tmp_path / "scenario.corrected.yaml").for_recordings([_swing(np.inf, 6.0, 0.4)])
    assert again.scenario.unlimited == ["hinge"] and not again.limited
    assert diagnose(again, [_swing(np.inf, 6.0, 0.4, 3)], settings=Settings(most_effects=0)).kind == "none"


@pytest.mark.parametrize("limit", [2.0, np.inf])
def test_a_replay_of_a_report_has_the_limits_that_act(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: float
) -> None:
    recording = _swing(limit, 6.0, 0.4)
    verdict, outcome = examine(scene, [recording])
    write(recording, tmp_path / "swing.parquet")
    write_artifacts(tmp_path, verdict, outcome, [recording], [], ["a command"], replay=False)
    shown: list[RecordingReplay] = []
    monkeypatch.setattr(replay, "write_recording_replay", lambda out, found, meshcat: shown.append(found))
    replay.replay_command(scene.name, str(tmp_path / "swing.parquet"), tmp_path, tmp_path / "replay.html")
    [found] = shown
    assert found.corrected is not None
    for physics in (found.nominal, found.corrected):
        assert [effect.name for effect in physics.actuators] == ["actuator_saturation"] * (limit == 2.0)


def test_a_scenario_may_say_that_no_limit_acts(scene: Scene, tmp_path: Path) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_text(SCENARIO + "unlimited: [hinge]\n", encoding="utf-8")
    assert not Scene.load(path).for_recordings([_swing(np.inf, 6.0, 0.4)]).limited
    path.write_text(SCENARIO + "unlimited: [handle]\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"unlimited\[0\] names the joint 'handle', which the model lacks"):
        Scene.load(path)
