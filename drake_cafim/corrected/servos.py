"""Position servos as Drake systems: from commanded positions and the joints' state to efforts."""

from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_cafim.corrected.clock import Clock
from drake_cafim.corrected.reading import array, discrete_state, read
from drake_cafim.effects.actuator import Effort
from drake_cafim.effects.servo import Servo
from drake_cafim.effects.servo_effect import ServoEffect
from drake_cafim.typing import Array


class ServoSystem(LeafSystem):
    """The efforts of all joints: those asked for directly, and those of position servos.

    .. pydrake_system::

        name: ServoSystem
        input_ports: [effort, command, read, v, gain, supply]
        output_ports: [asked]

    All (n,), one element a joint: `effort` and `asked` N m or N; `command`, and what the encoders `read`, rad or m; `v`
    rad/s or m/s; `gain` the column that kp is a multiple of; `supply` the voltage over its nominal. `effort` and
    `supply` need not be connected: 0, and 1. Without `command` the servos are switched off; `gain` is needed where a
    servo's kp is a multiple.
    """

    def __init__(self, servos: Sequence[Servo], joints: Sequence[str]) -> None:
        LeafSystem.__init__(self)
        self._servos = [(joints.index(servo.joint), servo) for servo in servos]
        for name in ("effort", "command", "read", "v", "gain", "supply"):
            self.DeclareVectorInputPort(name, len(joints))
        self.DeclareVectorOutputPort("asked", len(joints), self._calc_asked)

    def _calc_asked(self, context: Context, output: BasicVector) -> None:
        asked, command = self._given("effort", context), self._given("command", context)
        total = np.zeros(output.size()) if asked is None else asked
        if command is not None:
            q, v = (read(self.GetInputPort(name), context) for name in ("read", "v"))
            gain, supply = self._given("gain", context), self._given("supply", context)
            for j, servo in self._servos:
                if servo.column is not None and gain is None:
                    raise RuntimeError(f"kp at {servo.joint} is a multiple of {servo.column}: connect the port gain")
                factor = 1.0 if gain is None or servo.column is None else float(gain[j])
                voltage = 1.0 if supply is None else float(supply[j])
                made = servo.effort(command[j : j + 1], q[j : j + 1], v[j : j + 1], factor, voltage)
                total[j] += float(made.value[0])
        output.SetFromVector(array(total))

    def _given(self, name: str, context: Context) -> Array | None:
        port = self.GetInputPort(name)
        return read(port, context) if port.HasValue(context) else None


class CommandSystem(LeafSystem):
    """What a servo follows under an effect on its command that has a memory.

    .. pydrake_system::

        name: CommandSystem
        input_ports: [sent]
        output_ports: [followed]

    Both (n,) rad or m. Discrete state 0 holds the state of what was followed at the end of the last period, then the
    past commands, the oldest first, NaN before the first. Element `joint` of the output is the mean over the current
    period.
    """

    def __init__(self, effect: ServoEffect, joint: int, joints: int, clock: Clock) -> None:
        LeafSystem.__init__(self)
        self._effect, self._joint, self._period = effect, joint, clock.period
        self.DeclareVectorInputPort("sent", joints)
        self.DeclareVectorOutputPort("followed", joints, self._calc_followed)
        past = int(np.ceil(effect.past / clock.period)) + 1
        self._memory = len(effect.rest(0.0))
        clock.keep(self, np.full(self._memory + past, np.nan), self._update_state)

    def _signal(self, context: Context) -> Effort:
        """What is followed, from the past commands to the end of the current period."""
        now, before, sent = self._read_state(context)
        if not self._effect.past:
            return self._effect.follow_from(now, sent, self._period)
        past = before[np.isfinite(before)]
        times, values = self._period * np.arange(-len(past), 2), np.concatenate([past, [sent, sent]])
        return self._effect.follow(Effort(array(times), array(values)))

    def _read_state(self, context: Context) -> tuple[Array, Array, float]:
        """The state of what is followed, the past commands, and what is sent."""
        state = discrete_state(context)
        sent = float(read(self.get_input_port(), context)[self._joint])
        now = state[: self._memory]
        return (now if np.isfinite(now[0]) else self._effect.rest(sent)), state[self._memory :], sent

    def _calc_followed(self, context: Context, output: BasicVector) -> None:
        command = read(self.get_input_port(), context)
        command[self._joint] = self._signal(context).means(array([0.0, self._period]))[0]
        output.SetFromVector(array(command))

    def _update_state(self, context: Context) -> Array:
        now, before, sent = self._read_state(context)
        return array(np.concatenate([self._effect.after(now, sent, self._period), before[1:], [sent]]))
