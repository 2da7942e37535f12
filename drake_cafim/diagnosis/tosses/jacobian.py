"""How the arcs' rows change with each number of a model, from one simulation of them."""

from collections.abc import Sequence

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.tosses.free_body import FreeBody
from drake_cafim.diagnosis.tosses.pose_readings import axes_of, sensor_slopes
from drake_cafim.diagnosis.tosses.simulated_arcs import Shot
from drake_cafim.diagnosis.tosses.state import State
from drake_cafim.dynamics.rotations import rotation_matrices
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.kinds import ByKind
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array, Indices


def number_columns(scene: Scene, shot: Shot, model: Model) -> Array:
    """Whitened rows (B, S, 6, n) by the model's unknowns and strengths, the arcs' beginnings held."""
    vector = model.vector
    sizes = [*(0.01 * scene.priors.std), *_sizes(model)]
    sensed: dict[int, Array] = {}
    pushed: list[tuple[int, Array, Array]] = []
    sensors = _sensor_positions(model)
    for index, size in enumerate(sizes):
        if index in sensors:
            effect, k = sensors[index]
            sensed[index] = sensor_rows(shot, effect)[..., k]
            continue
        ahead, behind = vector.copy(), vector.copy()
        ahead[index] += size
        behind[index] -= size
        up, down = model.at(ahead), model.at(behind)
        taken = float(up.vector[index] - down.vector[index])
        change, deeper = difference(shot, up.physics(scene), down.physics(scene))
        pushed.append((index, change / taken, deeper / taken))
    result = np.zeros((*shot.flights.shape, 6, len(vector)))
    if pushed:
        rows = force_rows(shot, [one[1] for one in pushed], [one[2] for one in pushed])
        for k, (index, _, _) in enumerate(pushed):
            result[..., index] = rows[..., k]
    for index, column in sensed.items():
        result[..., index] = column
    return result


def _sizes(model: Model) -> list[float]:
    """Finite steps of the strengths."""
    sizes = []
    for effect in model.effects:
        for strength in effect.strengths:
            own = abs(effect.values[strength.name])
            typical = own if strength.inverse else strength.typical
            sizes.append(max(effect.difference_step, 1e-3) * (typical if typical > 0.0 else 1.0))
    return sizes


class _Sensor(ByKind[SensorEffect | None]):
    def other(self, effect: Effect) -> None:
        return None

    def sensor(self, effect: SensorEffect) -> SensorEffect:
        return effect


_SENSOR = _Sensor()


def _sensor_positions(model: Model) -> dict[int, tuple[SensorEffect, int]]:
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
    """By how much two physics accelerate the body differently, (F, 6), and land its points deeper, (E,) m."""
    ahead, behind = FreeBody(up), FreeBody(down)
    tangent = shot.tangent
    remembers = ahead.touch_points.memory > 0 or behind.touch_points.memory > 0
    change = tangent.acceleration(ahead, shot.recalled(ahead) if remembers else None)
    change = change - tangent.acceleration(behind, shot.recalled(behind) if remembers else None)
    landed = tangent.landings
    deeper = np.zeros(len(landed.row))
    if len(landed.row):
        state = shot.flights.fine.state[landed.row]
        deeper = np.asarray(_depth(ahead, state, landed.point) - _depth(behind, state, landed.point))
    return change, deeper


def _depth(body: FreeBody, state: State, point: Indices) -> Array:
    contact = body.contact
    assert contact is not None
    lever = body.touch_points.levers(rotation_matrices(state.quaternion))[np.arange(len(point)), :, point]
    return np.asarray((contact.point - state.p - lever) @ contact.normal)


def force_rows(shot: Shot, changes: Sequence[Array], deeper: Sequence[Array]) -> Array:
    """Whitened rows (B, S, 6, k) of accelerations (F, 6) on the way and of points that land deeper (E,) m."""
    B = shot.flights.shape[0]
    initial = np.zeros((B, 12, len(changes)))
    moved = shot.tangent.propagated(initial, np.stack(changes, axis=-1), np.stack(deeper, axis=-1))
    return shot.slopes(moved)


def sensor_rows(shot: Shot, effect: SensorEffect) -> Array:
    """Whitened rows (B, S, 6, k) by the strengths of a sensor effect."""
    B, S = shot.flights.shape
    states, times = shot.flights.at_samples, shot.arcs.times
    change = np.zeros((B, S, 6, len(effect.strengths)))
    motion = np.concatenate([states.v, states.w], axis=1).reshape(B, S, 6)
    if effect.shifts:
        for k, step in enumerate(effect.directions()):
            behind = times if step.behind is None else effect.with_values(step.behind).shown(times)
            later = (effect.with_values(step.ahead).shown(times) - behind) / step.size
            # an arc is simulated from its own beginning on
            change[..., k] = (later - later[:, :1])[..., None] * motion
    elif effect.settling is not None:
        change[..., 0] = -motion
    else:
        on = axes_of(effect)
        change[:, :, on] = sensor_slopes(effect, shot.arcs, states.p[:, on])
    return shot.whitened(change)
