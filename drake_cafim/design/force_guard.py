"""A force limit that holds in execution: commands are cut by what measured, noisy forces say, not by the model.

Of a command, the guard lets through as much as keeps the force within the limit but for a small probability, until
the robot, which takes a while to follow, has come back from it.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.stats import norm

from drake_cafim.design.force_belief import FilterConfig, ForceBelief, predicted_forces
from drake_cafim.design.policies import attainable
from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.typing import Array


@dataclass(frozen=True)
class GuardConfig:
    """How careful the guard is."""

    probability: float = 1e-3  # of exceeding the limit, at any instant
    ramp: float = 0.05  # s, the longest that the robot takes to follow a change of command
    shares: int = 16  # parts of a command that are tried, and as many of a retreat
    instants: int = 4  # of each period at which the force is looked at
    filter: FilterConfig = field(default_factory=FilterConfig)


def guarded_command(
    model: PlanningModel, belief: ForceBelief, robot_state: Array, command: Array, limit: float, config: GuardConfig
) -> Array:
    """The command (nu,) nearest to `command` that keeps the force within `limit` N; if none does, the mildest.

    It goes from `command` to a stop, and from there to a retreat at full speed along the force that is felt now.
    Commands and forces have the same axes; what is touched does not move.
    """
    retreat = _retreat(model, belief, robot_state)
    shares = np.linspace(1.0, 0.0, config.shares)[:, np.newaxis]
    commands = np.concatenate([shares * command, (1.0 - shares[1:]) * retreat])
    # a robot that follows at once gets further in the first period, one that does not in the second
    followed = [_approach(robot_state, commands, retreat, model.period, ramp, config) for ramp in (1e-6, config.ramp)]
    risk = exceedance(model, belief, np.concatenate(followed, axis=1), limit).max(axis=-1)
    held = np.flatnonzero(risk <= config.probability)
    return attainable(model, robot_state, commands[held[0] if len(held) else np.argmin(risk)])


def exceedance(model: PlanningModel, belief: ForceBelief, robot_states: Array, limit: float) -> Array:
    """Σ_k w_k P(s_k |λ̂(θ_k)| > `limit`), (...,), at robot states (..., 2 nu)."""
    forces = np.linalg.norm(predicted_forces(model, robot_states, belief.theta), axis=-1)
    shape = (-1, *[1] * (forces.ndim - 1))
    room = limit / np.maximum(forces, 1e-9 * limit) - belief.mean.reshape(shape)
    risk = norm.sf(room / np.sqrt(belief.variance).reshape(shape))
    return np.asarray(np.tensordot(belief.weight, risk, axes=1))


def _retreat(model: PlanningModel, belief: ForceBelief, robot_state: Array) -> Array:
    """Velocity (nu,) at full speed along the force expected now; zero without one."""
    felt = (belief.weight * np.maximum(belief.mean, 0.0)) @ predicted_forces(model, robot_state, belief.theta)
    size = float(np.linalg.norm(felt))
    _, fastest = model.velocity_bounds
    return np.asarray(fastest * felt / size if size > 0 else np.zeros_like(fastest))


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
