"""Desired motions: multisines of several kinds, with rich and with poor excitation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .robots import Array

KINDS = ("rich", "rich", "rich", "rich", "slow", "few", "small", "monotone")


@dataclass(frozen=True)
class Desired:
    """Desired position, velocity and acceleration (B, N, n)."""

    q: Array
    v: Array
    a: Array
    kind: str


def multisine(time: Array, amplitude: Array, frequency: Array, phase: Array) -> tuple[Array, Array, Array]:
    """Sum over the last axis of amplitude sin(2 pi f t + phase), with its two derivatives; time (N,), others (K,)."""
    angle = 2.0 * np.pi * frequency * time[:, None] + phase
    rate = 2.0 * np.pi * frequency
    return (
        np.sin(angle) @ amplitude,
        np.cos(angle) @ (amplitude * rate),
        -np.sin(angle) @ (amplitude * rate**2),
    )


def _ramp(time: Array, seconds: float) -> tuple[Array, Array, Array]:
    """A quintic step from 0 to 1 over `seconds` with its derivatives."""
    s = np.clip(time / seconds, 0.0, 1.0)
    return (
        s**3 * (10.0 - 15.0 * s + 6.0 * s**2),
        30.0 * s**2 * (1.0 - s) ** 2 / seconds,
        60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / seconds**2,
    )


def desired(
    rng: np.random.Generator, members: int, samples: int, step: float, size: int, kind: str, linear: np.ndarray
) -> Desired:
    """Random desired motions from rest; `linear` (n,) marks prismatic joints, whose amplitudes are a tenth."""
    time = step * np.arange(samples)
    ramp, ramp1, ramp2 = _ramp(time, 0.6)
    q, v, a = (np.zeros((members, samples, size)) for _ in range(3))
    moving = rng.random(size) < 0.5 if kind == "few" else np.ones(size, dtype=bool)
    if not moving.any():
        moving[rng.integers(size)] = True
    for member in range(members):
        for joint in range(size):
            terms = 2 if kind == "slow" else int(rng.integers(4, 7))
            top = 0.35 if kind == "slow" else rng.uniform(1.2, 2.4)
            frequency = np.sort(rng.uniform(0.1, top, terms))
            peak = rng.uniform(1.0, 2.5)  # rad/s that the sines may sum to
            if kind == "small":
                peak *= 0.15
            shape = rng.dirichlet(np.ones(terms))
            amplitude = np.minimum(peak * shape / (2.0 * np.pi * frequency), 0.5 / terms)
            if linear[joint]:
                amplitude *= 0.2
            s0, s1, s2 = multisine(time, amplitude, frequency, rng.uniform(0.0, 2.0 * np.pi, terms))
            centre = rng.uniform(-0.5, 0.5) * (0.2 if linear[joint] else 1.0)
            if kind == "monotone":
                speed = rng.choice([-1.0, 1.0]) * rng.uniform(0.15, 0.35) * (0.2 if linear[joint] else 1.0)
                s0, s1, s2 = 0.05 * s0 + speed * time, 0.05 * s1 + speed, 0.05 * s2
            if not moving[joint]:
                s0 = s1 = s2 = np.zeros(samples)
            start = s0[0]
            s0 = s0 - start
            q[member, :, joint] = centre + ramp * s0
            v[member, :, joint] = ramp1 * s0 + ramp * s1
            a[member, :, joint] = ramp2 * s0 + 2.0 * ramp1 * s1 + ramp * s2
    return Desired(q, v, a, kind)
