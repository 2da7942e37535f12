"""Differential inverse kinematics: joint velocities for a tool velocity, of an arm and of the jaws of a gripper."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.inverse_kinematics import (
    DifferentialInverseKinematicsParameters,
    DifferentialInverseKinematicsStatus,
    DoDifferentialInverseKinematics,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame

from drake_cafim.diagrams.arrays import as_array
from drake_cafim.typing import Array


class Mover(Protocol):
    """A robot whose tool is moved along nu coordinates by n joints."""

    @property
    def q_start(self) -> Array:
        """Start posture (n,)."""
        ...

    @property
    def coordinates(self) -> int:
        """Number nu of the tool's coordinates."""
        ...

    def position(self, q: Array) -> Array:
        """The tool's coordinates (nu,) m at the posture q (n,)."""
        ...

    def joint_velocity(self, q: Array, velocity: Array) -> Array:
        """Joint velocities (n,) that move the tool with `velocity` (nu,) m/s at the posture q (n,)."""
        ...


class ArmMover:
    """A tool frame T moves along `axes`, rows of unit vectors in W (nu, 3), counted from `origin` (3,) m in W.

    Along other directions and in orientation it stays as at `q_start`. The position and velocity limits of `plant`
    are kept: where they would be exceeded, the tool moves more slowly in the same direction.
    """

    def __init__(
        self,
        *,
        plant: MultibodyPlant,
        tool: Frame,
        axes: Array,
        origin: Array,
        q_start: Sequence[float],
        period: float,
        hold_gain: float = 10.0,
        centering_gain: float = 0.5,
    ) -> None:
        """`hold_gain` (1/s) corrects drift along held directions, `centering_gain` (1/s) drift of the null space."""
        self._plant, self._tool, self._axes, self._origin, self._hold_gain = plant, tool, axes, origin, hold_gain
        self._context = plant.CreateDefaultContext()
        self._q_start = as_array(q_start)
        self._X_WT_start = self._pose(self._q_start)
        self._held = np.eye(3) - axes.T @ axes
        self._parameters = _limits(plant, self._q_start, period, centering_gain)

    @property
    def q_start(self) -> Array:
        return self._q_start

    @property
    def coordinates(self) -> int:
        return len(self._axes)

    def position(self, q: Array) -> Array:
        return as_array(self._axes @ (as_array(self._pose(q).translation()) - self._origin))

    def joint_velocity(self, q: Array, velocity: Array) -> Array:
        """Joint velocities (n,) by Drake's `DoDifferentialInverseKinematics`; zero where it finds no solution."""
        X_WT = self._pose(q)
        drift: Array = as_array(self._X_WT_start.translation()) - as_array(X_WT.translation())
        turn = rotation_error(X_WT.rotation(), self._X_WT_start.rotation())
        gain = self._hold_gain
        wanted = np.concatenate([gain * turn, self._axes.T @ velocity + gain * self._held @ drift])
        result = DoDifferentialInverseKinematics(self._plant, self._context, wanted, self._tool, self._parameters)
        if result.status == DifferentialInverseKinematicsStatus.kNoSolutionFound:
            return np.zeros(self._plant.num_velocities())
        return as_array(result.joint_velocities)

    def _pose(self, q: Array) -> RigidTransform:
        self._plant.SetPositions(self._context, q)
        return self._tool.CalcPoseInWorld(self._context)


class JawMover:
    """Two jaws that mirror each other; the coordinate is each jaw's distance m from the middle, as its joint's."""

    def __init__(self, start: float) -> None:
        self._start = start

    @property
    def q_start(self) -> Array:
        return as_array([self._start, self._start])

    @property
    def coordinates(self) -> int:
        return 1

    def position(self, q: Array) -> Array:
        return as_array(q[:1])

    def joint_velocity(self, q: Array, velocity: Array) -> Array:
        return as_array(np.repeat(velocity, 2))


def rotation_error(R_WT: RotationMatrix, R_WD: RotationMatrix) -> Array:
    """Rotation vector (3,) in W, rad, that turns frame T onto the desired D."""
    turn = (R_WD @ R_WT.transpose()).ToAngleAxis()
    return as_array(turn.angle() * turn.axis())


def _limits(
    plant: MultibodyPlant, q_nominal: Array, period: float, centering_gain: float
) -> DifferentialInverseKinematicsParameters:
    parameters = DifferentialInverseKinematicsParameters(plant.num_positions(), plant.num_velocities())
    parameters.set_time_step(period)
    parameters.set_nominal_joint_position(q_nominal)
    parameters.set_joint_position_limits((plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()))
    parameters.set_joint_velocity_limits((plant.GetVelocityLowerLimits(), plant.GetVelocityUpperLimits()))
    parameters.set_joint_centering_gain(as_array(centering_gain * np.eye(plant.num_positions())))
    return parameters
