"""Export: values back into the model file, all other bytes as they were, and the same motion."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from drake_cafim.cli import main
from drake_cafim.export.mjcf import MjcfText, write_mjcf
from drake_cafim.export.values import values_of
from drake_cafim.export.xml_text import read_xml_text
from drake_cafim.scene.scene import Scene
from tests.parametrize import long_after

EFFECTS = """effects:
  - {effect: joint_viscous_friction, at: elbow, coefficient: 0.15}
  - {effect: joint_coulomb_friction, at: shoulder, torque: 0.4}
  - {effect: payload, at: lower, mass: 0.5, x: 0.02, y: 0.03, z: -0.3}
  - {effect: rotor_inertia, at: elbow, inertia: 0.01}
"""
UNKNOWN = """unknown:
  - {parameter: mass, body: upper, mean: 2.3, std: 0.1}
  - {parameter: inertia, body: upper, mean: 1.1, std: 0.1}
"""
MJCF = """<mujoco model="arm">
  <!-- stays -->
  <compiler angle="degree"/>
  <default><joint damping="0.2"/><default class="big"><motor gear="50"/></default></default>
  <worldbody>
    <body name="upper" pos="0 0 1" euler="0 0 30">
      <joint name="shoulder"   axis="0 1 0"
             frictionloss='0.1'/> <!-- here too -->
      <inertial pos="0 0 -0.2" mass="2" diaginertia="0.03 0.03 0.002"/>
      <include file="lower.xml"/>
    </body>
  </worldbody>
  <actuator><motor name="m1" joint="shoulder" class="big"/></actuator>
</mujoco>
"""
LOWER = """<mujoco><body name="lower" pos="0 0 -0.4">
  <joint name="elbow" axis="0 1 0" springref="10" stiffness="0.5"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.35" size="0.03" density="900"/>
</body></mujoco>
"""
URDF = """<robot name="arm"><!-- stays -->
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 -0.2" rpy="0.1 0.2 0.3"/><mass value="2"/>
    <inertia ixx="0.03" iyy="0.03" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0 0 -0.2"/><mass value="1"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="90" velocity="9"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.4"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="90" velocity="9"/><dynamics damping='0.1'/></joint>
  <transmission name="t"><type>transmission_interface/SimpleTransmission</type><joint name="elbow"/>
    <actuator name="a"><drake:rotor_inertia value="0.0002"/><drake:gear_ratio value="10"/></actuator></transmission>
</robot>
"""
SDF = """<sdf version="1.9"><model name="arm"><!-- stays -->
  <link name="upper"><inertial><pose>0 0 -0.2 0.1 0.2 0.3</pose><mass>2</mass>
    <inertia><ixx>0.03</ixx><iyy>0.03</iyy><izz>0.002</izz></inertia></inertial></link>
  <link name="lower"><pose>0 0 -0.4 0 0 0</pose><inertial><pose>0 0 -0.2 0 0 0</pose><mass>1</mass>
    <inertia><ixx>0.02</ixx><iyy>0.02</iyy><izz>0.002</izz></inertia></inertial></link>
  <joint name="shoulder" type="revolute"><parent>world</parent><child>upper</child><axis><xyz>0 1 0</xyz></axis></joint>
  <joint name="elbow" type="revolute"><parent>upper</parent><child>lower</child><axis><xyz>0 1 0</xyz>
    <dynamics><damping>0.1</damping><spring_stiffness>1</spring_stiffness></dynamics></axis>
    <drake:rotor_inertia>0.0002</drake:rotor_inertia><drake:gear_ratio>10</drake:gear_ratio></joint>
</model></sdf>
"""
SPRING = "  - {effect: joint_spring, at: elbow, stiffness: 1.0, rest: 0.5}\n"
GEAR = "  - {effect: actuator_gain_error, at: shoulder, gain: 0.9}\n"
TILT = "  - {effect: gravity_misalignment, at: world, roll: 0.05, pitch: -0.03}\n"
LOST = "  - {effect: actuator_delay, at: elbow, delay: 0.005}\n  - {effect: sensor_bias, at: q.elbow, bias: 0.01}\n"


def exported(
    folder: Path, model: str, form: str, more: str = "", unknown: str = UNKNOWN
) -> tuple[dict[str, object], Path]:
    """The result of the command for a scenario with corrections, and the exported file."""
    name = {"urdf": "arm.urdf", "sdf": "arm.sdf", "mjcf": "arm.xml"}[form]
    (folder / name).write_text(model)
    (folder / "lower.xml").write_text(LOWER)
    weld = "weld: [{body: base}]\n" if form == "urdf" else ""
    (folder / "arm.yaml").write_text(f"model: {name}\n{weld}{unknown}{EFFECTS}{more}")
    line = ["export", str(folder / "arm.yaml"), "--to", form, "--out", str(folder / "out"), "--json"]
    result = CliRunner().invoke(main, line)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout), folder / "out" / name


@pytest.mark.parametrize(
    ("form", "model", "more"),
    long_after(1, [("urdf", URDF, ""), ("sdf", SDF, SPRING), ("mjcf", MJCF, SPRING + GEAR + TILT)]),
)
def test_the_exported_model_moves_as_the_corrected_scene(form: str, model: str, more: str, tmp_path: Path) -> None:
    told, path = exported(tmp_path, model, form, more)
    assert told["lost"] == []
    parity: dict[str, float] = told["parity"]  # type: ignore[assignment]
    assert parity["drake"] < 1e-6 and parity["uncorrected"] > 0.1
    if form == "mjcf":
        assert parity["mujoco"] < 0.01
    text = path.read_text()
    assert "<!-- stays -->" in text
    # all lines but those with a changed value are as they were
    same = [line for line in text.splitlines() if line in model.splitlines()]
    assert len(same) >= len(model.splitlines()) - 9


def test_values_are_where_they_belong(tmp_path: Path) -> None:
    exported(tmp_path, URDF, "urdf")
    scene = Scene.load(tmp_path / "out" / "scenario.exported.yaml")
    upper, elbow = scene.tree.body("upper"), scene.tree.joints[1]
    assert upper.mass == 2.3 and scene.tree.body("lower").mass == pytest.approx(1.5)
    assert np.trace(upper.I_BBcm_B) == pytest.approx(1.1 * 2.3 / 2.0 * 0.062)
    assert (elbow.damping, elbow.rotor_inertia) == (pytest.approx(0.25), pytest.approx(0.03))
    assert [(effect.name, effect.values["torque"]) for effect in scene.of_model] == [("joint_coulomb_friction", 0.4)]
    assert scene.known == ()


@pytest.mark.parametrize("joint", [pytest.param("shoulder", marks=pytest.mark.long), "elbow"])
def test_friction_that_the_file_states_and_that_was_estimated_is_written(joint: str, tmp_path: Path) -> None:
    """What is found beside it, at the shoulder, comes on top, and the parameter is unknown about the new value."""
    rubs = {
        "shoulder": URDF.replace('velocity="9"/></joint>', 'velocity="9"/><dynamics friction="0.8"/></joint>', 1),
        "elbow": URDF.replace("damping='0.1'", "damping='0.1' friction='0.8'"),
    }[joint]
    unknown = f"unknown:\n  - {{parameter: dry_friction, joint: {joint}, mean: 0.3, std: 0.8}}\n"
    told, _ = exported(tmp_path, rubs, "urdf", unknown=unknown)
    scene = Scene.load(tmp_path / "out" / "scenario.exported.yaml")
    total = {"shoulder": 0.4, joint: 0.7 if joint == "shoulder" else 0.3}
    assert {effect.at: effect.values["torque"] for effect in scene.of_model} == pytest.approx(total)
    [prior] = scene.unknown
    assert (prior.parameter, prior.prior.mean) == ("dry_friction", pytest.approx(total[joint]))
    assert told["parity"]["drake"] < 1e-6 < 0.1 < told["parity"]["uncorrected"]  # type: ignore[index]
    assert f"dry_friction of {joint}, 0.3 N m" in told["written"]  # type: ignore[operator]


@pytest.mark.long
@pytest.mark.parametrize(
    ("form", "model"),
    [("urdf", URDF), ("sdf", SDF), pytest.param("mjcf", MJCF, marks=pytest.mark.long)],
)
def test_inertials_that_the_model_holds_act_once(form: str, model: str, tmp_path: Path) -> None:
    change = [0.1, 0.05, -0.04, 0.03, 0.02, -0.02, 0.01, 0.05, -0.03, 0.02]
    entry = f"  - {{parameter: inertials, body: lower, std: 0.1, log_cholesky: {change}}}\n"
    told, _ = exported(tmp_path, model, form, unknown=UNKNOWN + entry)
    assert told["parity"]["drake"] < 1e-6 < 0.1 < told["parity"]["uncorrected"]  # type: ignore[index]
    assert "inertials of lower" in told["written"]  # type: ignore[operator]
    scene, again = (Scene.load(tmp_path / path) for path in ("arm.yaml", "out/scenario.exported.yaml"))
    corrected = scene.physics_at(scene.priors.mean).tree
    mass = sum(body.mass for body in corrected.bodies if body.joint == 1)
    assert again.tree.body("lower").mass == pytest.approx(mass, rel=1e-6)
    [prior] = [entry for entry in again.scenario.unknown if entry.parameter == "inertials"]
    assert prior.log_cholesky == [] and prior.std == 0.1


@pytest.mark.long
def test_what_the_format_cannot_hold_is_said_and_kept(tmp_path: Path) -> None:
    told, _ = exported(tmp_path, URDF, "urdf", SPRING + LOST)
    assert [line.partition(" (")[0] for line in told["lost"]] == [
        "joint spring at elbow", "actuator delay at elbow", "sensor bias at q.elbow",
    ]  # fmt: skip
    kept = Scene.load(tmp_path / "out" / "scenario.exported.yaml").known
    assert [effect.name for effect in kept] == ["joint_spring", "actuator_delay", "sensor_bias"]


def test_the_way_over_which_friction_builds_up_is_said_to_be_lost(tmp_path: Path) -> None:
    more = "  - {effect: joint_coulomb_friction, at: elbow, torque: 0.3, slip: 0.01}\n"
    told, path = exported(tmp_path, MJCF, "mjcf", more)
    [line] = told["lost"]  # type: ignore[misc]
    assert line.startswith("joint coulomb friction at elbow (torque 0.3 N m, built up over 0.01 rad): in the file it")
    assert 'frictionloss="0.3"' in (path.parent / "lower.xml").read_text()


@pytest.mark.parametrize(("at", "friction"), [("shoulder", 0.1), ("elbow", None)])
def test_friction_that_the_file_states_holds_as_soon_as_one_that_is_written(
    at: str, friction: float | None, tmp_path: Path
) -> None:
    """MuJoCo's own softness would let a corrected joint creep; a joint with nothing to correct stays as it is."""
    (tmp_path / "arm.xml").write_text(MJCF)
    (tmp_path / "lower.xml").write_text(LOWER)
    (tmp_path / "arm.yaml").write_text(f"model: arm.xml\neffects:\n{SPRING.replace('elbow', at)}")
    values, text = values_of(Scene.load(tmp_path / "arm.yaml"), "mjcf"), MjcfText.read(tmp_path / "arm.xml")
    assert {name: value.friction for name, value in values.joints.items()} == {at: friction}
    assert write_mjcf(text, values) == []
    assert (b'solreffriction="0.005 1"' in text.main.written()) is (friction is not None)


@pytest.mark.long
def test_friction_that_the_file_turns_off_is_lost(tmp_path: Path) -> None:
    off = MJCF.replace("<default>", '<option><flag constraint="disable"/></option><default>', 1)
    told, path = exported(tmp_path, off, "mjcf")
    assert told["lost"] == ["friction of shoulder: the file turns it off, <flag constraint>"]
    assert "frictionloss='0.1'" in path.read_text()


def test_a_model_of_another_format_is_refused(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(URDF)
    (tmp_path / "arm.yaml").write_text("model: arm.urdf\nweld: [{body: base}]\n")
    result = CliRunner().invoke(
        main, ["export", str(tmp_path / "arm.yaml"), "--to", "mjcf", "--out", str(tmp_path / "o")]
    )
    assert result.exit_code == 2 and "expected --to urdf" in result.output
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("opening", ["<a  x = \"1>2\"  y='3' />", "<a x='1>2' y='3'></a>", "<a\n  x='1>2'\n  y='3'/>"])
def test_only_the_attribute_changes(opening: str, tmp_path: Path) -> None:
    (tmp_path / "f.xml").write_text(f"<?xml version='1.0'?>\n<r>é{opening}<!-- y='3' --></r>")
    file = read_xml_text(tmp_path / "f.xml")
    node = file.root.children[0]
    node.set("y", "4")
    before = (tmp_path / "f.xml").read_text()
    assert file.written().decode() == before.replace("y='3'", 'y="4"', 1)
    node.set("z", "5")
    assert read_back(file.written(), tmp_path) == {"x": "1>2", "y": "4", "z": "5"}


def read_back(content: bytes, folder: Path) -> dict[str, str]:
    (folder / "g.xml").write_bytes(content)
    return read_xml_text(folder / "g.xml").root.children[0].attributes
