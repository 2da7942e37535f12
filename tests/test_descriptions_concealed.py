"""The maker and the score of the effects that are concealed in recordings of public robots."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drake_cafim.scene.scene import Scene
from tests.descriptions.concealed import found, line, summary
from tests.descriptions.hidden import Hidden, Usual, draw
from tests.descriptions.mujoco_robot import Robot, specification

ARM = """<mujoco model="arm"><compiler angle="radian"/><worldbody><body name="upper">
  <joint name="shoulder" axis="0 1 0" range="-2 2" frictionloss="0.3" damping="0.1"/><geom size="0.1" mass="2"/>
  <body name="lower" pos="0 0 -0.4"><joint name="elbow" axis="0 1 0" range="-2 2"/><geom size="0.1" pos="0 0 -0.3"/>
  </body></body></worldbody><actuator><motor name="m" joint="elbow" gear="20"/></actuator></mujoco>"""


def result(effect: str, at: str, told: list[tuple[str, str]], verdict: str = "explained") -> dict[str, Any]:
    truth = {"robot": "arm", "effect": effect, "at": at, "parameters": {"bias": 0.1}, "first": "bias"}
    report = {"verdict": verdict, "explanation": [{"effect": e, "at": a, "parameters": {}} for e, a in told]}
    truth |= {"equal": [["gravity_misalignment", "world"]] if effect else [], "stds": 20.0}
    return {"seal": {"truth": truth}, "report": report if verdict else None, "failure": "" if verdict else "no report"}


def test_what_is_named_counts_at_its_place_or_by_an_exact_other_name() -> None:
    right, equal = ("sensor_bias", "q.shoulder"), ("gravity_misalignment", "world")
    wrong, failed = ("sensor_bias", "q.elbow"), result(*right, [], "")
    cases = [result(*right, [right]), result(*right, [equal, wrong]), result(*right, [wrong]), failed]
    assert [found(case) for case in cases] == [True, True, False, False]
    nulls = [result("", "", [], "none"), result("", "", [wrong]), result("", "", [], "")]
    assert [line(null).split()[0] for null in nulls] == ["quiet", "alarm", "failed"]
    said = summary([*cases, *nulls])
    assert said.startswith("2 of 4 named") and "1 of them alone" in said
    assert "on 1 of 3 nulls" in said and said.endswith("2 diagnoses failed")


def test_a_late_and_weak_motor_acts_so() -> None:
    commands = np.array([[1.0, 10.0], [2.0, 20.0]])
    hidden = Hidden(gain=np.array([1.0, 0.5]), bias=np.array([0.25, 0.0]), late=3, joint=1)
    np.testing.assert_array_equal(hidden.acting(commands, 5, 4), [2.25, 5.0])
    np.testing.assert_array_equal(hidden.acting(commands, 7, 4), [2.25, 10.0])


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    (tmp_path / "arm.xml").write_text(ARM, encoding="utf-8")
    return Scene.load(tmp_path / "arm.xml")


def test_mujoco_has_what_the_file_states(scene: Scene) -> None:
    robot = Robot.of(specification(scene, scene.folder / "arm.xml"), scene)
    assert robot.motors == (-1, 0)
    np.testing.assert_array_equal(robot.frictions, [0.3, 0.0])
    at_rest = np.zeros((1, 2))
    speed = np.array([[1.0, 0.0]])
    damping = robot.inverse(at_rest, speed, at_rest) - robot.inverse(at_rest, at_rest, at_rest)
    np.testing.assert_allclose(damping[0], [0.1, 0.0], atol=1e-12)


def test_every_drawn_effect_can_be_made(scene: Scene) -> None:
    """Each changes MuJoCo's model, the efforts or the readings, and states the strength that was asked for."""
    usual = Usual(*(np.ones(2) for _ in range(4)))
    rng, seen = np.random.default_rng(0), set()
    for _ in range(200):
        kind = draw(rng, scene, usual)
        hidden, values = kind.made(kind.neutral + kind.unit)
        assert next(iter(values.values())) == pytest.approx(kind.neutral + kind.unit)
        spec = specification(scene, scene.folder / "arm.xml")
        hidden.change(spec)
        hidden.turn(Robot.of(spec, scene).model)
        seen.add(kind.effect)
    assert len(seen) == 12
