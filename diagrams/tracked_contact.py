"""Sensitivities through a robot that follows its commands by joint control and is pushed back by what it touches.

AutoDiffXd goes through the whole Diagram: the MultibodyPlant, its inverse dynamics control, the planner's contact law.
Beyond the partial derivative of the contact force by θ, which the other evaluators compute along a given motion, there
is what θ does to the motion: dy/dθ = ∂λ/∂θ + ∂λ/∂r · dr/dθ.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody
from pydrake.systems.analysis import Simulator_
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_cafim.diagrams.arrays import as_array
from drake_cafim.diagrams.control import JointGains, add_velocity_control
from drake_cafim.diagrams.movers import Mover
from drake_cafim.diagrams.planner_contact import PlannerContact, TouchedPoint
from drake_cafim.diagrams.tracking import TrackingConfig
from drake_cafim.diagrams.workspace import Workspace
from drake_cafim.diagrams.world import export_tool_state
from drake_cafim.sensitivity.model import PlanningModel, Rollout, Start
from drake_cafim.typing import Array

APPROACH = 20
"""Steps in which the posture of a start is found from the robot's own start posture."""


@dataclass(frozen=True)
class TrackedRobot:
    """A scenario's robot with its control, of which `build` makes the Diagram with a planning model's contact.

    `add` adds the robot to a plant, without geometry that collides, and returns its instance, the tool's body and the
    points where the contact force acts. The tool's point p_BT (3,) m moves along `axes` (nu, 3), measured from `origin`
    (3,) in W.
    """

    time_step: float  # s
    add: Callable[[MultibodyPlant], tuple[ModelInstanceIndex, RigidBody, Sequence[TouchedPoint]]]
    control_plant: MultibodyPlant
    mover: Mover
    p_BT: Array
    axes: Array
    origin: Array
    workspace: Workspace
    tracking: TrackingConfig
    gains: JointGains

    def build(self, model: PlanningModel) -> Diagram:
        """The Diagram, convertible to AutoDiffXd: the world `model` without sensor noise and concealed effects.

        .. pydrake_system::

            name: tracked_contact
            input_ports: [command]
            output_ports: [measured_state, contact_force]

        θ is numeric parameter 0 of its subsystem `planner_contact`.
        """
        builder = DiagramBuilder()
        plant = MultibodyPlant(self.time_step)
        builder.AddNamedSystem("plant", plant)
        instance, tool, points = self.add(plant)
        plant.Finalize()
        plant.SetDefaultPositions(instance, as_array(self.mover.q_start))
        add_velocity_control(
            builder,
            plant,
            instance,
            control_plant=self.control_plant,
            mover=self.mover,
            command_period=model.period,
            workspace=self.workspace,
            tracking=self.tracking,
            gains=self.gains,
        )
        state = export_tool_state(builder, plant, tool, p_BT=self.p_BT, axes=self.axes, origin=self.origin)
        law = PlannerContact(model, model.parameters.mean, coordinates=len(self.axes), points=points)
        builder.AddNamedSystem("planner_contact", law)
        builder.Connect(state.get_output_port(), law.get_input_port())
        builder.Connect(law.GetOutputPort("spatial_forces"), plant.get_applied_spatial_force_input_port())
        builder.ExportOutput(law.GetOutputPort("contact_force"), "contact_force")
        diagram: Diagram = builder.Build()
        diagram.set_name("tracked_contact")
        return diagram


class TrackedEvaluator:
    """Simulates the robot's Diagram under the commands of each motion, by default in AutoDiffXd.

    A motion's commands are the velocities at the ends of its periods. The robot begins at rest on its reference: the
    posture that its control reaches at the motion's first position, without a contact's deflection. Rollouts hold the
    motion that the robot makes, which is not the given one. For models of a fixed environment (no state).
    """

    def __init__(self, robot: TrackedRobot, model: PlanningModel) -> None:
        self.robot, self.model = robot, model

    @cached_property
    def _double(self) -> Diagram:
        return self.robot.build(self.model)

    @cached_property
    def _automatic(self) -> Any:
        return self._double.ToAutoDiffXd()

    def __call__(self, motion: Array, theta: Array, start: Start) -> Rollout:
        """Rollouts under the commands of motion (B, T + 1, nr) at θ (n,)."""
        axes = motion.shape[-1] // 2
        begin: dict[bytes, Array] = {}
        parts = []
        for candidate in motion[:, :: self.model.substeps]:
            key = candidate[0].tobytes()
            if key not in begin:
                begin[key] = self._posture(candidate[0, :axes])
            parts.append(self.simulate(candidate[0], candidate[1:, axes:], theta, begin[key]))
        motions, forces, readings, slopes = (np.stack([part[index] for part in parts]) for index in range(4))
        count, length = motions.shape[:2]
        nothing = np.zeros((count, length, 0))
        return Rollout(motions, nothing, forces, readings, slopes, np.zeros((count, length, 0, len(theta))))

    def simulate(
        self, robot_state: Array, commands: Array, theta: Array, q: Array, *, automatic: bool = True
    ) -> tuple[Array, Array, Array, Array]:
        """Tool states (T+1, nr), forces (T, nλ), measurements (T, ny) and their sensitivities (T, ny, n).

        From posture q (n,) and `robot_state` (nr,) under commands (T, nu) m/s. Without `automatic` in plain numbers,
        the sensitivities then being zero.
        """
        system: Any = self._automatic if automatic else self._double
        seeded: Any = InitializeAutoDiff(theta).ravel() if automatic else theta
        simulator = Simulator_[AutoDiffXd if automatic else float](system)
        context = simulator.get_mutable_context()
        self._set_start(system, context, robot_state, q)
        law = system.GetSubsystemByName("planner_contact")
        law.GetMyMutableContextFromRoot(context).get_mutable_numeric_parameter(0).SetFromVector(seeded)
        ports = [system.GetOutputPort(name) for name in ("measured_state", "contact_force")]
        motion, forces, readings, slopes = [_values(ports[0].Eval(context))], [], [], []
        for number, command in enumerate(commands):
            system.get_input_port().FixValue(context, command)
            simulator.AdvanceTo((number + 1) * self.model.period)
            moved, force = (np.asarray(port.Eval(context)) for port in ports)
            reading = self.model.measurement(np.zeros(0), moved, force, seeded)
            motion.append(_values(moved))
            forces.append(_values(force))
            readings.append(_values(reading))
            slopes.append(_slopes(reading, len(theta)))
        return np.array(motion), np.array(forces), np.array(readings), np.array(slopes)

    def _posture(self, position: Array) -> Array:
        """The joints (n,) at which the control holds the tool at `position` (nu,) m, from the start posture on."""
        mover = self.robot.mover
        q, step = np.array(mover.q_start), 0.05  # s, slow beside the corrections of the mover
        for left in range(APPROACH, 0, -1):
            q = q + step * mover.joint_velocity(q, (position - mover.position(q)) / (left * step))
        for _ in range(3):
            q = q + step * mover.joint_velocity(q, (position - mover.position(q)) / step)
        return q

    def _set_start(self, system: Any, context: Any, robot_state: Array, q: Array) -> None:
        mover, axes = self.robot.mover, len(self.robot.axes)
        speed = robot_state[axes:]
        v = mover.joint_velocity(q, speed)
        context.SetTime(0.0)
        plant = system.GetSubsystemByName("plant")
        plant.SetPositionsAndVelocities(plant.GetMyMutableContextFromRoot(context), np.concatenate([q, v]))
        tracking = system.GetSubsystemByName("tracking")
        reference = np.concatenate([q, v, np.zeros(len(q)), speed, speed, speed, [0.0]])
        tracking.GetMyMutableContextFromRoot(context).SetDiscreteState(reference)


def _values(values: Any) -> Array:
    plain = np.asarray(values)
    return np.asarray(ExtractValue(plain).ravel() if plain.dtype == object else np.array(plain))


def _slopes(values: Any, count: int) -> Array:
    """Derivatives (k, n) of AutoDiffXd values; zero for those without, which are constants."""
    plain = np.asarray(values)
    gradient: Any = ExtractGradient(plain.reshape(-1, 1)) if plain.dtype == object else np.zeros((len(plain), 0))
    return np.zeros((len(plain), count)) if gradient.shape[1] == 0 else np.asarray(gradient)
