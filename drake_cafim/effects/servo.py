"""The law of a position servo: the effort that it makes of a commanded position, and that effort's derivatives."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.typing import Array


@dataclass(frozen=True)
class Servo:
    """A position servo at one `joint`.

    With e the part of `cmd` − q beyond the dead band, the voltage term is T = clip(kp e, ±limit), and

        effort = T (1 − sag |T| |effort|/limit) − kv v,

    which without sag is T − kv v. `stiffness` kp is N m/rad (N/m), or its scale where a column of the recording is
    multiplied by it; `damping` kv N m s/rad (N s/m) acts at once; `limit` N m (N) is at standstill; `dead_band` rad
    (m); `sag` 1/(N m) or 1/N. kp and the limit scale with a logged supply.
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

    def effort(
        self, command: Array, q: Array, v: Array, gain: Array | float = 1.0, supply: Array | float = 1.0
    ) -> "ServoEffort":
        """The effort at `command`, `q` rad (m) and `v` rad/s (m/s), each (N,).

        `gain` (N,) is the value of the column that kp is a multiple of, `supply` (N,) the supply over its nominal.
        """
        stiffness = self.stiffness * gain * supply
        error = command - q
        beyond = error - np.clip(error, -self.dead_band, self.dead_band)
        asked = stiffness * beyond
        limit = self.limit * supply if np.isfinite(self.limit) else np.full_like(asked, np.inf)
        term = np.clip(asked, -limit, limit)
        by_error = np.where((np.abs(error) > self.dead_band) & (np.abs(asked) < limit), stiffness, 0.0)
        value, by_term = term - self.damping * v, np.ones_like(term)
        by_v = np.full_like(term, -self.damping)
        if self.sag > 0.0 and np.isfinite(self.limit):
            # T and the effort of one sign: E (1 + sag T²/limit) = T − kv v; of opposite signs the effort brakes
            same = np.sign(term) * np.sign(value)
            loss = same * self.sag * term**2 / limit
            share = 1.0 / np.maximum(1.0 + loss, LEAST_SHARE)
            by_term = share - value * share**2 * 2.0 * same * self.sag * term / limit
            value, by_v = value * share, by_v * share
        return ServoEffort(value, -by_error * by_term, by_v, by_error * by_term)

    def effort_by(
        self, parameter: str, command: Array, q: Array, v: Array, gain: Array | float = 1.0, supply: Array | float = 1.0
    ) -> Array:
        """(N,) derivative of the effort of a servo without sag by its "stiffness" or its "damping"."""
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
