"""Interpolates channels between samples, and applies delay, lag, bias and misalignment of sensors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .recursion import followed
from .robots import Array
from .truth import Channels, Sensor

Curve = Callable[[Array], Array]


def _between(time: Array, at: Array) -> tuple[np.ndarray, Array, Array]:
    """Interval's index, its length and the part of it gone, for instants (B, M); held outside."""
    index = np.stack([np.searchsorted(stamps, row, side="right") - 1 for row, stamps in zip(at, time, strict=True)])
    index = np.clip(index, 0, time.shape[1] - 2)
    rows = np.arange(len(time))[:, None]
    length = time[rows, index + 1] - time[rows, index]
    return index, length, np.clip((at - time[rows, index]) / length, 0.0, 1.0)


def position_curve(time: Array, q: Array, v: Array, a: Array) -> Curve:
    """Quintic through position, velocity and acceleration (B, N); outside it is held."""
    rows = np.arange(len(time))[:, None]

    def curve(at: Array) -> Array:
        k, h, s = _between(time, at)
        rest = q[rows, k + 1] - q[rows, k] - h * v[rows, k] - 0.5 * h**2 * a[rows, k]
        rest1 = h * (v[rows, k + 1] - v[rows, k] - h * a[rows, k])
        rest2 = h**2 * (a[rows, k + 1] - a[rows, k])
        upper = s**3 * (
            (10.0 * rest - 4.0 * rest1 + 0.5 * rest2)
            + s * ((-15.0 * rest + 7.0 * rest1 - rest2) + s * (6.0 * rest - 3.0 * rest1 + 0.5 * rest2))
        )
        return q[rows, k] + s * h * v[rows, k] + 0.5 * (s * h) ** 2 * a[rows, k] + upper

    return curve


def velocity_curve(time: Array, v: Array, a: Array) -> Curve:
    """Cubic through velocity and acceleration (B, N); outside it is held."""
    rows = np.arange(len(time))[:, None]

    def curve(at: Array) -> Array:
        k, h, s = _between(time, at)
        rest = v[rows, k + 1] - v[rows, k] - h * a[rows, k]
        rest1 = h * (a[rows, k + 1] - a[rows, k])
        return v[rows, k] + s * h * a[rows, k] + s**2 * ((3.0 * rest - rest1) + s * (rest1 - 2.0 * rest))

    return curve


def fine_curve(time: Array, value: Array) -> Curve:
    """Linear through finely sampled values (B, M)."""
    return lambda at: np.stack(
        [np.interp(row, stamps, values) for row, stamps, values in zip(at, time, value, strict=True)]
    )


def _change(columns: list[str], wrap: Callable[[Curve, Array], Curve]) -> Sensor:
    def apply(channels: Channels) -> Channels:
        changed = {name: wrap(channels.columns[name], channels.time) for name in columns}
        return Channels(channels.time, {**channels.columns, **changed})

    return apply


def biased(columns: list[str], amount: float) -> Sensor:
    return _change(columns, lambda curve, time: lambda at: curve(at) + amount)


def scaled(columns: list[str], gain: float) -> Sensor:
    return _change(columns, lambda curve, time: lambda at: gain * curve(at))


def drifting(columns: list[str], rate: float) -> Sensor:
    return _change(columns, lambda curve, time: lambda at: curve(at) + rate * at)


def delayed(columns: list[str], seconds: float) -> Sensor:
    return _change(columns, lambda curve, time: lambda at: curve(at - seconds))


def skewed(columns: list[str], skew: float) -> Sensor:
    return _change(columns, lambda curve, time: lambda at: curve(at * (1.0 + skew)))


def lagged(columns: list[str], time_constant: float, parts: int = 16) -> Sensor:
    """First order, starting settled; integrated exactly for a curve taken as linear over 1/16 of a sample."""

    def wrap(curve: Curve, time: Array) -> Curve:
        fractions = np.arange(parts) / parts
        fine = (time[:, :-1, None] + np.diff(time, axis=1)[:, :, None] * fractions).reshape(len(time), -1)
        fine = np.concatenate([fine, time[:, -1:]], axis=1)
        return fine_curve(fine, first_order(fine, curve(fine), time_constant))

    return _change(columns, wrap)


def first_order(time: Array, value: Array, time_constant: float) -> Array:
    """y' = (x - y)/T for x linear between times (B, M), from y = x at the first."""
    step = np.diff(time, axis=1)
    slope = np.diff(value, axis=1) / step
    # Behind the line that x runs along it stays by T times the line's slope.
    target = value[:, :-1] - slope * time_constant
    keep = np.exp(-step / time_constant)
    fed = target + slope * step - keep * target
    return followed(np.pad(keep, ((0, 0), (1, 0))), np.concatenate([value[:, :1], fed], axis=1))


def turned(sensor: str, rotation: Array) -> Sensor:
    """f_S = R^T f for the forces and torques of a wrench sensor."""

    def apply(channels: Channels) -> Channels:
        columns = dict(channels.columns)
        for triple in (("fx", "fy", "fz"), ("tx", "ty", "tz")):
            sources = [channels.columns[f"wrench.{sensor}.{name}"] for name in triple]
            for row, name in enumerate(triple):
                columns[f"wrench.{sensor}.{name}"] = _mixed(sources, rotation[:, row])
        return Channels(channels.time, columns)

    return apply


def _mixed(sources: list[Curve], weights: Array) -> Curve:
    return lambda at: np.sum([weight * source(at) for weight, source in zip(weights, sources, strict=True)], axis=0)
