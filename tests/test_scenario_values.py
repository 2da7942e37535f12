"""Every key of a scenario with values that cannot be: one sentence that names the file and the key."""

import copy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

from drake_cafim.cli import main
from drake_cafim.errors import InputError
from drake_cafim.scenario.schema import parse
from drake_cafim.scene.scene import Scene

URDF = """
<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="0 0 0.2"/><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tool"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><sphere radius="0.02"/></geometry></collision></link>
<link name="marker"/><joint name="on_tool" type="fixed"><parent link="tool"/><child link="marker"/></joint>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit effort="10" velocity="10" lower="-3" upper="3"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="tool"/><origin xyz="0 0 0.4"/><axis xyz="0 1 0"/>
<limit effort="10" velocity="10" lower="-3" upper="3"/></joint></robot>
"""
SCENARIO = """
model: arm.urdf
gravity: [0, 0, -9.81]
weld: [{body: base}]
channels:
  q: {std: 2.0e-4}
  q.elbow: {std: 4.0e-4}
  v: {std: 1.0e-3, correlation_time: 0.0}
  u: {std: 0.0, hold: zero_order}
  wrench.wrist: {body: tool, frame: tool, std: {force: 0.1, torque: 0.01}}
  pose.tool: {std: {position: 2.0e-4, rotation: 4.0e-3}}
unknown:
  - {parameter: mass, body: tool, mean: 1.5, std: 0.15}
  - {parameter: damping, joint: elbow, mean: 0.1, std: 0.15}
  - {parameter: stiffness, contact: [tool, ground], mean: 4540.0, std: 227.0}
  - {parameter: torque, effect: joint_coulomb_friction, at: elbow, mean: 1.0, std: 0.5}
contact:
  - {bodies: [tool, ground], ground: {point: [0, 0, 0], normal: [0, 0, 1]}, law: kelvin_voigt, stiffness: 4000.0,
     damping: 6.0, friction: 0.35, slip_velocity: 0.01}
effects:
  - {effect: joint_coulomb_friction, at: elbow, torque: 1.2}
  - {effect: actuator_delay, at: elbow, delay: 0.01}
  - {effect: external_disturbance, at: tool, x: 1.0, interval: [0.1, 0.2]}
topics:
  /joint_states: {joints: {j: elbow}, scale: 1.0, join: 0.0}
"""
NAN, INF = float("nan"), float("inf")
NEVER = [NAN, INF, -1e300, 10**400, True, [1], {1: 2}, {None: 1}, "no such thing"]
"""What none of the keys with a single number, name or list may hold."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scenario")
    (path / "arm.urdf").write_text(URDF)
    return path


def refusal(folder: Path, text: str) -> str:
    """The sentence with which the scenario is refused."""
    path = folder / "arm.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        Scene.load(path)
    sentence = str(caught.value)
    assert sentence.startswith(f"{path}: ") and "\n" not in sentence
    return sentence.removeprefix(f"{path}: ")


def changed(*path: Any, value: Any) -> str:
    """The scenario with the value at a path of keys and indices replaced."""
    return str(yaml.dump(with_value(yaml.safe_load(SCENARIO), path, value)))


def with_value(raw: Any, path: tuple[Any, ...], value: Any) -> Any:
    """A copy of `raw` with another value at `path`."""
    raw = copy.deepcopy(raw)
    at = raw
    for step in path[:-1]:
        at = at[step]
    at[path[-1]] = value
    return raw


def leaves(raw: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths of all numbers and texts."""
    if isinstance(raw, dict | list):
        for key, value in raw.items() if isinstance(raw, dict) else enumerate(raw):
            yield from leaves(value, (*path, key))
    else:
        yield path


def test_the_scenario_itself_is_accepted(folder: Path) -> None:
    (folder / "arm.yaml").write_text(SCENARIO)
    scene = Scene.load(folder / "arm.yaml")
    assert [unknown.parameter for unknown in scene.unknown] == ["mass", "damping", "stiffness", "torque"]


@pytest.mark.parametrize("value", NEVER, ids=[str(value)[:12] for value in NEVER])
def test_no_key_takes_what_is_no_number_and_no_name(folder: Path, value: Any) -> None:
    scenario = yaml.safe_load(SCENARIO)
    for path in leaves(scenario):
        # another name of the ground is as good as any
        any_text = (path[-1] == "j" or path == ("contact", 0, "bodies", 1)) and isinstance(value, str)
        parts_of_std = path[-1] == "std" and isinstance(value, dict)
        if any_text or parts_of_std or path == ("model",):
            continue
        with pytest.raises(InputError) as caught:
            Scene.build(parse(with_value(scenario, path, value), "arm.yaml"), folder, "arm.yaml")
        sentence = str(caught.value)
        assert sentence.startswith(f"arm.yaml: {path[0]}") or "unknown channel" in sentence, path
        assert "\n" not in sentence


@pytest.mark.parametrize(
    ("path", "value", "sentence"),
    [
        (("effects", 1, "delay"), -0.01, "effects[1].delay is -0.01 s, expected a finite number from 0 to 0.2 s"),
        (("effects", 1, "delay"), INF, "effects[1].delay is inf s, expected a finite number from 0 to 0.2 s"),
        (("effects", 0, "torque"), NAN, "effects[0].torque is nan N m, expected a finite number from 0 to 1e+12 N m"),
        (("effects", 0, "slip_velocity"), 0.0, "effects[0].slip_velocity is 0 rad/s, expected"),
        (("effects", 2, "interval"), [0.2, 0.1], "effects[2]: interval is from 0.2 to 0.1 s"),
        (("effects", 2, "interval"), [0.2], "effects[2].interval is [0.2], expected a list of 2"),
        (("effects", 2, "start"), 0.1, "effects[2].start is 0.1, expected the times under `interval` alone"),
        (("effects", 1), {"effect": "sensor_misalignment", "at": "q.elbow", "roll": 0.1, "pitch": 0.0, "yaw": 0.0},
         "effects[1]: at is q.elbow, expected a whole wrench sensor"),
        (("effects", 1), {"effect": "sensor_misalignment", "at": "wrench.wrist.fx", "roll": 0.1},
         "effects[1]: at is wrench.wrist.fx, expected a whole wrench sensor"),
        (("effects", 0, "at"), "knee", "effects[0].at is knee, expected one of shoulder, elbow"),
        (("effects", 0, "effect"), "glue", "effects[0].effect: there is no effect named 'glue'"),
        (("effects", 1), {"effect": "actuator_delay", "at": "elbow"}, "effects[1]: actuator_delay needs delay"),
        (("effects", 1), "delay", "effects[1] is 'delay', expected a mapping"),
        (("effects",), {"delay": 1}, "effects is {'delay': 1}, expected a list"),
        (("gravity", 2), NAN, "gravity[2] is nan m/s², expected a finite number"),
        (("gravity",), [0, 0], "gravity is [0, 0], expected a list of 3"),
        (("channels", "q", "std"), INF, "channels.q.std is inf, expected"),
        (("channels", "q", "std"), -1.0, "channels.q.std is -1, expected"),
        (("channels", "wrench.wrist", "std"), 0.1, "channels.wrench.wrist.std has one number, expected force"),
        (("channels", "wrench.wrist", "body"), "palm", "channels.wrench.wrist.body names the body 'palm'"),
        (("channels", "q.knee"), {"std": 1.0}, "channels.q.knee names the joint 'knee', which the model lacks"),
        (("channels", "q"), {"std": 1.0, "body": "tool"}, "channels.q has body or frame"),
        (("channels",), ["q"], "channels is ['q'], expected a mapping"),
        (("unknown", 0, "std"), 1e300, "unknown[0].std is 1e+300, expected a finite number above 0"),
        (("unknown", 0, "std"), 0.0, "unknown[0].std is 0, expected a finite number above 0"),
        (("unknown", 0, "mean"), -1.0, "unknown[0].mean is -1 kg, expected a finite number above 0"),
        (("unknown", 0, "body"), "marker", "unknown[0].body is marker, which has no mass in the model"),
        (("unknown", 0, "body"), "palm", "unknown[0].body is 'palm', which the model lacks; it has: base"),
        (("unknown", 1, "parameter"), "mass", "unknown[1].parameter is 'mass', which a joint lacks"),
        (("unknown", 0, "parameter"), "inertials", "unknown[0] (inertials) has a mean, expected log_cholesky"),
        (("unknown", 1, "parameter"), "inertials", "unknown[1] (inertials) needs body, expected a link of the model"),
        (("unknown", 0, "log_cholesky"), [0.1], "unknown[0].log_cholesky is [0.1], expected a list of 10"),
        (("unknown", 0, "log_cholesky"), [0.1] * 10, "unknown[0] (mass) has log_cholesky, which only inertials have"),
        (("unknown", 2, "contact"), ["tool"], "unknown[2].contact is ['tool'], expected a list of 2"),
        (("unknown", 2, "parameter"), "dissipation",
         "unknown[2].parameter is 'dissipation', which a contact by the law kelvin_voigt lacks; valid: stiffness"),
        (("unknown", 3, "at"), "palm", "unknown[3].at is palm, expected one of"),
        (("unknown", 3, "parameter"), "width", "unknown[3].parameter is 'width', which joint_coulomb_friction lacks"),
        (("contact", 0, "stiffness"), 0.0, "contact[0].stiffness is 0 N/m, expected a finite number above 0"),
        (("contact", 0, "friction"), -0.1, "contact[0].friction is -0.1, expected"),
        (("contact", 0, "slip_velocity"), 0.0, "contact[0].slip_velocity is 0 m/s, expected a finite number above 0"),
        (("contact", 0, "resistance"), 1.0, "contact[0] needs exactly one of slip_velocity and resistance"),
        (("contact", 0, "modulus"), 1e5, "contact[0].modulus is 100000, but the law kelvin_voigt has no modulus"),
        (("contact", 0, "law"), "hydroelastic", "contact[0] has no modulus, expected a number in Pa"),
        (("contact", 0, "dissipation"), 1.0, "contact[0].dissipation is 1, but the law kelvin_voigt has no"),
        (("contact", 0, "ground", "normal"), [0, 0, 0], "contact[0].ground.normal is [0.0, 0.0, 0.0]"),
        (("contact", 0, "ground", "normal"), [0, 1e-200, 0], "contact[0].ground.normal is [0.0, 1e-200, 0.0]"),
        (("weld",), [{"body": "base"}, {"body": "base"}], "weld[1].body is 'base', which is welded already"),
        (("weld",), [{"body": "world"}], "weld[0].body is 'world', expected a body of the model"),
        (("weld", 0, "body"), "palm", "weld[0].body is 'palm', which the model lacks; it has: base"),
        (("lock",), {"shoulder": 0.0, "elbow": 0.0}, "no joint of the model moves, all of them are under lock"),
        (("topics", "/joint_states"), 3, "topics./joint_states is 3, expected a mapping"),
        (("servo",), {"kp": "stiff"}, "servo.kp.all is 'stiff', expected a number"),
        (("servo",), {"kp": {"wing": 3.0}}, "servo.kp names the joint 'wing', which the model lacks; it has: "),
        (("servo",), {"kp": {"column": "gain"}}, "servo.kp is {'column': 'gain'}, expected a number, numbers by joint"),
        (("servo",), {"kp": 3.0, "limit": 0.0}, "servo.limit is 0, expected a finite number above 0"),
        (("servo",), {"kp": 3.0, "drive": "motor"}, "servo.drive is 'motor'; valid: servo"),
        (("servo",), {"kp": 3.0, "supply": {"nominal": 7.4}}, "servo.supply has no column, expected the recording's"),
        (("unknown", 1, "parameter"), "servo_stiffness", "unknown[1].parameter is 'servo_stiffness', which a "),
        (("topics", "/joint_states", "join"), -1.0, "topics./joint_states.join is -1 s, expected a finite number"),
    ],
)  # fmt: skip
def test_the_sentence_names_the_key_and_what_was_expected(
    folder: Path, path: tuple[Any, ...], value: Any, sentence: str
) -> None:
    assert refusal(folder, changed(*path, value=value)).startswith(sentence)


def test_the_friction_of_a_contact_without_it_is_no_unknown(folder: Path) -> None:
    scenario = yaml.safe_load(SCENARIO)
    (contact,) = scenario["contact"]
    scenario["contact"] = [
        {name: value for name, value in contact.items() if name not in ("friction", "slip_velocity")}
    ]
    scenario["unknown"][2] |= {"parameter": "friction", "mean": 0.3, "std": 0.1}
    sentence = "unknown[2].parameter is 'friction', which a contact by the law kelvin_voigt lacks"
    assert refusal(folder, str(yaml.dump(scenario))).startswith(sentence)


def test_a_contact_with_the_world_that_has_no_shape_is_refused(folder: Path) -> None:
    """The world is a body of Drake's plant, and none of the robot's."""
    scenario = yaml.safe_load(SCENARIO)
    scenario["unknown"].pop(2)
    scenario["contact"][0]["bodies"] = ["world", "tool"]
    del scenario["contact"][0]["ground"]
    sentence = "contact world/tool: expected a body with one collision sphere that moves"
    assert refusal(folder, str(yaml.dump(scenario))).startswith(sentence)


@pytest.mark.parametrize("section", ["unknown", "contact", "effects"])
def test_an_entry_given_twice_is_refused(folder: Path, section: str) -> None:
    entries = yaml.safe_load(SCENARIO)[section]
    for entry in entries:
        assert refusal(folder, changed(section, value=[*entries, copy.deepcopy(entry)])).startswith(section)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (f"{SCENARIO}\ngravity: [0, 0, 0]\n", "the key 'gravity' is given twice"),
        (SCENARIO.replace("q: {std: 2.0e-4}", "q: {std: 2.0e-4, std: 1.0}"), "the key 'std' is given twice"),
        (f"1: 2\n{SCENARIO}", "has the key 1, expected a text, in quotes"),
        (f"null: 2\n{SCENARIO}", "has the key empty, expected a text"),
        (SCENARIO.replace("torque: 1.2", f"torque: {'9' * 5000}"), "not readable as YAML"),
        (f"task: {'[' * 3000}{']' * 3000}\n{SCENARIO}", "nests too deeply"),
        ("model: [", "not readable as YAML"),
        ("- 3", "found list, expected a scenario"),
        ("", "found NoneType, expected a scenario"),
    ],
)
def test_yaml_that_is_no_scenario_is_refused(folder: Path, text: str, sentence: str) -> None:
    (folder / "arm.yaml").write_text(text)
    with pytest.raises(InputError, match=sentence) as caught:
        Scene.load(folder / "arm.yaml")
    assert str(folder / "arm.yaml") in str(caught.value) and "\n" not in str(caught.value)


def test_the_command_ends_with_status_2_and_the_sentence(folder: Path) -> None:
    (folder / "arm.yaml").write_text(changed("effects", 1, "delay", value=-0.01))
    out = str(folder / "out")
    result = CliRunner().invoke(main, ["estimate", str(folder / "arm.yaml"), "none.parquet", "--out", out])
    assert result.exit_code == 2
    assert result.output.startswith(f"cafim: {folder / 'arm.yaml'}: effects[1].delay is -0.01 s")


def test_a_scheduler_is_refused_and_not_ignored(folder: Path) -> None:
    (folder / "arm.yaml").write_text(SCENARIO)
    asked = ["estimate", str(folder / "arm.yaml"), "none.parquet", "--scheduler", "tcp://host:8786"]
    result = CliRunner().invoke(main, asked)
    assert result.exit_code == 2
    assert result.output.startswith("cafim: --scheduler tcp://host:8786: estimate is a single task")
