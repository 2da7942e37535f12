"""Sensor effects as Drake systems: input are the true channels, output the channels as the effect distorts them.

Effects with a state are sampled with a period h: the time step of a discrete plant, or a given update period.
"""

from collections.abc import Sequence
from math import factorial
from typing import ClassVar

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_cafim.corrected.clock import Clock
from drake_cafim.corrected.reading import array, discrete_state, read
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.effects.timing import POINTS, interpolation
from drake_cafim.recordings.recording import POSE_COMPONENTS
from drake_cafim.typing import Array

LONGEST = 60.0
"""s of simulation for which a slow clock's past is stored; after that its output is the oldest stored value."""
SAME_TIME = 1e-9
"""s; two samples closer in time than this are the same sample."""


class SensorSystem(LeafSystem):
    """A sensor effect without a state.

    .. pydrake_system::

        name: SensorSystem
        input_ports: [true]
        output_ports: [measured]

    Both hold the channels `columns`; those of the effect are transformed by `effect.measured`, but for the four numbers
    of a quaternion. The Context's time is the recording's time.
    """

    turns: ClassVar[bool] = False
    """Whether quaternions are transformed as well, which are of unit length again afterwards."""

    def __init__(self, effect: SensorEffect, columns: Sequence[str]) -> None:
        LeafSystem.__init__(self)
        self.effect = effect
        on = [column for column in effect.channels(columns) if self.turns or not _of_quaternion(column)]
        self._on = np.array([list(columns).index(column) for column in on], dtype=int)
        self._quaternion = np.array([k for k, column in enumerate(columns) if _of_quaternion(column)], dtype=int)
        self.DeclareVectorInputPort("true", len(columns))
        self.DeclareVectorOutputPort("measured", len(columns), self._calc_measured)

    def _true(self, context: Context) -> Array:
        return read(self.get_input_port(), context)

    def _written(self, context: Context, true: Array) -> Array:
        """The measured values (c,) for true values (c,) of the effect's channels."""
        return array(self.effect.measured(np.array([context.get_time()]), true[None])[0])

    def _calc_measured(self, context: Context, output: BasicVector) -> None:
        channels = self._true(context)
        channels[self._on] = self._written(context, channels[self._on])
        if self.turns and len(self._quaternion):
            channels[self._quaternion] /= np.linalg.norm(channels[self._quaternion])
        output.SetFromVector(array(channels))


class ShiftedSensorSystem(SensorSystem):
    """A sensor whose output is the value of another time, interpolated from its past samples.

    .. pydrake_system::

        name: ShiftedSensorSystem
        input_ports: [true]
        output_ports: [measured]

    Discrete state 0 holds the last `past` samples (past, 1 + c) row by row, the oldest first: time s, NaN for unused
    rows, then the channels. For a time before all of them the output is the oldest sample; for a time in the future,
    as of a fast clock, it is extrapolated by the parabola through the last three samples.
    """

    turns: ClassVar[bool] = True

    def __init__(self, effect: SensorEffect, columns: Sequence[str], clock: Clock, past: int) -> None:
        super().__init__(effect, columns)
        self._shown, self._past = effect.shown, past
        clock.keep(self, np.full(past * (1 + len(self._on)), np.nan), self._update_state)

    def _samples(self, context: Context) -> Array:
        """The stored samples (past, 1 + c): time, then the channels."""
        return discrete_state(context).reshape(self._past, -1)

    def _update_state(self, context: Context) -> Array:
        now = np.concatenate([[context.get_time()], self._true(context)[self._on]])
        return array(np.concatenate([self._samples(context)[1:], now[None]]).ravel())

    def _written(self, context: Context, true: Array) -> Array:
        samples, now = self._samples(context), context.get_time()
        samples = samples[samples[:, 0] < now - SAME_TIME]
        time, channels = np.append(samples[:, 0], now), np.concatenate([samples[:, 1:], true[None]])
        [shown] = self._shown(np.array([now]))
        if shown <= now:
            return array((interpolation(time, np.array([shown])) @ channels)[0])
        parts = range(min(3, len(time)))
        series = [interpolation(time[-3:], np.array([now]), order) @ channels[-3:] for order in parts]
        powers = [(shown - now) ** order / factorial(order) for order in parts]
        return np.asarray(sum(power * term[0] for power, term in zip(powers, series, strict=True)))


class LagSensor(SensorSystem):
    """A sensor with a first-order lag.

    .. pydrake_system::

        name: LagSensor
        input_ports: [true]
        output_ports: [measured]

    Discrete state 0 holds the last two samples (2, 1 + c), the older first: time s, NaN for an unused row, then the
    channels; and after them the last output (c,).
    """

    turns: ClassVar[bool] = True

    def __init__(self, effect: SensorEffect, columns: Sequence[str], clock: Clock) -> None:
        super().__init__(effect, columns)
        self._constant = effect.settling or 0.0
        clock.keep(self, np.full(2 + 3 * len(self._on), np.nan), self._update_state)

    def _samples(self, context: Context) -> Array:
        """The stored samples (2, 1 + c): time, then the channels."""
        return discrete_state(context)[: 2 + 2 * len(self._on)].reshape(2, -1)

    def _update_state(self, context: Context) -> Array:
        true = self._true(context)[self._on]
        last = self._samples(context)[1]
        return array(np.concatenate([last, [context.get_time()], true, self._written(context, true)]))

    def _written(self, context: Context, true: Array) -> Array:
        samples, now = self._samples(context), context.get_time()
        written = discrete_state(context)[samples.size :]
        if not np.isfinite(samples[1, 0]):
            return true
        if now - samples[1, 0] < SAME_TIME:
            return written
        samples = samples[np.isfinite(samples[:, 0])]
        time, channels = np.append(samples[:, 0], now), np.concatenate([samples[:, 1:], true[None]])
        settled = self.effect.measured(time, channels)
        # `measured` starts in steady state; the deviation of the last output from it decays exponentially
        kept = np.exp((time[-2] - now) / self._constant)
        return np.asarray(settled[-1] + kept * (written - settled[-2]))


def _of_quaternion(column: str) -> bool:
    """Whether a column is one of the four numbers of a pose's quaternion."""
    return column.startswith("pose.") and column.rsplit(".", 1)[-1] in POSE_COMPONENTS[3:]


def sensor_system(effect: SensorEffect, columns: Sequence[str], clock: Clock) -> SensorSystem:
    """The system of a sensor effect: lag, time shift, or without a state."""
    if effect.settling is not None:
        return LagSensor(effect, columns, clock)
    if effect.shifts:
        late = float(np.max(LONGEST - effect.shown(np.array([LONGEST]))))
        return ShiftedSensorSystem(effect, columns, clock, POINTS + max(int(np.ceil(late / clock.period)), 0))
    return SensorSystem(effect, columns)
