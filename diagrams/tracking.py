"""A commanded end-effector velocity, turned into a joint reference by differential inverse kinematics."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.inverse_kinematics import (
    DifferentialInverseKinematicsParameters,
    DifferentialInverseKinematicsStatus,
    DoDifferentialInverseKinematics,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from drake_cafim.diagrams.arrays import as_array
from drake_cafim.diagrams.workspace import Workspace
from drake_cafim.typing import Array


@dataclass
class TrackingConfig:
    """How the arm's reference follows a commanded velocity."""

    period: float = 0.005  # s, of the differential inverse kinematics
    ramp: float = 0.05  # s, over which a new command is reached, linearly
    # beyond it the wrist of the arm with a hand saturates (12 N m)
    acceleration: float = 15.0  # m/s², the most by which the commanded velocity changes, in each coordinate
    delay: float = 0.0005  # s, of the update after the planner's, so that it reads the command of this moment
    hold_gain: float = 10.0  # 1/s, pulls the held directions and the orientation back
    centering_gain: float = 0.5  # 1/s, pulls the redundant motion to the start posture


@dataclass(frozen=True)
class Reference:
    """A joint reference: positions rad, velocities rad/s, accelerations rad/s², each (n,)."""

    q: Array
    v: Array
    a: Array

    def after(self, elapsed: float) -> "Reference":
        """The reference `elapsed` s later at constant acceleration."""
        q = self.q + elapsed * self.v + 0.5 * elapsed**2 * self.a
        return Reference(q=q, v=self.v + elapsed * self.a, a=self.a)


def rotation_error(R_WT: RotationMatrix, R_WD: RotationMatrix) -> Array:
    """Rotation vector (3,) in W, rad, that turns frame T onto the desired D."""
    turn = (R_WD @ R_WT.transpose()).ToAngleAxis()
    return np.asarray(turn.angle() * turn.axis())


class VelocityTracking(LeafSystem):
    """Joint reference that moves a tool frame T with the commanded velocity and holds everything else.

    .. pydrake_system::

        name: VelocityTracking
        input_ports: [command]
        output_ports: [desired_state, desired_acceleration]

    `command` (nu,) m/s is the velocity along `axes`, rows of unit vectors in W (nu, 3). The other directions and
    the orientation stay where `q_start` has them. The joint limits of `plant` (positions, velocities) hold: what
    they forbid slows the tool down and does not turn it aside (`DoDifferentialInverseKinematics`).
    The command is cut at the `workspace`, whose coordinates count from `origin` (3,) m in W, and smoothed by
    `config`. Discrete state: q, v, a (n,) each, which hold from the last update on at constant acceleration; the
    tool's velocity (nu,) at the end of that period, at the last command, and the command; the number of updates.
    """

    def __init__(
        self,
        *,
        plant: MultibodyPlant,
        tool: Frame,
        axes: Array,
        origin: Array,
        q_start: Sequence[float],
        command_period: float,
        workspace: Workspace,
        config: TrackingConfig,
    ) -> None:
        LeafSystem.__init__(self)
        self._origin, self._workspace, self._command_period = origin, workspace, command_period
        self._plant, self._tool, self._axes, self._config = plant, tool, np.asarray(axes, dtype=float), config
        self._context = plant.CreateDefaultContext()
        self._q_start = np.asarray(q_start, dtype=float)
        self._steps_per_command = round(command_period / config.period)
        self._parameters = make_parameters(plant, self._q_start, config)
        self._X_WT_start = self._pose(self._q_start)
        self._held = np.eye(3) - self._axes.T @ self._axes
        n, nu = plant.num_positions(), len(self._axes)
        self._slices = np.split(np.arange(3 * n + 3 * nu + 1), np.cumsum([n, n, n, nu, nu, nu]))
        start = np.concatenate([self._q_start, np.zeros(2 * n + 3 * nu + 1)])
        self.DeclareDiscreteState(as_array(start))
        self.DeclareVectorInputPort("command", nu)
        # no input is asked of these two, or the loop through the plant would look algebraic
        sources = {self.xd_ticket(), self.time_ticket()}
        self.DeclareVectorOutputPort("desired_state", 2 * n, self._calc_desired_state, sources)
        self.DeclareVectorOutputPort("desired_acceleration", n, self._calc_desired_acceleration, sources)
        self.DeclarePeriodicDiscreteUpdateEvent(config.period, config.delay, self._update)

    def _pose(self, q: Array) -> RigidTransform:
        self._plant.SetPositions(self._context, q)
        return self._tool.CalcPoseInWorld(self._context)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        state = context.get_discrete_state_vector().CopyToVector()
        now, before, target, count = (state[part] for part in self._slices[3:])
        period, tick = self._config.period, round(float(count[0]))
        begin = self._reference(state).after(period if tick > 0 else 0.0)
        if tick % self._steps_per_command == 0:
            before, target = now, self._cut_command(context, begin.q, now)
        share = min(1.0, (tick % self._steps_per_command + 1) * period / self._config.ramp)
        most = self._config.acceleration * period
        now = now + np.clip(before + share * (target - before) - now, -most, most)
        end = self.joint_velocity(begin.q, now)
        acceleration = (end - begin.v) / period
        values.set_value(as_array(np.concatenate([begin.q, begin.v, acceleration, now, before, target, [tick + 1.0]])))

    def _cut_command(self, context: Context, q: Array, velocity: Array) -> Array:
        command = as_array(self.get_input_port().Eval(context))
        position = self._axes @ (as_array(self._pose(q).translation()) - self._origin)
        return self._workspace.allowed(command, position, velocity, period=self._command_period, ramp=self._config.ramp)

    def joint_velocity(self, q: Array, velocity: Array) -> Array:
        """Joint velocities (n,) rad/s that move the tool with `velocity` (nu,) m/s along the axes; 0 if none do."""
        X_WT = self._pose(q)
        drift: Array = as_array(self._X_WT_start.translation()) - as_array(X_WT.translation())
        turn = rotation_error(X_WT.rotation(), self._X_WT_start.rotation())
        gain = self._config.hold_gain
        wanted = np.concatenate([gain * turn, self._axes.T @ velocity + gain * self._held @ drift])
        result = DoDifferentialInverseKinematics(self._plant, self._context, wanted, self._tool, self._parameters)
        if result.status == DifferentialInverseKinematicsStatus.kNoSolutionFound:
            return np.zeros(self._plant.num_velocities())
        return np.asarray(result.joint_velocities)

    def _reference(self, state: Array) -> Reference:
        q, v, a = (state[part] for part in self._slices[:3])
        return Reference(q=q, v=v, a=a)

    def _now(self, context: Context) -> Reference:
        state = context.get_discrete_state_vector().CopyToVector()
        last = max(float(state[self._slices[-1]][0]) - 1.0, 0.0) * self._config.period
        return self._reference(state).after(context.get_time() - last)

    def _calc_desired_state(self, context: Context, output: BasicVector) -> None:
        reference = self._now(context)
        output.SetFromVector(as_array(np.concatenate([reference.q, reference.v])))

    def _calc_desired_acceleration(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._now(context).a)


def make_parameters(
    plant: MultibodyPlant, q_nominal: Array, config: TrackingConfig
) -> DifferentialInverseKinematicsParameters:
    """Limits of `plant` and the redundancy's pull towards `q_nominal`, for Drake's differential IK."""
    parameters = DifferentialInverseKinematicsParameters(plant.num_positions(), plant.num_velocities())
    parameters.set_time_step(config.period)
    parameters.set_nominal_joint_position(q_nominal)
    parameters.set_joint_position_limits((plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()))
    parameters.set_joint_velocity_limits((plant.GetVelocityLowerLimits(), plant.GetVelocityUpperLimits()))
    parameters.set_joint_centering_gain(as_array(config.centering_gain * np.eye(plant.num_positions())))
    return parameters
