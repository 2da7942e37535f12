"""A force limit that holds in execution, from measured, noisy forces, though the model may be wrong.

The guard does not believe the model: under each of a few hypotheses θ_k about the parameters, the true force is
s_k λ̂(θ_k), with a gain s_k ~ N(1, `gain_std`²) at first that every measured force corrects. Of a command it lets
through as much as keeps (ŝ_k + z σ_k) |λ̂(θ_k)| within the limit under every hypothesis, until the robot, which takes
a while to follow, has come back from it.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from drake_cafim.belief import Belief
from drake_cafim.design.policies import attainable
from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.typing import Array


@dataclass(frozen=True)
class GuardConfig:
    """How careful the guard is."""

    probability: float = 1e-4  # of exceeding the limit, at any one period and under any one hypothesis
    spread: float = 2.0  # belief stds away from its mean at which the hypotheses are
    gain_std: float = 0.5  # of the true force over the predicted one, before any was felt
    drift: float = 0.5  # 1/√s, std of the gain's random walk after a second
    ramp: float = 0.02  # s, the longest that the robot takes to follow a change of command
    shares: int = 31  # parts of a command that are tried, from all of it to a retreat
    instants: int = 4  # of each period at which the force is looked at

    @property
    def z(self) -> float:
        return float(norm.ppf(1.0 - self.probability))


@dataclass(frozen=True)
class Gains:
    """True force over the predicted one under each hypothesis: mean and variance, (m,) each."""

    mean: Array
    variance: Array


def hypotheses(model: PlanningModel, belief: Belief, spread: float) -> Array:
    """The mean of the belief and ± `spread` std along its principal axes, (2n + 1, n), inside the bounds."""
    values, axes = np.linalg.eigh(belief.covariance)
    reach = spread * (np.sqrt(np.maximum(values, 0.0)) * axes).T
    points = np.concatenate([belief.mean[np.newaxis], belief.mean + reach, belief.mean - reach])
    return np.stack([model.parameters.clip(point) for point in points])


def first_gains(count: int, config: GuardConfig) -> Gains:
    """Before any force was felt."""
    return Gains(np.ones(count), np.full(count, config.gain_std**2))


def learn_gains(
    gains: Gains, predicted: Array, measured: Array, noise_std: Array, period: float, config: GuardConfig
) -> Gains:
    """The gains a period later: a random walk, corrected by `measured` (ny,) = s_k `predicted` (m, ny) + noise.

    Where no force is predicted, the gain is less certain by a period; never less than at first.
    """
    variance = np.minimum(gains.variance + config.drift**2 * period, config.gain_std**2)
    whitened = predicted / noise_std
    after = 1.0 / (1.0 / variance + (whitened**2).sum(axis=-1))
    innovation = measured / noise_std - gains.mean[:, np.newaxis] * whitened
    return Gains(gains.mean + after * (whitened * innovation).sum(axis=-1), after)


def guarded_command(
    model: PlanningModel,
    points: Array,
    gains: Gains,
    robot_state: Array,
    command: Array,
    limit: float,
    config: GuardConfig,
) -> Array:
    """The command (nu,) nearest to `command` that keeps the force within `limit` N; if none does, the mildest.

    It goes from `command` to a retreat at full speed along the force that is felt now, or to a stop where none is.
    Commands and forces have the same axes; what is touched does not move. `points` (m, n) are the hypotheses.
    """
    retreat = _retreat(model, points, gains, robot_state)
    shares = np.linspace(1.0, 0.0, config.shares)[:, np.newaxis]
    commands = shares * command + (1.0 - shares) * retreat
    # a robot that follows at once gets further in the first period, one that does not in the second
    followed = [_approach(robot_state, commands, retreat, model.period, ramp, config) for ramp in (1e-6, config.ramp)]
    states = np.concatenate(followed, axis=1)
    upper = np.maximum(gains.mean, 0.0) + config.z * np.sqrt(gains.variance)
    forces = np.stack([np.linalg.norm(contact_force(model, states, point), axis=-1).max(axis=-1) for point in points])
    worst = (upper[:, np.newaxis] * forces).max(axis=0)
    held = np.flatnonzero(worst <= limit)
    return attainable(model, robot_state, commands[held[0] if len(held) else np.argmin(worst)])


def contact_force(model: PlanningModel, robot_states: Array, theta: Array) -> Array:
    """λ (..., nλ) N of a model whose touched thing does not move, at robot states (..., 2 nu)."""
    return model.contact(np.zeros((*robot_states.shape[:-1], 0)), robot_states, theta)


def _retreat(model: PlanningModel, points: Array, gains: Gains, robot_state: Array) -> Array:
    """Velocity (nu,) at full speed along the force felt now, averaged over hypotheses; zero without one."""
    felt = np.maximum(gains.mean, 0.0) @ np.stack([contact_force(model, robot_state, point) for point in points])
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
