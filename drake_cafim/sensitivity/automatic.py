"""Sensitivities by AutoDiffXd through the model's Drake Diagram: the reference for the other two methods."""

from functools import cached_property
from typing import Any

import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff

from drake_cafim.sensitivity.model import PlanningModel, Rollout, Start
from drake_cafim.sensitivity.system import build_diagram, set_parameters
from drake_cafim.typing import Array


class AutoDiffEvaluator:
    """Steps the model's Diagram in AutoDiffXd, one candidate after the other, without analytic derivatives."""

    def __init__(self, model: PlanningModel) -> None:
        self.model = model
        size = model.measured_motion(np.zeros((1, 2, 2 * len(model.velocity_bounds[0])))).shape[-1]
        self._motion_size = int(size)

    @cached_property
    def _diagram(self) -> Any:
        # built only once: creating Diagrams leaks memory in Drake 1.51
        return build_diagram(self.model, self._motion_size).ToAutoDiffXd()

    @cached_property
    def _context(self) -> Any:
        return self._diagram.CreateDefaultContext()

    def __call__(self, motion: Array, theta: Array, start: Start) -> Rollout:
        """Rollouts along motion (B, T·substeps + 1, nr) at θ (n,) from `start`."""
        parts = [self._single(candidate, theta, start) for candidate in motion]
        stacks = [np.stack([part[index] for part in parts]) for index in range(5)]
        return Rollout(motion[:, :: self.model.substeps], *stacks)

    def _single(self, motion: Array, theta: Array, start: Start) -> tuple[Array, ...]:
        """States, forces, measurements, their sensitivities, and those of the states, along one motion."""
        diagram, context, model = self._diagram, self._context, self.model
        seeded = InitializeAutoDiff(theta).ravel()
        set_parameters(diagram, context, seeded)
        count = len(theta)
        if model.state_size:
            shift: Array = np.zeros(count)
            first = start.state + start.sensitivity @ InitializeAutoDiff(shift).ravel()
            context.SetDiscreteState(np.asarray(first))
        states, tangents, forces, readings, slopes = [], [], [], [], []
        inputs = [diagram.get_input_port(i) for i in range(diagram.num_input_ports())]
        for index in range(len(motion)):
            inputs[0].FixValue(context, motion[index])
            if model.state_size and index % model.substeps == 0:
                x = context.get_discrete_state_vector().CopyToVector()
                states.append(ExtractValue(x).ravel())
                tangents.append(_gradient(x, count))
            if index > 0 and index % model.substeps == 0:
                forces.append(ExtractValue(diagram.GetOutputPort("contact_force").Eval(context)).ravel())
                reading = diagram.GetOutputPort("measurement").Eval(context)
                readings.append(ExtractValue(reading).ravel())
                slopes.append(_gradient(reading, count))
            if model.state_size and index + 1 < len(motion):
                inputs[1].FixValue(context, motion[index + 1])
                update = diagram.EvalUniquePeriodicDiscreteUpdate(context)
                context.SetDiscreteState(update.value(0))
        if not model.state_size:
            periods = (len(motion) - 1) // model.substeps + 1
            states = [np.zeros(0)] * periods
            tangents = [np.zeros((0, count))] * periods
        return tuple(np.stack(part) for part in (states, forces, readings, slopes, tangents))


def _gradient(values: Any, count: int) -> Array:
    """Derivatives (k, n) of AutoDiffXd values; zero for values without derivatives, which are constants."""
    gradient: Any = ExtractGradient(np.asarray(values).reshape(-1, 1))
    return np.zeros((len(values), count)) if gradient.shape[1] == 0 else np.asarray(gradient)
