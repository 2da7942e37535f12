"""Machines that the makers of `tests.concealed` simulate, with all their numbers free: sliders, arms and a press."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from tests.concealed import laws
from tests.concealed.contact_law import ContactLaw
from tests.concealed.laws import Laws
from tests.concealed.mujoco_arm import ArmInverse, ArmPlant
from tests.concealed.press import PressPlant, Stage, random_stage
from tests.concealed.robots import Array, Joint, Link, Robot, random_arm
from tests.concealed.simulate import Simulation
from tests.concealed.urdf import arm_urdf

TOLERANCE = 1e-11
"""Of the maker's integration: derivatives are differences of its results."""

LAWS: Mapping[str, Callable[[int, Mapping[str, float]], Laws]] = {
    "joint_viscous_friction": lambda j, x: laws.viscous(j, x["coefficient"]),
    "joint_coulomb_friction": lambda j, x: laws.coulomb(j, x["torque"], x["width"]),
    "joint_spring": lambda j, x: laws.spring(j, x["stiffness"], x["rest"]),
    "actuator_gain_error": lambda j, x: laws.gain_error(j, x["gain"]),
    "actuator_bias": lambda j, x: laws.bias(j, x["torque"]),
}
"""The makers' laws by the effects' names: joint and strengths to the law."""


@dataclass(frozen=True)
class Effect:
    """The effect that acts, with its true strengths."""

    name: str
    at: str
    values: Mapping[str, float]
    width: float | None = None
    """Of the change of sign of a dry friction, rad/s (m/s): not a strength, but not known either."""

    @property
    def numbers(self) -> list[float]:
        """The strengths, then the logarithm of the width if there is one."""
        return [*self.values.values(), *([] if self.width is None else [float(np.log(self.width))])]

    def law(self, joint: int, numbers: Array) -> Laws:
        """The makers' law with these `numbers`."""
        strengths = dict(zip(self.values, map(float, numbers), strict=False))
        if self.width is not None:
            strengths["width"] = float(np.exp(numbers[-1]))
        return LAWS[self.name](joint, strengths)


@dataclass(frozen=True)
class Unknown:
    """An entry of `unknown:` and the parameter's true value."""

    entry: Mapping[str, object]
    true: float

    @property
    def prior_std(self) -> float:
        return float(self.entry["std"])  # type: ignore[arg-type]


@dataclass(frozen=True)
class Arm:
    """A robot of joints, simulated by MuJoCo's dynamics."""

    robot: Robot
    contacts: tuple[dict[str, object], ...] = ()
    sensors: Mapping[str, dict[str, object]] = field(default_factory=dict)

    @cached_property
    def inverse(self) -> ArmInverse:
        return ArmInverse(self.robot)

    @property
    def urdf(self) -> str:
        return arm_urdf(self.robot)

    def feedforward(self, q: Array, v: Array, a: Array) -> Array:
        """Efforts (N, n) of the nominal robot along a motion."""
        return self.inverse.torque(q, v, a)

    @property
    def inertia(self) -> Array:
        return np.diag(self.inverse.mass_matrix(np.zeros(self.robot.size)))

    def simulation(
        self, unknown: tuple[Unknown, ...], values: Array, effect: Effect, copies: int
    ) -> tuple[Simulation, None]:
        """With the unknowns and the effect's numbers at `values` (n + k,)."""
        robot = self.robot
        for item, value in zip(unknown, values, strict=False):
            if item.entry["parameter"] != "mass":
                raise ValueError(f"{item.entry}: an arm's unknowns are masses")
            link = robot.link_index(str(item.entry["body"]))
            robot = robot.replace_link(link, robot.links[link].with_mass(float(value)))
        joint_laws = effect.law(robot.joint_index(effect.at), values[len(unknown) :])
        plant = ArmPlant(robot, copies)
        return Simulation(plant, robot.size, joint_laws, {}, TOLERANCE), None


@dataclass(frozen=True)
class Press:
    """A stage that presses and rubs a sphere on a wall, its differential equation solved with located events."""

    stage: Stage
    law: ContactLaw

    @property
    def robot(self) -> Robot:
        return self.stage.robot

    @property
    def urdf(self) -> str:
        return self.stage.urdf()

    @property
    def contacts(self) -> tuple[dict[str, object], ...]:
        law = self.law
        return (
            {
                "bodies": ["tool", "wall"],
                "stiffness": law.stiffness,
                "damping": law.damping,
                "friction": law.friction,
                "slip_velocity": law.slip_velocity,
            },
        )

    @property
    def sensors(self) -> Mapping[str, dict[str, object]]:
        return {"wrench.wrist": {"body": "tool", "frame": "tool"}}

    @property
    def inertia(self) -> Array:
        return self.stage.moved

    def feedforward(self, q: Array, v: Array, a: Array) -> Array:
        """Inertia, weight and the expected normal force (N, 3)."""
        effort = self.stage.moved * a - self.stage.weight
        depth = self.stage.radius - self.stage.tip[2] - q[:, 2]
        effort[:, 2] -= np.where(depth > 0.0, self.law.stiffness * depth, 0.0)
        return np.asarray(effort)

    def simulation(
        self, unknown: tuple[Unknown, ...], values: Array, effect: Effect, copies: int
    ) -> tuple[Simulation, PressPlant]:
        """With the unknowns and the effect's numbers at `values` (n + k,), and its plant for wrenches."""
        numbers = {str(item.entry["parameter"]): float(x) for item, x in zip(unknown, values, strict=False)}
        plant = PressPlant(self.stage, replace(self.law, **numbers), copies)  # type: ignore[arg-type]
        joint_laws = effect.law(self.robot.joint_index(effect.at), values[len(unknown) :])
        return Simulation(plant, 3, joint_laws, {}, TOLERANCE), plant


Machine = Arm | Press


def slider() -> Arm:
    """One sliding mass of 2 kg."""
    link = Link("block", 2.0, np.zeros(3), 0.01 * np.eye(3))
    joint = Joint("rail", "prismatic", -1, np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0]))
    return Arm(Robot("slider", (link,), (joint,), np.array([0.0, 0.0, -9.81])))


def planar_arm() -> Arm:
    """Two links that hang and swing in a vertical plane."""
    links, joints = [], []
    for index, (name, mass, length) in enumerate((("upper", 2.4, 0.35), ("fore", 1.5, 0.3))):
        inertia = mass / 12.0 * np.diag([length**2 + 0.005, length**2 + 0.005, 0.005])
        links.append(Link(name, mass, np.array([0.0, 0.0, -0.5 * length]), inertia))
        origin = np.array([0.0, 0.0, 0.5 if index == 0 else -0.35])
        rotor = (0.08, 0.05)[index]
        axis = np.array([0.0, 1.0, 0.0])
        joints.append(Joint(("shoulder", "elbow")[index], "revolute", index - 1, origin, np.zeros(3), axis, 0.0, rotor))
    return Arm(Robot("planar", tuple(links), tuple(joints), np.array([0.0, 0.0, -9.81])))


def seven_joints() -> Arm:
    """A spatial arm of seven joints."""
    return Arm(random_arm(np.random.default_rng(77), 7))


def press() -> Press:
    """A stage with its contact."""
    law = ContactLaw(stiffness=4500.0, damping=50.0, friction=0.4, slip_velocity=0.006)
    return Press(random_stage(np.random.default_rng(7)), law)
