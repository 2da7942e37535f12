"""Commands of position servos for a planned motion, and the servos' inputs in a simulation of it."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.predict.servo_input import ServoInput
from drake_cafim.diagnosis.rows.servo_efforts import followed
from drake_cafim.effects.actuator import Effort
from drake_cafim.errors import InputError
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


def commands_for(physics: Physics, q: Array, v: Array, u: Array) -> Array:
    """cmd = q + (u + kv v)/kp, (..., n): what the servos of `physics` make the efforts `u` (..., n) of.

    NaN at joints without a servo. Raises `InputError` where kp is a multiple of a column, which a plan does not have.
    """
    cmd = np.full_like(q, np.nan)
    for servo in physics.servos:
        if servo.column is not None:
            raise InputError(
                f"servo.kp is a multiple of the column {servo.column}, which a planned motion does not have; expected "
                "kp as a number"
            )
        j, effective = physics.tree.joint_index(servo.joint), physics.servo_at(servo.joint)
        cmd[..., j] = q[..., j] + (u[..., j] + effective.damping * v[..., j]) / effective.stiffness
    return cmd


@dataclass(frozen=True)
class ServoPlan:
    """The commands (T, B, n) of B planned motions at `time` (T,) s, NaN where no servo drives, as they are followed."""

    time: Array
    sent: Array
    followed: Array

    @classmethod
    def of(cls, physics: Physics, time: Array, sent: Array) -> "ServoPlan":
        """The plan for a robot with `physics`: its effects on commands act on those that are `sent`."""
        along = sent.copy()
        for servo in physics.servos:
            j = physics.tree.joint_index(servo.joint)
            for b in range(sent.shape[1]):
                along[:, b, j] = followed(physics, servo.joint, Effort(time, sent[:, b, j])).means(time)
        return cls(time, sent, along)

    def input(self, physics: Physics, k: int) -> ServoInput:
        """The servos' inputs from sample `k` to the next."""
        command = self.followed[k]
        on = np.isfinite(command).astype(float)
        offset, scale = np.zeros_like(command), np.ones_like(command)
        middle = np.array([0.5 * (self.time[k] + self.time[min(k + 1, len(self.time) - 1)])])
        for effect in physics.sensors:
            if effect.at.startswith("q.") and not effect.late:
                j = physics.tree.joint_index(effect.at.removeprefix("q."))
                zero, item = (float(effect.measured(middle, np.full((1, 1), x))[0, 0]) for x in (0.0, 1.0))
                scale[:, j], offset[:, j] = (item - zero) * scale[:, j], (item - zero) * offset[:, j] + zero
        ones = np.ones_like(command)
        return ServoInput(on, np.nan_to_num(command), ones, ones, scale, offset)
