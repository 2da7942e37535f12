"""Sensor effects on the poses of whole arcs: from true poses to those that a tracker records."""

import numpy as np

from drake_cafim.diagnosis.tosses.arcs import Arcs
from drake_cafim.dynamics.free_body_state import State
from drake_cafim.dynamics.rotations import exponential, inverse, logarithm, product
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

AXES = ("x", "y", "z")


def axes_of(effect: SensorEffect) -> list[int]:
    """Indices of the axes x, y, z that the effect acts on."""
    place, _, last = effect.at.rpartition(".")
    return [AXES.index(last)] if last in AXES and place.startswith("pose.") else [0, 1, 2]


def true_times(physics: Physics, times: Array) -> Array:
    """The times (B, S), s, of the poses that are recorded at `times` (B, S) s."""
    for effect in physics.sensors:
        times = effect.shown(times)
    return times


def measured_poses(physics: Physics, arcs: Arcs, states: State) -> tuple[Array, Array]:
    """The recorded positions (B S, 3) m and quaternions (B S, 4) of the states at the samples."""
    p, quaternion = states.p, states.quaternion
    for effect in physics.sensors:
        if effect.settling is not None:
            p, quaternion = _lag_poses(effect, arcs, p, quaternion)
        elif not effect.shifts:
            on = axes_of(effect)
            p = p.copy()
            p[:, on] = _measure_positions(effect, arcs, p[:, on])
    return p, quaternion


def _measure_positions(effect: SensorEffect, arcs: Arcs, true: Array) -> Array:
    """The recorded values (B S, c) of `true` (B S, c); an effect with a past sees that of its own arc only."""
    if not effect.late:
        return effect.measured(arcs.times.ravel(), true)
    B, S = arcs.times.shape
    result = true.reshape(B, S, -1).copy()
    for b, count in enumerate(arcs.counts):
        result[b, :count] = effect.measured(arcs.times[b, :count], result[b, :count])
    return result.reshape(true.shape)


def sensor_slopes(effect: SensorEffect, arcs: Arcs, true: Array) -> Array:
    """∂measured/∂strengths (B, S, c, k) at `true` (B S, c) and zero effect."""
    B, S = arcs.times.shape
    if not effect.late:
        return effect.columns(arcs.times.ravel(), true).reshape(B, S, true.shape[1], -1)
    result = np.zeros((B, S, true.shape[1], len(effect.strengths)))
    for b, count in enumerate(arcs.counts):
        result[b, :count] = effect.columns(arcs.times[b, :count], true.reshape(B, S, -1)[b, :count])
    return result


def measured_changes(physics: Physics, arcs: Arcs, change: Array) -> Array:
    """The change (B, S, 6, k) of the recorded poses by `change` (B, S, 6, k) of the true ones."""
    for effect in physics.sensors:
        if effect.scale != 1.0:
            change = change * np.repeat([effect.scale, 1.0], 3)[:, None]
        elif effect.settling is not None:
            change = _lag(effect, arcs, change)
    return change


def _lag_poses(effect: SensorEffect, arcs: Arcs, p: Array, quaternion: Array) -> tuple[Array, Array]:
    """Positions and quaternions after a first-order lag; a rotation lags in the sum of its small rotations."""
    B, S = arcs.times.shape
    late_p = _lag(effect, arcs, p.reshape(B, S, 3)).reshape(-1, 3)
    q = quaternion.reshape(B, S, 4)
    turns = logarithm(product(q[:, 1:], inverse(q[:, :-1])))
    rolled = np.concatenate([np.zeros((B, 1, 3)), np.cumsum(turns, axis=1)], axis=1)
    behind = _lag(effect, arcs, rolled) - rolled
    return late_p, product(exponential(behind), q).reshape(-1, 4)


def _lag(effect: SensorEffect, arcs: Arcs, true: Array) -> Array:
    """y with τ ẏ = x − y for x `true` (B, S, ...), linear between samples; y starts in the steady state of a ramp."""
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
