"""What position servos get during a simulation: commands, gains and supply by interval; and the efforts they make."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from drake_cafim.diagnosis.rows.servo_efforts import followed
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.effects.actuator import ActuatorEffect, Effort
from drake_cafim.effects.servo import drive_servos
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Indices

DIFFERENCE = 1e-6
"""N m (N), step by which the slope of an actuator effect is taken."""


@dataclass(frozen=True)
class ServoInput:
    """The inputs of the servos in B simulations, (B, n) each, n joints; `on` is 0 where no servo drives a joint.

    `command` rad (m), `gain` and `supply` as in `Servo.effort`; the encoder reads `scale` q + `offset`.
    """

    on: Array
    command: Array
    gain: Array
    supply: Array
    scale: Array
    offset: Array

    def at(self, index: Indices) -> "ServoInput":
        """The inputs of the simulations with these indices, which may repeat."""
        return ServoInput(*(getattr(self, field.name)[index] for field in fields(self)))

    def padded(self, length: int) -> "ServoInput":
        """The inputs repeated to `length` rows by their last one; where there is none, no servo is on."""
        if not len(self.on):  # a window of one sample, as before a gap
            idle = np.ones((length, self.on.shape[1]))
            return ServoInput(0.0 * idle, *[idle] * 5)
        return self.at(np.minimum(np.arange(length), len(self.on) - 1))

    def drive(self, physics: Physics, q: Array, v: Array, effort: Array, duration: Array) -> tuple[Array, Array]:
        """The acting efforts (B, n) beside `effort`, and their slope in v for a step of `duration` (B,) s.

        The actuator effects act on the sum. A step from velocity v moves q by ½ h v within its first half, so that the
        slope in q enters that in v times ½ h.
        """
        inputs = (np.ascontiguousarray(getattr(self, field.name)) for field in fields(self))
        total, slope = drive_servos(*physics.servo_numbers, *inputs, q, v, np.ascontiguousarray(effort), duration)
        for j in {physics.tree.joint_index(effect.at) for effect in physics.actuators if _acts_at_once(effect)}:
            driven = self.on[:, j] > 0.0
            acting, ahead = (_after(physics, j, total[:, j] + step) for step in (0.0, DIFFERENCE))
            slope[:, j] *= np.where(driven, (ahead - acting) / DIFFERENCE, 1.0)
            total[:, j] = np.where(driven, acting, total[:, j])
        return total, slope


def _acts_at_once(effect: ActuatorEffect) -> bool:
    return not effect.past and effect.settling is None


def _after(physics: Physics, joint: int, effort: Array) -> Array:
    """The efforts (B,) after the actuator effects at a joint that have no memory."""
    for effect in physics.actuators:
        if effect.at == physics.tree.joint_names[joint] and _acts_at_once(effect):
            effort = effect.drive(Effort(np.arange(len(effort), dtype=float), effort)).values
    return effort


def stacked(inputs: Sequence[ServoInput]) -> list[ServoInput]:
    """For each interval of several simulations of equal length, the inputs of all of them."""
    together = [np.stack([getattr(item, field.name) for item in inputs], axis=1) for field in fields(ServoInput)]
    return [ServoInput(*(part[k] for part in together)) for k in range(len(inputs[0].on))]


def joined(inputs: Sequence[ServoInput]) -> ServoInput:
    """The inputs of several recordings, one after the other."""
    return ServoInput(*(np.concatenate([getattr(item, field.name) for item in inputs]) for field in fields(ServoInput)))


def goals_of(weak: WeakForm, physics: Physics) -> dict[int, Effort]:
    """The commanded position over time that each servo follows in one recording, by the joint's index."""
    samples, names = weak.samples, physics.tree.joint_names
    return {j: followed(physics, names[j], sent.over(samples.time)) for j, sent in samples.commands.items()}


def servo_input(weak: WeakForm, physics: Physics, goals: Mapping[int, Effort], edges: Array) -> ServoInput:
    """The inputs over each of the intervals between `edges` (K + 1,) s of one recording, (K, n).

    `goals` are those of `goals_of`.
    """
    samples, n = weak.samples, weak.joints
    time, count = samples.time, len(edges) - 1
    sample = np.clip(np.searchsorted(time, edges[:-1] + 1e-12, side="right") - 1, 0, len(time) - 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    on, command, offset = (np.zeros((count, n)) for _ in range(3))
    gain, supply, scale = (np.ones((count, n)) for _ in range(3))
    for j, sent in samples.commands.items():
        name = physics.tree.joints[j].name
        on[:, j] = 1.0
        command[:, j] = goals[j].means(edges)[:-1]
        gain[:, j], supply[:, j] = sent.gain[sample], sent.supply[sample]
        for effect in physics.sensors:
            if effect.at == f"q.{name}" and not effect.late:
                zero = effect.measured(middle, np.zeros((count, 1)))[:, 0]
                slope = effect.measured(middle, np.ones((count, 1)))[:, 0] - zero
                scale[:, j], offset[:, j] = slope * scale[:, j], slope * offset[:, j] + zero
    return ServoInput(on, command, gain, supply, scale, offset)
