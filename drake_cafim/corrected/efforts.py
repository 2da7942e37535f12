"""Actuator effects as systems: the effort that is asked for goes in, the effort that acts comes out.

All are in series on the vector of all joints' efforts (n,). What remembers is sampled with a period h, the plant's
time step: its output is the mean of the acting effort over the current period, so that nothing is lost between steps.
At a sample a discrete plant's own step still lies ahead, and the effort is the new one; an integrator has arrived there
with the old one. Either way a sample is the effort of the period that the next update ends.
"""

from typing import Any

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_cafim.corrected.clock import Clock
from drake_cafim.corrected.reading import array, read, remembered
from drake_cafim.effects.actuator import ActuatorDelay, ActuatorEffect, ActuatorLag, Effort
from drake_cafim.typing import Array


class ActuatorSystem(LeafSystem):
    """An actuator effect without a memory.

    .. pydrake_system::

        name: ActuatorSystem
        input_ports: [asked]
        output_ports: [acting]

    Both (n,) N m or N, one a joint; element `joint` goes through `effect.drive`.
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
    """An actuator that is late: discrete state 0 holds its past efforts, the oldest first, NaN before there were any.

    .. pydrake_system::

        name: DelaySystem
        input_ports: [asked]
        output_ports: [acting]
    """

    def __init__(self, effect: ActuatorDelay, joint: int, joints: int, clock: Clock) -> None:
        super().__init__(effect, joint, joints)
        self._period = clock.period
        past = int(np.ceil(effect.values["delay"] / clock.period)) + 1
        clock.keep(self, np.full(past, np.nan), self._remember)

    def _past(self, context: Context) -> Array:
        return remembered(context)

    def _acting(self, context: Context, asked: float) -> float:
        past = self._past(context)
        past = past[np.isfinite(past)]
        times = array(self._period * np.arange(-len(past), 2))
        effort = Effort(times, np.concatenate([past, [asked, asked]]))
        return float(self.effect.drive(effort).means(times[-2:])[0])

    def _remember(self, context: Context) -> Array:
        asked = float(read(self.get_input_port(), context)[self._joint])
        return array(np.append(self._past(context)[1:], asked))


class LagSystem(ActuatorSystem):
    """An actuator that follows slowly: discrete state 0 is the effort that acts now, NaN before the first one.

    .. pydrake_system::

        name: LagSystem
        input_ports: [asked]
        output_ports: [acting]
    """

    def __init__(self, effect: ActuatorLag, joint: int, joints: int, clock: Clock) -> None:
        super().__init__(effect, joint, joints)
        self._period, self._constant = clock.period, effect.values["time_constant"]
        clock.keep(self, np.full(1, np.nan), self._remember)

    def _now(self, context: Context, asked: float) -> float:
        known = float(remembered(context)[0])
        return known if np.isfinite(known) else asked

    def _acting(self, context: Context, asked: float) -> float:
        # the law starts settled: at what acts now, which an effort of a moment ago has brought about
        times = array(self._period * np.array([-1.0, 0.0, 1.0]))
        effort = Effort(times, np.array([self._now(context, asked), asked, asked]))
        return float(self.effect.drive(effort).means(times[1:])[0])

    def _remember(self, context: Context) -> Array:
        asked = float(read(self.get_input_port(), context)[self._joint])
        now = self._now(context, asked)
        # τ ẏ = u − y, integrated over the period
        change = self._period * (asked - self._acting(context, asked)) / self._constant
        return array(np.array([now + change]))


def actuator_system(effect: ActuatorEffect, joint: int, joints: int, clock: Clock) -> ActuatorSystem:
    """The system of an actuator effect."""
    known: dict[type[ActuatorEffect], Any] = {ActuatorDelay: DelaySystem, ActuatorLag: LagSystem}
    kind = known.get(type(effect))
    return ActuatorSystem(effect, joint, joints) if kind is None else kind(effect, joint, joints, clock)
