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
from .strength import ACCEPT, TRAINED, Alternative, Excess, Windows, offsets, true_value
from .truth import Concealed

_EVERY = 12  # windows between two evaluations of the noise's Jacobian


class ArmRows:
    """Whitened rows along noise-free measurements: the nominal arm's torque balance, and v against the rate of q."""

    def __init__(self, case: Case) -> None:
        world: World = case.study["world"]  # type: ignore[assignment]
        settings: Settings = case.study["settings"]  # type: ignore[assignment]
        self.entries: list[dict[str, object]] = case.study["entries"]  # type: ignore[assignment]
        self.values: dict[str, float] = case.truth["nominal_parameters_true"]  # type: ignore[assignment]
        self.robot, self.effects = with_true_unknown(world.nominal, self.entries, self.values), world.effects
        self.names = [joint.name for joint in self.robot.joints]
        self.time = world.motion.time[TRAINED]
        q, v, a, u = (x[TRAINED] for x in (world.motion.q, world.motion.v, world.motion.a, world.motion.u))
        self.q = np.stack([world.measured[f"q.{name}"][TRAINED] for name in self.names], axis=2)
        self.v = np.stack([world.measured[f"v.{name}"][TRAINED] for name in self.names], axis=2)
        self.has_velocity = settings.has_velocity
        if not self.has_velocity:
            self.v = v + self.rate(self.q - q)
        self.a, self.u = a + self.rate(self.v - v), u
        self.halfway = 0.5 * (self.q + q), 0.5 * (self.v + v), 0.5 * (self.a + a)
        self.windows = Windows.over(self.q.shape[1], settings.step)
        self.noise_q: ChannelNoise = case.study["noise_q"]  # type: ignore[assignment]
        self.noise_v: ChannelNoise = case.study["noise_v"]  # type: ignore[assignment]
        self.nominal_torque = self.torque(self.robot)
        loose = any(item.laws.transmissions for item in self.effects)
        self.misfit = self._over_steps() if loose else self.nominal_torque - self.u
        self.std = self._noise()
        self.channels = tuple(self.names) + tuple(f"rate of {name}" for name in self.names if self.has_velocity)

    def torque(self, robot: Robot, q: Array | None = None, v: Array | None = None, a: Array | None = None) -> Array:
        """Inverse dynamics (B, N, n)."""
        inverse = ArmInverse(robot)
        q, v, a = (own if given is None else given for own, given in ((self.q, q), (self.v, v), (self.a, a)))
        return inverse.torque(*(x.reshape(-1, robot.size) for x in (q, v, a))).reshape(q.shape)

    def rate(self, values: Array) -> Array:
        """Rates (B, N, ...) of values at this case's instants."""
        return np.stack([np.gradient(own, t, axis=0) for t, own in zip(self.time, values, strict=True)])

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
        unknown = [self._unknown(entry) for entry in self.entries]
        centres = self.time[:, self.windows.centres()]
        shape = (0, *self.std.shape)
        return Excess(
            self.channels,
            self.whiten(self.misfit, self.q, self.v),
            np.stack(unknown) if unknown else np.zeros(shape),
            centres,
            offsets(self.entries, self.values),
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

    def shown_in(self, item: Concealed) -> list[str]:
        """Channels that an effect is to be seen in: its joint's, or of a link every joint's."""
        place = item.at.split(".")[-1]
        if place not in self.names:
            return list(self.names)
        return [place, f"rate of {place}"] if "." in item.at else [place]

    def alternatives(self, item: Concealed, excess: Excess) -> list[Alternative]:
        return list(arm_alternatives(self, item, excess))

    def only(self, joint: int, values: Array) -> Array:
        """Torques (B, N, n) that act at one joint alone."""
        out = np.zeros_like(self.u)
        out[:, :, joint] = values
        return out


def with_true_unknown(robot: Robot, entries: list[dict[str, object]], values: dict[str, float]) -> Robot:
    """The nominal robot with what is unknown of it as it truly is."""
    for entry in entries:
        value = true_value(entry, values)
        if entry["parameter"] == "damping":
            robot = robot.replace_joint(robot.joint_index(str(entry["joint"])), damping=value)
        else:
            link = robot.link_index(str(entry["body"]))
            robot = robot.replace_link(link, robot.links[link].with_mass(value))
    return robot


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


TIMES = (0.001, 0.002, 0.004, 0.008, 0.016, 0.03)
"""Delays (s) that a late sensor is compared at; of a lag one is enough, as what undoes it grows in proportion."""


def sensor_alternatives(rows: ArmRows, joints: list[int]) -> Iterator[tuple[str, str, Array]]:
    """Faults of encoders, each with one parameter: whitened rows. Of joints not asked for, the biases only.

    Each is what undoing the fault changes: a delay d by the value d later, a lag T by T times the value's rate.
    """
    base = rows.torque(rows.robot, *rows.halfway)
    ones = np.ones_like(rows.time)
    for j, name in enumerate(rows.names):
        of_q = _slope(rows, j, 0, base)
        yield "sensor_bias", f"q.{name}", rows.whiten(of_q)
        if j not in joints:
            continue
        of_v, of_a = _slope(rows, j, 1, base), _slope(rows, j, 2, base)
        for effect, change in undone(rows.time, rows.q[:, :, j]):
            yield effect, f"q.{name}", _moved(rows, j, (of_q, of_v, of_a), change)
        for effect, change in (("sensor_bias", ones), *undone(rows.time, rows.v[:, :, j])) if rows.has_velocity else ():
            yield effect, f"v.{name}", _sped(rows, j, (of_v, of_a), change)


def undone(time: Array, value: Array) -> Iterator[tuple[str, Array]]:
    """Faults of a channel's values (B, N) beyond a bias, and a small or their whole undoing (B, N)."""
    yield "sensor_gain_error", 1e-3 * value
    yield "sensor_drift", 1e-3 * time
    curves = [CubicSpline(stamps, own) for stamps, own in zip(time, value, strict=True)]
    rate = np.stack([curve(stamps, 1) for curve, stamps in zip(curves, time, strict=True)])
    yield "clock_skew", 1e-3 * time * rate
    yield "sensor_lag", 1e-3 * rate
    for seconds in TIMES:
        later = np.minimum(time + seconds, time[:, -1:])
        ahead = np.stack([curve(stamps) for curve, stamps in zip(curves, later, strict=True)])
        yield "sensor_delay", ahead - value


def _slope(rows: ArmRows, j: int, which: int, base: Array) -> Array:
    """Change of the torques (B, N, n) with a joint's q, v or a: halfway from what was measured to what was.

    There a secant from the one to the other is right to the second order.
    """
    state = [x.copy() for x in rows.halfway]
    state[which][:, :, j] += 1e-5
    return (rows.torque(rows.robot, *state) - base) / 1e-5


def _moved(rows: ArmRows, j: int, slopes: tuple[Array, Array, Array], change: Array) -> Array:
    """Rows of a change of q; without measured velocities v and a are those of q too."""
    torque = slopes[0] * change[:, :, None]
    if not rows.has_velocity:
        rate = rows.rate(change)
        torque += slopes[1] * rate[:, :, None] + slopes[2] * rows.rate(rate)[:, :, None]
    return rows.whiten(torque, q=rows.only(j, change))


def _sped(rows: ArmRows, j: int, slopes: tuple[Array, Array], change: Array) -> Array:
    torque = slopes[0] * change[:, :, None] + slopes[1] * rows.rate(change)[:, :, None]
    return rows.whiten(torque, v=rows.only(j, change))


def pulse_alternatives(rows: ArmRows, item: Concealed) -> Iterator[Alternative]:
    """The same pulse on each of the links: whitened rows of a force along each of the world's axes."""
    assert item.interval is not None and item.recording is not None
    member = RECORDINGS.index(item.recording)
    part = (rows.time[member] - item.interval[0]) / (item.interval[1] - item.interval[0])
    inside = np.flatnonzero((part > 0.0) & (part < 1.0))
    shape = np.sin(np.pi * part[inside]) ** 2
    inverse, q = ArmInverse(rows.robot), rows.q[member, inside]
    for link, body in enumerate(rows.robot.links):
        base = inverse.point(q, link, np.zeros(3))
        torques = np.zeros((3, *rows.u.shape))
        for j in range(rows.robot.size):
            reach = (inverse.point(q + 1e-6 * np.eye(rows.robot.size)[j], link, np.zeros(3)) - base) / 1e-6
            torques[:, member, inside, j] = (shape[:, None] * reach).T
        yield Alternative("external_disturbance", body.name, np.stack([rows.whiten(x) for x in torques]), 3)


def arm_alternatives(rows: ArmRows, item: Concealed, excess: Excess) -> Iterator[Alternative]:
    """What could be taken for the effect, and looks at the effect itself."""
    channels = rows.shown_in(item) or rows.names
    joints = [rows.names.index(name) for name in channels if name in rows.names]
    for j in range(rows.robot.size):
        if joints == [j] or confined(rows, excess, j, len(item.parameters)):
            for name, count, torques in joint_alternatives(rows, j):
                regressors = np.stack([rows.whiten(rows.only(j, torque)) for torque in torques])
                yield Alternative(name, rows.names[j], regressors, count)
    for name, place, count, torques in body_alternatives(rows, joints):
        yield Alternative(name, place, np.stack([rows.whiten(torque) for torque in torques]), count)
    for name, place, row in sensor_alternatives(rows, joints):
        yield Alternative(name, place, row[None], 1)
    if item.effect == "external_disturbance":
        yield from pulse_alternatives(rows, item)


def confined(rows: ArmRows, excess: Excess, j: int, own: int) -> bool:
    """Whether all that is seen could come from one joint, as of a tilted gravity on an arm that moves in a plane.

    No torque at the joint explains what the other joints show: where that alone is too much, none need be tried.
    """
    others = np.array([k for k in range(len(excess.channels)) if k != j])
    apart = Excess(
        tuple(excess.channels[k] for k in others),
        excess.rows[..., others],
        excess.unknown[..., others],
        excess.centres,
        excess.offset,
    )
    paid = 0.5 * float(excess.offset @ excess.offset)  # at most, by the truth
    return apart.cost() - paid + 0.5 * (1 - own) * np.log(excess.rows.size) < ACCEPT
