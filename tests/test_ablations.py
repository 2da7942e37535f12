"""Alterations of real machines' models and recordings are exactly the effects that they are sealed as."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.effects.link import Payload
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.concealed import ablate, ablation, ablation_draws, trial
from tests.concealed.ablation import Ablation, Machine
from tests.concealed.machines import divided

ARM = """<robot name="arm"><link name="base"/>
<link name="link"><inertial><origin xyz="0.01 0 -0.2"/><mass value="2"/>
<inertia ixx="0.05" ixy="0.001" ixz="0" iyy="0.05" iyz="0" izz="0.01"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="link"/><axis xyz="0 1 0"/></joint></robot>"""
TIME = 0.002 * np.arange(1000)


def _machine() -> Machine:
    q = np.sin(2.0 * TIME)
    table = pd.DataFrame(
        {"time": TIME, "q.hinge": q, "v.hinge": 2.0 * np.cos(2.0 * TIME), "u.hinge": np.cos(5.0 * TIME)}
    )
    unknown = [{"parameter": "mass", "body": "link", "mean": 2.0, "std": 0.2}]
    return Machine(
        {"model": "arm.urdf", "weld": [{"body": "base"}], "unknown": unknown}, ARM, {"train_0.parquet": table}
    )


@pytest.mark.parametrize(
    "made",
    [
        ablation.biased_sensor(_machine(), "q.hinge", 0.1),
        ablation.wrong_sensor_gain(_machine(), "v.hinge", 1.2),
        ablation.late_sensor(_machine(), "v.hinge", 0.013),
        ablation.drifting_sensor(_machine(), "q.hinge", -0.05),
    ],
    ids=lambda made: made.effect,
)
def test_sensor_effects_taken_out_give_the_recording_back(made: Ablation) -> None:
    effect = effect_named(made.effect)(made.at, made.parameters)
    assert isinstance(effect, SensorEffect)
    altered = made.machine.tables["train_0.parquet"][made.at].to_numpy()[:, None]
    true = _machine().tables["train_0.parquet"][made.at].to_numpy()
    inside = slice(20, -20)
    np.testing.assert_allclose(effect.true(TIME, altered)[inside, 0], true[inside], atol=2e-5)
    assert np.abs(altered[inside, 0] - true[inside]).max() > 1e-2


def test_actuator_effects_give_the_effort_that_acted() -> None:
    true = _machine().tables["train_0.parquet"]["u.hinge"].to_numpy()
    weak = ablation.weak_actuator(_machine(), "hinge", 0.7)
    biased = ablation.biased_actuator(_machine(), "hinge", 0.3)
    late = ablation.late_actuator(_machine(), "hinge", 0.011)
    np.testing.assert_allclose(0.7 * weak.machine.tables["train_0.parquet"]["u.hinge"], true)
    np.testing.assert_allclose(biased.machine.tables["train_0.parquet"]["u.hinge"] + 0.3, true)
    samples = round(late.parameters["delay"] / 0.002)
    assert late.parameters["delay"] == pytest.approx(0.011, abs=0.0011)
    np.testing.assert_array_equal(late.machine.tables["train_0.parquet"]["u.hinge"][:-samples], true[samples:])


def _lump(tree: Tree) -> tuple[float, Array, Array]:
    """Mass, first moment and rotational inertia about the joint's frame of all that rides joint 0."""
    riding = [body for body in tree.bodies if body.joint == 0]
    places = [body.p_JB + body.R_JB @ body.p_BBcm for body in riding]
    about = [
        body.R_JB @ body.I_BBcm_B @ body.R_JB.T + body.mass * (p @ p * np.eye(3) - np.outer(p, p))
        for body, p in zip(riding, places, strict=True)
    ]
    moment = sum((body.mass * p for body, p in zip(riding, places, strict=True)), np.zeros(3))
    return sum(body.mass for body in riding), moment, sum(about, np.zeros((3, 3)))


def test_a_payload_makes_up_for_the_lost_mass(tmp_path: Path) -> None:
    made = ablation.lost_mass(_machine(), "link", 0.4, np.array([0.0, 0.02, -0.3]))
    for name, text in (("whole.urdf", ARM), ("arm.urdf", made.machine.model)):
        (tmp_path / name).write_text(text)
    whole = Scene.from_model(tmp_path / "whole.urdf", channels={"q": 1e-3}, weld=["base"]).tree
    rest = Scene.from_model(tmp_path / "arm.urdf", channels={"q": 1e-3}, weld=["base"]).tree
    again, _ = Payload("link", made.parameters).change(rest, np.array([0.0, 0.0, -9.81]))
    for part, other in zip(_lump(again), _lump(whole), strict=True):
        np.testing.assert_allclose(part, other, atol=1e-12)
    assert made.machine.scenario["unknown"][0]["mean"] == pytest.approx(1.6)  # type: ignore[index]
    with pytest.raises(ValueError, match="no rigid body"):
        ablation.lost_mass(_machine(), "link", 1.9, np.array([0.0, 0.0, -0.6]))


def _inverse_residual(machine: Machine, *effects: tuple[str, dict[str, float]]) -> Array:
    """M v̇ + h − u (N,) along the smoothed motion, with effects at the hinge or the link."""
    scene = ablation_draws.scene_of(machine)
    table = {str(column): values.to_numpy() for column, values in machine.tables["train_0.parquet"].items()}
    q, v, a = ablation_draws.smooth_motion(table, ["hinge"])
    physics = scene.physics.with_effects([effect_named(name)(_place(name), values) for name, values in effects])
    laws, _, _ = physics.applied_at_joints([JointSamples(q[:, 0].copy(), v[:, 0].copy(), np.zeros(len(q)))])
    needed = ablation_draws._inverse(physics, q, v, a) - laws
    between = 0.5 * (needed + np.concatenate([needed[1:], needed[-1:]]))
    return np.asarray(between[:, 0] - table["u.hinge"])


def _place(name: str) -> str:
    return {"payload": "link", "gravity_misalignment": "world"}.get(name, "hinge")


@pytest.mark.parametrize("kind", ["rotor", "gravity", "payload", "viscous", "Coulomb", "spring", "ripple"])
def test_forces_and_inertias_are_exact_changes_of_the_efforts(kind: str) -> None:
    """With the effect in its physics, the altered machine leaves what the unaltered one leaves without it."""
    before = _machine()
    made = ablation_draws.ARM[kind](before, np.random.default_rng(5))
    bare = _inverse_residual(before)
    np.testing.assert_allclose(_inverse_residual(made.machine, (made.effect, dict(made.parameters))), bare, atol=1e-9)
    changed = _inverse_residual(made.machine) - bare
    effort = before.tables["train_0.parquet"]["u.hinge"].to_numpy()
    assert 0.15 < np.sqrt(np.mean(changed**2) / np.mean(effort**2)) < 0.55


def test_dead_zones_and_lags_give_back_what_acted() -> None:
    before = _machine()
    dead = ablation.dead_actuator(before, "hinge", 0.2)
    written = dead.machine.tables["train_0.parquet"]["u.hinge"].to_numpy()
    true = before.tables["train_0.parquet"]["u.hinge"].to_numpy()
    np.testing.assert_allclose(np.where(np.abs(written) < 0.2, 0.0, written - 0.2 * np.sign(written)), true, atol=1e-12)
    lagging = ablation.lagging_sensor(before, "v.hinge", 0.03).machine.tables["train_0.parquet"]["v.hinge"].to_numpy()
    v, w = before.tables["train_0.parquet"]["v.hinge"].to_numpy(), 2.0
    # a cosine behind a lag, once its start is forgotten
    steady = 2.0 * (np.cos(w * TIME) + 0.03 * w * np.sin(w * TIME)) / (1.0 + (0.03 * w) ** 2)
    np.testing.assert_allclose(lagging[300:], steady[300:], atol=1e-4)
    assert np.abs(lagging - v).max() > 0.05


def test_there_are_enough_kinds_and_cases_on_seven_machines() -> None:
    every = ablation_draws.slots()
    assert len(every) >= 120 and len({kind for _, kind, _ in every}) >= 12
    assert len({name for name, _, _ in every}) == 7 and 7 * ablate.NULLS_PER_MACHINE >= 60


def test_the_blocks_of_a_machine_are_divided_without_rest() -> None:
    item, other = divided(_machine(), False, np.random.default_rng(0))
    times = np.concatenate([table["time"] for side in (item, other) for table in side.tables.values()])
    np.testing.assert_array_equal(np.sort(times), TIME)
    assert len(item.tables) == len(other.tables) == 2


def test_what_a_control_names_is_not_misnamed_and_a_near_name_is_no_exact_one() -> None:
    def result(kind: str, named: list[tuple[str, str]], found: bool, family: bool) -> dict[str, Any]:
        return {"set": "arm", "kind": kind, "named": named, "truths": [("joint_spring", "j")], "found": found,
                "family": family, "verdict": "unexplained"}  # fmt: skip

    tilt = ("gravity_misalignment", "world")
    results = [
        result("spring", [("joint_spring", "j"), tilt], True, True),
        result("spring", [("torque_ripple", "j")], False, True),
        result("control", [tilt], False, False),
        result("null", [], True, True),
        result("null", [tilt], False, False),
    ]
    # what is named in any case is not found by naming it
    results.append(result("gravity", [tilt], True, True) | {"truths": [tilt]})
    told = ablate.summary(results)
    assert told["by kind"] == {"spring": [1, 2], "gravity": [0, 1]}
    told = ablate.summary(results[:-1])
    assert (told["sealed"], told["nulls"]) == (2, 2)
    assert (told["found exactly"], told["family and place"], told["misnamed"]) == (0.5, 1.0, 0.5)
    assert told["nulls that name"] == 0.5


def test_a_killed_run_goes_on(data_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Finished slots are not diagnosed again, and what is told is of all of them."""
    (tmp_path / "slots").mkdir()
    done = {"set": "emps_drive", "kind": "link mass", "named": [["payload", "carriage"]], "found": False,
            "family": True, "truths": [["mass", "carriage"]], "verdict": "explained",
            "truth": {"effect": "mass", "at": "carriage"}}  # fmt: skip
    (tmp_path / "slots" / "000.json").write_text(json.dumps(done))
    (tmp_path / "slots" / "control-emps_drive.json").write_text(
        json.dumps(done | {"kind": "control", "named": [], "truth": {"effect": "", "at": ""}})
    )
    (tmp_path / "known" / "emps_drive").mkdir(parents=True)
    monkeypatch.setattr(ablate, "_diagnosed", None)
    asked = ["--data", str(data_folder), "--out", str(tmp_path), "--only", "0", "--resume"]
    assert ablate.main(asked) == 0
    assert json.loads((tmp_path / "summary.json").read_text())["sealed"] == 1
    with pytest.raises(SystemExit, match="not empty"):
        ablate.main(asked[:-1])


def test_a_half_of_a_machine_is_diagnosed_with_nothing_left_out() -> None:
    line = trial.command(["cafim", "diagnose"], "out", ["train_0.parquet", "train_1.parquet"])
    assert line[:5] == ["cafim", "diagnose", "scenario.yaml", "--recording", "train_0.parquet"]
    assert "--held-out" not in line


def test_tables_of_learned_forces_outlive_the_report(tmp_path: Path) -> None:
    """The corrected scenario names them by their place in its folder, which is deleted."""
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "hinge_law.parquet").write_bytes(b"law")
    learned = {"effect": "learned_force", "at": "hinge", "table": "hinge_law.parquet"}
    scenario = {"effects": [{"effect": "joint_viscous_friction", "at": "hinge", "coefficient": 1.0}, learned]}
    ablate._keep_tables(scenario, tmp_path / "report", tmp_path / "laws")
    shutil.rmtree(tmp_path / "report")
    assert "table" not in scenario["effects"][0]
    assert Path(str(learned["table"])).read_bytes() == b"law"


@pytest.fixture(scope="module")
def drive_without_friction(data_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """The slot of a real drive whose friction was taken out, and the control of that drive."""
    out = tmp_path_factory.mktemp("ablations")
    slot = next(k for k, (name, kind, _) in enumerate(ablation_draws.slots()) if kind == "known friction")
    assert ablate.main(["--data", str(data_folder), "--out", str(out), "--only", str(slot)]) == 0
    found: list[dict[str, Any]] = json.loads((out / "ablations.json").read_text())
    return found


# a minute of two commands, each of which compiles anew; the same drive is diagnosed in test_real_machines.py
@pytest.mark.long
def test_friction_taken_out_of_a_real_drive_is_found_again(drive_without_friction: list[dict[str, Any]]) -> None:
    lost, _ = drive_without_friction
    assert lost["found"] and "friction" in lost["truth"]["effect"]


@pytest.mark.long
def test_of_a_real_drive_as_it_is_known_nothing_is_named(drive_without_friction: list[dict[str, Any]]) -> None:
    _, control = drive_without_friction
    assert control["found"]
