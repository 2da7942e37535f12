"""Sensitivities by central differences of whole rollouts, without derivatives of the model."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.sensitivity.model import PlanningModel, Rollout, Start
from drake_cafim.typing import Array


@dataclass(frozen=True)
class FiniteDifferenceEvaluator:
    """Central differences in θ with steps `relative_step` · max(|prior mean|, |θ|) for each parameter."""

    model: PlanningModel
    relative_step: float = 1e-5

    def __call__(self, motion: Array, theta: Array, start: Start) -> Rollout:
        """Rollouts along motion (B, T·substeps + 1, nr) at θ (n,) from `start`, by 2 n + 1 predictions."""
        middle = predict(self.model, motion, theta, start.state)
        steps = self.relative_step * np.maximum(np.abs(self.model.parameters.mean), np.abs(theta))
        slopes, tangents = [], []
        for index, step in enumerate(steps):
            shift = np.zeros_like(theta)
            shift[index] = step
            ahead, behind = (
                predict(self.model, motion, theta + sign * shift, start.state + sign * start.sensitivity @ shift)
                for sign in (1.0, -1.0)
            )
            slopes.append((ahead.measurements - behind.measurements) / (2.0 * step))
            tangents.append((ahead.states - behind.states) / (2.0 * step))
        return Rollout(
            middle.motion,
            middle.states,
            middle.forces,
            middle.measurements,
            np.stack(slopes, axis=-1),
            np.stack(tangents, axis=-1),
        )


def predict(model: PlanningModel, motion: Array, theta: Array, state: Array) -> Rollout:
    """The rollout without sensitivities, along motion (B, T·substeps + 1, nr) from states (nx,) or (B, nx).

    Scalar-generic in θ and the state.
    """
    ends = motion[:, :: model.substeps]
    none = np.zeros(())
    if model.state_size == 0:
        moved = ends[:, 1:]
        x = np.zeros((*moved.shape[:2], 0))
        force = model.contact(x, moved, theta)
        reading = model.measurement(x, moved, force, theta)
        return Rollout(ends, np.zeros((*ends.shape[:2], 0)), force, reading, none, none)
    x = np.broadcast_to(state, (motion.shape[0], model.state_size))
    force = model.contact(x, motion[:, 0], theta)
    states, forces, readings = [x], [], []
    for index in range(1, motion.shape[1]):
        x = model.step(x, motion[:, index - 1], motion[:, index], force, theta)
        force = model.contact(x, motion[:, index], theta)
        if index % model.substeps == 0:
            states.append(x)
            forces.append(force)
            readings.append(model.measurement(x, motion[:, index], force, theta))
    trail, force_trail, readings_trail = (np.stack(part, axis=1) for part in (states, forces, readings))
    return Rollout(ends, trail, force_trail, readings_trail, none, none)
