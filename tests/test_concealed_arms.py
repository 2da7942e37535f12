"""The maker's arms against Drake and against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from concealed import laws
from concealed.excitation import desired
from concealed.mujoco_arm import ArmInverse, ArmPlant
from concealed.robots import Robot, random_arm
from concealed.simulate import Motion, Simulation
from concealed.urdf import arm_urdf
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

STEP = 0.002


def drake_plant(robot: Robot) -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(arm_urdf(robot), "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    return plant


def moved(
    robot: Robot, extra: laws.Laws, seed: int, samples: int = 250, rotors: dict[int, float] | None = None, tolerance: float = 1e-8
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
    time = np.tile(STEP * np.arange(samples), (2, 1))

    def command(k, q, v):
        return feedforward[:, k] + inertia * (25.0 * (goal.q[:, k] - q) + 8.0 * (goal.v[:, k] - v))

    return simulation.run(time, goal.q[:, 0], goal.v[:, 0], command)


@pytest.mark.parametrize(("size", "branched"), [(2, False), (3, False), (6, True), (7, False), (7, True)])
def test_null_agrees_with_drake_inverse_dynamics_and_energy(size: int, branched: bool) -> None:
    robot = random_arm(np.random.default_rng(size + branched), size, branched)
    motion = moved(robot, laws.Laws(), seed=size)
    plant = drake_plant(robot)
    context = plant.CreateDefaultContext()
    order = [plant.GetJointByName(joint.name).velocity_start() for joint in robot.joints]
    # The nominal plant's own rotor inertia does not enter CalcInverseDynamics.
    rotor = np.array([joint.rotor_inertia for joint in robot.joints])
    energy, scale = [], np.abs(motion.u).max()
    for q, v, a, u in zip(motion.q[0], motion.v[0], motion.a[0], motion.u[0], strict=True):
        for values, setter in ((q, plant.SetPositions), (v, plant.SetVelocities)):
            ordered = np.zeros(size)
            ordered[order] = values
            setter(context, ordered)
        known = np.zeros(size)
        known[order] = a
        forces = plant.MakeMultibodyForces(plant) if hasattr(plant, "MakeMultibodyForces") else None
        if forces is None:
            from pydrake.multibody.tree import MultibodyForces

            forces = MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        torque = plant.CalcInverseDynamics(context, known, forces)[order] + 0.0
        reflected = torque if _includes_rotors(plant, context, rotor) else torque + rotor * a
        np.testing.assert_allclose(reflected, u, atol=1e-8 * scale)
        energy.append(plant.CalcKineticEnergy(context) + plant.CalcPotentialEnergy(context) + _rotor_energy(plant, context, rotor, v))
    work = np.sum(motion.u[0, :-1] * np.diff(motion.q[0], axis=0), axis=1)
    np.testing.assert_allclose(np.diff(energy), work, atol=2e-8 * scale)


def _includes_rotors(plant: MultibodyPlant, context, rotor: np.ndarray) -> bool:
    """Whether Drake's mass matrix holds the rotors (it does, and inverse dynamics with it)."""
    mass = plant.CalcMassMatrix(context)
    unit = np.zeros(len(rotor))
    unit[0] = 1.0
    from pydrake.multibody.tree import MultibodyForces

    forces = MultibodyForces(plant)
    plant.CalcForceElementsContribution(context, forces)
    at_rest = plant.CalcInverseDynamics(context, np.zeros(len(rotor)), forces)
    return bool(np.isclose(plant.CalcInverseDynamics(context, unit, forces)[0] - at_rest[0], mass[0, 0]))


def _rotor_energy(plant: MultibodyPlant, context, rotor: np.ndarray, v: np.ndarray) -> float:
    """What Drake's kinetic energy leaves out: half v M v minus its own figure."""
    own = 0.5 * plant.GetVelocities(context) @ plant.CalcMassMatrix(context) @ plant.GetVelocities(context)
    return float(own - plant.CalcKineticEnergy(context))
