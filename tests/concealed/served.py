"""`python -m tests.concealed.served COUNT [--first SEED]`: random arms that are commanded by position, diagnosed blind.

Each arm of two or three joints hangs in MuJoCo; position servos, written here anew, act on it at every step of the
engine. No effort is recorded: commands every 8 ms, and encoders of 2π/4096. Every fourth case conceals nothing, the
others one effect of a servo or dry friction at one joint. A case is clear where the effect moves a joint by more than
`CLEAR` quanta, root mean square. Printed: a row a case, and how many clear ones were told exactly.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene

from .mujoco_arm import ArmInverse, mjcf
from .robots import Array, Robot, random_arm
from .urdf import arm_urdf

EFFECTS = (
    "servo_gain_error",
    "servo_dead_band",
    "supply_sag",
    "command_delay",
    "command_lag",
    "command_rate_limit",
    "actuator_speed_limit",
    "joint_coulomb_friction",
)
STEP, PERIOD, DURATION = 1e-4, 0.008, 6.0
QUANTUM = 2.0 * np.pi / 4096
CLEAR = 2.0


@dataclass(frozen=True)
class Truth:
    """The servos of all joints, (n,) each, and the effect `values` at one joint; no effect where its name is empty."""

    kp: Array
    kv: Array
    limit: Array
    effect: str = ""
    joint: int = 0
    values: tuple[float, ...] = ()


def effort(truth: Truth, goal: Array, q: Array, v: Array) -> Array:
    """(n,) N m: the servos' torques towards the followed commands `goal` (n,)."""
    kp, error, j = truth.kp.copy(), goal - q, truth.joint
    if truth.effect == "servo_gain_error":
        kp[j] *= truth.values[0]
    if truth.effect == "servo_dead_band":
        error[j] = np.sign(error[j]) * max(abs(error[j]) - truth.values[0], 0.0)
    voltage = np.clip(kp * error, -truth.limit, truth.limit)
    torque = voltage - truth.kv * v
    if truth.effect == "supply_sag":
        for _ in range(30):
            share = truth.values[0] * abs(voltage[j]) / truth.limit[j] * abs(torque[j])
            torque[j] = 0.5 * torque[j] + 0.5 * (voltage[j] * (1.0 - share) - truth.kv[j] * v[j])
    if truth.effect == "actuator_speed_limit":
        most = truth.values[1] * max(1.0 - v[j] * np.sign(torque[j]) / truth.values[0], 0.0)
        torque[j] = np.sign(torque[j]) * min(abs(torque[j]), most)
    if truth.effect == "joint_coulomb_friction":
        torque[j] -= truth.values[0] * np.tanh(v[j] / 0.005)
    return torque


def follower(truth: Truth, start: Array) -> Callable[[float, Callable[[float], Array]], Array]:
    """What the servos follow at a time, given what is commanded at any time; called once a step."""
    state = start.copy()

    def followed(now: float, sent: Callable[[float], Array]) -> Array:
        goal, j = sent(now).copy(), truth.joint
        if truth.effect == "command_delay":
            goal[j] = sent(max(now - truth.values[0], 0.0))[j]
        if truth.effect == "command_lag":
            state[j] += (goal[j] - state[j]) * (1.0 - np.exp(-STEP / truth.values[0]))
            goal[j] = state[j]
        if truth.effect == "command_rate_limit":
            state[j] += np.clip(goal[j] - state[j], -STEP * truth.values[0], STEP * truth.values[0])
            goal[j] = state[j]
        return goal

    return followed


def wanted(seed: int, joint: int) -> Callable[[float], float]:
    """A sum of sines, rad, that the commands sample."""
    rng = np.random.default_rng([seed, joint])
    rates, phases = 2.0 * np.pi * rng.uniform(0.15, 1.3, 4), rng.uniform(0.0, 2.0 * np.pi, 4)
    sizes = rng.uniform(0.2, 0.5, 4)
    return lambda t: float(np.sum(sizes * (np.sin(rates * t + phases) - np.sin(phases))))


def recording(robot: Robot, truth: Truth, seed: int) -> Recording:
    """Positions and commands of one run; it starts at rest at the first command."""
    model = mujoco.MjModel.from_xml_string(mjcf(robot, 1))
    model.opt.timestep = STEP
    data, n = mujoco.MjData(model), robot.size
    waves = [wanted(seed, j) for j in range(n)]
    count = round(DURATION / PERIOD)
    commands = np.array([[wave(k * PERIOD) for wave in waves] for k in range(count + 1)])

    def sent(at: float) -> Array:
        return commands[min(int(at / PERIOD + 1e-9), count)]

    followed, rows = follower(truth, commands[0]), []
    every = round(PERIOD / STEP)
    for k in range(count * every):
        if k % every == 0:
            rows.append(QUANTUM * np.round(data.qpos / QUANTUM))
        data.qfrc_applied[:] = effort(truth, followed(k * STEP, sent), data.qpos, data.qvel)
        mujoco.mj_step(model, data)
    q = np.array(rows)
    names = [joint.name for joint in robot.joints]
    columns = {f"q.{name}": q[:, j] for j, name in enumerate(names)}
    columns |= {f"cmd.{name}": commands[:count, j] for j, name in enumerate(names)}
    return Recording(f"run {seed}", PERIOD * np.arange(count), columns)


def drawn(seed: int) -> tuple[Robot, Truth]:
    """A robot and what is concealed in it."""
    rng = np.random.default_rng(seed)
    while True:
        robot = random_arm(rng, int(rng.choice([2, 3])))
        if all(joint.kind == "revolute" for joint in robot.joints):
            break
    n = robot.size
    inertia = np.diag(ArmInverse(robot).mass_matrix(np.full(n, 0.3)))
    kp = np.round(inertia * rng.uniform(20.0, 45.0, n) ** 2, 1)
    kv = np.round(2.0 * rng.uniform(0.4, 0.9, n) * np.sqrt(kp * inertia), 2)
    # about what gravity and a motion of 6 rad/s² ask for
    asked = np.abs(ArmInverse(robot).torque(np.full((1, n), 0.8), np.zeros((1, n)), np.full((1, n), 6.0))[0]) + 1.0
    limit = np.round(asked * rng.uniform(2.0, 4.0, n), 1)
    bare = Truth(kp, kv, limit)
    if seed % 4 == 0:
        return robot, bare
    effect, j = EFFECTS[(seed - seed // 4) % len(EFFECTS)], int(rng.integers(n))
    size = float(np.exp(rng.uniform(np.log(0.1), np.log(1.0))))
    values: tuple[float, ...] = {
        "servo_gain_error": (1.0 + float(rng.choice([-1.0, 1.0])) * 0.4 * size,),
        "servo_dead_band": (0.03 * size,),
        "supply_sag": (0.7 * size / limit[j],),
        "command_delay": (0.03 * size,),
        "command_lag": (0.03 * size,),
        "command_rate_limit": (0.6 / size**0.5,),
        "actuator_speed_limit": (4.0, 0.5 * limit[j] / size**0.3),
        "joint_coulomb_friction": (0.2 * size * asked[j],),
    }[effect]
    return robot, Truth(kp, kv, limit, effect, j, values)


def scenario(robot: Robot, truth: Truth) -> str:
    """What the diagnosis is told: the model, and the servos as they are without the effect."""

    def by_joint(values: Array) -> str:
        return (
            "{" + ", ".join(f"{joint.name}: {value}" for joint, value in zip(robot.joints, values, strict=True)) + "}"
        )

    servo = f"{{kp: {by_joint(truth.kp)}, kv: {by_joint(truth.kv)}, limit: {by_joint(truth.limit)}}}"
    return f"model: arm.urdf\nweld: [{{body: base}}]\nservo: {servo}\n"


def moved(robot: Robot, truth: Truth, shown: Recording) -> float:
    """Quanta by which the effect moves a joint in the first run, root mean square, at the joint that it moves most."""
    bare = recording(robot, Truth(truth.kp, truth.kv, truth.limit), 1)
    apart = [shown[f"q.{joint.name}"] - bare[f"q.{joint.name}"] for joint in robot.joints]
    return float(max(np.sqrt(np.mean(item**2)) for item in apart) / QUANTUM)


def main() -> int:
    """The rows, and the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int)
    parser.add_argument("--first", type=int, default=1)
    given = parser.parse_args()
    clear, exact, nulls, alarms = 0, 0, 0, 0
    for seed in range(given.first, given.first + given.count):
        began = time.process_time()
        robot, truth = drawn(seed)
        runs = [recording(robot, truth, number) for number in (1, 2)]
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "arm.urdf").write_text(arm_urdf(robot))
            (Path(folder) / "scenario.yaml").write_text(scenario(robot, truth))
            verdict = diagnose(Scene.load(Path(folder) / "scenario.yaml"), runs)
        found = [explanation.effect.key for explanation in verdict.explanation]
        if not truth.effect:
            nulls, alarms, right, far = nulls + 1, alarms + (verdict.kind != "none"), verdict.kind == "none", 0.0
        else:
            far = moved(robot, truth, runs[0])
            right = verdict.kind == "explained" and found == [(truth.effect, robot.joints[truth.joint].name)]
            clear, exact = clear + (far > CLEAR), exact + (far > CLEAR and right)
        values = " ".join(f"{value:.4g}" for value in truth.values)
        at = f"@{robot.joints[truth.joint].name}" if truth.effect else "nothing"
        print(
            f"{seed} {'right' if right else 'WRONG'} {truth.effect}{at} {values}, moves {far:.1f} quanta: {verdict} "
            f"({time.process_time() - began:.0f} s)",
            flush=True,
        )
    print(f"clear and exact: {exact} of {clear}; false alarms: {alarms} of {nulls}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
