"""The force guard as a system between a controller and what it commands."""

from typing import Any

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from drake_cafim.belief import Belief
from drake_cafim.design.force_guard import (
    Gains,
    GuardConfig,
    contact_force,
    first_gains,
    guarded_command,
    hypotheses,
    learn_gains,
)
from drake_cafim.sensitivity.model import PlanningModel


class ForceGuard(LeafSystem):
    """Keeps the contact force within `limit` N, whatever is commanded and though `model` may be wrong.

    .. pydrake_system::

        name: ForceGuard
        input_ports: [command, measured_state, measured_force, belief]
        output_ports: [command]

    Every `model.period` it keeps `measured_state` (2 nu,), position m and velocity m/s, and learns from
    `measured_force` (nλ,) N, with the noise that `model` states. `belief` (n + n²,) is mean, then covariance;
    `config` says how careful to be. `command` (nu,) m/s passes through at once, as much of it as may.
    """

    def __init__(self, model: PlanningModel, limit: float, *, config: GuardConfig | None = None) -> None:
        super().__init__()
        self._model, self._limit = model, limit
        self._config = GuardConfig() if config is None else config
        self._names = model.parameters.names
        size, axes = len(self._names), len(model.velocity_bounds[0])
        self._count = 2 * size + 1
        self.DeclareVectorInputPort("command", axes)
        self.DeclareVectorInputPort("measured_state", 2 * axes)
        self.DeclareVectorInputPort("measured_force", len(model.noise_std))
        self.DeclareVectorInputPort("belief", size + size**2)
        self._robot = int(self.DeclareDiscreteState(2 * axes))
        self._belief = int(self.DeclareDiscreteState(size + size**2))
        self._gains = int(self.DeclareDiscreteState(2 * self._count))
        self.DeclareVectorOutputPort("command", axes, self._guard)
        self.DeclarePeriodicDiscreteUpdateEvent(model.period, 0.0, self._learn)

    def begin_experiment(self, context: Context) -> None:
        """Forget in `context` (this system's own) what was felt: nothing is touched yet."""
        first = first_gains(self._count, self._config)
        state: Any = context.get_mutable_discrete_state()
        state.get_mutable_vector(self._gains).SetFromVector(np.concatenate([first.mean, first.variance]))

    def _points(self, belief: Any) -> Any:
        return hypotheses(self._model, Belief.from_vector(self._names, belief), self._config.spread)

    def _read(self, context: Context, index: int) -> Any:
        state: Any = context.get_discrete_state()
        return np.array(state.get_vector(index).get_value())

    def _learn(self, context: Context, update: DiscreteValues) -> None:
        inputs: list[Any] = [np.array(self.get_input_port(index).Eval(context)) for index in (1, 2, 3)]
        robot, measured, belief = inputs
        predicted = np.stack([contact_force(self._model, robot, point) for point in self._points(belief)])
        before = Gains(*np.split(self._read(context, self._gains), 2))
        after = learn_gains(before, predicted, measured, self._model.noise_std, self._model.period, self._config)
        written: Any = update
        written.get_mutable_vector(self._robot).SetFromVector(robot)
        written.get_mutable_vector(self._belief).SetFromVector(belief)
        written.get_mutable_vector(self._gains).SetFromVector(np.concatenate([after.mean, after.variance]))

    def _guard(self, context: Context, output: BasicVector) -> None:
        command: Any = np.array(self.get_input_port(0).Eval(context))
        allowed: Any = guarded_command(
            self._model,
            self._points(self._read(context, self._belief)),
            Gains(*np.split(self._read(context, self._gains), 2)),
            self._read(context, self._robot),
            command,
            self._limit,
            self._config,
        )
        output.SetFromVector(allowed)
