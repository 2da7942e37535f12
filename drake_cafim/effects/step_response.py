"""What joints under position servos make of the steps of their commands, between the samples.

Steps add up to staircases S of effort. Beside everything else that moves them, the joints answer to S by x(t),

    ẍ = M⁻¹ E,    E = S − k x − d ẋ,    k and d the slopes of each servo's effort by its own q and v,

and E is left of the staircases. Its integrals are those of x: with ẍ the sum of m_jk E_k over the joints k,

    ∫ ẍ dt = Δẋ,    ∫ (t − t̄) ẍ dt = h (ẋ₁ + ẋ₂)/2 − Δx    over an interval h about its middle t̄.

A light joint takes a step back long before the next sample, a heavy one hardly at all. The joints are solved one after
the other, each under what is left at the others, taken as linear in time with the right integral and moment (block
Gauss-Seidel; M is positive definite).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drake_cafim.effects.actuator import Effort
from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array, Indices

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


@dataclass(frozen=True)
class Left:
    """By joint: `mean` and `moment` (P,) of E over each piece, about its middle, and x and ẋ (G,) at their edges."""

    mean: dict[int, Array]
    moment: dict[int, Array]
    state: dict[int, tuple[Array, Array]]
    sweeps: dict[int, list[tuple[Array, ...]]]
    """x, ẋ (G,), and the acceleration under which they are solved, mean and slope (P,), in each sweep."""


@dataclass(frozen=True)
class Answers:
    """The joints' answers to all staircases `steps`, by joint index: P pieces lie between the G times `grid`.

    `mobility` M⁻¹ (N, n, n) and `slopes` k and d (N, n), none negative, hold from each sample of `time` (N,) s to the
    next. Where all slopes are zero nothing is taken back, and x is left at zero.
    """

    time: Array
    mobility: Array
    slopes: tuple[Array, Array]
    steps: Mapping[int, Effort]
    grid: Array

    @classmethod
    def of(cls, time: Array, mobility: Array, slopes: tuple[Array, Array], steps: Mapping[int, Effort]) -> "Answers":
        """The answers, on the times of the samples and of all steps."""
        edges = [own.times[(own.times > time[0]) & (own.times < time[-1])] for own in steps.values()]
        return cls(time, mobility, slopes, steps, np.unique(np.concatenate([time, *edges])))

    @cached_property
    def responses(self) -> dict[int, StepResponse]:
        """What is left of each joint's steps."""
        return {j: self._response(j, own, self._left) for j, own in self.steps.items()}

    def by_slopes(self, joint: int, by_k: float, by_d: float, by_steps: Effort) -> dict[int, StepResponse]:
        """The derivative of `responses` by a number, by which one joint's k, d and staircase have these derivatives."""
        still = Effort(self.grid[:1], np.zeros(1))
        steps = {j: by_steps if j == joint else still for j in self.steps}
        changed = []
        if joint in self._oscillators:
            m = self._alone[joint]
            k, d = (m * slope[self._piece, joint] for slope in self.slopes)
            both = zip(*oscillator_slopes(k, d, self._h), strict=True)
            by = [m * (by_k * by_stiffness + by_d * by_damping) for by_stiffness, by_damping in both]
            for x, v, force, slope in self._left.sweeps[joint]:
                way = by[0] * x[:-1] + by[1] * v[:-1] + by[4] * force + by[6] * slope
                changed.append((way, by[2] * x[:-1] + by[3] * v[:-1] + by[5] * force + by[7] * slope))
        left = self._solve(steps, {joint: changed})
        found = {j: self._response(j, own, left) for j, own in steps.items()}
        own = found[joint]
        taken = by_k * self.responses[joint].q + by_d * self.responses[joint].v
        found[joint] = replace(own, after=own.after - taken, before=own.before - taken)
        return found

    @cached_property
    def _h(self) -> Array:
        return np.diff(self.grid)

    @cached_property
    def _middle(self) -> Array:
        return 0.5 * (self.grid[1:] + self.grid[:-1])

    @cached_property
    def _piece(self) -> Indices:
        """(P,) the sample interval that each piece lies in."""
        return np.clip(np.searchsorted(self.time, self._middle, side="right") - 1, 0, len(self.time) - 2)

    @cached_property
    def _m(self) -> Array:
        """(P, n, n) the mobility."""
        return self.mobility[self._piece]

    @cached_property
    def _alone(self) -> dict[int, Array]:
        """(P,) each joint's own mobility; masses that a fit tries may be none at all: it is then as if very heavy."""
        own = {j: self._m[:, j, j] for j in self.steps}
        return {j: np.maximum(m, LEAST_MOBILITY * np.median(np.abs(m))) for j, m in own.items()}

    @cached_property
    def _oscillators(self) -> dict[int, tuple[Array, ...]]:
        """How each joint goes over each piece; empty where nothing is taken back."""
        k, d = (slope[self._piece] for slope in self.slopes)
        taken = np.any(k != 0.0) or np.any(d != 0.0)
        return {j: oscillator(m * k[:, j], m * d[:, j], self._h) for j, m in self._alone.items()} if taken else {}

    @cached_property
    def _left(self) -> Left:
        return self._solve(self.steps, {})

    def _by_others(self, joint: int, left: Left) -> tuple[Array, Array]:
        """(P,) the mean acceleration of a joint by what is `left` at the others, and the integral of its moment."""
        others, nothing = [i for i in self.steps if i != joint], np.zeros(len(self._h))
        pushed = sum((self._m[:, joint, i] * left.mean[i] for i in others), nothing)
        return pushed, sum((self._m[:, joint, i] * left.moment[i] for i in others), nothing)

    # sweeps that diverge, under values that a fit tries, leave infinite rows, which no fit takes
    @np.errstate(over="ignore", invalid="ignore")
    def _solve(self, steps: Mapping[int, Effort], changed: Mapping[int, Sequence[tuple[Array, Array]]]) -> Left:
        """What is left of `steps` where x and ẋ of a joint change by `changed` in each sweep, (P,) each, besides."""
        held = {j: own.at(self._middle) for j, own in steps.items()}
        # where nothing is taken back, all is left
        mean = {j: (0.0 if self._oscillators else 1.0) * own for j, own in held.items()}
        rest = {j: (np.zeros(len(self.grid)), np.zeros(len(self.grid))) for j in steps}
        left = Left(mean, {j: np.zeros(len(self._h)) for j in steps}, rest, {j: [] for j in steps})
        for sweep in range(SWEEPS if len(steps) > 1 else 1):
            for j, answer in self._oscillators.items():
                pushed, turned = self._by_others(j, left)
                force, slope = self._alone[j] * held[j] + pushed, 12.0 * turned / self._h**3
                way, rise = answer[4] * force + answer[6] * slope, answer[5] * force + answer[7] * slope
                if j in changed:
                    way, rise = way + changed[j][sweep][0], rise + changed[j][sweep][1]
                x, v = left.state[j] = _follow(*answer[:4], way, rise)
                left.sweeps[j].append((x, v, force, slope))
                left.mean[j] = (np.diff(v) / self._h - pushed) / self._alone[j]
                left.moment[j] = (0.5 * self._h * (v[1:] + v[:-1]) - np.diff(x) - turned) / self._alone[j]
        return left

    @np.errstate(over="ignore", invalid="ignore")
    def _response(self, joint: int, steps: Effort, left: Left) -> StepResponse:
        """The response of a joint of whose `steps` that is `left`."""
        time, piece, h = self.time, self._piece, self._h
        # about the middle of a sample interval, a piece beside it has a moment by its mean as well
        arm = self._middle - 0.5 * (time[piece] + time[piece + 1])
        integral = np.asarray(np.bincount(piece, left.mean[joint] * h, len(time) - 1), dtype=float)
        moment = left.moment[joint] + arm * left.mean[joint] * h
        about = np.asarray(np.bincount(piece, moment, len(time) - 1), dtype=float)
        x, v = (values[np.searchsorted(self.grid, time)] for values in left.state[joint])
        last = np.maximum(np.arange(len(time)) - 1, 0)
        k, d = (slope[:, joint] for slope in self.slopes)
        after, before = steps.at(time) - k * x - d * v, steps.before(time) - k[last] * x - d[last] * v
        return StepResponse(integral, about, after, before, x, v)


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


def oscillator_slopes(stiffness: Array, damping: Array, h: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """The derivatives of what `oscillator` gives by the stiffness ω², and by the damping λ."""
    first, odd, _, even_less, way, _, turned, _ = oscillator(stiffness, damping, h)
    a = 0.5 * damping
    even = 0.5 * (first + even_less)
    beyond = a**2 - stiffness
    # g = −∂(sinh(b h) e^(−a h)/b)/∂ω²
    close = np.abs(beyond) * h**2 < CLOSE
    g = np.where(close, np.exp(-a * h) * h**3 / 6.0, (h * even - odd) / (2.0 * np.where(close, 1.0, beyond)))
    # of a loose joint the way by one interval's force changes by far less than the velocity by the way before
    loose = stiffness * h**2 < CLOSE
    stiff, ramp = np.where(loose, 1.0, stiffness), turned + 0.5 * h * way
    undamped = damping * h < CLOSE
    loosely = np.where(undamped, -(h**4) / 24.0, (g - ramp) / np.where(undamped, 1.0, damping))
    first_by, odd_by = (-0.5 * h * odd - a * g, stiffness * g), (-g, a * g - 0.5 * h * odd)
    way_by = (np.where(loose, 0.0, -(first_by[0] + way) / stiff), -g)
    ramp_by = (
        np.where(loose, 0.0, (g - damping * way_by[0] - ramp) / stiff),
        np.where(loose, loosely, (0.5 * h * odd + a * g - way) / stiff),
    )
    found = []
    for i, (direct, half) in enumerate([(1.0, 0.0), (0.0, 0.5)]):
        back = -direct * odd - stiffness * odd_by[i]
        last = first_by[i] - 2.0 * (half * odd + a * odd_by[i])
        by_ramp = ramp_by[i] - 0.5 * h * way_by[i], way_by[i] - 0.5 * h * odd_by[i]
        found.append((first_by[i], odd_by[i], back, last, way_by[i], odd_by[i], *by_ramp))
    return found[0], found[1]


LEAST_MOBILITY = 1e-6
"""Least mobility of a joint, over its median."""
CLOSE = 1e-5
"""Numbers without a unit below which series replace differences."""


@compiled
def _follow(by_x: Array, by_v: Array, v_by_x: Array, v_by_v: Array, way: Array, rise: Array) -> tuple[Array, Array]:
    """x and ẋ, (P + 1,) each, from rest; `way` and `rise` (P,) are what a force adds to them over each piece."""
    x, v = np.zeros(len(way) + 1), np.zeros(len(way) + 1)
    for i in range(len(way)):
        x[i + 1] = by_x[i] * x[i] + by_v[i] * v[i] + way[i]
        v[i + 1] = v_by_x[i] * x[i] + v_by_v[i] * v[i] + rise[i]
    return x, v
