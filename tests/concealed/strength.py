"""How clear a concealed effect is, by the maker's own reckoning along the noise-free truth.

The nominal equations are evaluated on noise-free measurements, multiplied by sin^4 windows of 60 ms (tosses: 100 ms)
that overlap by half, and divided by the std that the measurement noise gives each such row. With the unknown parameters
refitted (their priors as extra rows), what remains is the excess that a diagnosis can find: its sum of squares in a
channel, over the number of the channel's rows, is the strength; `clear` is 3 or more (a root-mean-square residual of
1.7 std a row). Rows are taken as independent: neighbours correlate at about -0.3, which is left out.

The expected log Bayes factor of the truth over another explanation is half of what the other, fitted best, leaves over,
plus (k_other - k_true)/2 ln(rows). Under 3 another name is acceptable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .noise import ChannelNoise
from .robots import Array

WINDOW = 0.06  # s
CLEAR = 3.0
ACCEPT = 3.0


@dataclass(frozen=True)
class Windows:
    """sin^4 windows over samples of `step` s; every window has the same shape."""

    step: float
    length: int  # samples in a window
    starts: np.ndarray  # (W,)

    @classmethod
    def over(cls, samples: int, step: float, seconds: float = WINDOW) -> Windows:
        length = max(8, round(seconds / step))
        return cls(step, length, np.arange(0, samples - length, max(1, length // 2)))

    @property
    def shape(self) -> tuple[Array, Array, Array]:
        """Window, its first and second derivatives in time; (length,)."""
        rate = np.pi / (self.length * self.step)
        angle = rate * self.step * (np.arange(self.length) + 0.5)
        s, c = np.sin(angle), np.cos(angle)
        return s**4, 4.0 * rate * s**3 * c, 4.0 * rate**2 * (3.0 * s**2 * c**2 - s**4)

    def integrate(self, values: Array, weight: Array) -> Array:
        """Sums over windows (B, W, ...) of weight times values (B, N, ...), times the step."""
        index = self.starts[:, None] + np.arange(self.length)
        return self.step * np.einsum("bwl...,l->bw...", values[:, index], weight)

    def centres(self) -> np.ndarray:
        return self.starts + self.length // 2

    def noise_std(self, weight: Array, noise: ChannelNoise) -> float:
        """Std of the windowed sum of the noise under `weight`."""
        lag = np.abs(np.subtract.outer(np.arange(self.length), np.arange(self.length))) * self.step
        correlation = np.exp(-lag / noise.correlation_time) if noise.correlation_time else (lag == 0.0).astype(float)
        white = noise.quantum**2 / 12.0 * (weight @ weight)
        return self.step * float(np.sqrt(noise.std**2 * weight @ correlation @ weight + white))


@dataclass(frozen=True)
class Excess:
    """Whitened rows by channel: what the nominal leaves, and what a prior std of each unknown parameter would do."""

    channels: tuple[str, ...]
    rows: Array  # (B, W, C) in std
    unknown: Array  # (P, B, W, C)
    centres: Array  # (B, W) s

    def remaining(self, others: Array | None = None, members: slice = slice(0, 3)) -> Array:
        """Rows (b, W, C) after the unknown parameters, and any `others` (Q, B, W, C) without a prior, are fitted."""
        rows = self.rows[members]
        unknown = self.unknown[:, members].reshape(len(self.unknown), -1).T
        free = np.zeros((rows.size, 0)) if others is None else others[:, members].reshape(len(others), -1).T
        scale = np.maximum(np.linalg.norm(free, axis=0), 1e-30)
        design = np.hstack([unknown, free / scale])
        prior = np.hstack([np.eye(unknown.shape[1]), np.zeros((unknown.shape[1], free.shape[1]))])
        target = np.concatenate([rows.ravel(), np.zeros(unknown.shape[1])])
        if design.shape[1] == 0:
            return rows
        fit, *_ = np.linalg.lstsq(np.vstack([design, prior]), target, rcond=1e-10)
        return (rows.ravel() - design @ fit).reshape(rows.shape)


@dataclass(frozen=True)
class Alternative:
    """Another explanation: its name and place, its whitened regressors (Q, B, W, C) and number of parameters."""

    effect: str
    at: str
    regressors: Array
    parameters: int


def strength(
    excess: Excess, channels: Sequence[str] | None, interval: tuple[float, float] | None, member: int | None
) -> dict[str, object]:
    """Per channel and of the affected one: mean square of the remaining rows, and whether that is clear.

    A pulse is judged in its own recording and interval, and must add up to 100 besides.
    """
    left = excess.remaining()
    per = {name: float(np.mean(left[:, :, i] ** 2)) for i, name in enumerate(excess.channels)}
    names = [name for name in (channels or excess.channels) if name in per]
    total = max(float(np.sum(left[:, :, excess.channels.index(name)] ** 2)) for name in names)
    value = max(per[name] for name in names)
    if interval is not None and member is not None:
        inside = (excess.centres[member] > interval[0] - 0.02) & (excess.centres[member] < interval[1] + 0.02)
        squares = left[member][inside] ** 2
        value = float(squares.mean(axis=0).max()) if len(squares) else 0.0
        total = float(squares.sum(axis=0).max()) if len(squares) else 0.0
        return {"value": value, "total": total, "clear": bool(value >= CLEAR and total >= 100.0), "channels": per}
    return {"value": value, "total": total, "clear": bool(value >= CLEAR), "channels": per}


def acceptable(excess: Excess, own: int, alternatives: Sequence[Alternative]) -> list[dict[str, object]]:
    """Explanations whose expected log Bayes factor against the truth is under 3; for faint effects `none` is one."""
    count = excess.rows[:3].size
    found: list[dict[str, object]] = []
    nominal = 0.5 * float(np.sum(excess.remaining() ** 2)) - 0.5 * own * np.log(count)
    if nominal < ACCEPT:
        found.append({"effect": "none", "at": "", "log_bayes_factor": float(nominal)})
    for other in alternatives:
        left = 0.5 * float(np.sum(excess.remaining(other.regressors) ** 2))
        factor = left + 0.5 * (other.parameters - own) * np.log(count)
        if factor < ACCEPT and nominal >= ACCEPT:
            found.append({"effect": other.effect, "at": other.at, "log_bayes_factor": float(factor)})
    return found
