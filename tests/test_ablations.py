"""Alterations of real machines' models and recordings are exactly the effects that they are sealed as."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.link import Payload
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.concealed import ablate, ablation
from tests.concealed.ablation import Ablation, Machine

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


# a minute of two commands, each of which compiles anew; the same drive is diagnosed in test_real_machines.py
@pytest.mark.long
def test_friction_taken_out_of_a_real_drive_is_found_again(data_folder: Path, tmp_path: Path) -> None:
    assert ablate.main(["--data", str(data_folder), "--out", str(tmp_path), "--only", "0"]) == 0
    lost, control = json.loads((tmp_path / "ablations.json").read_text())
    assert lost["found"] and "friction" in lost["truth"]["effect"]
    assert control["found"]
