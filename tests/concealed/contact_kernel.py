"""The contact law at each contact point, compiled, for simulations that evaluate few points very often."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

RELEASE = 1e-3  # s, in which a bristle or a relaxing force is let go once out of contact
FOLLOWED, FORGOTTEN = 3e-3, 0.8  # s, in which a lasting dent follows the deepest depth, and is forgotten
# fmt: off
NUMBERS = (
    "stiffness", "damping", "friction", "slip_velocity", "static", "stribeck_velocity", "adhesion",
    "adhesion_range", "cubic", "relaxing", "relaxation_time", "dissipation", "first", "second", "angle",
    "presliding", "offset", "patch_part", "patch_rate", "patch_phase", "plastic", "ageing", "electric", "swelling",
    "hysteresis",
)
# fmt: on
"""Of a law, as numbers; zeros, and a `static` or `first` that is none, switch effects off."""
LAW = np.dtype([(name, float) for name in NUMBERS])


def _kept(function: Any) -> Any:
    """`function` compiled at its first call, and kept for the next process where there is a place to."""
    try:
        return numba.njit(cache=True)(function)
    except RuntimeError:
        return numba.njit(function)


@_kept
def _pushing(law: Any, t: float, d: float, d_rate: float, z: Any) -> float:
    """Normal force (N) at depth d, before it is kept from pulling."""
    push = law.stiffness * d * (1.0 + law.dissipation * d_rate) + law.damping * d_rate + law.cubic * d**3
    if law.relaxing != 0.0:
        push = push + z[2]
    if law.plastic != 0.0:
        push = push - law.stiffness * law.plastic * z[4]
    if law.hysteresis != 0.0:
        push = push * (1.0 + law.hysteresis * np.tanh(d_rate / 0.003))
    if law.electric != 0.0:
        push = push + law.electric * np.sin(2.0 * np.pi * 3.3 * t) ** 3
    return float(push)


@_kept
def _coefficient(law: Any, x: float, y: float, speed: float, age: float) -> float:
    """Coefficient of friction, the same in all directions."""
    mu = law.friction
    if law.static == law.static:
        mu = mu + (law.static - law.friction) * np.exp(-((speed / law.stribeck_velocity) ** 2))
    if law.patch_rate != 0.0:
        there = np.sin(law.patch_rate * x + law.patch_phase) * np.sin(law.patch_rate * y - law.patch_phase)
        mu = mu * (1.0 + law.patch_part * there)
    if law.ageing != 0.0:
        mu = mu * (1.0 + law.ageing * age)
    return float(mu)


@_kept
def _flow(law: Any, p: Any, sliding: Any, speed: float, z: Any) -> Any:
    """What the normal force is multiplied by along the surface's two axes, against the motion."""
    if law.presliding != 0.0:
        bristle = law.friction / law.presliding
        return bristle * z[0], bristle * z[1]
    # tanh(s/w)/s is finite at rest.
    factor = 1.0 / law.slip_velocity
    if speed / law.slip_velocity > 1e-6:
        factor = np.tanh(speed / law.slip_velocity) / speed
    if law.first == law.first:
        c, s = np.cos(law.angle), np.sin(law.angle)
        along_first, along_second = (
            law.first * (c * sliding[0] + s * sliding[1]),
            law.second * (c * sliding[1] - s * sliding[0]),
        )
        return factor * (along_first * c - along_second * s), factor * (along_first * s + along_second * c)
    factor = factor * _coefficient(law, p[0], p[1], speed, z[3])
    return factor * sliding[0], factor * sliding[1]


@_kept
def _grown(law: Any, sliding: Any, speed: float, d: float, d_rate: float, z: Any, out: Any) -> None:
    """Rates of a touching point's hidden states into `out` (5,)."""
    if law.presliding != 0.0:
        for i in range(2):
            out[i] = sliding[i] - speed * z[i] / law.presliding
    if law.relaxing != 0.0:
        out[2] = law.relaxing * d_rate - z[2] / law.relaxation_time
    if law.ageing != 0.0:
        out[3] = 1.0
    if law.plastic != 0.0:
        out[4] = max(0.0, d - z[4]) / FOLLOWED - z[4] / FORGOTTEN


@_kept
def _released(law: Any, z: Any, out: Any) -> None:
    """Rates of a free point's hidden states into `out` (5,)."""
    for i in range(5):
        out[i] = -z[i] / RELEASE
    if law.plastic != 0.0:
        out[4] = -z[4] / FORGOTTEN


@_kept
def _dot(a: Any, b: Any) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@_kept
def at_points(laws: Any, axes: Any, time: Any, points: Any, velocities: Any, hidden: Any, touching: Any) -> Any:
    """As ContactLaw.force; `laws` (1,) of dtype LAW, `axes` (3, 3) the normal and two directions on the surface."""
    law, shape = laws[0], points.shape[:2]
    n, first, second = axes[0], axes[1], axes[2]
    force, rates = np.zeros(points.shape), np.zeros(hidden.shape)
    pushing, depth = np.zeros(shape), np.empty(shape)
    for b in range(shape[0]):
        for k in range(shape[1]):
            p, v, z = points[b, k], velocities[b, k], hidden[b, k]
            d = law.offset + law.swelling * time[b] - _dot(p, n)
            d_rate = law.swelling - _dot(v, n)
            depth[b, k], net = d, 0.0
            if touching[b, k]:
                sliding = v - _dot(v, n) * n
                speed, along = np.sqrt(_dot(sliding, sliding)), (_dot(sliding, first), _dot(sliding, second))
                net = pushing[b, k] = max(0.0, _pushing(law, time[b], d, d_rate, z))
                along_first, along_second = _flow(law, p, along, speed, z)
                force[b, k] = -pushing[b, k] * (along_first * first + along_second * second)
                _grown(law, along, speed, d, d_rate, z, rates[b, k])
            else:
                _released(law, z, rates[b, k])
            if law.adhesion != 0.0:
                net -= law.adhesion * np.exp(min(d, 0.0) / law.adhesion_range)
            force[b, k] += net * n
    return force, pushing, rates, depth
