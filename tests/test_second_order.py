"""The packaged worlds' plants are of second order in their step, whatever depends on velocities."""

import numpy as np
import pytest
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, Sine

from drake_cafim.corrected.world import AffectedRobot
from drake_cafim.diagrams.arm import add_model
from drake_cafim.dynamics.motion import motion
from drake_cafim.dynamics.tree import tree_of
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

SECONDS = 0.4
EFFECTS = {
    "none": (),
    "joint_viscous_friction": (("joint_viscous_friction", "joint2", {"coefficient": 8.0}),),
    "aerodynamic_drag": (("aerodynamic_drag", "link4", {"coefficient": 40.0}),),
    "both": (
        ("joint_viscous_friction", "joint4", {"coefficient": 2.0}),
        ("aerodynamic_drag", "link6", {"coefficient": 10.0}),
    ),
}


def arm(step: float) -> tuple[DiagramBuilder, MultibodyPlant]:
    builder = DiagramBuilder()
    plant: MultibodyPlant
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=step)
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("link0", add_model(plant, "arm7")))
    return builder, plant


def physics_with(effects: tuple[tuple[str, str, dict[str, float]], ...]) -> tuple[Physics, Physics]:
    """The arm's physics without and with the effects."""
    _, plant = arm(0.0)
    plant.Finalize()
    nominal = Physics(tree_of(plant), np.array([0.0, 0.0, -9.81]))
    return nominal, nominal.with_effects([effect_named(name)(at, values) for name, at, values in effects])


def unbalanced(physics: Physics, nominal: Physics, step: float) -> Array:
    """The effort (N, n) that the equations of motion lack at the instants of the positions, in a moving arm."""
    builder, plant = arm(step)
    affected = AffectedRobot(nominal.tree, physics)
    affected.prepare(plant)
    plant.Finalize()
    plant.SetDefaultPositions(np.array([0.3, -0.5, 0.2, -1.5, 0.1, 1.2, 0.4]))
    n = plant.num_positions()
    amplitudes = np.array([20.0, 30.0, 10.0, 15.0, 2.0, 2.0, 1.0])
    effort = builder.AddNamedSystem("effort", Sine(amplitudes, np.arange(6.0, 6.0 + n), np.arange(float(n)), True))
    builder.Connect(effort.get_output_port(0), plant.get_actuation_input_port())
    affected.connect(builder, plant, effort.get_output_port(0))
    logs = [LogVectorOutput(port, builder, step) for port in (plant.get_state_output_port(), effort.get_output_port(0))]
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(SECONDS)
    state, u = (np.array(log.FindLog(simulator.get_context()).data().T) for log in logs)
    q, v = state[:-1, :n], state[:, n:]
    middle, acceleration = 0.5 * (v[1:] + v[:-1]), np.diff(v, axis=0) / step
    moving = motion(physics.tree, q, middle)
    response = physics.free_response(moving)
    joints = [JointSamples(q[:, j], middle[:, j], u[:-1, j]) for j in range(n)]
    applied = physics.applied_at_joints(joints)[0] + moving.project(physics.body_wrenches(moving))
    needed = np.linalg.solve(response.mobility, acceleration[..., np.newaxis])[..., 0]
    return np.asarray(needed + response.bias - applied - u[:-1], dtype=float)[
        2:
    ]  # the first step has no velocity before


@pytest.mark.parametrize("effects", EFFECTS.values(), ids=EFFECTS)
def test_error_falls_with_the_square_of_the_step(effects: tuple[tuple[str, str, dict[str, float]], ...]) -> None:
    nominal, physics = physics_with(effects)
    errors = [np.abs(unbalanced(physics, nominal, step)).max(axis=0) for step in (2e-3, 1e-3)]
    felt = errors[0] > 1e-3
    assert felt.any()
    np.testing.assert_array_less(3.0, (errors[0] / errors[1])[felt])
