"""The law of a position servo: the effort that it makes of a commanded position, and that effort's derivatives."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array, Indices


@dataclass(frozen=True)
class Servo:
    """A position servo at one `joint`.

    With e the part of `cmd` − q beyond the dead band, the voltage term is T = clip(kp e, ±limit), and

        effort = T (1 − sag |T| |effort|/limit) − kv v,

    which without sag is T − kv v. A motor's envelope bounds it by stall_torque (1 − v sign(effort)/no_load_speed), and
    beyond that speed nothing is left along the motion. `stiffness` kp is N m/rad (N/m), or its scale where a column of
    the recording is multiplied by it; `damping` kv N m s/rad (N s/m) acts at once; `limit` N m (N) is at standstill;
    `dead_band` rad (m); `sag` 1/(N m) or 1/N; `stall_torque` N m (N), `no_load_speed` rad/s (m/s). kp and the limit
    scale with a logged supply.
    """

    joint: str
    stiffness: float
    damping: float = 0.0
    limit: float = np.inf
    dead_band: float = 0.0
    sag: float = 0.0
    column: str | None = None
    """The recording's column that kp is `stiffness` times of; None where kp is a number."""
    supply: str | None = None
    """The recording's column of the supply voltage; None where it is not logged."""
    nominal_supply: float = 1.0
    """The supply, in the column's unit, at which kp and the limit are as stated."""
    stall_torque: float = np.inf
    no_load_speed: float = np.inf

    @property
    def numbers(self) -> Array:
        """(7,) as compiled functions take them: stiffness, damping, limit, dead band, sag, stall torque, its speed."""
        envelope = (self.stall_torque, self.no_load_speed)
        return np.array([self.stiffness, self.damping, self.limit, self.dead_band, self.sag, *envelope])

    @property
    def has_envelope(self) -> bool:
        """Whether the motor's envelope bounds the effort."""
        return bool(np.isfinite(self.stall_torque))

    def effort(
        self, command: Array, q: Array, v: Array, gain: Array | float = 1.0, supply: Array | float = 1.0
    ) -> "ServoEffort":
        """The effort at `command`, `q` rad (m) and `v` rad/s (m/s), each (N,).

        `gain` (N,) is the value of the column that kp is a multiple of, `supply` (N,) the supply over its nominal.
        """
        shape = np.broadcast_shapes(np.shape(command), np.shape(q), np.shape(v))
        samples = (
            np.ascontiguousarray(np.broadcast_to(it, shape), dtype=float) for it in (command, q, v, gain, supply)
        )
        return ServoEffort(*servo_efforts(self.numbers, *samples))

    def effort_by(
        self, parameter: str, command: Array, q: Array, v: Array, gain: Array | float = 1.0, supply: Array | float = 1.0
    ) -> Array:
        """(N,) derivative of the effort by its "stiffness" or its "damping", of a servo without sag or envelope."""
        if parameter == "damping":
            return -v
        error = command - q
        beyond = gain * supply * (error - np.clip(error, -self.dead_band, self.dead_band))
        return np.where(np.abs(self.stiffness * beyond) < self.limit * supply, beyond, 0.0)


LEAST_SHARE = 0.05
"""Least 1 − sag |T| where the effort brakes: with less, the law has no solution."""


@dataclass(frozen=True)
class ServoEffort:
    """An effort N m (N) and its derivatives, (N,) each: `value`, `d_q`, `d_v`, `d_command`."""

    value: Array
    d_q: Array
    d_v: Array
    d_command: Array


@compiled
def _law(numbers: Array, error: float, v: float, gain: float, supply: float) -> tuple[float, float, float]:
    """The effort of `Servo` at an error cmd − q, and its derivatives by error and v.

    `numbers` are those of `Servo.numbers`.
    """
    stiffness, damping, limit, dead_band, sag, stall, fastest = numbers
    kp, most = stiffness * gain * supply, limit * supply
    asked = kp * (error - min(max(error, -dead_band), dead_band))
    term = min(max(asked, -most), most)
    by_error = kp if abs(error) > dead_band and abs(asked) < most else 0.0
    value, by_v = term - damping * v, -damping
    if sag > 0.0 and 0.0 < most < np.inf:
        # T and the effort of one sign: E (1 + sag T²/limit) = T − kv v; of opposite signs the effort brakes
        same = np.sign(term) * np.sign(value)
        share = 1.0 / max(1.0 + same * sag * term**2 / most, LEAST_SHARE)
        by_error *= share - value * share**2 * 2.0 * same * sag * term / most
        value, by_v = value * share, by_v * share
    if stall < np.inf:
        side = 1.0 if value > 0.0 else -1.0
        left = stall * (1.0 - side * v / fastest)
        if side * value > left:
            value, by_error, by_v = side * max(left, 0.0), 0.0, -stall / fastest if left > 0.0 else 0.0
    return value, by_error, by_v


@compiled
def servo_efforts(
    numbers: Array, command: Array, q: Array, v: Array, gain: Array, supply: Array
) -> tuple[Array, Array, Array, Array]:
    """The fields (N,) of `ServoEffort` by a servo's `numbers` (7,) at samples (N,)."""
    value, d_q, d_v, d_command = np.empty_like(q), np.empty_like(q), np.empty_like(q), np.empty_like(q)
    for i in range(len(q)):
        value[i], d_command[i], d_v[i] = _law(numbers, command[i] - q[i], v[i], gain[i], supply[i])
        d_q[i] = -d_command[i]
    return value, d_q, d_v, d_command


@compiled
def drive_servos(
    joints: Indices, numbers: Array, on: Array, command: Array, gain: Array, supply: Array, scale: Array, offset: Array,
    q: Array, v: Array, effort: Array, duration: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """The efforts (B, n) with those of m servos at `joints` (m,), of `numbers` (m, 7), and their slope in v.

    All else but `duration` (B,) is (B, n); encoders read `scale` q + `offset`. A step moves q by ½ h v within its first
    half, so that the slope in q enters that in v times ½ h.
    """
    total, slope = effort.copy(), np.zeros_like(effort)
    for i in range(len(q)):
        for k in range(len(joints)):
            j = joints[k]
            error = command[i, j] - scale[i, j] * q[i, j] - offset[i, j]
            value, by_error, by_v = _law(numbers[k], error, v[i, j], gain[i, j], supply[i, j])
            total[i, j] += on[i, j] * value
            slope[i, j] = on[i, j] * (by_v - 0.5 * duration[i] * scale[i, j] * by_error)
    return total, slope
