"""Servos behind an actuator effect with a memory (delay, lag): their past efforts decide what acts in a simulation."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.predict.servo_input import ServoInput
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.effects.actuator import Effort
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

PAST = 0.4
"""s of past efforts that are kept: twice the longest delay in the bounds."""


def remembering(physics: Physics) -> set[int]:
    """The indices of the joints with a servo and an actuator effect that has a memory."""
    served = {servo.joint for servo in physics.servos}
    found = {e.at for e in physics.actuators if e.at in served and (e.past > 0.0 or e.settling is not None)}
    return {physics.tree.joint_index(name) for name in found}


def past_efforts(weak: WeakForm, physics: Physics, start: int, joint: int) -> Effort:
    """What the servo at `joint` asked for before the sample `start` of a recording, up to `PAST` s."""
    time = weak.samples.time
    first = min(int(np.searchsorted(time, time[start] - PAST)), max(start - 1, 0))
    stop = max(start, first + 1)
    return Effort(time[first:stop], weak.terms(physics).rows.u[first:stop, joint])


@dataclass
class ServoMemory:
    """The efforts that the servos of B simulations have asked for, by joint index, since `PAST` s before each start."""

    now: Array
    """(B,) s, the simulations' times."""
    asked: dict[int, list[Effort]]

    @classmethod
    def of(cls, forms: Sequence[tuple[WeakForm, int]], physics: Physics) -> "ServoMemory | None":
        """The memory of simulations that start at a sample of a recording each; None where no effect has one."""
        joints = remembering(physics)
        if not joints:
            return None
        begin = np.array([weak.samples.time[start] for weak, start in forms])
        past = {j: [past_efforts(weak, physics, start, j) for weak, start in forms] for j in joints}
        return cls(begin, past)

    def drive(
        self, physics: Physics, servo: ServoInput, q: Array, v: Array, duration: Array
    ) -> tuple[ServoInput, Array]:
        """The servos' inputs without those joints, and the efforts (B, n) that act there over the next `duration` s."""
        acting, on = np.zeros_like(q), servo.on.copy()
        bare = replace(physics, actuators=())
        middle = q + 0.5 * duration[:, None] * v
        asked = servo.drive(bare, middle, v, np.zeros_like(q), duration)[0]
        end = self.now + duration
        for j, efforts in self.asked.items():
            on[:, j] = 0.0
            for b in np.flatnonzero((servo.on[:, j] > 0.0) & (duration > 0.0)):
                before, until = efforts[b], end[b]
                times = np.concatenate([before.times, [self.now[b]]])
                values = np.concatenate([before.values, [asked[b, j]]])
                recent = times >= self.now[b] - PAST
                efforts[b] = Effort(times[recent], values[recent])
                effort = Effort(np.append(times[recent], until), np.append(values[recent], asked[b, j]))
                for effect in physics.actuators:
                    if effect.at == physics.tree.joints[j].name:
                        effort = effect.drive(effort)
                acting[b, j] = effort.means(np.array([self.now[b], until]))[0]
        self.now = end
        return replace(servo, on=on), acting
