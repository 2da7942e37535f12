"""The efforts of position servos along a recorded motion, with their derivatives by the measured channels."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drake_cafim.effects.actuator import Effort
from drake_cafim.effects.servo import ServoEffort
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.driving import Command
from drake_cafim.typing import Array


@dataclass(frozen=True)
class ServoMotion:
    """What the servos of one recording act on: the `commands` by joint index, and q, v (N, n) at `time` (N,) s.

    q is what the encoders read, without the delay or lag of the recording; v is the true velocity, since back-EMF acts
    at once.
    """

    time: Array
    q: Array
    v: Array
    commands: Mapping[int, Command]

    def efforts(self, physics: Physics) -> dict[int, ServoEffort]:
        """The effort of each servo at the samples, by joint index."""
        found = {}
        for j, command in self.commands.items():
            name = physics.tree.joints[j].name
            position = mean_around(followed(physics, name, command.over(self.time)), self.time)
            servo = physics.servo_at(name)
            found[j] = servo.effort(position, self.q[:, j], self.v[:, j], command.gain, command.supply)
        return found


def followed(physics: Physics, joint: str, command: Effort) -> Effort:
    """The commanded position over time that the servo at `joint` follows when `command` is sent to it."""
    for effect in physics.servo_effects:
        if effect.at == joint:
            command = effect.follow(command)
    return command


def mean_around(signal: Effort, time: Array) -> Array:
    """(N,) mean of `signal` from halfway after the sample before to halfway before the next, for each of `time` (N,) s.

    With it, the trapezoid rule integrates a staircase between the samples.
    """
    middles = 0.5 * (time[1:] + time[:-1])
    edges = np.concatenate([[2.0 * time[0] - middles[0]], middles, [2.0 * time[-1] - middles[-1]]])
    return signal.means(edges)[:-1]


def servo_key(physics: Physics) -> tuple[object, ...]:
    """All numbers that the efforts of servos and the loads from outside depend on, as a key of a cache."""
    effects = ((effect.key, *effect.values.items()) for effect in physics.servo_effects)
    contacts = (str(contact) for contact in physics.contacts)
    return (physics.servos, *effects, physics.tree.inertial_parameters.tobytes(), physics.gravity.tobytes(), *contacts)
