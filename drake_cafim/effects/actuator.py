"""Actuator effects: how the effort that acts at a joint differs from the commanded effort."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from drake_cafim.effects.effect import Direction, Effect, P, Place, Strength
from drake_cafim.effects.surroundings import Surroundings
from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array

EFFORT_LIMIT = "effort limit"
"""The group of the laws of what bounds an actuator's effort."""
LAG_PARTS = 8
"""Number of constant pieces that approximate the exponential response within one held interval."""


@dataclass(frozen=True)
class Effort:
    """A piecewise constant effort: `values` (K,) N m or N from each of `times` (K,) s to the next.

    If `ramped` it is piecewise linear instead, and constant after the last.
    """

    times: Array
    values: Array
    ramped: bool = False

    def means(self, times: Array) -> Array:
        """Mean effort (N,) from each of `times` (N,) s to the next; the last entry is the value at the last time."""
        lasting, change = np.diff(self.times), np.diff(self.values) if self.ramped else np.zeros(len(self.values) - 1)
        slope = np.append(np.divide(change, lasting, where=lasting > 0.0, out=0.0 * change), 0.0)
        sums = np.concatenate([[0.0], np.cumsum((self.values[:-1] + 0.5 * change) * lasting)])
        inside = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, None)
        since = times - self.times[inside]
        integral = sums[inside] + (self.values[inside] + 0.5 * slope[inside] * since) * since
        return np.append(np.diff(integral) / np.diff(times), self.values[inside[-1]] + slope[inside[-1]] * since[-1])

    def at(self, times: Array) -> Array:
        """(N,) the value of a held effort at `times` (N,) s, just after a step that is there."""
        return np.asarray(self.values[np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, None)])

    def before(self, times: Array) -> Array:
        """(N,) the value of a held effort just before `times` (N,) s."""
        return np.asarray(self.values[np.clip(np.searchsorted(self.times, times, side="left") - 1, 0, None)])

    def bent_at(self, *levels: float) -> "Effort":
        """The same effort with a knot wherever it crosses one of `levels`, so that clipping there is exact."""
        if not self.ramped:
            return self
        times, values = [self.times], [self.values]
        before, after = self.values[:-1], self.values[1:]
        for level in levels:
            crossed = np.flatnonzero((before - level) * (after - level) < 0.0)
            share = (level - before[crossed]) / (after[crossed] - before[crossed])
            times.append(self.times[crossed] + share * np.diff(self.times)[crossed])
            values.append(np.full(len(crossed), level))
        every = np.concatenate(times)
        order = np.argsort(every, kind="stable")
        return Effort(every[order], np.concatenate(values)[order], True)


@dataclass(frozen=True)
class ActuatorEffect(Effect):
    """A change of one joint's effort."""

    place: ClassVar[Place] = Place.ACTUATOR
    family: ClassVar[str] = "actuator"
    kind: ClassVar[str] = "actuator"
    upstream: ClassVar[bool] = False
    """Whether it acts before the point where the effort is measured: a measured effort already contains it."""

    of_command: ClassVar[bool] = False
    """Whether a position servo's effort takes the form of another law by it: no hypothesis where a servo drives."""

    def add_to(self, physics: P) -> P:
        return physics.with_part("actuators", self)

    @property
    def past(self) -> float:
        """How far back, s, past commands determine the present effort; 0 where the acting effort is the whole state."""
        return 0.0

    @classmethod
    def attachments(cls, where: Surroundings) -> Iterator[str]:
        measured = [at for at in cls.places(where.tree) if cls.upstream and f"u.{at}" in where.columns]
        within = [servo.joint for servo in where.servos if cls.of_command]
        yield from (at for at in super().attachments(where) if at not in (*measured, *within))

    @abstractmethod
    def drive(self, effort: Effort) -> Effort:
        """The effort that acts when `effort` is commanded."""

    @property
    def gain(self) -> float:
        """The factor by which the effect multiplies an effort."""
        return 1.0

    def looks(self, effort: Array) -> Iterator[Sequence[Direction]]:
        """Alternative sets of steps for screening, each tested alone; `effort` (N,) is the joint's command."""
        yield self.directions()

    def from_look(self, look: Sequence[Direction], coefficients: Array) -> Self | None:
        """The effect that the coefficients of one of `looks` determine; None where they are implausible for it."""
        return self.from_directions(coefficients)


@dataclass(frozen=True)
class ActuatorGainError(ActuatorEffect):
    """gain·u acts."""

    name: ClassVar[str] = "actuator_gain_error"
    of_command: ClassVar[bool] = True
    shown_over: ClassVar[str] = "effort"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("gain", "1", 0.1, lower=0.2, upper=5.0, nominal=1.0),)
    reference: ClassVar[str] = "Gautier, Briot, IEEE/ASME Trans. Mechatronics 19(6), 2014 (drive gains)"
    formula: ClassVar[str] = "<i>g</i> <i>u</i> acts"
    words: ClassVar[str] = "scales the effort"
    alike: ClassVar[Mapping[str, str]] = {
        "payload": "more load and less effort look alike at one joint",
        "rotor_inertia": "where inertia dominates, more of it and less effort look alike",
        "actuator_gain_error": "at another joint, where inertias are unknown: only their ratios to the efforts show",
        "joint_load_dependent_friction": "a loss in proportion to the effort, but opposed to the motion",
        "actuator_dead_zone": "a zone much smaller than the efforts takes a nearly constant share of them",
    }

    def drive(self, effort: Effort) -> Effort:
        return replace(effort, values=self.values["gain"] * effort.values)

    @property
    def gain(self) -> float:
        return self.values["gain"]


@dataclass(frozen=True)
class ActuatorBias(ActuatorEffect):
    """u + torque acts."""

    name: ClassVar[str] = "actuator_bias"
    shown_over: ClassVar[str] = "effort"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("torque", "N m", 0.3, linear_unit="N"),)
    reference: ClassVar[str] = "Janot, Gautier, Brunot, Nonlinear System Identification Benchmarks, 2019 (EMPS offset)"
    formula: ClassVar[str] = "<i>u</i> + <i>b</i> acts"
    words: ClassVar[str] = "adds a constant effort to what is asked for"
    alike: ClassVar[Mapping[str, str]] = {
        "joint_asymmetric_coulomb_friction": "with Coulomb friction beside it, half the two strengths' difference",
        "joint_spring": "a soft spring with a far rest position is a constant effort",
        "gravity_misalignment": "over a small range of positions a tilt is a constant effort",
    }

    def drive(self, effort: Effort) -> Effort:
        return replace(effort, values=effort.values + self.values["torque"])


@dataclass(frozen=True)
class ActuatorDelay(ActuatorEffect):
    """u(t − delay) acts; before t₀ + delay the first effort is taken to act."""

    name: ClassVar[str] = "actuator_delay"
    needs_motion: ClassVar[bool] = True
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("delay", "s", 0.005, lower=0.0, upper=0.2),)
    reference: ClassVar[str] = "Niemeyer, Slotine, IEEE J. Oceanic Engineering 16(1), 1991 (delayed efforts)"
    formula: ClassVar[str] = "<i>u</i>(<i>t</i> − τ) acts"
    words: ClassVar[str] = "lets the effort act later than it was asked for"
    alike: ClassVar[Mapping[str, str]] = {
        "actuator_lag": "slow efforts are late by the time constant, whichever of the two it is",
        "joint_elasticity": "below its resonance a soft joint passes an effort on late",
        "joint_viscous_friction": "under a motion at one frequency both shift the effort's phase",
        "sensor_delay": "late effort and late position are the same at one joint; the other joints tell them apart",
    }

    @property
    def past(self) -> float:
        return self.values["delay"]

    def drive(self, effort: Effort) -> Effort:
        times = np.concatenate([effort.times[:1], effort.times + self.values["delay"]])
        return Effort(times, np.concatenate([effort.values[:1], effort.values]), effort.ramped)

    def looks(self, effort: Array) -> Iterator[Sequence[Direction]]:
        for delay in (0.001, 0.004, 0.012, 0.03):
            yield (Direction({"delay": delay}, None, delay),)

    def from_look(self, look: Sequence[Direction], coefficients: Array) -> "ActuatorDelay":
        tried = look[0].size
        # a negative delay is kept: it is implausible, so that the hypothesis is dropped later
        return self.with_values({"delay": min(float(coefficients[0]), 2.0 * tried)})


@dataclass(frozen=True)
class ActuatorLag(ActuatorEffect):
    """τ ẏ = u − y, and y acts; it starts in steady state, y = u."""

    name: ClassVar[str] = "actuator_lag"
    needs_motion: ClassVar[bool] = True
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("time_constant", "s", 0.005, lower=1e-5, upper=0.5),)
    reference: ClassVar[str] = "Swevers, Verdonck, De Schutter, IEEE Control Systems 27(5), 2007 (drive dynamics)"
    formula: ClassVar[str] = "τ <i>ẏ</i> = <i>u</i> − <i>y</i>, <i>y</i> acts"
    words: ClassVar[str] = "lets the effort follow what is asked for slowly"
    alike: ClassVar[Mapping[str, str]] = {
        "actuator_delay": "slow efforts are late by the time constant, whichever of the two it is",
        "joint_elasticity": "below its resonance a soft joint passes an effort on late",
        "joint_viscous_friction": "under a motion at one frequency both shift the effort's phase",
        "sensor_lag": "late effort and late position are alike at one joint; the other joints tell them apart",
    }

    @property
    def settling(self) -> float:
        return self.values["time_constant"]

    def drive(self, effort: Effort) -> Effort:
        tau = self.values["time_constant"]
        steps = np.append(np.diff(effort.times), 1.0)
        kept = np.exp(-steps / tau)
        # in steady state it trails a ramp of slope s by τ s; the deviation from that decays exponentially
        slope = np.zeros(len(steps))
        if effort.ramped:
            slope[:-1] = np.divide(np.diff(effort.values), steps[:-1], where=steps[:-1] > 0.0, out=0.0 * steps[:-1])
        settled, end = effort.values - tau * slope, effort.values + slope * (steps - tau)
        gap = np.asarray(_transient(settled, end, kept, float(effort.values[0])))
        # the mean over each part: the staircase then has the integral of the exponential
        part = np.arange(LAG_PARTS + 1) / LAG_PARTS
        decay = np.exp(-steps[:, None] * part / tau)
        mean = tau * (decay[:, :-1] - decay[:, 1:]) / np.maximum(steps[:, None] / LAG_PARTS, 1e-300)
        times = effort.times[:, None] + steps[:, None] * part[:-1]
        middle = (part[:-1] + 0.5 / LAG_PARTS) * (slope * steps)[:, None]
        return Effort(times.ravel(), (settled[:, None] + middle + gap[:, None] * mean).ravel())

    def looks(self, effort: Array) -> Iterator[Sequence[Direction]]:
        for constant in (0.001, 0.004, 0.012, 0.03):
            yield (Direction({"time_constant": constant}, None, constant),)

    def from_look(self, look: Sequence[Direction], coefficients: Array) -> "ActuatorLag":
        return self.with_values({"time_constant": min(float(coefficients[0]), 2.0 * look[0].size)})


@compiled
def _transient(settled: Array, end: Array, kept: Array, start: float) -> Array:
    """(K,) Deviation of a lagging effort from its steady state at the beginning of each piece; it begins at `start`.

    The steady state is `settled` (K,) at a piece's beginning and `end` (K,) at its end; within the piece the deviation
    decays to the fraction `kept` (K,).
    """
    gap, y = np.empty_like(settled), start
    for k in range(len(settled)):
        gap[k] = y - settled[k]
        y = end[k] + gap[k] * kept[k]
    return gap


@dataclass(frozen=True)
class ActuatorSaturation(ActuatorEffect):
    """u acts, clipped to ±limit."""

    name: ClassVar[str] = "actuator_saturation"
    group: ClassVar[str | None] = EFFORT_LIMIT
    shown_over: ClassVar[str] = "effort"
    upstream: ClassVar[bool] = True
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("limit", "N m", 10.0, lower=1e-6, upper=1e6, inverse=True, linear_unit="N"),
    )
    reference: ClassVar[str] = "Hu, Lin, Control Systems with Actuator Saturation, 2001, §1"
    formula: ClassVar[str] = "<i>u</i> acts, cut at ±limit"
    words: ClassVar[str] = "cuts the effort at a limit"
    alike: ClassVar[Mapping[str, str]] = {
        "actuator_gain_error": "where most efforts are clipped, less of each looks alike",
        "joint_viscous_friction": "the largest efforts come with the fastest motion",
        "joint_hard_stop": "the largest efforts may come at the end of the range",
    }

    def drive(self, effort: Effort) -> Effort:
        limit = self.values["limit"]
        effort = effort.bent_at(-limit, limit)
        return replace(effort, values=np.clip(effort.values, -limit, limit))

    def looks(self, effort: Array) -> Iterator[Sequence[Direction]]:
        for share in (0.3, 0.5, 0.65, 0.77, 0.86, 0.92, 0.96, 0.98, 0.995, 0.999):
            limit = float(np.quantile(np.abs(effort), share))
            if limit > 0.0:
                yield (Direction({"limit": limit}, None, 1.0),)

    def from_look(self, look: Sequence[Direction], coefficients: Array) -> "ActuatorSaturation | None":
        # the coefficient is about 1 if the effort is clipped at this limit, else about 0; a start need not be exact,
        # hence the wide bounds
        return self.with_values(look[0].ahead) if 0.3 < coefficients[0] < 3.0 else None


@dataclass(frozen=True)
class ActuatorDeadZone(ActuatorEffect):
    """Nothing for |u| < width, else u − width·sign(u) acts."""

    name: ClassVar[str] = "actuator_dead_zone"
    of_command: ClassVar[bool] = True
    shown_over: ClassVar[str] = "effort"
    upstream: ClassVar[bool] = True
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("width", "N m", 0.3, lower=0.0, linear_unit="N"),)
    reference: ClassVar[str] = "Tao, Kokotović, Adaptive Control with Actuator Nonlinearities, 1996, §2"
    formula: ClassVar[str] = "0 for |<i>u</i>| &lt; <i>w</i>, else <i>u</i> − <i>w</i> sign(<i>u</i>)"
    words: ClassVar[str] = "swallows small efforts, and takes as much off large ones"
    alike: ClassVar[Mapping[str, str]] = {
        "actuator_gain_error": "a zone much smaller than the efforts takes a nearly constant share of them",
        "joint_coulomb_friction": "a loss of constant size, but opposed to the motion instead of the effort",
    }

    def drive(self, effort: Effort) -> Effort:
        width = self.values["width"]
        effort = effort.bent_at(-width, width)
        return replace(effort, values=effort.values - np.clip(effort.values, -width, width))

    def looks(self, effort: Array) -> Iterator[Sequence[Direction]]:
        scale = float(np.sqrt(np.mean(effort**2)))
        for share in (0.01, 0.1, 0.3, 0.6, 1.0):
            if scale > 0.0:
                yield (Direction({"width": share * scale}, None, share * scale),)

    def from_look(self, look: Sequence[Direction], coefficients: Array) -> "ActuatorDeadZone":
        return self.with_values({"width": min(float(coefficients[0]), 2.0 * look[0].size)})
