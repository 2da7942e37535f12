"""The force guard as a Drake system between a controller and the robot."""

from typing import Any

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteStateIndex, DiscreteValues, LeafSystem

from drake_cafim.belief import Belief
from drake_cafim.design.force_belief import ForceBelief, first_force_belief, learn
from drake_cafim.design.force_guard import GuardConfig, guarded_command
from drake_cafim.sensitivity.model import PlanningModel


class ForceGuard(LeafSystem):
    """Keeps the contact force within `limit` N for any command, allowing for errors of `model`.

    .. pydrake_system::

        name: ForceGuard
        input_ports: [command, measured_state, measured_force]
        output_ports: [command, force_belief]

    Every `model.period` it samples `measured_state` (2 nu,), position m and velocity m/s, and updates its force belief
    by `measured_force` (nλ,) N, with the noise std of `model`; `config` sets the risk. `command` (nu,) m/s passes
    through directly, reduced where necessary. `force_belief` is the belief as a vector, for a controller that plans
    with it.
    """

    def __init__(self, model: PlanningModel, limit: float, *, config: GuardConfig | None = None) -> None:
        super().__init__()
        self._model, self._limit = model, limit
        self._config = GuardConfig() if config is None else config
        axes, count = len(model.velocity_bounds[0]), self._config.filter.points
        self.DeclareVectorInputPort("command", axes)
        self.DeclareVectorInputPort("measured_state", 2 * axes)
        self.DeclareVectorInputPort("measured_force", len(model.noise_std))
        self._robot = int(self.DeclareDiscreteState(2 * axes))
        self._belief = int(self.DeclareDiscreteState(ForceBelief.vector_size(count, len(model.parameters.names))))
        self.DeclareVectorOutputPort("command", axes, self._guard)
        self.DeclareStateOutputPort("force_belief", DiscreteStateIndex(self._belief))
        self.DeclarePeriodicDiscreteUpdateEvent(model.period, 0.0, self._learn)

    @property
    def hypotheses(self) -> int:
        """Number of hypotheses in its force belief."""
        return self._config.filter.points

    def begin(self, context: Context, belief: Belief) -> None:
        """Reset the force belief in `context`, this system's context, to its prior given `belief`."""
        first = first_force_belief(self._model, belief, self._config.filter)
        state: Any = context.get_mutable_discrete_state()
        state.get_mutable_vector(self._belief).SetFromVector(first.vector())

    def _read(self, context: Context, index: int) -> Any:
        state: Any = context.get_discrete_state()
        return np.array(state.get_vector(index).get_value())

    def _force_belief(self, context: Context) -> ForceBelief:
        return ForceBelief.from_vector(self._read(context, self._belief), self._config.filter.points)

    def _learn(self, context: Context, update: DiscreteValues) -> None:
        robot, measured = (np.array(self.get_input_port(index).Eval(context)) for index in (1, 2))
        before: Any = self._force_belief(context)
        after = learn(self._model, before, robot, measured, self._limit, self._config.filter)
        written: Any = update
        written.get_mutable_vector(self._robot).SetFromVector(robot)
        written.get_mutable_vector(self._belief).SetFromVector(after.vector())

    def _guard(self, context: Context, output: BasicVector) -> None:
        command: Any = np.array(self.get_input_port(0).Eval(context))
        robot, belief = self._read(context, self._robot), self._force_belief(context)
        allowed: Any = guarded_command(self._model, belief, robot, command, self._limit, self._config)
        output.SetFromVector(allowed)
