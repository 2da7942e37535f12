"""The motion of a recording, estimated from its samples and a model: an iterated Kalman smoother of each joint.

About a motion (q̄, v̄) that was estimated before, each joint obeys the model's acceleration a and a white acceleration w
that no model knows, of spectral density S:

    q̇ = v,    v̇ = a(q̄, v̄) + a_q (q − q̄) + a_v (v − v̄) + w,    E w(t) w(t′) = S δ(t − t′).

S is the likeliest (the innovations' likelihood is maximised): nearly zero where the model is right, so that the whole
recording tells where the joint is, and large where something is missing, so that the samples nearby do. The smoother is
that of Rauch, Tung and Striebel (AIAA Journal 3(8), 1965).
"""

from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.thresholds import LONGEST_PAUSE_OF_WINDOW
from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array, Flags

DENSITIES = 10.0 ** np.arange(-12.0, 7.0, 1.0)
"""Densities S that are tried, times the square of 1 rad/s (or m/s) over 1 s; those around the likeliest are refined."""
REFINEMENTS = 2
"""Times that the grid about the likeliest density is halved."""
LONGEST_PAUSE = LONGEST_PAUSE_OF_WINDOW
"""Pause between samples, in median sampling intervals, after which a joint starts anew."""
REFUSED = 6.6
"""Rise of −2 ln likelihood at which a smaller density is refused: the 99 % point of χ² with one degree of freedom."""
DIFFUSE = 1e8
"""Variance of the initial state, over that of one sample."""
PASSES = 4
"""Most times that the acceleration is computed along the motion estimated before."""
SETTLED = 0.3
"""Root mean square change of the velocities, in their standard deviations, at which the iteration ends."""


@dataclass(frozen=True)
class Trajectory:
    """Estimated positions and velocities `q`, `v` and the standard deviations of both, (N, n) each, SI units.

    `density` (n,) are the spectral densities S of the accelerations that the model does not explain.
    """

    q: Array
    v: Array
    q_std: Array
    v_std: Array
    density: Array

    def distance(self, other: "Trajectory") -> Array:
        """(n,) root mean square difference of the velocities from those of `other`, in its standard deviations."""
        apart = np.clip((self.v - other.v) / np.maximum(other.v_std, np.finfo(float).tiny), -1e100, 1e100)
        return np.asarray(np.sqrt(np.mean(apart**2, axis=0)))

    def with_joints(self, chosen: Flags, other: "Trajectory") -> "Trajectory":
        """The same with the `chosen` joints (n,) as in `other`."""
        names = ("q", "v", "q_std", "v_std", "density")
        return Trajectory(*(np.where(chosen, getattr(other, name), getattr(self, name)) for name in names))


@dataclass(frozen=True)
class Transition:
    """How each joint's state changes from sample to sample, (N − 1, n) each, in units of rad, s (m, s).

    q₊ = q + `q_by_v` v + `rise_q`,    v₊ = `v_by_q` q + `v_by_v` v + `rise_v`,

    for deviations from the motion `about`, (2, N, n), or for the state itself where that is zero.
    """

    q_by_v: Array
    v_by_q: Array
    v_by_v: Array
    rise_q: Array
    rise_v: Array
    about: Array
    interval: Array
    """(N − 1, n) s, the sample intervals."""

    @staticmethod
    def unknown(time: Array, joints: int) -> "Transition":
        """That of a joint of which no acceleration is known."""
        nothing = np.zeros((len(time) - 1, joints))
        h = np.diff(time)[:, None] + nothing
        return Transition(h, nothing, 1.0 + nothing, nothing, nothing, np.zeros((2, len(time), joints)), h)

    def without_model(self, joints: Flags) -> "Transition":
        """The same about the same motion, where nothing is known of the acceleration of these `joints` (n,)."""
        if not np.any(joints):
            return self
        q, v = self.about
        # where the acceleration is not known either, a velocity lasts, and a position changes by it
        h = self.interval
        free = Transition(h, 0.0 * h, 1.0 + 0.0 * h, q[:-1] + h * v[:-1] - q[1:], v[:-1] - v[1:], self.about, h)
        names = ("q_by_v", "v_by_q", "v_by_v", "rise_q", "rise_v")
        return replace(self, **{name: np.where(joints, getattr(free, name), getattr(self, name)) for name in names})

    @staticmethod
    def of(
        time: Array,
        q: Array,
        v: Array,
        gain: Array,
        way: Array,
        by_q: Array,
        by_v: Array,
        ends: tuple[Array | float, Array | float] = (0.5, 1.0 / 6.0),
    ) -> "Transition":
        """That of a model about the motion `q`, `v` (N, n).

        `gain` and `way` (N − 1, n) are the integral and the double integral of its acceleration over each sample
        interval; `by_q` and `by_v` (N, n) its derivatives by the joint's own position and velocity. `ends` are the
        weights of the acceleration at an interval's end in both, over h and over h².
        """
        h = np.diff(time)[:, None]
        rate, pull = (0.5 * (slope[:-1] + slope[1:]) for slope in (by_v, by_q))
        decay = np.minimum(rate * h, 0.0)
        # exact for a constant rate: a stiff friction takes a deviation away within an interval
        lasting = h * np.where(decay < -1e-6, np.expm1(decay) / np.where(decay < -1e-6, decay, 1.0), 1.0 + 0.5 * decay)
        missed_q, missed_v = q[:-1] + h * v[:-1] + way - q[1:], v[:-1] + gain - v[1:]
        # what is missed at the interval's end changes the law there, which opposes it: (1 + w λ) δv = missed
        braking = np.maximum(-by_v[1:], 0.0) * h
        rise_v = missed_v / (1.0 + ends[0] * braking)
        rise_q = missed_q - h * ends[1] * braking * rise_v
        return Transition(lasting, pull * lasting, np.exp(decay), rise_q, rise_v, np.stack([q, v]), h + 0.0 * q[1:])


def smooth(time: Array, q: Array, v: Array, variance_q: Array, variance_v: Array, transition: Transition) -> Trajectory:
    """The trajectory of all joints from samples `q`, `v` (N, n) with these variances (N, n); infinite where missing."""
    columns = []
    h = np.ascontiguousarray(np.diff(time))
    away = (q - transition.about[0], v - transition.about[1], variance_q, variance_v)
    steps = (transition.q_by_v, transition.v_by_q, transition.v_by_v, transition.rise_q, transition.rise_v)
    for j in range(q.shape[1]):
        numbers = tuple(np.ascontiguousarray(part[:, j], dtype=float) for part in (*away, *steps))
        density = _likeliest_density(h, numbers)
        columns.append((*_smoothed(h, *numbers, density), density))
    q_hat, v_hat, q_std, v_std = (np.stack([column[k] for column in columns], axis=1) for k in range(4))
    q_hat, v_hat = q_hat + transition.about[0], v_hat + transition.about[1]
    return Trajectory(q_hat, v_hat, q_std, v_std, np.array([column[4] for column in columns]))


def _likeliest_density(h: Array, samples: tuple[Array, ...]) -> float:
    """The smallest density that the innovations do not refuse against the likeliest one."""
    exponents = np.log10(DENSITIES)
    costs = [_cost(h, *samples, 10.0**exponent) for exponent in exponents]
    best, step = int(np.argmin(costs)), 1.0
    exponent, cost = float(exponents[best]), costs[best]
    for _ in range(REFINEMENTS):
        step *= 0.5
        for near in (exponent - step, exponent + step):
            found = _cost(h, *samples, 10.0**near)
            if found < cost:
                exponent, cost = near, found
    for smaller, own in zip(exponents, costs, strict=True):
        if own < cost + REFUSED and smaller < exponent:
            return float(10.0**smaller)
    return float(10.0**exponent)


@compiled
def _filtered(
    h: Array,
    q: Array,
    v: Array,
    variance_q: Array,
    variance_v: Array,
    q_by_v: Array,
    v_by_q: Array,
    v_by_v: Array,
    rise_q: Array,
    rise_v: Array,
    density: float,
    means: Array,
    covariances: Array,
) -> float:
    """Twice the negative log likelihood of the innovations; fills the filtered `means` (N, 2), `covariances` (N, 3)."""
    N, cost, started = len(q), 0.0, 0
    longest = LONGEST_PAUSE * np.median(h)
    scale_q, scale_v = np.inf, np.inf
    for k in range(N):
        scale_q, scale_v = min(scale_q, variance_q[k]), min(scale_v, variance_v[k])
    if not np.isfinite(scale_q):
        scale_q = 1.0
    if not np.isfinite(scale_v):
        scale_v = 1e4 * scale_q
    x, y, a, b, c = q[0], v[0] if np.isfinite(variance_v[0]) else 0.0, DIFFUSE * scale_q, 0.0, DIFFUSE * scale_v
    for k in range(N):
        if k > 0:
            dt, f, g, r = h[k - 1], q_by_v[k - 1], v_by_q[k - 1], v_by_v[k - 1]
            x, y = x + f * y + rise_q[k - 1], g * x + r * y + rise_v[k - 1]
            if h[k - 1] > longest:
                # nobody knows what happened in between: the joint starts anew
                x, y = q[k], v[k] if np.isfinite(variance_v[k]) else 0.0
                a, b, c, started = DIFFUSE * scale_q, 0.0, DIFFUSE * scale_v, k
            else:
                a, b, c = (
                    a + f * (2.0 * b + f * c) + density * dt**3 / 3.0,
                    g * a + (r + f * g) * b + f * r * c + density * dt**2 / 2.0,
                    g * g * a + 2.0 * g * r * b + r * r * c + density * dt,
                )
        if np.isfinite(variance_q[k]):
            s, e = a + variance_q[k], q[k] - x
            if k > started + 1:
                cost += e * e / s + np.log(s)
            g, f = a / s, b / s
            x, y = x + g * e, y + f * e
            c -= f * b
            a, b = a * variance_q[k] / s, b * variance_q[k] / s
        if np.isfinite(variance_v[k]):
            s, e = c + variance_v[k], v[k] - y
            if k > started + 1:
                cost += e * e / s + np.log(s)
            g, f = b / s, c / s
            x, y = x + g * e, y + f * e
            a -= g * b
            b, c = b * variance_v[k] / s, c * variance_v[k] / s
        means[k, 0], means[k, 1] = x, y
        covariances[k, 0], covariances[k, 1], covariances[k, 2] = a, b, c
    return cost


@compiled
def _cost(
    h: Array,
    q: Array,
    v: Array,
    variance_q: Array,
    variance_v: Array,
    q_by_v: Array,
    v_by_q: Array,
    v_by_v: Array,
    rise_q: Array,
    rise_v: Array,
    density: float,
) -> float:
    means, covariances = np.empty((len(q), 2)), np.empty((len(q), 3))
    steps = (q_by_v, v_by_q, v_by_v, rise_q, rise_v)
    cost: float = _filtered(h, q, v, variance_q, variance_v, *steps, density, means, covariances)
    return cost


@compiled
def _smoothed(
    h: Array,
    q: Array,
    v: Array,
    variance_q: Array,
    variance_v: Array,
    q_by_v: Array,
    v_by_q: Array,
    v_by_v: Array,
    rise_q: Array,
    rise_v: Array,
    density: float,
) -> tuple[Array, Array, Array, Array]:
    """Smoothed q, v and their standard deviations, (N,) each."""
    N = len(q)
    longest = LONGEST_PAUSE * np.median(h)
    means, covariances = np.empty((N, 2)), np.empty((N, 3))
    steps = (q_by_v, v_by_q, v_by_v, rise_q, rise_v)
    _filtered(h, q, v, variance_q, variance_v, *steps, density, means, covariances)
    q_std, v_std = np.empty(N), np.empty(N)
    q_std[N - 1], v_std[N - 1] = np.sqrt(max(covariances[N - 1, 0], 0.0)), np.sqrt(max(covariances[N - 1, 2], 0.0))
    x, y = means[N - 1, 0], means[N - 1, 1]
    A, B, C = covariances[N - 1, 0], covariances[N - 1, 1], covariances[N - 1, 2]
    for k in range(N - 2, -1, -1):
        dt, f, g, r = h[k], q_by_v[k], v_by_q[k], v_by_v[k]
        a, b, c = covariances[k, 0], covariances[k, 1], covariances[k, 2]
        if h[k] > longest:
            x, y, A, B, C = means[k, 0], means[k, 1], a, b, c
            q_std[k], v_std[k] = np.sqrt(max(A, 0.0)), np.sqrt(max(C, 0.0))
            continue
        # what the filter predicts at k + 1
        px = means[k, 0] + f * means[k, 1] + rise_q[k]
        py = g * means[k, 0] + r * means[k, 1] + rise_v[k]
        pa = a + f * (2.0 * b + f * c) + density * dt**3 / 3.0
        pb = g * a + (r + f * g) * b + f * r * c + density * dt**2 / 2.0
        pc = g * g * a + 2.0 * g * r * b + r * r * c + density * dt
        det = pa * pc - pb * pb
        if det <= 0.0:
            det = 1e-300
        # G = P Fᵀ P₊⁻¹
        u11, u12, u21, u22 = a + f * b, g * a + r * b, b + f * c, g * b + r * c
        g11, g12 = (u11 * pc - u12 * pb) / det, (u12 * pa - u11 * pb) / det
        g21, g22 = (u21 * pc - u22 * pb) / det, (u22 * pa - u21 * pb) / det
        dx, dy = x - px, y - py
        x, y = means[k, 0] + g11 * dx + g12 * dy, means[k, 1] + g21 * dx + g22 * dy
        dA, dB, dC = A - pa, B - pb, C - pc
        nA = a + g11 * (g11 * dA + g12 * dB) + g12 * (g11 * dB + g12 * dC)
        nB = b + g11 * (g21 * dA + g22 * dB) + g12 * (g21 * dB + g22 * dC)
        nC = c + g21 * (g21 * dA + g22 * dB) + g22 * (g21 * dB + g22 * dC)
        A, B, C = nA, nB, nC
        means[k, 0], means[k, 1] = x, y
        q_std[k], v_std[k] = np.sqrt(max(A, 0.0)), np.sqrt(max(C, 0.0))
    return means[:, 0].copy(), means[:, 1].copy(), q_std, v_std
