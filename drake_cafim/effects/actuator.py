"""What becomes of an effort between its command and the joint."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from drake_cafim.compiled import compiled
from drake_cafim.effects.effect import Direction, Effect, Place, Strength
from drake_cafim.typing import Array

LAG_PARTS = 8
"""Steps that stand for the exponential approach within one held interval."""


@dataclass(frozen=True)
class Effort:
    """An effort that is held: `values` (K,) N m or N from each of `times` (K,) s to the next."""

    times: Array
    values: Array

    def means(self, times: Array) -> Array:
        """Mean effort (N,) from each of `times` (N,) s to the next; the last one's is the value there."""
        sums = np.concatenate([[0.0], np.cumsum(self.values[:-1] * np.diff(self.times))])
        inside = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, None)
        integral = sums[inside] + self.values[inside] * (times - self.times[inside])
        return np.append(np.diff(integral) / np.diff(times), self.values[inside[-1]])


@dataclass(frozen=True)
class ActuatorEffect(Effect):
    """A change of one joint's effort."""

    place: ClassVar[Place] = Place.ACTUATOR
    family: ClassVar[str] = "actuator"

    @abstractmethod
    def drive(self, effort: Effort) -> Effort:
        """The effort that acts when `effort` is asked for."""

    @property
    def gain(self) -> float:
        """What the effect multiplies an effort by."""
        return 1.0

    def looks(self, effort: Array) -> Iterator[Sequence[Direction]]:
        """Sets of steps to screen with, each on its own; `effort` (N,) is what the joint is asked for at all times."""
        yield self.directions()

    def from_look(self, look: Sequence[Direction], coefficients: Array) -> Self | None:
        """The effect that the coefficients of one of `looks` stand for; None where they stand for none."""
        return self.from_directions(coefficients)


@dataclass(frozen=True)
class ActuatorGainError(ActuatorEffect):
    """gain·u acts."""

    name: ClassVar[str] = "actuator_gain_error"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("gain", "1", 0.1, lower=0.2, upper=5.0, nominal=1.0),)
    reference: ClassVar[str] = "Gautier, Briot, IEEE/ASME Trans. Mechatronics 19(6), 2014 (drive gains)"
    alike: ClassVar[Mapping[str, str]] = {
        "payload": "more load and less effort look alike at one joint",
        "rotor_inertia": "where inertia dominates, more of it and less effort look alike",
        "joint_load_dependent_friction": "a loss in proportion to the effort, but opposed to the motion",
        "actuator_dead_zone": "a zone much smaller than the efforts takes a nearly constant share of them",
    }

    def drive(self, effort: Effort) -> Effort:
        return Effort(effort.times, self.values["gain"] * effort.values)

    @property
    def gain(self) -> float:
        return self.values["gain"]


@dataclass(frozen=True)
class ActuatorBias(ActuatorEffect):
    """u + torque acts."""

    name: ClassVar[str] = "actuator_bias"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("torque", "N m", 0.3, linear_unit="N"),)
    reference: ClassVar[str] = "Janot, Gautier, Brunot, Nonlinear System Identification Benchmarks, 2019 (EMPS offset)"
    alike: ClassVar[Mapping[str, str]] = {
        "joint_asymmetric_coulomb_friction": "with Coulomb friction beside it, half the two strengths' difference",
        "joint_spring": "a soft spring with a far rest position is a constant effort",
        "gravity_misalignment": "over a small range of positions a tilt is a constant effort",
    }

    def drive(self, effort: Effort) -> Effort:
        return Effort(effort.times, effort.values + self.values["torque"])


@dataclass(frozen=True)
class ActuatorDelay(ActuatorEffect):
    """u(t − delay) acts; before the first effort has come through, it is taken to have acted already."""

    name: ClassVar[str] = "actuator_delay"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("delay", "s", 0.005, lower=0.0, upper=0.2),)
    reference: ClassVar[str] = "Niemeyer, Slotine, IEEE J. Oceanic Engineering 16(1), 1991 (delayed efforts)"
    alike: ClassVar[Mapping[str, str]] = {
        "actuator_lag": "slow efforts are late by the time constant, whichever of the two it is",
        "joint_elasticity": "below its resonance a soft joint passes an effort on late",
        "joint_viscous_friction": "under a motion at one frequency both shift the effort's phase",
        "sensor_delay": "late effort and late position are the same at one joint; the other joints tell them apart",
    }

    def drive(self, effort: Effort) -> Effort:
        times = np.concatenate([effort.times[:1], effort.times + self.values["delay"]])
        return Effort(times, np.concatenate([effort.values[:1], effort.values]))

    def looks(self, effort: Array) -> Iterator[Sequence[Direction]]:
        for delay in (0.001, 0.004, 0.012, 0.03):
            yield (Direction({"delay": delay}, None, delay),)

    def from_look(self, look: Sequence[Direction], coefficients: Array) -> "ActuatorDelay":
        tried = look[0].size
        # negative stays so: an effort that acts before it is asked for is none
        return self.with_values({"delay": min(float(coefficients[0]), 2.0 * tried)})


@dataclass(frozen=True)
class ActuatorLag(ActuatorEffect):
    """τ ẏ = u − y, and y acts; it starts settled."""

    name: ClassVar[str] = "actuator_lag"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("time_constant", "s", 0.005, lower=1e-5, upper=0.5),)
    reference: ClassVar[str] = "Swevers, Verdonck, De Schutter, IEEE Control Systems 27(5), 2007 (drive dynamics)"
    alike: ClassVar[Mapping[str, str]] = {
        "actuator_delay": "slow efforts are late by the time constant, whichever of the two it is",
        "joint_elasticity": "below its resonance a soft joint passes an effort on late",
        "joint_viscous_friction": "under a motion at one frequency both shift the effort's phase",
        "sensor_lag": "late effort and late position are alike at one joint; the other joints tell them apart",
    }

    def drive(self, effort: Effort) -> Effort:
        tau = self.values["time_constant"]
        steps = np.append(np.diff(effort.times), 1.0)
        kept = np.exp(-steps / tau)
        gap = np.asarray(_behind(np.ascontiguousarray(effort.values), kept))
        # the mean over each part: the staircase then has the integral of the exponential
        part = np.arange(LAG_PARTS + 1) / LAG_PARTS
        decay = np.exp(-steps[:, None] * part / tau)
        mean = tau * (decay[:, :-1] - decay[:, 1:]) / np.maximum(steps[:, None] / LAG_PARTS, 1e-300)
        times = effort.times[:, None] + steps[:, None] * part[:-1]
        return Effort(times.ravel(), (effort.values[:, None] + gap[:, None] * mean).ravel())

    def looks(self, effort: Array) -> Iterator[Sequence[Direction]]:
        for constant in (0.001, 0.004, 0.012, 0.03):
            yield (Direction({"time_constant": constant}, None, constant),)

    def from_look(self, look: Sequence[Direction], coefficients: Array) -> "ActuatorLag":
        return self.with_values({"time_constant": min(float(coefficients[0]), 2.0 * look[0].size)})


@compiled
def _behind(values: Array, kept: Array) -> Array:
    """By how much a lagging effort is off each of the held `values` (K,) when it sets in; `kept` (K,) of it remains."""
    gap, y = np.empty_like(values), values[0]
    for k in range(len(values)):
        gap[k] = y - values[k]
        y = values[k] + gap[k] * kept[k]
    return gap


@dataclass(frozen=True)
class ActuatorSaturation(ActuatorEffect):
    """u acts, clipped to ±limit."""

    name: ClassVar[str] = "actuator_saturation"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("limit", "N m", 10.0, lower=1e-6, upper=1e6, inverse=True, linear_unit="N"),
    )
    reference: ClassVar[str] = "Hu, Lin, Control Systems with Actuator Saturation, 2001, §1"
    alike: ClassVar[Mapping[str, str]] = {
        "actuator_gain_error": "where most efforts are clipped, less of each looks alike",
        "joint_viscous_friction": "the largest efforts come with the fastest motion",
        "joint_hard_stop": "the largest efforts may come at the end of the range",
    }

    def drive(self, effort: Effort) -> Effort:
        limit = self.values["limit"]
        return Effort(effort.times, np.clip(effort.values, -limit, limit))

    def looks(self, effort: Array) -> Iterator[Sequence[Direction]]:
        for share in (0.3, 0.5, 0.65, 0.77, 0.86, 0.92, 0.96, 0.98, 0.995, 0.999):
            limit = float(np.quantile(np.abs(effort), share))
            if limit > 0.0:
                yield (Direction({"limit": limit}, None, 1.0),)

    def from_look(self, look: Sequence[Direction], coefficients: Array) -> "ActuatorSaturation | None":
        # what is clipped is all missing or there is no clipping; a start need not be exact
        return self.with_values(look[0].ahead) if 0.3 < coefficients[0] < 3.0 else None


@dataclass(frozen=True)
class ActuatorDeadZone(ActuatorEffect):
    """Nothing for |u| < width, else u − width·sign(u) acts."""

    name: ClassVar[str] = "actuator_dead_zone"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("width", "N m", 0.3, lower=0.0, linear_unit="N"),)
    reference: ClassVar[str] = "Tao, Kokotović, Adaptive Control with Actuator Nonlinearities, 1996, §2"
    alike: ClassVar[Mapping[str, str]] = {
        "actuator_gain_error": "a zone much smaller than the efforts takes a nearly constant share of them",
        "joint_coulomb_friction": "a loss of constant size, but opposed to the motion instead of the effort",
    }

    def drive(self, effort: Effort) -> Effort:
        width = self.values["width"]
        return Effort(effort.times, effort.values - np.clip(effort.values, -width, width))

    def looks(self, effort: Array) -> Iterator[Sequence[Direction]]:
        scale = float(np.sqrt(np.mean(effort**2)))
        for share in (0.01, 0.1, 0.3, 0.6, 1.0):
            if scale > 0.0:
                yield (Direction({"width": share * scale}, None, share * scale),)

    def from_look(self, look: Sequence[Direction], coefficients: Array) -> "ActuatorDeadZone":
        return self.with_values({"width": min(float(coefficients[0]), 2.0 * look[0].size)})
