"""The blind proof's arms that are commanded by position: their servos against the laws that they are to have."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.preparation import prepare
from tests.concealed import served_case
from tests.concealed.make import make
from tests.concealed.mujoco_arm import ArmInverse
from tests.concealed.robots import Robot, random_arm
from tests.concealed.served_case import PERIOD, QUANTUM, STEP, UNITS, Served, commanded, draw, run
from tests.concealed_case import written

SERVED = Served(np.array([150.0, 140.0]), np.array([12.0, 10.0]), np.array([20.0, 10.0]), joint=1)


@pytest.fixture(scope="module")
def robot() -> Robot:
    rng = np.random.default_rng(5)
    return next(
        found for found in iter(lambda: random_arm(rng, 2), None) if all(j.kind == "revolute" for j in found.joints)
    )


@pytest.mark.parametrize(
    ("effect", "values"),
    [("", ()), ("servo_gain_error", (0.6,)), ("servo_dead_band", (0.05,))],
)
def test_at_rest_the_servos_carry_what_their_law_says(robot: Robot, effect: str, values: tuple[float, ...]) -> None:
    served = replace(SERVED, effect=effect, joint=0, values=values)
    command = np.array([0.3, -0.4])
    # it comes to rest from the first command on, where the run begins at zero
    q = run(robot, served, np.tile(command, (round(2.0 / PERIOD), 1)))[-1]
    kp, error = served.kp.copy(), command - q
    if effect == "servo_gain_error":
        kp[0] *= 0.6
    if effect == "servo_dead_band":
        error[0] = np.sign(error[0]) * max(abs(error[0]) - 0.05, 0.0)
    weight = ArmInverse(robot).torque(q[None], np.zeros((1, 2)), np.zeros((1, 2)))[0]
    assert abs(weight[0]) > 0.5
    # the encoders' step is what it is known to
    assert np.all(np.abs(kp * error - weight) <= 0.6 * QUANTUM * served.kp)


def test_a_followed_command_of_bounded_acceleration_gets_to_a_step_in_the_shortest_time() -> None:
    """Half of the way at a, half at −a: 2 √(1/4) s to a step of 1 rad with a = 4 rad/s²."""
    followed = replace(SERVED, effect="command_acceleration_limit", values=(4.0,)).follower(np.zeros(2))
    path = np.array([followed(k * STEP, lambda at: np.array([1.0, 1.0]))[1] for k in range(round(1.5 / STEP))])
    at = (np.arange(len(path)) + 0.5) * STEP
    expected = np.where(at < 0.5, 2.0 * at**2, np.where(at < 1.0, 1.0 - 2.0 * (1.0 - at) ** 2, 1.0))
    assert path == pytest.approx(expected, abs=4.0 * STEP**2)


def test_what_is_followed_is_late_lagged_or_limited_in_its_rate() -> None:
    def sent(at: float) -> np.ndarray:
        return np.array([at, 2.0 * at])

    for effect, value, expected in (
        ("command_delay", 0.02, 2.0 * (1.0 - 0.02)),
        ("command_lag", 0.05, 2.0 * (1.0 - 0.05)),
        ("command_rate_limit", 1.5, 1.5),
    ):
        followed = replace(SERVED, effect=effect, values=(value,)).follower(np.zeros(2))
        for k in range(round(1.0 / STEP) + 1):
            goal = followed(k * STEP, sent)
        assert goal == pytest.approx([1.0, expected], abs=3.0 * STEP), effect


def test_sag_a_speed_limit_and_friction_act_beside_the_actuators() -> None:
    goal, q = np.array([0.0, 0.1]), np.zeros(2)
    limited = replace(SERVED, effect="actuator_speed_limit", values=(4.0, 3.0))
    # at standstill 14 N m are cut to the limit's 10, and these to the stall torque of 3; it brakes with all of it
    assert limited.beside(goal, q, np.zeros(2)) == pytest.approx(3.0 - 10.0)
    assert limited.beside(goal, q, np.array([0.0, 0.5])) == pytest.approx(3.0 * (1.0 - 0.125) - (10.0 - 5.0))
    sagging = replace(SERVED, effect="supply_sag", values=(0.05,))
    # all the voltage: E = 10 (1 − 0.05 E)
    assert sagging.beside(goal, q, np.zeros(2)) == pytest.approx(10.0 / 1.5 - 10.0)
    dry = replace(SERVED, effect="joint_coulomb_friction", values=(0.7,))
    assert dry.beside(goal, q, np.array([1.0, -1.0])) == pytest.approx(0.7)


@pytest.mark.long
def test_a_case_has_commands_and_encoders_and_no_effort() -> None:
    for kind in ("null", "single:command_delay"):
        case = make(kind, "served2", 3)
        table = case.recordings["train_1.parquet"]
        names = [str(column) for column in table.columns]
        assert {name.partition(".")[0] for name in names} == {"time", "q", "cmd"}
        steps = table.filter(like="q.").to_numpy() / QUANTUM
        assert np.abs(steps - np.round(steps)).max() < 1e-6
        assert np.abs(table.filter(like="q.").to_numpy()).max() > 0.2
        assert set(case.scenario["servo"]) == {"kp", "kv", "limit"}  # type: ignore[call-overload]
        effects: list[dict[str, object]] = case.truth["effects"]  # type: ignore[assignment]
        assert [item["effect"] for item in effects] == [kind.partition(":")[2]] * (kind != "null")
        assert case.truth["verdict"] == ("explained" if effects else "none")
        strengths: list[dict[str, float]] = case.truth["strengths"]  # type: ignore[assignment]
        assert [item["clear"] for item in strengths] == [item["value"] > 2.0 for item in strengths]
        assert all(item["value"] > 0.0 for item in strengths) and len(strengths) == len(effects)


@pytest.mark.long
@pytest.mark.parametrize("effect", ["", *UNITS])
def test_half_the_step_gives_the_same_motion(robot: Robot, monkeypatch: pytest.MonkeyPatch, effect: str) -> None:
    rng = np.random.default_rng(8)
    served = draw(rng, robot, effect)
    commands = commanded(rng, 2)[: round(1.0 / PERIOD)]
    monkeypatch.setattr(served_case, "QUANTUM", 1e-9)
    found = []
    for step in (STEP, 0.5 * STEP):
        monkeypatch.setattr(served_case, "STEP", step)
        found.append(run(robot, served, commands))
    assert np.abs(found[0]).max() > 0.05
    assert np.abs(found[0] - found[1]).max() < 0.05 * QUANTUM


def test_what_servos_bend_between_samples_is_noise_of_the_rows(tmp_path: Path) -> None:
    """At 8 ms a servo moves a light joint along more than a parabola between samples: the rows were 1.3 times noisy."""
    scene, read = written(served_case.make_served(np.random.default_rng(3), 2, "null"), tmp_path)
    problem = prepare(scene, read).problem()
    rows = [z for _, z in by_run(problem, problem.rows_of(problem.nominal()))]
    assert np.all(np.mean(np.concatenate(rows) ** 2, axis=0) < 1.15)
