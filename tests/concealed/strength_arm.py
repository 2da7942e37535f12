"""Strength and rival explanations on arms."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from .arm_case import Settings
from .case import RECORDINGS, Case, World
from .inverse import Moving
from .mujoco_arm import ArmInverse
from .noise import ChannelNoise
from .robots import Array, Link, Robot
from .strength import ACCEPT, TRAINED, Alternative, Excess, Windows, offsets, summed, true_value
from .truth import Concealed
from .uneven import sums_of

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
        self.plain, self.slope = sums_of(self.windows, self.time, self.windows.shape[:2])
        self.noise_q: ChannelNoise = case.study["noise_q"]  # type: ignore[assignment]
        self.noise_v: ChannelNoise = case.study["noise_v"]  # type: ignore[assignment]
        self.moving = Moving(self.robot, *(x.reshape(-1, self.robot.size) for x in (self.q, self.v, self.a)))
        self.nominal_torque = self.moving.efforts().reshape(self.q.shape)
        loose = any(item.laws.transmissions for item in self.effects)
        self.misfit = self._over_steps() if loose else self.nominal_torque - self.u
        self.std = self._noise()
        self._halfway_torque: Array | None = None
        self._looks: dict[tuple[str, int], list[Alternative]] = {}
        self.channels = tuple(self.names) + tuple(f"rate of {name}" for name in self.names if self.has_velocity)

    def torque(self, robot: Robot, q: Array | None = None, v: Array | None = None, a: Array | None = None) -> Array:
        """Inverse dynamics (B, N, n)."""
        inverse = ArmInverse(robot)
        q, v, a = (own if given is None else given for own, given in ((self.q, q), (self.v, v), (self.a, a)))
        return inverse.torque(*(x.reshape(-1, robot.size) for x in (q, v, a))).reshape(q.shape)

    def carried(self, link: int, body: Link) -> Array:
        """Torques (B, N, n) of all joints for `body` alone in a link's place."""
        return self.moving.carried(link, body).reshape(self.q.shape)

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
        at = self.windows.centres()[::_EVERY]
        of_noise = zip((momentum, place, speed), (self._masses(at), *self._jacobians(at)), strict=True)
        now = sum(std**2 * (slope**2).sum(axis=3) for std, slope in of_noise)
        variance = np.repeat(now, _EVERY, axis=1)[:, : len(self.windows.centres())]
        if self.has_velocity:
            rate = self.windows.noise_std(w, self.noise_v) ** 2 + self.windows.noise_std(w1, self.noise_q) ** 2
            variance = np.concatenate([variance, np.full_like(variance, rate)], axis=2)
        return np.sqrt(variance)

    def _masses(self, at: np.ndarray) -> Array:
        """Mass matrices (B, K, n, n) at samples (K,)."""
        inverse = ArmInverse(self.robot)
        return np.array([[inverse.mass_matrix(q) for q in own] for own in self.q[:, at]])

    def _jacobians(self, at: np.ndarray) -> tuple[Array, Array]:
        """Slopes (B, K, n, n) of the torques with q and v at samples (K,)."""
        n, step = self.robot.size, 1e-5
        nudge = step * np.eye(n)
        none = np.zeros_like(nudge)
        change = np.concatenate([np.zeros((1, 2 * n)), np.block([[nudge, none], [none, nudge]])])
        q, v, a = (
            x[:, at, None, :] + more
            for x, more in ((self.q, change[:, :n]), (self.v, change[:, n:]), (self.a, 0.0 * change[:, :n]))
        )
        torque = self.torque(self.robot, q, v, a)
        slopes = ((torque[:, :, 1:] - torque[:, :, :1]) / step).swapaxes(2, 3)
        return slopes[..., :n], slopes[..., n:]

    def whiten(self, torque: Array, q: Array | None = None, v: Array | None = None) -> Array:
        """Rows (B, W, n or 2 n) in std of torques (B, N, n) and of the mismatch of q and v (zero where not given)."""
        rows = summed(self.plain, torque)
        if self.has_velocity:
            rate = np.zeros_like(rows)
            rate = rate if v is None else rate + summed(self.plain, v)
            rate = rate if q is None else rate + summed(self.slope, q)
            rows = np.concatenate([rows, rate], axis=2)
        return rows / self.std

    def whiten_at(self, joint: int, torques: Sequence[Array]) -> Array:
        """Rows (Q, B, W, n or 2 n) in std of torques, each (B, N), that act at one joint alone."""
        rows = np.zeros((len(torques), *self.std.shape))
        rows[..., joint] = np.moveaxis(summed(self.plain, np.stack(torques, axis=2)), 2, 0) / self.std[..., joint]
        return rows

    def slope_with(self, j: int, which: int) -> Array:
        """Change of the torques (B, N, n) with a joint's q, v or a: halfway from what was measured to what was.

        There a secant from the one to the other is right to the second order.
        """
        if self._halfway_torque is None:
            self._halfway_torque = self.torque(self.robot, *self.halfway)
        state = [x.copy() for x in self.halfway]
        state[which][:, :, j] += 1e-5
        return (self.torque(self.robot, *state) - self._halfway_torque) / 1e-5

    def once(self, key: tuple[str, int], looks: Callable[[], Iterable[Alternative]]) -> list[Alternative]:
        """Looks that these rows alone decide, kept for what asks next."""
        if key not in self._looks:
            self._looks[key] = list(looks())
        return self._looks[key]

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
            return self.whiten_at(j, [float(entry["std"]) * self.v[:, :, j]])[0]  # type: ignore[arg-type]
        link = self.robot.link_index(str(entry["body"]))
        body = self.robot.links[link]
        heavier = body.with_mass(body.mass + float(entry["std"]))  # type: ignore[arg-type]
        return self.whiten(self.carried(link, heavier) - self.carried(link, body))

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


def late(rows: ArmRows, j: int, seconds: float) -> Array:
    """u(t - d) - u(t) of the staircase (B, N)."""
    u = rows.u[:, :, j]
    shift = seconds / rows.windows.step
    whole, part = int(shift), shift - int(shift)
    early = np.concatenate([np.repeat(u[:, :1], whole + 1, axis=1), u], axis=1)[:, : u.shape[1] + 1]
    return (1.0 - part) * early[:, 1:] + part * early[:, :-1] - u


def slow(rows: ArmRows, j: int, seconds: float) -> Array:
    """What a first-order lag of u takes from u (B, N)."""
    u = rows.u[:, :, j]
    keep = float(np.exp(-rows.windows.step / seconds))
    late, _ = lfilter([0.0, 1.0 - keep], [1.0, -keep], u, axis=1, zi=u[:, :1])
    return np.asarray(late - u)


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
        yield "actuator_delay", 1, [late(rows, j, seconds)]
        yield "actuator_lag", 1, [slow(rows, j, seconds)]
    curve = np.gradient(np.gradient(u, rows.windows.step, axis=1), rows.windows.step, axis=1)
    yield "joint_elasticity", 2, [curve]
    span = max(float(np.ptp(q)), 1e-3)
    for turns in np.arange(1.0, 13.0, 0.5):
        yield "torque_ripple", 3, [np.sin(2.0 * np.pi * turns * q / span), np.cos(2.0 * np.pi * turns * q / span)]
    for part in (0.75, 0.85, 0.95):
        for side in (-1.0, 1.0):
            over = np.maximum(0.0, side * q - np.quantile(side * q, part))
            yield "joint_hard_stop", 3, [over]


def body_alternatives(rows: ArmRows, joints: list[int]) -> Iterator[Alternative]:
    """Explanations that act on many joints: payloads and the tilt of gravity."""
    for link in range(rows.robot.size):
        if set(joints) & {joint for joint in range(rows.robot.size) if link in rows.robot.descendants(joint)}:
            yield from rows.once(("payload", link), lambda link=link: [_payload(rows, link)])
    yield from rows.once(("gravity", 0), lambda: [_tilted(rows)])


def _payload(rows: ArmRows, link: int) -> Alternative:
    body = rows.robot.links[link]
    points = [body.com, *(body.com + 0.05 * np.eye(3))]
    base = rows.carried(link, body)
    loads = [rows.carried(link, body.with_point_mass(0.02 * body.mass, p)) - base for p in points]
    return Alternative("payload", body.name, np.stack([rows.whiten(load) for load in loads]), 4)


def _tilted(rows: ArmRows) -> Alternative:
    tilts = []
    for axis in ("x", "y"):
        g = Rotation.from_euler(axis, 1e-3).as_matrix() @ rows.robot.gravity
        tilts.append(rows.torque(replace(rows.robot, gravity=g)) - rows.nominal_torque)
    return Alternative("gravity_misalignment", "world", np.stack([rows.whiten(tilt) for tilt in tilts]), 2)


TIMES = (0.001, 0.002, 0.004, 0.008, 0.016, 0.03)
"""Delays (s) that a late sensor is compared at; of a lag one is enough, as what undoes it grows in proportion."""


def sensor_alternatives(rows: ArmRows, joints: list[int]) -> Iterator[Alternative]:
    """Faults of encoders, each with one parameter. Of joints not asked for, the biases only.

    Each is what undoing the fault changes: a delay d by the value d later, a lag T by T times the value's rate.
    """
    for j in range(rows.robot.size):
        yield from rows.once(("bias", j), lambda j=j: [_biased(rows, j)])
        if j in joints:
            yield from rows.once(("encoder", j), lambda j=j: _encoders(rows, j))


def _biased(rows: ArmRows, j: int) -> Alternative:
    return Alternative("sensor_bias", f"q.{rows.names[j]}", rows.whiten(rows.slope_with(j, 0))[None], 1)


def _encoders(rows: ArmRows, j: int) -> Iterator[Alternative]:
    """Faults of a joint's q and v beyond a bias of q."""
    name, ones = rows.names[j], np.ones_like(rows.time)
    of_q, of_v, of_a = (rows.slope_with(j, which) for which in range(3))
    for effect, change in undone(rows.time, rows.q[:, :, j]):
        yield Alternative(effect, f"q.{name}", _moved(rows, j, (of_q, of_v, of_a), change)[None], 1)
    for effect, change in (("sensor_bias", ones), *undone(rows.time, rows.v[:, :, j])) if rows.has_velocity else ():
        yield Alternative(effect, f"v.{name}", _sped(rows, j, (of_v, of_a), change)[None], 1)


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


def _at_joint(rows: ArmRows, j: int) -> Iterator[Alternative]:
    for name, count, torques in joint_alternatives(rows, j):
        yield Alternative(name, rows.names[j], rows.whiten_at(j, torques), count)


def arm_alternatives(rows: ArmRows, item: Concealed, excess: Excess) -> Iterator[Alternative]:
    """What could be taken for the effect, and looks at the effect itself."""
    channels = rows.shown_in(item) or rows.names
    joints = [rows.names.index(name) for name in channels if name in rows.names]
    for j in range(rows.robot.size):
        if joints == [j] or confined(rows, excess, j, len(item.parameters)):
            yield from rows.once(("joint", j), lambda j=j: _at_joint(rows, j))
    yield from body_alternatives(rows, joints)
    yield from sensor_alternatives(rows, joints)
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
