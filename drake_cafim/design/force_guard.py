"""A force limit that holds in execution: commands are cut by what measured, noisy forces say, not by the model.

Of a command, the guard lets through as much as keeps the force within the limit but for a small probability, until
the robot, which takes a while to follow, has come back from it.
"""

from dataclasses import dataclass, field
from functools import cache

import numpy as np
from scipy.special import ndtr

from drake_cafim.design.attainable import attainable
from drake_cafim.design.force_belief import FilterConfig, ForceBelief, magnitude, predicted_forces, sizes
from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.typing import Array


@dataclass(frozen=True)
class GuardConfig:
    """How careful the guard is."""

    # of exceeding the limit at an instant, at worst of how the robot may follow; an experiment has a hundred instants
    probability: float = 0.001
    ramp: float = 0.02  # s, the longest that the robot takes to follow a change of command
    shares: int = 12  # parts of a command that are tried, and as many of a retreat
    instants: int = 4  # of each period at which the force is looked at
    filter: FilterConfig = field(default_factory=FilterConfig)


def guarded_command(
    model: PlanningModel, belief: ForceBelief, robot_state: Array, command: Array, limit: float, config: GuardConfig
) -> Array:
    """What the robot can do of `guarded_commands` for one `robot_state` (2 nu,) and `command` (nu,)."""
    states, commands = robot_state[np.newaxis], command[np.newaxis]
    return attainable(model, robot_state, guarded_commands(model, belief, states, commands, limit, config)[0])


def guarded_commands(
    model: PlanningModel, belief: ForceBelief, robot_states: Array, commands: Array, limit: float, config: GuardConfig
) -> Array:
    """Commands (B, nu) nearest to `commands` that keep the force within `limit` N; where none does, the mildest.

    From robot states (B, 2 nu). What goes against the force that may be met is taken away first, so that sliding along
    it remains; then the rest; then it retreats along that force, up to full speed. Commands and forces have the same
    axes; what is touched does not move.
    """
    away = _away(model, belief, robot_states, commands, limit, config)
    pushed = np.any(away, axis=1)
    if not pushed.any():
        return commands
    less = np.arange(config.shares)[:, np.newaxis] / max(config.shares - 1, 1)
    against = np.minimum(np.einsum("bi,bi->b", commands, away), 0.0)[:, np.newaxis] * away
    sliding = commands - against
    _, fastest = model.velocity_bounds
    retreat = fastest * away
    tried = np.concatenate(
        [
            commands[:, np.newaxis] - less * against[:, np.newaxis],
            (1.0 - less[1:]) * sliding[:, np.newaxis],
            less[1:] * retreat[:, np.newaxis],
        ],
        axis=1,
    )
    # a robot that follows at once gets further in the first period, one that does not in the second
    before, after = robot_states[:, np.newaxis], retreat[:, np.newaxis]
    followed = _approach(before, tried, after, model.period, (1e-6, config.ramp), config)
    risk = exceedance(model, belief, followed, limit).max(axis=-1)
    held = risk <= config.probability
    best = np.where(held.any(axis=1), held.argmax(axis=1), risk.argmin(axis=1))
    chosen = tried[np.arange(len(tried)), best]
    return np.where(pushed[:, np.newaxis], chosen, commands)


def exceedance(model: PlanningModel, belief: ForceBelief, robot_states: Array, limit: float) -> Array:
    """P(|λ| > `limit`), (...,), at robot states (..., 2 nu)."""
    mean, variance = magnitude(belief, predicted_forces(model, robot_states, belief.theta), limit)
    risk = ndtr((mean - limit) / np.sqrt(np.maximum(variance, 1e-12 * limit**2)))
    return np.asarray(belief.weight @ risk.reshape(len(risk), -1)).reshape(risk.shape[1:])


def _away(
    model: PlanningModel, belief: ForceBelief, robot_states: Array, commands: Array, limit: float, config: GuardConfig
) -> Array:
    """Unit vectors (B, nu) along the forces expected on the ways of `commands`; zero where none is possible."""
    before, onwards = robot_states[:, np.newaxis], commands[:, np.newaxis]
    way = _approach(before, onwards, onwards, model.period, (1e-6,), config)[:, 0]
    forces = predicted_forces(model, np.concatenate([before, way], axis=1), belief.theta)
    mean, variance = magnitude(belief, forces, limit)
    size = sizes(forces)
    # as strong as it may be: a hypothesis that has been felt to push little turns the robot little
    strong = np.maximum(mean, 0.0) + np.sqrt(variance)
    gain = np.divide(strong, size, out=np.zeros_like(size), where=size > 0)
    expected = np.einsum("m,mbs,mbsi->bi", belief.weight, gain, forces)
    length = sizes(expected)[:, np.newaxis]
    return np.asarray(np.divide(expected, length, out=np.zeros_like(expected), where=length > 0))


def _approach(
    robot_states: Array, commands: Array, retreat: Array, period: float, ramps: tuple[float, ...], config: GuardConfig
) -> Array:
    """States (B, N, 2·instants·R, 2 nu) of a robot that ramps to each command in a period, to `retreat` in the next.

    From robot states (B, 1, 2 nu) to commands (B, N, nu), then to retreat (B, 1 or N, nu); it takes `ramps`
    (R,) s for a change, one after the other.
    """
    size = commands.shape[-1]
    elapsed, moved, changed = _ramps(period, ramps, config.instants)
    position = robot_states[:, :, np.newaxis, np.newaxis, :size]
    velocity = robot_states[:, :, np.newaxis, np.newaxis, size:]
    states = np.empty((*commands.shape[:2], len(ramps), 2, config.instants, 2 * size))
    for number, target in enumerate((commands, retreat)):
        change = target[:, :, np.newaxis, np.newaxis] - velocity
        states[..., number, :, :size] = position + velocity * elapsed + change * moved
        states[..., number, :, size:] = velocity + change * changed
        position, velocity = states[..., number, -1:, :size], states[..., number, -1:, size:]
    return states.reshape(*commands.shape[:2], -1, 2 * size)


@cache
def _ramps(period: float, ramps: tuple[float, ...], instants: int) -> tuple[Array, Array, Array]:
    """Elapsed times (instants, 1) of a period, s, and after each ramp (R, instants, 1) what of a change has come about.

    Of position, as a time by which to multiply the change of velocity, s, and of velocity, from 0 to 1.
    """
    elapsed = np.arange(1, instants + 1) / instants * period
    ramp = np.minimum(ramps, period)[:, np.newaxis]
    inside = np.minimum(elapsed, ramp)
    moved = 0.5 * inside**2 / ramp + (elapsed - inside)
    return elapsed[:, np.newaxis], moved[..., np.newaxis], (inside / ramp)[..., np.newaxis]
