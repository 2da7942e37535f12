"""What joints under position servos make of the steps of their commands, between the samples.

Steps add up to staircases S of effort. Beside everything else that moves them, the joints answer to S by x(t),

    ẍ = M⁻¹ E,    E = S − k x − d ẋ,    k and d the slopes of each servo's effort by its own q and v,

and E is left of the staircases. Its integrals are those of x: with ẍ the sum of m_jk E_k over the joints k,

    ∫ ẍ dt = Δẋ,    ∫ (t − t̄) ẍ dt = h (ẋ₁ + ẋ₂)/2 − Δx    over an interval h about its middle t̄.

A light joint takes a step back long before the next sample, a heavy one hardly at all. The joints are solved one after
the other, each under what is left at the others, taken as linear in time with the right integral and moment (block
Gauss-Seidel; M is positive definite).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drake_cafim.effects.actuator import Effort
from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array

SWEEPS = 4
"""Times that each joint is solved. An error falls by m_jk²/(m_jj m_kk) from one to the next, or by more."""


@dataclass(frozen=True)
class StepResponse:
    """The effort E that is left of one joint's steps, over N samples.

    `integral` (N − 1,) is ∫ E dt over each sample interval, `moment` (N − 1,) is ∫ (t − t̄) E dt about its middle t̄;
    `after` (N,) is E just after each sample, `before` (N,) just before; `q`, `v` (N,) are x and ẋ at the samples.
    """

    integral: Array
    moment: Array
    after: Array
    before: Array
    q: Array
    v: Array


def responses(
    time: Array, mobility: Array, slopes: tuple[Array, Array], steps: Mapping[int, Effort]
) -> dict[int, StepResponse]:
    """The answer of each joint to the staircases `steps` of all of them, by joint index.

    `mobility` M⁻¹ (N, n, n) and `slopes` k and d (N, n), none negative, hold from each sample of `time` (N,) s to the
    next. Where all slopes are zero nothing is taken back, and x is left at zero.
    """
    edges = [own.times[(own.times > time[0]) & (own.times < time[-1])] for own in steps.values()]
    grid = np.unique(np.concatenate([time, *edges]))
    h, middle = np.diff(grid), 0.5 * (grid[1:] + grid[:-1])
    at = np.searchsorted(grid, time)
    piece = np.clip(np.searchsorted(time, middle, side="right") - 1, 0, len(time) - 2)
    m, (k, d) = mobility[piece], (slope[piece] for slope in slopes)
    # masses that a fit tries may be none at all: a joint then answers as if it were very heavy
    alone = {j: np.maximum(m[:, j, j], LEAST_MOBILITY * np.median(np.abs(m[:, j, j]))) for j in steps}
    held = {j: own.at(middle) for j, own in steps.items()}
    taken = np.any([slope != 0.0 for slope in slopes])
    # mean and moment of what is left over each piece, and the state at its edges
    mean, moment = ({j: (0.0 if taken else 1.0) * held[j] for j in steps}, {j: np.zeros(len(h)) for j in steps})
    state = {j: (np.zeros(len(grid)), np.zeros(len(grid))) for j in steps}
    answers = {j: oscillator(own * k[:, j], own * d[:, j], h) for j, own in alone.items()} if taken else {}
    for _ in range(SWEEPS if len(steps) > 1 else 1):
        for j in answers:
            others = [i for i in steps if i != j]
            pushed = sum((m[:, j, i] * mean[i] for i in others), np.zeros(len(h)))
            turned = sum((m[:, j, i] * moment[i] for i in others), np.zeros(len(h)))
            x, v = state[j] = _follow(*answers[j], alone[j] * held[j] + pushed, 12.0 * turned / h**3)
            mean[j] = (np.diff(v) / h - pushed) / alone[j]
            moment[j] = (0.5 * h * (v[1:] + v[:-1]) - np.diff(x) - turned) / alone[j]
    # about the middle of a sample interval, a piece beside it has a moment by its mean as well
    arm = middle - 0.5 * (time[piece] + time[piece + 1])
    found = {}
    for j, own in steps.items():
        x, v = (values[at] for values in state[j])
        integral = np.asarray(np.bincount(piece, mean[j] * h, len(time) - 1), dtype=float)
        about = np.asarray(np.bincount(piece, moment[j] + arm * mean[j] * h, len(time) - 1), dtype=float)
        after = own.at(time) - slopes[0][:, j] * x - slopes[1][:, j] * v
        last = np.maximum(np.arange(len(time)) - 1, 0)
        before = own.before(time) - slopes[0][last, j] * x - slopes[1][last, j] * v
        found[j] = StepResponse(integral, about, after, before, x, v)
    return found


def oscillator(stiffness: Array, damping: Array, h: Array) -> tuple[Array, ...]:
    """How ẍ = f − ω² x − λ ẋ goes over `h` (P,) s, with `stiffness` ω² 1/s² and `damping` λ 1/s (P,).

    φ₁₁, φ₁₂, φ₂₁, φ₂₂ are the state's at the end by its at the begin; then x and ẋ at the end, from rest, under f = 1
    and under f = t − h/2.
    """
    a = 0.5 * damping
    beyond = a**2 - stiffness
    b = np.sqrt(np.abs(beyond))
    over = beyond > 0.0
    # e^(−a h) cosh(b h) and e^(−a h) sinh(b h)/b without differences of large numbers; cos, sin where b is imaginary
    slow, fast = np.exp(-np.where(over, stiffness / np.maximum(a + b, 1e-300), 0.0) * h), np.exp(-(a + b) * h)
    even = np.where(over, 0.5 * (slow + fast), np.exp(-a * h) * np.cos(b * h))
    close = b * h < CLOSE
    odd = np.where(over, 0.5 * (slow - fast), np.exp(-a * h) * np.sin(b * h)) / np.where(close, 1.0, b)
    odd = np.where(close, np.exp(-a * h) * h, odd)
    first = even + a * odd
    # under a constant force x is (1 − φ₁₁)/ω², or without stiffness (h − (1 − e^(−λ h))/λ)/λ; under a ramp the integral
    # of that, (h − φ₁₂ − λ x)/ω² or (h²/2 − x)/λ
    lasting, loose = np.maximum(damping * h, CLOSE), stiffness * h**2 < CLOSE
    stiff, damped = np.where(loose, 1.0, stiffness), damping * h > CLOSE
    way = np.where(damped, (1.0 + np.expm1(-lasting) / lasting) / lasting, 0.5) * h**2
    way = np.where(loose, way, (1.0 - first) / stiff)
    ramp = np.where(damped, (0.5 - way / h**2) / lasting, 1.0 / 6.0) * h**3
    ramp = np.where(loose, ramp, (h - odd - damping * way) / stiff)
    return first, odd, -stiffness * odd, even - a * odd, way, odd, ramp - 0.5 * h * way, way - 0.5 * h * odd


LEAST_MOBILITY = 1e-6
"""Least mobility of a joint, over its median."""
CLOSE = 1e-5
"""Numbers without a unit below which series replace differences."""


@compiled
def _follow(
    by_x: Array,
    by_v: Array,
    v_by_x: Array,
    v_by_v: Array,
    way: Array,
    rise: Array,
    way_by_slope: Array,
    rise_by_slope: Array,
    force: Array,
    slope: Array,
) -> tuple[Array, Array]:
    """x and ẋ, (P + 1,) each, from rest, under `force` and its `slope` over each piece."""
    x, v = np.zeros(len(force) + 1), np.zeros(len(force) + 1)
    for i in range(len(force)):
        x[i + 1] = by_x[i] * x[i] + by_v[i] * v[i] + way[i] * force[i] + way_by_slope[i] * slope[i]
        v[i + 1] = v_by_x[i] * x[i] + v_by_v[i] * v[i] + rise[i] * force[i] + rise_by_slope[i] * slope[i]
    return x, v
