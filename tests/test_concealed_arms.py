"""The arm simulator of concealed cases against Drake; its laws of joints, drives and bodies against closed forms."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces

from tests.concealed import laws
from tests.concealed.excitation import desired
from tests.concealed.mujoco_arm import ArmInverse, ArmPlant
from tests.concealed.robots import Array, Robot, random_arm
from tests.concealed.simulate import Motion, Simulation
from tests.concealed.urdf import arm_urdf

STEP = 0.002


def moved(
    robot: Robot,
    extra: laws.Laws,
    seed: int = 5,
    samples: int = 250,
    rotors: dict[int, float] | None = None,
    tolerance: float = 1e-8,
) -> Motion:
    """A short batch of two recordings under the nominal feedforward and a soft PD."""
    rng = np.random.default_rng(seed)
    linear = np.array([joint.kind == "prismatic" for joint in robot.joints])
    goal = desired(rng, 2, samples, STEP, robot.size, "rich", linear)
    inverse = ArmInverse(robot)
    feedforward = np.stack([inverse.torque(goal.q[b], goal.v[b], goal.a[b]) for b in range(2)])
    inertia = np.diag(inverse.mass_matrix(goal.q[0, 0]))
    plant_robot = robot
    for joint in rotors or {}:
        plant_robot = plant_robot.replace_joint(joint, rotor_inertia=0.0)
    simulation = Simulation(ArmPlant(plant_robot, 2, extra.bodies), robot.size, extra, rotors or {}, tolerance)

    def command(k: int, q: Array, v: Array) -> Array:
        return feedforward[:, k] + inertia * (25.0 * (goal.q[:, k] - q) + 8.0 * (goal.v[:, k] - v))

    return simulation.run(np.tile(STEP * np.arange(samples), (2, 1)), goal.q[:, 0], goal.v[:, 0], command)


def added(robot: Robot, motion: Motion) -> Array:
    """Joint efforts (B, N, n) that act beyond u, from MuJoCo's inverse dynamics."""
    inverse = ArmInverse(robot)
    return np.stack([inverse.torque(motion.q[b], motion.v[b], motion.a[b]) for b in range(len(motion.q))]) - motion.u


@pytest.fixture
def robot() -> Robot:
    return random_arm(np.random.default_rng(8), 3)


@pytest.mark.parametrize(("size", "branched"), [(2, False), (3, False), (6, True), (7, False), (7, True)])
def test_null_agrees_with_drakes_inverse_dynamics_and_energy(size: int, branched: bool) -> None:
    robot = random_arm(np.random.default_rng(size + branched), size, branched)
    motion = moved(robot, laws.Laws(), seed=size)
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(arm_urdf(robot), "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    order = [plant.GetJointByName(joint.name).velocity_start() for joint in robot.joints]
    place = np.zeros((size, size))
    place[order, np.arange(size)] = 1.0
    energy, scale = [], np.abs(motion.u).max()
    for q, v, a, u in zip(motion.q[0], motion.v[0], motion.a[0], motion.u[0], strict=True):
        plant.SetPositions(context, place @ q)
        plant.SetVelocities(context, place @ v)
        forces = MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        np.testing.assert_allclose(plant.CalcInverseDynamics(context, place @ a, forces)[order], u, atol=1e-8 * scale)
        # CalcKineticEnergy leaves reflected inertia out, the mass matrix holds it.
        kinetic = 0.5 * (place @ v) @ plant.CalcMassMatrix(context) @ (place @ v)
        energy.append(kinetic + plant.CalcPotentialEnergy(context))
    # u is held from its sample to the next, so its work is exact: u times the way.
    work = np.sum(motion.u[0, :-1] * np.diff(motion.q[0], axis=0), axis=1)
    np.testing.assert_allclose(np.diff(energy), work, atol=2e-8 * scale)


CLOSED: list[tuple[str, laws.Laws, Callable[[Array, Array, Array], Array]]] = [
    ("viscous", laws.viscous(1, 0.3), lambda q, v, u: -0.3 * v),
    ("coulomb", laws.coulomb(1, 0.4), lambda q, v, u: -0.4 * np.tanh(v / 0.005)),
    (
        "asymmetric",
        laws.asymmetric_coulomb(1, 0.4, 0.1),
        lambda q, v, u: np.where(v > 0, -0.4 * np.tanh(v / 0.005), 0.1 * np.tanh(-v / 0.005)),
    ),
    (
        "stribeck",
        laws.stribeck(1, 0.2, 0.5, 0.1),
        lambda q, v, u: -(0.2 + 0.3 * np.exp(-((v / 0.1) ** 2))) * np.tanh(v / 0.005),
    ),
    (
        "load",
        laws.load_dependent(1, 0.1, 0.08),
        lambda q, v, u: -(0.1 + 0.08 * np.abs(u)) * np.tanh(v / 0.005),
    ),
    ("spring", laws.spring(1, 1.5, -0.2), lambda q, v, u: -1.5 * (q + 0.2)),
    ("ripple", laws.ripple(1, 0.3, 20.0, 0.4), lambda q, v, u: 0.3 * np.sin(20.0 * q + 0.4)),
    ("saturation", laws.saturation(1, 0.5), lambda q, v, u: np.clip(u, -0.5, 0.5) - u),
    ("gain", laws.gain_error(1, 0.9), lambda q, v, u: -0.1 * u),
    ("bias", laws.bias(1, 0.25), lambda q, v, u: 0.25 + 0.0 * u),
    (
        "dead zone",
        laws.dead_zone(1, 0.2),
        lambda q, v, u: np.where(np.abs(u) < 0.2, 0.0, u - 0.2 * np.sign(u)) - u,
    ),
]


@pytest.mark.parametrize(("name", "law", "closed"), CLOSED, ids=[row[0] for row in CLOSED])
def test_joint_law_adds_its_closed_form_at_its_joint_alone(
    robot: Robot, name: str, law: laws.Laws, closed: Callable[[Array, Array, Array], Array]
) -> None:
    motion = moved(robot, law)
    extra = added(robot, motion)
    expected = np.zeros_like(extra)
    expected[:, :, 1] = closed(motion.q[:, :, 1], motion.v[:, :, 1], motion.u[:, :, 1])
    assert np.abs(expected).max() > 0.05
    np.testing.assert_allclose(extra, expected, atol=1e-8)


def test_hard_stop_pushes_only_beyond_its_position(robot: Robot) -> None:
    free = moved(robot, laws.Laws())
    position = float(np.quantile(free.q[:, :, 1], 0.7))
    motion = moved(robot, laws.hard_stop(1, position, 40.0, 1.0, 0.5))
    extra = added(robot, motion)[:, :, 1]
    depth = motion.q[:, :, 1] - position
    expected = -np.where(depth > 0.0, np.maximum(0.0, 40.0 * depth + 0.5 * motion.v[:, :, 1]), 0.0)
    assert (depth > 0.0).any()
    np.testing.assert_allclose(extra, expected, atol=1e-8)


def test_delay_acts_exactly_late(robot: Robot) -> None:
    delay = 0.0053
    motion = moved(robot, laws.delay(1, delay))
    late = added(robot, motion)[:, :, 1] + motion.u[:, :, 1]
    index = np.floor((motion.time[0] - delay) / STEP + 1e-9).astype(int)
    np.testing.assert_allclose(late, motion.u[:, np.maximum(index, 0), 1], atol=1e-8)


def test_lag_is_first_order(robot: Robot) -> None:
    constant = 0.013
    motion = moved(robot, laws.lag(1, constant))
    acting = added(robot, motion)[:, :, 1] + motion.u[:, :, 1]
    expected = np.empty_like(acting)
    expected[:, 0] = motion.u[:, 0, 1]
    for k in range(1, acting.shape[1]):
        expected[:, k] = motion.u[:, k - 1, 1] + (expected[:, k - 1] - motion.u[:, k - 1, 1]) * np.exp(-STEP / constant)
    np.testing.assert_allclose(acting, expected, atol=1e-6)


@pytest.mark.parametrize(
    "law", [laws.elasticity(1, 400.0, 0.6), laws.backlash(1, 0.004, 900.0, 1.0)], ids=["elastic", "gap"]
)
def test_transmission_conserves_momentum_of_rotor_and_link(robot: Robot, law: laws.Laws) -> None:
    inertia = robot.joints[1].rotor_inertia
    motion = moved(robot, law, rotors={1: inertia}, samples=300)
    coupling = added(robot.replace_joint(1, rotor_inertia=0.0), motion)[:, :, 1] + motion.u[:, :, 1]
    # The rotor's path, integrated again from u and the coupling alone, must give the coupling back through its law.
    fine = 40
    step = STEP / fine
    q = motion.q[0, :, 1]
    v = motion.v[0, :, 1]
    item = law.transmissions[0]
    angle, rate = q[0] + Simulation._twist(item, motion.u[:, 0, 1])[0], 0.0
    rebuilt = []
    for k in range(len(q) - 1):
        mode = np.array([[angle - q[k] > 0.002, q[k] - angle > 0.002]])
        rebuilt.append(item.torque(np.array([angle - q[k]]), np.array([rate - v[k]]), mode)[0])
        for part in range(fine):
            share = (part + 0.5) / fine
            link = q[k] + share * STEP * v[k] + 0.5 * (share * STEP) ** 2 * motion.a[0, k, 1]
            speed = v[k] + share * (v[k + 1] - v[k])
            half = angle + 0.5 * step * rate
            mode = np.array([[half - link > 0.002, link - half > 0.002]])
            torque = item.torque(np.array([half - link]), np.array([rate - speed]), mode)[0]
            rate += step * (motion.u[0, k, 1] - torque) / inertia
            angle = half + 0.5 * step * rate
    np.testing.assert_allclose(rebuilt, coupling[0, :-1], atol=0.05 * np.abs(coupling).max())


def test_bodies_get_drag_pulse_and_plane(robot: Robot) -> None:
    link, com = 2, robot.links[2].com
    pulse = laws.disturbance(link, np.array([3.0, -2.0, 1.0]), (0.1, 0.3), 1)
    motion = moved(robot, pulse)
    extra = added(robot, motion)
    assert np.abs(extra[0]).max() < 1e-8
    inverse = ArmInverse(robot)
    k = 100
    jacobian = np.column_stack(
        [
            (
                inverse.point(motion.q[1, k] + 1e-6 * e, link, np.zeros(3))
                - inverse.point(motion.q[1, k] - 1e-6 * e, link, np.zeros(3))
            )[0]
            / 2e-6
            for e in np.eye(3)[:, None, :]
        ]
    )
    size = np.sin(np.pi * (motion.time[1, k] - 0.1) / 0.2) ** 2
    np.testing.assert_allclose(extra[1, k], jacobian.T @ (size * np.array([3.0, -2.0, 1.0])), atol=1e-6)
    dragged = moved(robot, laws.drag(link, com, 4.0))
    power = np.sum(added(robot, dragged) * dragged.v, axis=2)
    path = [inverse.point(dragged.q[b], link, com) for b in range(2)]
    speed = np.linalg.norm(np.gradient(np.stack(path), STEP, axis=1), axis=2)
    np.testing.assert_allclose(power[:, 5:-5], -4.0 * speed[:, 5:-5] ** 3, atol=3e-3 * np.abs(power).max())


@pytest.mark.parametrize(
    "law", [laws.coulomb(1, 0.4), laws.lugre(1, 0.3, 0.4, 0.05, 200.0, 0.5)], ids=["tanh", "lugre"]
)
def test_stiff_friction_converges_with_the_tolerance(robot: Robot, law: laws.Laws) -> None:
    loose, tight = moved(robot, law, tolerance=1e-8), moved(robot, law, tolerance=1e-11)
    np.testing.assert_allclose(loose.q, tight.q, atol=2e-7)
    np.testing.assert_allclose(loose.v, tight.v, atol=2e-6)
