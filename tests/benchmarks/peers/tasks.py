"""The tasks: a planar arm under position servos and under torques that swing it over, and an arm of seven joints."""

from __future__ import annotations

import numpy as np

from tests.concealed.robots import Joint, Link, Robot, random_arm

from .task import Parameter, Task

GRAVITY = np.array([0.0, 0.0, -9.81])


def _planar() -> Robot:
    """Two rods of .5 and .4 m that swing in a vertical plane; the first weighs 2 kg."""
    links, joints, length = [], [], (0.5, 0.4)
    for j, mass in enumerate((2.0, 1.3)):
        thin = mass / 12.0 * length[j] ** 2
        links.append(Link(f"link{j + 1}", mass, np.array([0.0, 0.0, -0.5 * length[j]]), np.diag([thin, thin, 1e-3])))
        origin = np.array([0.0, 0.0, 0.0 if j == 0 else -length[0]])
        joints.append(Joint(f"joint{j + 1}", "revolute", j - 1, origin, np.zeros(3), np.array([0.0, 1.0, 0.0])))
    return Robot("planar", tuple(links), tuple(joints), GRAVITY)


def _of_joints(names: list[str], kind: str, true: list[float], start: list[float]) -> list[Parameter]:
    return [Parameter(kind, name, a, b) for name, a, b in zip(names, true, start, strict=True)]


def _planar_parameters() -> tuple[Parameter, ...]:
    names = ["joint1", "joint2"]
    return (
        Parameter("mass", "link2", 1.3, 0.8),
        *_of_joints(names, "damping", [0.25, 0.12], [0.1, 0.05]),
        *_of_joints(names, "friction", [0.4, 0.2], [0.1, 0.05]),
        *_of_joints(names, "armature", [0.05, 0.02], [0.01, 0.005]),
    )


def _seven_parameters(robot: Robot) -> tuple[Parameter, ...]:
    """22: damping, friction and armature of each joint, the last link's mass."""
    names = [joint.name for joint in robot.joints]
    fall = 0.85 ** np.arange(7)
    last = robot.links[-1]
    return (
        Parameter("mass", last.name, last.mass, round(0.7 * last.mass, 3)),
        *_of_joints(names, "damping", (0.6 * fall).tolist(), (0.24 * fall).tolist()),
        *_of_joints(names, "friction", (0.8 * fall).tolist(), (0.2 * fall).tolist()),
        *_of_joints(names, "armature", [joint.rotor_inertia for joint in robot.joints],
                    [0.3 * joint.rotor_inertia for joint in robot.joints]),
    )  # fmt: skip


PLANAR, SEVEN = _planar(), random_arm(np.random.default_rng(77), 7)
TASKS = (
    Task("servo", PLANAR, _planar_parameters(), 5.0, 40, ((200.0, 10.0), (100.0, 4.0)), (0.3, -0.4), (1.5, 1.5)),
    Task("swing-over", PLANAR, _planar_parameters(), 5.0, 20, None, (0.0, 0.0), (13.0, 4.0), (0.3, 1.2)),
    Task("seven", SEVEN, _seven_parameters(SEVEN), 10.0, 30,
         ((400.0, 30.0), (400.0, 30.0), (300.0, 20.0), (200.0, 15.0), (100.0, 8.0), (60.0, 5.0), (40.0, 3.0)),
         (0.1, 0.4, -0.3, 0.5, 0.2, -0.6, 0.3), (1.2,) * 7),
)  # fmt: skip
