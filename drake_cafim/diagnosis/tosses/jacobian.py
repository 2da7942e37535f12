"""Derivatives of the arcs' whitened rows by a model's parameters, from one simulation of the arcs."""

from collections.abc import Sequence

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.tosses.free_body import FreeBody
from drake_cafim.diagnosis.tosses.pose_readings import axes_of, sensor_slopes
from drake_cafim.diagnosis.tosses.simulated_arcs import Shot
from drake_cafim.dynamics.free_body_state import State
from drake_cafim.dynamics.rotations import rotation_matrices
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.kinds import ByKind
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array, Indices


def number_columns(scene: Scene, shot: Shot, model: Model) -> Array:
    """∂rows/∂vector (B, S, 6, n) by the model's unknowns and strengths, at fixed initial states of the arcs.

    A parameter of the motion changes accelerations and landings by central differences, which the tangent then
    propagates; a sensor effect has analytic slopes.
    """
    vector = model.vector
    sizes = [*(0.01 * scene.priors.std), *_sizes(model)]
    by_sensors: dict[int, Array] = {}
    by_motion: list[tuple[int, Array, Array]] = []
    sensors = _sensor_positions(model)
    for index, size in enumerate(sizes):
        if index in sensors:
            effect, k = sensors[index]
            by_sensors[index] = sensor_rows(shot, effect)[..., k]
            continue
        ahead, behind = vector.copy(), vector.copy()
        ahead[index] += size
        behind[index] -= size
        up, down = model.at(ahead), model.at(behind)
        # a model may keep a parameter within its bounds, so that the step differs from 2 size
        width = float(up.vector[index] - down.vector[index])
        change, deeper = difference(shot, up.physics(scene), down.physics(scene))
        by_motion.append((index, change / width, deeper / width))
    result = np.zeros((*shot.flights.shape, 6, len(vector)))
    if by_motion:
        rows = force_rows(shot, [change for _, change, _ in by_motion], [deeper for _, _, deeper in by_motion])
        for k, (index, _, _) in enumerate(by_motion):
            result[..., index] = rows[..., k]
    for index, column in by_sensors.items():
        result[..., index] = column
    return result


def _sizes(model: Model) -> list[float]:
    """Finite steps of the model's strengths."""
    sizes = []
    for effect in model.effects:
        for strength in effect.strengths:
            own = abs(effect.values[strength.name])
            typical = own if strength.inverse else strength.typical
            sizes.append(max(effect.difference_step, 1e-3) * (typical if typical > 0.0 else 1.0))
    return sizes


class _Sensor(ByKind[SensorEffect | None]):
    """The effect if it is one of a sensor, else None."""

    def other(self, effect: Effect) -> None:
        return None

    def sensor(self, effect: SensorEffect) -> SensorEffect:
        return effect


_SENSOR = _Sensor()


def _sensor_positions(model: Model) -> dict[int, tuple[SensorEffect, int]]:
    """By index in the model's vector: the sensor effect of that strength, and the strength's index in it."""
    found: dict[int, tuple[SensorEffect, int]] = {}
    index = len(model.unknown)
    for effect in model.effects:
        sensor = _SENSOR(effect)
        for k in range(len(effect.strengths)):
            if sensor is not None:
                found[index] = (sensor, k)
            index += 1
    return found


def difference(shot: Shot, up: Physics, down: Physics) -> tuple[Array, Array]:
    """Under `up` minus under `down`: the acceleration (F, 6), and the depth (E,) m of the points that land."""
    ahead, behind = FreeBody(up), FreeBody(down)
    tangent = shot.tangent
    remembers = ahead.touch_points.memory > 0 or behind.touch_points.memory > 0
    change = tangent.acceleration(ahead, shot.recall_memory(ahead) if remembers else None)
    change = change - tangent.acceleration(behind, shot.recall_memory(behind) if remembers else None)
    landed = tangent.landings
    deeper = np.zeros(len(landed.row))
    if len(landed.row):
        state = shot.flights.fine.state[landed.row]
        deeper = np.asarray(_depth(ahead, state, landed.point) - _depth(behind, state, landed.point))
    return change, deeper


def _depth(body: FreeBody, state: State, point: Indices) -> Array:
    """The depth (E,) m of one point of each state below the plane."""
    contact = body.contact
    assert contact is not None
    lever = body.touch_points.levers(rotation_matrices(state.quaternion))[np.arange(len(point)), :, point]
    return np.asarray((contact.point - state.p - lever) @ contact.normal)


def force_rows(shot: Shot, changes: Sequence[Array], deeper: Sequence[Array]) -> Array:
    """The change (B, S, 6, k) of the whitened rows by k added accelerations (F, 6) and depths (E,) m at landing."""
    B = shot.flights.shape[0]
    initial = np.zeros((B, 12, len(changes)))
    moved = shot.tangent.propagate(initial, np.stack(changes, axis=-1), np.stack(deeper, axis=-1))
    return shot.slopes(moved)


def sensor_rows(shot: Shot, effect: SensorEffect) -> Array:
    """∂rows/∂strengths (B, S, 6, k) of a sensor effect."""
    B, S = shot.flights.shape
    states, times = shot.flights.at_samples, shot.arcs.times
    change = np.zeros((B, S, 6, len(effect.strengths)))
    motion = np.concatenate([states.v, states.w], axis=1).reshape(B, S, 6)
    if effect.shifts:
        for k, step in enumerate(effect.directions()):
            behind = times if step.behind is None else effect.with_values(step.behind).shown(times)
            later = (effect.with_values(step.ahead).shown(times) - behind) / step.size
            # an arc's first sample defines its initial state: only the shift relative to it shows
            change[..., k] = (later - later[:, :1])[..., None] * motion
    elif effect.settling is not None:
        change[..., 0] = -motion
    else:
        on = axes_of(effect)
        change[:, :, on] = sensor_slopes(effect, shot.arcs, states.p[:, on])
    return shot.whiten(change)
