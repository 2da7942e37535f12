"""Tracks a commanded tool velocity: a joint reference, then Drake's inverse dynamics (computed-torque) control."""

from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.controllers import InverseDynamicsController
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import MatrixGain

from drake_cafim.diagrams.arrays import as_array
from drake_cafim.diagrams.movers import Mover
from drake_cafim.diagrams.tracking import TrackingConfig, VelocityTracking
from drake_cafim.diagrams.workspace import Workspace


@dataclass
class JointGains:
    """Stiffness (1/s²) and damping (1/s) of the joints' error dynamics; critical at damping² = 4 stiffness."""

    stiffness: float = 2500.0
    damping: float = 100.0


def add_velocity_control(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    robot: ModelInstanceIndex,
    *,
    control_plant: MultibodyPlant,
    mover: Mover,
    command_period: float,
    workspace: Workspace,
    tracking: TrackingConfig,
    gains: JointGains,
) -> None:
    """Exports the input `command` and makes the joints of `robot` follow it.

    `control_plant` is the robot alone, with all it carries, as the controller knows it. The effort is
    u = M(q)(a_d + kp (q_d − q) + kd (v_d − v)) + bias, within the model's effort limits.
    """
    reference = VelocityTracking(mover=mover, command_period=command_period, workspace=workspace, config=tracking)
    builder.AddNamedSystem("tracking", reference)
    count = control_plant.num_positions()
    controller = InverseDynamicsController(
        control_plant,
        as_array(np.full(count, gains.stiffness)),
        as_array(np.zeros(count)),
        as_array(np.full(count, gains.damping)),
        True,
    )
    builder.AddNamedSystem("joint_control", controller)
    builder.Connect(plant.get_state_output_port(robot), controller.get_input_port_estimated_state())
    _connect_efforts(builder, plant, robot, controller.get_output_port_control())
    builder.Connect(reference.GetOutputPort("desired_state"), controller.get_input_port_desired_state())
    builder.Connect(reference.GetOutputPort("desired_acceleration"), controller.get_input_port_desired_acceleration())
    builder.ExportInput(reference.GetInputPort("command"), "command")


def _connect_efforts(
    builder: DiagramBuilder, plant: MultibodyPlant, robot: ModelInstanceIndex, efforts: OutputPort
) -> None:
    """Connects the controller's efforts to the joints' actuators; brakes, which are actuators added later, get zero."""
    count, own = plant.num_actuators(robot), efforts.size()
    if count == own:
        builder.Connect(efforts, plant.get_actuation_input_port(robot))
        return
    padding = builder.AddNamedSystem("efforts", MatrixGain(as_array(np.eye(count, own))))
    builder.Connect(efforts, padding.get_input_port())
    builder.Connect(padding.get_output_port(), plant.get_actuation_input_port(robot))
