"""A force limit that holds in execution: commands are cut by what measured, noisy forces say, not by the model.

Of a command, the guard lets through as much as keeps the force within the limit but for a small probability, until
the robot, which takes a while to follow, has come back from it.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtr

from drake_cafim.design.force_belief import FilterConfig, ForceBelief, magnitude, predicted_forces
from drake_cafim.design.policies import attainable
from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.typing import Array


@dataclass(frozen=True)
class GuardConfig:
    """How careful the guard is."""

    probability: float = 0.01  # of exceeding the limit at an instant, at worst of how the robot may follow
    planned: float = 0.85  # of the limit, within which plans behind the guard keep the force that they expect
    ramp: float = 0.02  # s, the longest that the robot takes to follow a change of command
    shares: int = 12  # parts of a command that are tried, and as many of a retreat
    instants: int = 4  # of each period at which the force is looked at
    filter: FilterConfig = field(default_factory=FilterConfig)


def guarded_command(
    model: PlanningModel, belief: ForceBelief, robot_state: Array, command: Array, limit: float, config: GuardConfig
) -> Array:
    """The command (nu,) nearest to `command` that keeps the force within `limit` N; if none does, the mildest.

    What goes against the force that may be met is taken away first, so that sliding along it remains; then the
    rest; then it retreats along that force, up to full speed. Commands and forces have the same axes; what is
    touched does not move.
    """
    away = _away(model, belief, robot_state, command, limit, config)
    if not np.any(away):
        return attainable(model, robot_state, command)
    less = np.linspace(0.0, 1.0, config.shares)[:, np.newaxis]
    against = min(float(command @ away), 0.0) * away
    sliding = command - against
    _, fastest = model.velocity_bounds
    retreat = fastest * away
    commands = np.concatenate([command - less * against, (1.0 - less[1:]) * sliding, less[1:] * retreat])
    # a robot that follows at once gets further in the first period, one that does not in the second
    followed = [_approach(robot_state, commands, retreat, model.period, ramp, config) for ramp in (1e-6, config.ramp)]
    risk = exceedance(model, belief, np.concatenate(followed, axis=1), limit).max(axis=-1)
    held = np.flatnonzero(risk <= config.probability)
    return attainable(model, robot_state, commands[held[0] if len(held) else np.argmin(risk)])


def exceedance(model: PlanningModel, belief: ForceBelief, robot_states: Array, limit: float) -> Array:
    """P(|λ| > `limit`), (...,), at robot states (..., 2 nu)."""
    mean, variance = magnitude(belief, predicted_forces(model, robot_states, belief.theta), limit)
    risk = ndtr((mean - limit) / np.sqrt(np.maximum(variance, 1e-12 * limit**2)))
    return np.asarray(np.tensordot(belief.weight, risk, axes=1))


def _away(
    model: PlanningModel, belief: ForceBelief, robot_state: Array, command: Array, limit: float, config: GuardConfig
) -> Array:
    """Unit vector (nu,) along the force that is expected on the way of `command`; zero where none is possible."""
    way = _approach(robot_state, command[np.newaxis], command, model.period, 1e-6, config)[0]
    forces = predicted_forces(model, np.concatenate([robot_state[np.newaxis], way]), belief.theta)
    mean, variance = magnitude(belief, forces, limit)
    size = np.linalg.norm(forces, axis=-1)
    # as strong as it may be: a hypothesis that has been felt to push little turns the robot little
    strong = np.maximum(mean, 0.0) + np.sqrt(variance)
    gain = np.divide(strong, size, out=np.zeros_like(size), where=size > 0)
    felt = np.einsum("m,ms,msi->i", belief.weight, gain, forces)
    length = float(np.linalg.norm(felt))
    return np.asarray(felt / length if length > 0 else felt)


def _approach(
    robot_state: Array, commands: Array, retreat: Array, period: float, ramp: float, config: GuardConfig
) -> Array:
    """States (N, 2·instants, 2 nu) of a robot that ramps to each command in a period, and to `retreat` in the next."""
    size = commands.shape[-1]
    elapsed = (np.arange(1, config.instants + 1) / config.instants * period)[:, np.newaxis]
    ramp = min(ramp, period)
    position, velocity = (np.tile(part, (len(commands), 1)) for part in (robot_state[:size], robot_state[size:]))
    states = []
    for target in (commands, np.tile(retreat, (len(commands), 1))):
        change = (target - velocity)[:, np.newaxis]
        inside = np.minimum(elapsed, ramp)
        v = velocity[:, np.newaxis] + change * inside / ramp
        p = position[:, np.newaxis] + velocity[:, np.newaxis] * elapsed
        p = p + change * (0.5 * inside**2 / ramp + (elapsed - inside))
        states.append(np.concatenate([p, v], axis=-1))
        position, velocity = p[:, -1], v[:, -1]
    return np.concatenate(states, axis=1)
