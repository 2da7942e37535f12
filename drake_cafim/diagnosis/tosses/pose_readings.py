"""What the tracker writes of a pose: sensor effects on whole arcs."""

import numpy as np

from drake_cafim.diagnosis.tosses.arcs import Arcs
from drake_cafim.diagnosis.tosses.state import State
from drake_cafim.dynamics.rotations import exponential, inverse, logarithm, product
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

AXES = ("x", "y", "z")


def axes_of(effect: SensorEffect) -> list[int]:
    """Which of x, y, z the effect is on."""
    place, _, last = effect.at.rpartition(".")
    return [AXES.index(last)] if last in AXES and place.startswith("pose.") else [0, 1, 2]


def true_times(physics: Physics, times: Array) -> Array:
    """When what is written at `times` (B, S) s happened."""
    for effect in physics.sensors:
        times = effect.shown(times)
    return times


def written(physics: Physics, arcs: Arcs, states: State) -> tuple[Array, Array]:
    """Positions (B S, 3) m and quaternions (B S, 4) that are written of the states at the samples."""
    p, quaternion = states.p, states.quaternion
    for effect in physics.sensors:
        if effect.settling is not None:
            p, quaternion = _lagging(effect, arcs, p, quaternion)
        elif not effect.shifts:
            on = axes_of(effect)
            p = p.copy()
            p[:, on] = _measured(effect, arcs, p[:, on])
    return p, quaternion


def _measured(effect: SensorEffect, arcs: Arcs, true: Array) -> Array:
    """What is written (B S, c) of `true` (B S, c); what reaches into a channel's past stays within its own arc."""
    if not effect.late:
        return effect.measured(arcs.times.ravel(), true)
    B, S = arcs.times.shape
    result = true.reshape(B, S, -1).copy()
    for b, count in enumerate(arcs.counts):
        result[b, :count] = effect.measured(arcs.times[b, :count], result[b, :count])
    return result.reshape(true.shape)


def sensor_slopes(effect: SensorEffect, arcs: Arcs, true: Array) -> Array:
    """∂written/∂strengths (B, S, c, k) where `true` (B S, c) happens, without the effect."""
    B, S = arcs.times.shape
    if not effect.late:
        return effect.columns(arcs.times.ravel(), true).reshape(B, S, true.shape[1], -1)
    result = np.zeros((B, S, true.shape[1], len(effect.strengths)))
    for b, count in enumerate(arcs.counts):
        result[b, :count] = effect.columns(arcs.times[b, :count], true.reshape(B, S, -1)[b, :count])
    return result


def written_slopes(physics: Physics, arcs: Arcs, change: Array) -> Array:
    """How what is written changes, (B, S, 6, k), with positions and rotations by `change` (B, S, 6, k)."""
    for effect in physics.sensors:
        if effect.scale != 1.0:
            change = change * np.repeat([effect.scale, 1.0], 3)[:, None]
        elif effect.settling is not None:
            change = _filtered(effect, arcs, change)
    return change


def _lagging(effect: SensorEffect, arcs: Arcs, p: Array, quaternion: Array) -> tuple[Array, Array]:
    B, S = arcs.times.shape
    late_p = _filtered(effect, arcs, p.reshape(B, S, 3)).reshape(-1, 3)
    q = quaternion.reshape(B, S, 4)
    turns = logarithm(product(q[:, 1:], inverse(q[:, :-1])))
    rolled = np.concatenate([np.zeros((B, 1, 3)), np.cumsum(turns, axis=1)], axis=1)
    behind = _filtered(effect, arcs, rolled) - rolled
    return late_p, product(exponential(behind), q).reshape(-1, 4)


def _filtered(effect: SensorEffect, arcs: Arcs, true: Array) -> Array:
    """τ ẏ = x − y over values (B, S, ...), each arc beginning as if its motion had long been what it is."""
    tau = effect.settling
    if not tau:
        return true
    steps = np.maximum(np.diff(arcs.times, axis=1), 1e-9).reshape(*arcs.times[:, 1:].shape, *[1] * (true.ndim - 2))
    kept = np.exp(-steps / tau)
    slopes = np.diff(true, axis=1) / steps
    result = np.empty_like(true)
    result[:, 0] = true[:, 0] - tau * slopes[:, 0]
    for s in range(true.shape[1] - 1):
        settled = true[:, s] - tau * slopes[:, s]
        result[:, s + 1] = settled + kept[:, s] * (result[:, s] - settled) + slopes[:, s] * steps[:, s]
    return result
