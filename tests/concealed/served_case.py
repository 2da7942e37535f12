"""Cases on arms that are commanded by position: MuJoCo's position actuators, encoders of 2π/4096, no effort recorded.

Each arm of two or three joints hangs; commands come every 8 ms. What is concealed is one effect of a servo, or dry
friction, at one joint. Its strength is by how many of the encoders' steps it moves the joint that it moves most, root
mean square over the training runs; it is clear where these are more than `CLEAR`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import pandas as pd

from .case import RECORDINGS, Case
from .mujoco_arm import ArmInverse, mjcf
from .robots import Array, Robot, random_arm
from .truth import Concealed
from .urdf import arm_urdf

UNITS = {
    "servo_gain_error": {"gain": "1"},
    "servo_dead_band": {"width": "rad"},
    "supply_sag": {"sag": "1/(N m)"},
    "command_delay": {"delay": "s"},
    "command_lag": {"time_constant": "s"},
    "command_rate_limit": {"rate": "rad/s"},
    "command_acceleration_limit": {"acceleration": "rad/s²"},
    "actuator_speed_limit": {"no_load_speed": "rad/s", "stall_torque": "N m"},
    "joint_coulomb_friction": {"torque": "N m"},
}
"""The effects that may be concealed, and the units of their parameters."""
RIGS = ("served2", "served3")
STEP, PERIOD, DURATION = 2e-4, 0.008, 6.0
QUANTUM = 2.0 * np.pi / 4096
CLEAR = 2.0

Sent = Callable[[float], Array]


@dataclass(frozen=True)
class Served:
    """The servos of all joints, (n,) each, and the effect `values` at one joint; no effect where its name is empty."""

    kp: Array
    kv: Array
    limit: Array
    effect: str = ""
    joint: int = 0
    values: tuple[float, ...] = ()

    @property
    def bare(self) -> Served:
        """The same servos without the effect."""
        return replace(self, effect="", values=())

    def actuated(self, robot: Robot) -> mujoco.MjModel:
        """The arm with a position actuator at each joint, limited in its force, and a damper beside it."""
        gain = self.kp.copy()
        if self.effect == "servo_gain_error":
            gain[self.joint] *= self.values[0]
        actuators = "".join(
            f'<general joint="{joint.name}_0" gainprm="{kp!r}" biastype="affine" biasprm="0 {-kp!r} 0" '
            f'forcelimited="true" forcerange="{-limit!r} {limit!r}"/>'
            for joint, kp, limit in zip(robot.joints, gain.tolist(), self.limit.tolist(), strict=True)
        )
        actuators += "".join(
            f'<general joint="{joint.name}_0" biastype="affine" biasprm="0 0 {-kv!r}"/>'
            for joint, kv in zip(robot.joints, self.kv.tolist(), strict=True)
        )
        text = mjcf(robot, 1).replace("</mujoco>", f"<actuator>{actuators}</actuator></mujoco>")
        model = mujoco.MjModel.from_xml_string(text)
        # an Euler step h adds kv h/2 to a joint's inertia, or takes it away
        model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_RK4
        return model

    def goal(self, goal: Array, q: Array) -> Array:
        """(n,) rad: the actuators' inputs for the followed commands `goal` (n,)."""
        if self.effect != "servo_dead_band":
            return goal
        j, width = self.joint, self.values[0]
        error = goal[j] - q[j]
        goal[j] = q[j] + np.sign(error) * max(abs(error) - width, 0.0)
        return goal

    def beside(self, goal: Array, q: Array, v: Array) -> float:
        """N m: what acts at the effect's joint beside the actuators, at the inputs `goal` (n,)."""
        if self.effect not in ("supply_sag", "actuator_speed_limit", "joint_coulomb_friction"):
            return 0.0
        j = self.joint
        if self.effect == "joint_coulomb_friction":
            return float(-self.values[0] * np.tanh(v[j] / 0.005))
        voltage = float(np.clip(self.kp[j] * (goal[j] - q[j]), -self.limit[j], self.limit[j]))
        asked = torque = voltage - self.kv[j] * v[j]
        if self.effect == "supply_sag":
            for _ in range(30):
                share = self.values[0] * abs(voltage) / self.limit[j] * abs(torque)
                torque = 0.5 * torque + 0.5 * (voltage * (1.0 - share) - self.kv[j] * v[j])
            return float(torque - asked)
        most = self.values[1] * max(1.0 - v[j] * np.sign(asked) / self.values[0], 0.0)
        return float(np.sign(asked) * min(abs(asked), most) - asked)

    def follower(self, start: Array) -> Callable[[float, Sent], Array]:
        """What the servos follow over a step from a time on, given what is commanded; called once a step."""
        state, speed, j = start.copy(), 0.0, self.joint

        def followed(now: float, sent: Sent) -> Array:
            nonlocal speed
            goal = sent(now).copy()
            if self.effect == "command_delay":
                before, after = (sent(max(at - self.values[0], 0.0))[j] for at in (now, now + STEP))
                # how long ago, at the end of the step, the last command arrived
                arrived = (now + STEP - self.values[0]) % PERIOD
                goal[j] = before + (after - before) * min(arrived / STEP, 1.0)
            if self.effect == "command_lag":
                mean, left = (np.exp(-share * STEP / self.values[0]) for share in (0.5, 1.0))
                away = state[j] - goal[j]
                state[j], goal[j] = goal[j] + away * left, goal[j] + away * mean
            if self.effect == "command_rate_limit":
                moved = np.clip(goal[j] - state[j], -STEP * self.values[0], STEP * self.values[0])
                state[j], goal[j] = state[j] + moved, state[j] + 0.5 * moved
            if self.effect == "command_acceleration_limit":
                # the speed at the end of this step from which it can still stop at the goal
                most, left, before = self.values[0], goal[j] - state[j], speed
                side, half = np.sign(left), 0.5 * most * STEP
                ahead = max(side * (left - 0.5 * before * STEP), 0.0)
                wanted = side * min(np.sqrt(half**2 + 2.0 * most * ahead) - half, 2.0 * abs(left) / STEP)
                speed += np.clip(wanted - speed, -most * STEP, most * STEP)
                # the mean of the step's two speeds: with the last one alone it would move as if under more acceleration
                moved = 0.5 * (before + speed) * STEP
                state[j], goal[j] = state[j] + moved, state[j] + 0.5 * moved
            return goal

        return followed

    def concealed(self, robot: Robot) -> tuple[Concealed, ...]:
        """The effect as the truth states it; none where there is none."""
        if not self.effect:
            return ()
        units = UNITS[self.effect].items()
        numbers = {name: (float(value), unit) for (name, unit), value in zip(units, self.values, strict=True)}
        return (Concealed(self.effect, robot.joints[self.joint].name, numbers),)


def make_served(rng: np.random.Generator, size: int, kind: str) -> Case:
    """A case on a random arm with servos; kind: null, single:<effect>."""
    while True:
        robot = random_arm(rng, size)
        if all(joint.kind == "revolute" for joint in robot.joints):
            break
    served = draw(rng, robot, kind.partition(":")[2])
    commands = [commanded(rng, size) for _ in RECORDINGS]
    motions = [run(robot, served, sent) for sent in commands]
    names = [joint.name for joint in robot.joints]
    tables = {
        file: pd.DataFrame(
            {"time": PERIOD * np.arange(len(q))}
            | {f"q.{name}": q[:, j] for j, name in enumerate(names)}
            | {f"cmd.{name}": sent[:, j] for j, name in enumerate(names)}
        )
        for file, q, sent in zip(RECORDINGS, motions, commands, strict=True)
    }
    effects = served.concealed(robot)
    truth = {
        "kind": kind,
        "rig": f"served{size}",
        "verdict": "explained" if effects else "none",
        "effects": [item.statement() for item in effects],
        "nominal_parameters_true": {},
        "noise": {"kind": "quantised", "q": QUANTUM / np.sqrt(12.0)},
        "strengths": [],
        "accept": [],
    }
    if effects:
        trained = [b for b, file in enumerate(RECORDINGS) if file.startswith("train")]
        apart = np.concatenate([motions[b] - run(robot, served.bare, commands[b]) for b in trained])
        moved = float(np.max(np.sqrt(np.mean(apart**2, axis=0))) / QUANTUM)
        truth["strengths"] = [{"value": moved, "clear": moved > CLEAR}]
    return Case(kind, robot.name, scenario(robot, served), f"{robot.name}.urdf", arm_urdf(robot), tables, truth)


def draw(rng: np.random.Generator, robot: Robot, effect: str) -> Served:
    """Servos that are fast for the robot and strong enough, and the effect of this name, small or large."""
    n = robot.size
    inertia = np.diag(ArmInverse(robot).mass_matrix(np.full(n, 0.3)))
    kp = np.round(inertia * rng.uniform(20.0, 45.0, n) ** 2, 1)
    kv = np.round(2.0 * rng.uniform(0.4, 0.9, n) * np.sqrt(kp * inertia), 2)
    # about what gravity and a motion of 6 rad/s² ask for
    asked = np.abs(ArmInverse(robot).torque(np.full((1, n), 0.8), np.zeros((1, n)), np.full((1, n), 6.0))[0]) + 1.0
    limit = np.round(asked * rng.uniform(2.0, 4.0, n), 1)
    if not effect:
        return Served(kp, kv, limit)
    j, size = int(rng.integers(n)), float(np.exp(rng.uniform(np.log(0.1), np.log(1.0))))
    values: tuple[float, ...] = {
        "servo_gain_error": (1.0 + float(rng.choice([-1.0, 1.0])) * 0.4 * size,),
        "servo_dead_band": (0.03 * size,),
        "supply_sag": (0.7 * size / limit[j],),
        "command_delay": (0.03 * size,),
        "command_lag": (0.03 * size,),
        "command_rate_limit": (0.6 / size**0.5,),
        "command_acceleration_limit": (15.0 / size**0.5,),
        "actuator_speed_limit": (4.0, 0.5 * limit[j] / size**0.3),
        "joint_coulomb_friction": (0.2 * size * asked[j],),
    }[effect]
    return Served(kp, kv, limit, effect, j, values)


def commanded(rng: np.random.Generator, size: int) -> Array:
    """(N, n) rad: a sum of sines for each joint, sampled every `PERIOD`."""
    t = PERIOD * np.arange(round(DURATION / PERIOD))[:, None, None]
    rates, phases = 2.0 * np.pi * rng.uniform(0.15, 1.3, (4, size)), rng.uniform(0.0, 2.0 * np.pi, (4, size))
    sizes = rng.uniform(0.2, 0.5, (4, size))
    return np.asarray(np.sum(sizes * (np.sin(rates * t + phases) - np.sin(phases)), axis=1))


def run(robot: Robot, served: Served, commands: Array) -> Array:
    """(N, n) rad: what the encoders read; the run starts at rest at the first command."""
    model = served.actuated(robot)
    data, n, every = mujoco.MjData(model), robot.size, round(PERIOD / STEP)

    def sent(at: float) -> Array:
        return np.asarray(commands[min(int(at / PERIOD + 1e-9), len(commands) - 1)])

    followed, rows = served.follower(commands[0]), []
    for k in range(len(commands) * every):
        if k % every == 0:
            rows.append(QUANTUM * np.round(data.qpos / QUANTUM))
        goal = served.goal(followed(k * STEP, sent), data.qpos)
        data.ctrl[:n] = goal
        # at the middle of the step
        q, v = data.qpos + 0.5 * STEP * data.qvel, data.qvel + 0.5 * STEP * data.qacc
        data.qfrc_applied[served.joint] = served.beside(goal, q, v)
        mujoco.mj_step(model, data)
    return np.array(rows)


def scenario(robot: Robot, served: Served) -> dict[str, object]:
    """What the diagnosis is told: the model, and the servos as they are without the effect."""
    names = [joint.name for joint in robot.joints]
    numbers = (("kp", served.kp), ("kv", served.kv), ("limit", served.limit))
    servo = {key: dict(zip(names, values.tolist(), strict=True)) for key, values in numbers}
    return {"model": f"{robot.name}.urdf", "gravity": [0, 0, -9.81], "weld": [{"body": "base"}], "servo": servo}
