"""Strength and rival explanations on arms."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from .arm_case import Settings
from .case import RECORDINGS, Case, World
from .mujoco_arm import ArmInverse
from .noise import ChannelNoise
from .robots import Array, Robot
from .strength import Alternative, Excess, Windows, acceptable, strength
from .truth import Concealed

_EVERY = 12  # windows between two evaluations of the noise's Jacobian


class ArmRows:
    """Whitened rows along noise-free measurements: the nominal arm's torque balance, and v against the rate of q."""

    def __init__(self, case: Case) -> None:
        world: World = case.study["world"]  # type: ignore[assignment]
        settings: Settings = case.study["settings"]  # type: ignore[assignment]
        self.robot, self.entries = world.nominal, case.study["entries"]
        self.names = [joint.name for joint in self.robot.joints]
        self.time = world.motion.time
        self.q = np.stack([world.measured[f"q.{name}"] for name in self.names], axis=2)
        self.v = np.stack([world.measured[f"v.{name}"] for name in self.names], axis=2)
        late = np.gradient(self.v - world.motion.v, settings.step, axis=1)
        self.a, self.u = world.motion.a + late, world.motion.u
        self.windows = Windows.over(self.q.shape[1], settings.step)
        self.noise_q: ChannelNoise = case.study["noise_q"]  # type: ignore[assignment]
        self.noise_v: ChannelNoise = case.study["noise_v"]  # type: ignore[assignment]
        self.has_velocity = settings.has_velocity
        self.nominal_torque = self.torque(self.robot)
        loose = any(item.laws.transmissions for item in world.effects)
        self.misfit = self._over_steps() if loose else self.nominal_torque - self.u
        self.std = self._noise()
        self.channels = tuple(self.names) + tuple(f"rate of {name}" for name in self.names if self.has_velocity)

    def torque(self, robot: Robot, q: Array | None = None, v: Array | None = None, a: Array | None = None) -> Array:
        """Inverse dynamics (B, N, n)."""
        inverse = ArmInverse(robot)
        q, v, a = (own if given is None else given for own, given in ((self.q, q), (self.v, v), (self.a, a)))
        return inverse.torque(*(x.reshape(-1, robot.size) for x in (q, v, a))).reshape(q.shape)

    def _over_steps(self) -> Array:
        """The torque (B, N, n) that the nominal arm lacks in the mean over each step, the last one twice.

        A rotor feels a new command before its link does: at the samples themselves the two are never alike.
        """
        step = np.diff(self.time, axis=1)[:, :, None]
        (q, next_q), (v, next_v) = ((x[:, :-1], x[:, 1:]) for x in (self.q, self.v))
        middle = 0.5 * (q + next_q) + step / 8.0 * (v - next_v)
        missing = self.torque(self.robot, middle, 0.5 * (v + next_v), (next_v - v) / step) - self.u[:, :-1]
        return np.concatenate([missing, missing[:, -1:]], axis=1)

    def _noise(self) -> Array:
        """Std (B, W, n) of a row: momentum, stiffness and velocity terms of every joint's noise, added in squares."""
        w, w1, w2 = self.windows.shape
        if self.has_velocity:
            momentum = self.windows.noise_std(w1, self.noise_v)
        else:
            momentum = self.windows.noise_std(w2, self.noise_q)
        place = self.windows.noise_std(w, self.noise_q)
        speed = (
            self.windows.noise_std(w, self.noise_v) if self.has_velocity else self.windows.noise_std(w1, self.noise_q)
        )
        centres = self.windows.centres()
        inverse, n = ArmInverse(self.robot), self.robot.size
        variance = np.empty((len(self.q), len(centres), n))
        for b in range(len(self.q)):
            for i in range(0, len(centres), _EVERY):
                k = centres[i]
                mass = inverse.mass_matrix(self.q[b, k])
                dq, dv = self._jacobians(inverse, b, k)
                now = (
                    (mass**2).sum(axis=1) * momentum**2
                    + (dq**2).sum(axis=1) * place**2
                    + (dv**2).sum(axis=1) * speed**2
                )
                variance[b, i : i + _EVERY] = now
        if self.has_velocity:
            rate = self.windows.noise_std(w, self.noise_v) ** 2 + self.windows.noise_std(w1, self.noise_q) ** 2
            variance = np.concatenate([variance, np.full_like(variance, rate)], axis=2)
        return np.sqrt(variance)

    def _jacobians(self, inverse: ArmInverse, b: int, k: int) -> tuple[Array, Array]:
        n, step = self.robot.size, 1e-5
        q, v, a = self.q[b, k], self.v[b, k], self.a[b, k]
        nudge = step * np.eye(n)
        base = inverse.torque(q[None], v[None], a[None])
        dq = inverse.torque(q + nudge, np.tile(v, (n, 1)), np.tile(a, (n, 1))) - base
        dv = inverse.torque(np.tile(q, (n, 1)), v + nudge, np.tile(a, (n, 1))) - base
        return dq.T / step, dv.T / step

    def whiten(self, torque: Array, q: Array | None = None, v: Array | None = None) -> Array:
        """Rows (B, W, n or 2 n) in std of torques (B, N, n) and of the mismatch of q and v (zero where not given)."""
        w, w1, _ = self.windows.shape
        torque = self._evenly(torque)
        q, v = (None if one is None else self._evenly(one) for one in (q, v))
        rows = self.windows.integrate(torque, w)
        if self.has_velocity:
            rate = np.zeros_like(rows)
            rate = rate if v is None else rate + self.windows.integrate(v, w)
            rate = rate if q is None else rate + self.windows.integrate(q, w1)
            rows = np.concatenate([rows, rate], axis=2)
        return rows / self.std

    def _evenly(self, values: Array) -> Array:
        """Values (B, N, n) at even times: the windows know of no others."""
        if np.allclose(np.diff(self.time, axis=1), self.windows.step, rtol=1e-6, atol=0.0):
            return values
        even = self.windows.step * np.arange(values.shape[1])
        return np.stack([CubicSpline(t, own, axis=0)(t[0] + even) for t, own in zip(self.time, values, strict=True)])

    def excess(self) -> Excess:
        unknown = [self._unknown(entry) for entry in self.entries]  # type: ignore[attr-defined]
        centres = self.time[:, self.windows.centres()]
        shape = (0, *self.std.shape)
        return Excess(
            self.channels,
            self.whiten(self.misfit, self.q, self.v),
            np.stack(unknown) if unknown else np.zeros(shape),
            centres,
        )

    def _unknown(self, entry: dict[str, object]) -> Array:
        """Rows that one prior std of an unknown parameter makes."""
        if entry["parameter"] == "damping":
            j = self.names.index(str(entry["joint"]))
            return self.whiten(float(entry["std"]) * self.only(j, self.v[:, :, j]))  # type: ignore[arg-type]
        link = self.robot.link_index(str(entry["body"]))
        body = self.robot.links[link]
        heavier = self.robot.replace_link(link, body.with_mass(body.mass + float(entry["std"])))  # type: ignore[arg-type]
        return self.whiten(self.torque(heavier) - self.nominal_torque)

    def only(self, joint: int, values: Array) -> Array:
        """Torques (B, N, n) that act at one joint alone."""
        out = np.zeros_like(self.u)
        out[:, :, joint] = values
        return out


def _late(rows: ArmRows, j: int, seconds: float) -> Array:
    """u(t - d) - u(t) of the staircase."""
    u = rows.u[:, :, j]
    shift = seconds / rows.windows.step
    whole, part = int(shift), shift - int(shift)
    early = np.concatenate([np.repeat(u[:, :1], whole + 1, axis=1), u], axis=1)[:, : u.shape[1] + 1]
    return (1.0 - part) * early[:, 1:] + part * early[:, :-1] - u


def _slow(rows: ArmRows, j: int, seconds: float) -> Array:
    u = rows.u[:, :, j]
    keep = float(np.exp(-rows.windows.step / seconds))
    out = np.empty_like(u)
    out[:, 0] = u[:, 0]
    for k in range(1, u.shape[1]):
        out[:, k] = keep * out[:, k - 1] + (1.0 - keep) * u[:, k - 1]
    return out - u


def joint_alternatives(rows: ArmRows, j: int) -> Iterator[tuple[str, int, list[Array]]]:
    """Explanations at one joint: name, number of parameters, torques (B, N) that span it."""
    q, v, u, a = (x[:, :, j] for x in (rows.q, rows.v, rows.u, rows.a))
    sign = np.tanh(v / 0.005)
    yield "joint_viscous_friction", 1, [v]
    yield "joint_coulomb_friction", 1, [sign]
    yield "joint_asymmetric_coulomb_friction", 2, [sign * (v > 0.0), sign * (v <= 0.0)]
    yield "joint_load_dependent_friction", 2, [sign, np.abs(u) * sign]
    yield "joint_spring", 2, [q, np.ones_like(q)]
    yield "rotor_inertia", 1, [a]
    yield "actuator_gain_error", 1, [u]
    yield "actuator_bias", 1, [np.ones_like(u)]
    typical = max(float(np.sqrt(np.mean(v**2))), 1e-6)
    for part in (0.05, 0.1, 0.2, 0.4, 0.8):
        yield "joint_stribeck_friction", 3, [sign, sign * np.exp(-((v / (part * typical)) ** 2))]
    largest = float(np.abs(u).max())
    for part in (0.005, 0.02, 0.05, 0.1, 0.2, 0.4):
        width = part * largest
        yield "actuator_dead_zone", 1, [np.clip(u, -width, width)]
    for part in (0.5, 0.65, 0.8, 0.9, 0.95):
        yield "actuator_saturation", 1, [np.clip(u, -part * largest, part * largest) - u]
    for seconds in (0.0005, 0.001, 0.002, 0.004, 0.008, 0.016):
        yield "actuator_delay", 1, [_late(rows, j, seconds)]
        yield "actuator_lag", 1, [_slow(rows, j, seconds)]
    curve = np.gradient(np.gradient(u, rows.windows.step, axis=1), rows.windows.step, axis=1)
    yield "joint_elasticity", 2, [curve]
    span = max(float(np.ptp(q)), 1e-3)
    for turns in np.arange(1.0, 13.0, 0.5):
        yield "torque_ripple", 3, [np.sin(2.0 * np.pi * turns * q / span), np.cos(2.0 * np.pi * turns * q / span)]
    for part in (0.75, 0.85, 0.95):
        for side in (-1.0, 1.0):
            over = np.maximum(0.0, side * q - np.quantile(side * q, part))
            yield "joint_hard_stop", 3, [over]


def body_alternatives(rows: ArmRows, joints: list[int]) -> Iterator[tuple[str, str, int, list[Array]]]:
    """Explanations that act on many joints: payloads and the tilt of gravity; torques (B, N, n)."""
    base = rows.nominal_torque
    for link, body in enumerate(rows.robot.links):
        if not set(joints) & {joint for joint in range(rows.robot.size) if link in rows.robot.descendants(joint)}:
            continue
        points = [body.com, *(body.com + 0.05 * np.eye(3))]
        mass = 0.02 * body.mass
        loads = [rows.torque(rows.robot.replace_link(link, body.with_point_mass(mass, p))) - base for p in points]
        yield "payload", body.name, 4, loads
    tilts = []
    for axis in ("x", "y"):
        g = Rotation.from_euler(axis, 1e-3).as_matrix() @ rows.robot.gravity
        tilts.append(rows.torque(Robot(rows.robot.name, rows.robot.links, rows.robot.joints, g)) - base)
    yield "gravity_misalignment", "world", 2, tilts


def sensor_alternatives(rows: ArmRows, joints: list[int]) -> Iterator[tuple[str, str, Array]]:
    """Faults of encoders, each with one parameter: whitened rows."""
    time = rows.time[:, :, None]
    for j in joints:
        only = np.eye(rows.robot.size)[j]
        for effect, shape in (("sensor_bias", np.ones_like(time)), ("sensor_drift", time), ("sensor_delay", None)):
            change = 1e-3 * only * (-rows.v if shape is None else shape)
            yield effect, f"q.{rows.names[j]}", _moved(rows, change)
        yield "sensor_gain_error", f"q.{rows.names[j]}", _moved(rows, 1e-3 * only * rows.q)
        if rows.has_velocity:
            for effect, speed in (("sensor_bias", np.ones_like(rows.v)), ("sensor_gain_error", rows.v)):
                change = 1e-3 * only * speed
                late = np.gradient(change, rows.windows.step, axis=1)
                torque = rows.torque(rows.robot, v=rows.v + change, a=rows.a + late) - rows.nominal_torque
                yield effect, f"v.{rows.names[j]}", rows.whiten(torque, v=change)


def _moved(rows: ArmRows, change: Array) -> Array:
    return rows.whiten(rows.torque(rows.robot, q=rows.q + change) - rows.nominal_torque, q=change)


def arm_strength(case: Case) -> dict[str, object]:
    """Strength of each of the case's effects and the acceptable other names; sealed with the truth."""
    rows = ArmRows(case)
    excess = rows.excess()
    effects: tuple[Concealed, ...] = case.study["world"].effects  # type: ignore[attr-defined]
    told = []
    for item in effects:
        member = RECORDINGS.index(item.recording) if item.recording else None
        told.append(strength(excess, _channels(rows, item), item.interval, member))
    result: dict[str, object] = {"strengths": told, "accept": []}
    if len(effects) == 1 and not effects[0].effect.startswith("odd_"):
        only = effects[0]
        rivals = _alternatives(rows, only.effect, only.at, _channels(rows, only))
        result["accept"] = acceptable(excess, len(only.parameters), rivals)
    return result


def _channels(rows: ArmRows, item: Concealed) -> list[str] | None:
    place = item.at.split(".")[-1]
    if place not in rows.names:
        return list(rows.names)
    return [place, f"rate of {place}"] if "." in item.at else [place]


def _alternatives(rows: ArmRows, effect: str, at: str, channels: list[str] | None) -> list[Alternative]:
    found = []
    joints = [rows.names.index(name) for name in channels or rows.names if name in rows.names]
    for j in joints if len(joints) == 1 else []:
        for name, count, torques in joint_alternatives(rows, j):
            if name != effect:
                regressors = np.stack([rows.whiten(rows.only(j, torque)) for torque in torques])
                found.append(Alternative(name, rows.names[j], regressors, count))
    for name, place, count, torques in body_alternatives(rows, joints):
        if (name, place) != (effect, at):
            found.append(Alternative(name, place, np.stack([rows.whiten(torque) for torque in torques]), count))
    for name, place, row in sensor_alternatives(rows, joints):
        if (name, place) != (effect, at):
            found.append(Alternative(name, place, row[None], 1))
    return found
