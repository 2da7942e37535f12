"""The motion of a recording, estimated from its samples and a model: an iterated Kalman smoother of each joint.

About a motion (q̄, v̄) that was estimated before, each joint obeys the model's acceleration a and a white acceleration w
that no model knows, of spectral density S:

    q̇ = v,    v̇ = a(q̄, v̄) + a_q (q − q̄) + a_v (v − v̄) + w,    E w(t) w(t′) = S δ(t − t′).

S is the likeliest (the innovations' likelihood is maximised): nearly zero where the model is right, so that the whole
recording tells where the joint is, and large where something is missing, so that the samples nearby do. Noise of
the samples that lasts, such as coloured noise, has states of its own beside the joint's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from drake_cafim.diagnosis.noise.coloured import NoiseProcess
from drake_cafim.diagnosis.thresholds import LONGEST_PAUSE_OF_WINDOW
from drake_cafim.numerics.joint_smoother import filter_joint, smooth_joint
from drake_cafim.typing import Array, Flags

DENSITIES = 10.0 ** np.arange(-12.0, 7.0, 1.0)
"""Densities S that are tried, times the square of 1 rad/s (or m/s) over 1 s; those around the likeliest are refined."""
REFINEMENTS = 2
"""Times that the grid about the likeliest density is halved."""
LONGEST_PAUSE = LONGEST_PAUSE_OF_WINDOW
"""Pause between samples, in median sampling intervals, after which a joint starts anew."""
REFUSED = 6.6
"""Rise of −2 ln likelihood at which a smaller density is refused: the 99 % point of χ² with one degree of freedom."""
DIFFUSE = 1e6
"""Variance of the initial state, over that of one sample."""
PASSES = 4
"""Most times that the acceleration is computed along the motion estimated before."""
SETTLED = 0.3
"""Root mean square change of the velocities, in their standard deviations, at which the iteration ends."""


@dataclass(frozen=True)
class Trajectory:
    """Estimated positions and velocities `q`, `v` and the standard deviations of both, (N, n) each, SI units.

    `density` (n,) are the spectral densities S of the accelerations that the model does not explain, and `surprise`
    (n,) is −2 ln likelihood of the innovations, but for a constant.
    """

    q: Array
    v: Array
    q_std: Array
    v_std: Array
    density: Array
    surprise: Array

    def with_joints(self, chosen: Flags, other: "Trajectory") -> "Trajectory":
        """The same with the motion of the `chosen` joints (n,) as in `other`; what the model misses is as it was."""
        names = ("q", "v", "q_std", "v_std")
        return replace(self, **{name: np.where(chosen, getattr(other, name), getattr(self, name)) for name in names})


@dataclass(frozen=True)
class Transition:
    """How each joint's state changes from sample to sample, (N − 1, n) each, in units of rad, s (m, s).

    q₊ = `q_by_q` q + `q_by_v` v + `rise_q`,    v₊ = `v_by_q` q + `v_by_v` v + `rise_v`,

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
    q_by_q: Array

    @staticmethod
    def unknown(time: Array, joints: int) -> "Transition":
        """That of a joint of which no acceleration is known."""
        nothing = np.zeros((len(time) - 1, joints))
        h = np.diff(time)[:, None] + nothing
        return Transition(
            h, nothing, 1.0 + nothing, nothing, nothing, np.zeros((2, len(time), joints)), h, 1.0 + nothing
        )

    def without_model(self, joints: Flags) -> "Transition":
        """The same about the same motion, where nothing is known of the acceleration of these `joints` (n,)."""
        if not np.any(joints):
            return self
        q, v = self.about
        # where the acceleration is not known either, a velocity lasts, and a position changes by it
        h = self.interval
        still = 1.0 + 0.0 * h
        free = Transition(h, 0.0 * h, still, q[:-1] + h * v[:-1] - q[1:], v[:-1] - v[1:], self.about, h, still)
        names = ("q_by_q", "q_by_v", "v_by_q", "v_by_v", "rise_q", "rise_v")
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
        everywhere = h + 0.0 * q[1:]
        about = np.stack([q, v])
        return Transition(
            lasting, pull * lasting, np.exp(decay), rise_q, rise_v, about, everywhere, np.ones_like(everywhere)
        )


@dataclass(frozen=True)
class ChannelNoise:
    """The noise of one channel's samples: white of `variance` (N,), infinite where there is no sample, SI units.

    Beside it `std` times unit noise that the states of `process` make, where there is one.
    """

    variance: Array
    std: float = 0.0
    process: NoiseProcess | None = None


def smooth(
    time: Array, q: Array, v: Array, of_q: Sequence[ChannelNoise], of_v: Sequence[ChannelNoise], transition: Transition
) -> Trajectory:
    """The trajectory of all joints from samples `q`, `v` (N, n) with the noise of each joint's two channels."""
    columns = []
    h = np.ascontiguousarray(np.diff(time))
    longest = LONGEST_PAUSE * float(np.median(h))
    for j, noises in enumerate(zip(of_q, of_v, strict=True)):
        read = np.stack([q[:, j] - transition.about[0, :, j], v[:, j] - transition.about[1, :, j]], axis=1)
        numbers = (longest, h, read, *_state_space(transition, j, noises))
        density = _likeliest_density(numbers)
        columns.append((*smooth_joint(*numbers, density), density))
    q_hat, v_hat, q_std, v_std = (np.stack([column[k] for column in columns], axis=1) for k in range(4))
    q_hat, v_hat = q_hat + transition.about[0], v_hat + transition.about[1]
    surprise, densities = (np.array([column[k] for column in columns]) for k in (4, 5))
    return Trajectory(q_hat, v_hat, q_std, v_std, densities, surprise)


def _state_space(transition: Transition, j: int, noises: Sequence[ChannelNoise]) -> tuple[Array, ...]:
    """The linear model of joint `j` and of its channels' noise: a state of position, velocity and m − 2 of noise.

    The samples' white variances (N, 2) and rows (2, m) that make a sample of a state; the transition (N − 1, m, m), its
    rise (N − 1, 2), the covariance (N − 1, m, m) that noise adds; that of the first state (m, m).
    """
    variance = np.ascontiguousarray(np.stack([noise.variance for noise in noises], axis=1), dtype=float)
    m, N = 2 + sum(noise.process.states for noise in noises if noise.process), len(variance)
    seen, steps, fresh, start = np.eye(2, m), np.zeros((N - 1, m, m)), np.zeros((N - 1, m, m)), np.zeros((m, m))
    steps[:, 0, 0] = transition.q_by_q[:, j]
    steps[:, 0, 1], steps[:, 1, 0] = transition.q_by_v[:, j], transition.v_by_q[:, j]
    steps[:, 1, 1] = transition.v_by_v[:, j]
    scale_q, scale_v = (float(variance[:, k].min()) + noise.std**2 for k, noise in enumerate(noises))
    scale_q = scale_q if np.isfinite(scale_q) else 1.0
    start[0, 0], start[1, 1] = DIFFUSE * scale_q, DIFFUSE * (scale_v if np.isfinite(scale_v) else 1e4 * scale_q)
    first = 2
    for k, noise in enumerate(noises):
        if noise.process is not None:
            own = slice(first, first + noise.process.states)
            seen[k, own] = noise.std * noise.process.output
            steps[:, own, own], fresh[:, own, own] = noise.process.transition, noise.process.fresh
            start[own, own] = noise.process.lasting
            first = own.stop
    rise = np.stack([transition.rise_q[:, j], transition.rise_v[:, j]], axis=1)
    return variance, seen, steps, rise, fresh, start


def _likeliest_density(numbers: tuple[Any, ...]) -> float:
    """The smallest density that the innovations do not refuse against the likeliest one."""
    exponents = np.log10(DENSITIES)
    costs = _costs(numbers, exponents)
    best, step = int(np.argmin(costs)), 1.0
    exponent, cost = float(exponents[best]), float(costs[best])
    for _ in range(REFINEMENTS):
        step *= 0.5
        near = exponent + np.array([-step, step])
        for found, own in zip(near, _costs(numbers, near), strict=True):
            if own < cost:
                exponent, cost = float(found), float(own)
    for smaller, own in zip(exponents, costs, strict=True):
        if own < cost + REFUSED and smaller < exponent:
            return float(10.0**smaller)
    return float(10.0**exponent)


def _costs(numbers: tuple[Any, ...], exponents: Array) -> Array:
    """(D,) −2 ln likelihood of the innovations under densities of these powers of ten."""
    m, nothing = len(numbers[-1]), np.zeros((0, 0, 0))
    costs = filter_joint(*numbers, 10.0**exponents, np.empty((0, m)), nothing, nothing, nothing)
    return np.asarray(costs, dtype=float)
