"""Actuator effects as Drake systems: input is the commanded effort, output the acting effort.

All are in series on the vector of all joints' efforts (n,). Effects with a state are sampled with a period h, the
plant's time step: their output is the mean of the acting effort over the current period, so that the impulse is exact.
At a sample time a discrete plant has its step still ahead and uses the new effort; a continuous plant's integrator
arrives there with the old one. In both cases the output is the effort of the period that the next update ends.
"""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_cafim.corrected.clock import Clock
from drake_cafim.corrected.reading import array, discrete_state, read
from drake_cafim.effects.actuator import ActuatorEffect, Effort
from drake_cafim.typing import Array


class ActuatorSystem(LeafSystem):
    """An actuator effect without a state.

    .. pydrake_system::

        name: ActuatorSystem
        input_ports: [asked]
        output_ports: [acting]

    Both (n,) N m or N, one element per joint; element `joint` is transformed by `effect.drive`.
    """

    def __init__(self, effect: ActuatorEffect, joint: int, joints: int) -> None:
        LeafSystem.__init__(self)
        self.effect, self._joint = effect, joint
        self.DeclareVectorInputPort("asked", joints)
        self.DeclareVectorOutputPort("acting", joints, self._calc_acting)

    def _acting(self, context: Context, asked: float) -> float:
        return float(self.effect.drive(Effort(np.zeros(1), np.array([asked]))).values[0])

    def _calc_acting(self, context: Context, output: BasicVector) -> None:
        effort = read(self.get_input_port(), context)
        effort[self._joint] = self._acting(context, float(effort[self._joint]))
        output.SetFromVector(array(effort))


class DelaySystem(ActuatorSystem):
    """An actuator with a delay: discrete state 0 holds its past commands, the oldest first, NaN for those before t = 0.

    .. pydrake_system::

        name: DelaySystem
        input_ports: [asked]
        output_ports: [acting]
    """

    def __init__(self, effect: ActuatorEffect, joint: int, joints: int, clock: Clock) -> None:
        super().__init__(effect, joint, joints)
        self._period = clock.period
        past = int(np.ceil(effect.past / clock.period)) + 1
        clock.keep(self, np.full(past, np.nan), self._update_state)

    def _past(self, context: Context) -> Array:
        return discrete_state(context)

    def _acting(self, context: Context, asked: float) -> float:
        past = self._past(context)
        past = past[np.isfinite(past)]
        times = array(self._period * np.arange(-len(past), 2))
        effort = Effort(times, np.concatenate([past, [asked, asked]]))
        return float(self.effect.drive(effort).means(times[-2:])[0])

    def _update_state(self, context: Context) -> Array:
        asked = float(read(self.get_input_port(), context)[self._joint])
        return array(np.append(self._past(context)[1:], asked))


class LagSystem(ActuatorSystem):
    """An actuator with a first-order lag: discrete state 0 is the effort that acts now, NaN before the first command.

    .. pydrake_system::

        name: LagSystem
        input_ports: [asked]
        output_ports: [acting]
    """

    def __init__(self, effect: ActuatorEffect, joint: int, joints: int, clock: Clock) -> None:
        super().__init__(effect, joint, joints)
        self._period, self._constant = clock.period, effect.settling or 0.0
        clock.keep(self, np.full(1, np.nan), self._update_state)

    def _now(self, context: Context, asked: float) -> float:
        known = float(discrete_state(context)[0])
        return known if np.isfinite(known) else asked

    def _acting(self, context: Context, asked: float) -> float:
        # `drive` starts in steady state, so a piece at the acting effort, one period long, sets its initial state
        times = array(self._period * np.array([-1.0, 0.0, 1.0]))
        effort = Effort(times, np.array([self._now(context, asked), asked, asked]))
        return float(self.effect.drive(effort).means(times[1:])[0])

    def _update_state(self, context: Context) -> Array:
        asked = float(read(self.get_input_port(), context)[self._joint])
        now = self._now(context, asked)
        # τ ẏ = u − y, integrated over the period
        change = self._period * (asked - self._acting(context, asked)) / self._constant
        return array(np.array([now + change]))


def actuator_system(effect: ActuatorEffect, joint: int, joints: int, clock: Clock) -> ActuatorSystem:
    """The system of an actuator effect: lag, delay, or without a state."""
    if effect.settling is not None:
        return LagSystem(effect, joint, joints, clock)
    if effect.past > 0.0:
        return DelaySystem(effect, joint, joints, clock)
    return ActuatorSystem(effect, joint, joints)
