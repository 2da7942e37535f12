"""Actuator effects as systems: the effort that is asked for goes in, the effort that acts comes out.

All are in series on the vector of all joints' efforts (n,). What remembers is sampled with a period h, the plant's
time step: its output is the mean of the acting effort from now until h later, so that nothing is lost between steps.
"""

from typing import Any

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from drake_cafim.corrected.reading import array, read, remembered
from drake_cafim.effects.actuator import ActuatorDelay, ActuatorEffect, ActuatorLag, Effort
from drake_cafim.typing import Array


class HeldEffort(LeafSystem):
    """An effort held from sample to sample, beside a continuous plant; before the first sample it passes through.

    .. pydrake_system::

        name: HeldEffort
        input_ports: [asked]
        output_ports: [held]

    Both (n,) N m or N; discrete state 0 is the last sample, NaN before there was one.
    """

    def __init__(self, joints: int, period: float) -> None:
        LeafSystem.__init__(self)
        self.DeclareVectorInputPort("asked", joints)
        self.DeclareVectorOutputPort("held", joints, self._calc_held)
        self.DeclareDiscreteState(array(np.full(joints, np.nan)))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._sample)

    def _calc_held(self, context: Context, output: BasicVector) -> None:
        sample = remembered(context)
        output.SetFromVector(array(sample if np.isfinite(sample[0]) else read(self.get_input_port(), context)))

    def _sample(self, context: Context, values: DiscreteValues) -> None:
        values.set_value(0, array(read(self.get_input_port(), context)))


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

    def __init__(self, effect: ActuatorDelay, joint: int, joints: int, period: float) -> None:
        super().__init__(effect, joint, joints)
        self._period = period
        past = int(np.ceil(effect.values["delay"] / period)) + 1
        self.DeclareDiscreteState(array(np.full(past, np.nan)))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._remember)

    def _past(self, context: Context) -> Array:
        return remembered(context)

    def _acting(self, context: Context, asked: float) -> float:
        past = self._past(context)
        past = past[np.isfinite(past)]
        times = array(self._period * np.arange(-len(past), 2))
        effort = Effort(times, np.concatenate([past, [asked, asked]]))
        return float(self.effect.drive(effort).means(times[-2:])[0])

    def _remember(self, context: Context, values: DiscreteValues) -> None:
        asked = float(read(self.get_input_port(), context)[self._joint])
        values.set_value(0, array(np.append(self._past(context)[1:], asked)))


class LagSystem(ActuatorSystem):
    """An actuator that follows slowly: discrete state 0 is the effort that acts now, NaN before the first one.

    .. pydrake_system::

        name: LagSystem
        input_ports: [asked]
        output_ports: [acting]
    """

    def __init__(self, effect: ActuatorLag, joint: int, joints: int, period: float) -> None:
        super().__init__(effect, joint, joints)
        self._period, self._constant = period, effect.values["time_constant"]
        self.DeclareDiscreteState(array(np.full(1, np.nan)))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._remember)

    def _now(self, context: Context, asked: float) -> float:
        known = float(remembered(context)[0])
        return known if np.isfinite(known) else asked

    def _acting(self, context: Context, asked: float) -> float:
        # the law starts settled: at what acts now, which an effort of a moment ago has brought about
        times = array(self._period * np.array([-1.0, 0.0, 1.0]))
        effort = Effort(times, np.array([self._now(context, asked), asked, asked]))
        return float(self.effect.drive(effort).means(times[1:])[0])

    def _remember(self, context: Context, values: DiscreteValues) -> None:
        asked = float(read(self.get_input_port(), context)[self._joint])
        now = self._now(context, asked)
        # τ ẏ = u − y, integrated over the period
        change = self._period * (asked - self._acting(context, asked)) / self._constant
        values.set_value(0, array(np.array([now + change])))


def actuator_system(effect: ActuatorEffect, joint: int, joints: int, period: float) -> ActuatorSystem:
    """The system of an actuator effect."""
    known: dict[type[ActuatorEffect], Any] = {ActuatorDelay: DelaySystem, ActuatorLag: LagSystem}
    kind = known.get(type(effect))
    return ActuatorSystem(effect, joint, joints) if kind is None else kind(effect, joint, joints, period)


def remembers(effect: ActuatorEffect) -> bool:
    """Whether the effect needs a period."""
    return isinstance(effect, ActuatorDelay | ActuatorLag)
