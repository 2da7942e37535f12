"""Position servos: their law and its derivatives, their effects on commands, and the scenario's words for them."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from drake_cafim.effects.actuator import Effort
from drake_cafim.effects.command_profile import CommandAccelerationLimit
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.effects.servo import Servo
from drake_cafim.effects.servo_effect import CommandDelay, CommandLag, CommandRateLimit
from drake_cafim.effects.speed_limit import ActuatorSpeedLimit
from drake_cafim.scenario.scenario_yaml import as_yaml
from drake_cafim.scenario.schema import parse
from drake_cafim.typing import Array

TIME = np.linspace(0.0, 2.0, 201)
SERVOS = [
    Servo("a", 20.0, 0.5),
    Servo("a", 20.0, 0.5, limit=3.0),
    Servo("a", 20.0, 0.5, limit=3.0, dead_band=0.05),
    Servo("a", 20.0, 0.5, limit=3.0, sag=0.1),
]


def _motion() -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(0)
    return rng.normal(size=200) * 0.3, rng.normal(size=200) * 0.1, rng.normal(size=200)


@pytest.mark.parametrize("servo", SERVOS)
def test_the_law_has_the_derivatives_that_it_says(servo: Servo) -> None:
    command, q, v = _motion()
    law, step = servo.effort(command, q, v), 1e-7
    for derivative, moved in (
        (law.d_command, servo.effort(command + step, q, v)),
        (law.d_q, servo.effort(command, q + step, v)),
        (law.d_v, servo.effort(command, q, v + step)),
    ):
        assert (moved.value - law.value) / step == pytest.approx(derivative, abs=2e-5)


def test_sag_solves_its_own_equation() -> None:
    command, q, v = _motion()
    servo = Servo("a", 20.0, 0.5, limit=3.0, sag=0.1)
    term = np.clip(20.0 * (command - q), -3.0, 3.0)
    found = servo.effort(command, q, v).value
    assert found == pytest.approx(term * (1.0 - 0.1 * np.abs(term) / 3.0 * np.abs(found)) - 0.5 * v, abs=1e-12)


def test_gain_and_supply_scale_stiffness_and_limit_and_back_emf_stays() -> None:
    servo, half = Servo("a", 0.02, 0.5, limit=3.0), np.full(1, 0.5)
    near, far = (servo.effort(np.full(1, x), np.zeros(1), np.ones(1), 1000.0, half).value for x in (0.01, 9.0))
    assert (float(near[0]), float(far[0])) == pytest.approx((0.1 - 0.5, 1.5 - 0.5))


def test_commands_are_followed_late_slowly_or_at_a_bounded_rate() -> None:
    sent = Effort(TIME, np.where(TIME >= 0.5 - 1e-9, 1.0, 0.0))
    late = CommandDelay("a", {"delay": 0.1}).follow(sent).means(TIME)
    assert (late[59], late[60]) == pytest.approx((0.0, 1.0))
    slow = CommandLag("a", {"time_constant": 0.1}).follow(sent).means(TIME)
    assert slow[60] == pytest.approx(1.0 - np.exp(-1.05), abs=2e-3)
    bounded = CommandRateLimit("a", {"rate": 2.0}).follow(sent).means(TIME)
    assert bounded[75] == pytest.approx(0.51)
    assert bounded[110] == pytest.approx(1.0)


@pytest.mark.long
@pytest.mark.parametrize("ramped", [False, True])
def test_a_bounded_rate_agrees_with_small_steps(ramped: bool) -> None:
    rng = np.random.default_rng(1)
    goal = Effort(np.arange(21) * 0.1, np.cumsum(rng.normal(size=21)), ramped)
    fine = np.linspace(0.0, 2.0, 200_001)
    wanted = np.append(goal.means(fine)[:-1], goal.values[-1])
    y, path = wanted[0], []
    for target in wanted:
        path.append(y)
        y += np.clip(target - y, -5e-5, 5e-5)
    followed = CommandRateLimit("a", {"rate": 5.0}).follow(goal)
    assert np.interp(fine, followed.times, followed.values) == pytest.approx(np.array(path), abs=2e-3)


@pytest.mark.parametrize("ramped", [False, True])
def test_a_bounded_acceleration_agrees_with_small_steps(ramped: bool) -> None:
    """Each small step goes towards the goal, or brakes where it could not stop there otherwise."""
    rng, most = np.random.default_rng(1), 40.0
    goal = Effort(np.arange(21) * 0.1, np.cumsum(0.3 * rng.normal(size=21)), ramped)
    fine = np.linspace(0.0, 2.0, 200_001)
    wanted, h = np.append(goal.means(fine)[:-1], goal.values[-1]), fine[1]
    y, w, path = wanted[0], 0.0, []
    for target in wanted:
        path.append(y)
        left = target - y
        w += np.clip(np.sign(left) * np.sqrt(2.0 * most * abs(left)) - w, -most * h, most * h)
        y += w * h
    followed = CommandAccelerationLimit("a", {"acceleration": most}).follow(goal)
    error = np.interp(fine, followed.times, followed.values) - np.array(path)
    # a ramp is taken as steps of an eighth
    assert np.max(np.abs(error)) < (0.02 if ramped else 1e-3)


def test_a_profile_goes_on_from_where_it_was() -> None:
    effect, rng = CommandAccelerationLimit("a", {"acceleration": 30.0}), np.random.default_rng(2)
    sent, period = 0.2 * rng.normal(size=30), 0.02
    whole = effect.follow(Effort(period * np.arange(30), sent))
    now = effect.rest(float(sent[0]))
    for k, goal in enumerate(sent[:-1]):
        own = effect.follow_from(now, float(goal), period)
        expected = np.interp(k * period + own.times, whole.times, whole.values)
        assert own.values == pytest.approx(expected, abs=2e-5)
        now = effect.after(now, float(goal), period)


def test_a_slow_command_is_followed_exactly() -> None:
    sent = Effort(TIME, np.sin(TIME), True)
    followed = CommandRateLimit("a", {"rate": 1.5}).follow(sent)
    assert np.interp(TIME, followed.times, followed.values) == pytest.approx(np.sin(TIME), abs=1e-12)


def test_the_speed_limit_has_the_derivatives_that_it_says() -> None:
    u, q, v = _motion()
    effect, step = ActuatorSpeedLimit("a", {"no_load_speed": 1.5, "stall_torque": 0.2}), 1e-7
    law = effect.force(JointSamples(q, v, u))
    assert np.any(law.value != 0.0)
    assert (effect.force(JointSamples(q, v + step, u)).value - law.value) / step == pytest.approx(law.d_v, abs=1e-5)
    assert (effect.force(JointSamples(q, v, u + step)).value - law.value) / step == pytest.approx(law.d_u, abs=1e-5)
    for k, name in enumerate(("no_load_speed", "stall_torque")):
        moved = effect.with_values({**effect.values, name: effect.values[name] + step}).force(JointSamples(q, v, u))
        assert (moved.value - law.value) / step == pytest.approx(law.d_strengths[:, k], abs=1e-5)


@pytest.mark.parametrize(
    "servo",
    [
        {"kp": 17.8, "kv": 0.6},
        {"kp": {"elbow": 20, "wrist": 4.5}, "kv": {"elbow": 1.0}, "limit": 3.0, "drive": "servo"},
        {"kp": {"column": "gain", "scale": 0.0014}, "supply": {"column": "volts", "nominal": 7.4}},
    ],
)
def test_a_scenario_keeps_its_servo_when_it_is_written(servo: dict[str, object]) -> None:
    read = parse({"model": "arm.urdf", "servo": servo}, "scenario.yaml")
    assert parse(yaml.safe_load(as_yaml(read, Path(), Path())), "again.yaml") == read
    assert read.servo is not None and read.servo.kp
