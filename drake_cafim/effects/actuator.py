"""What becomes of an effort between its command and the joint."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from drake_cafim.effects.effect import Effect, Place, Strength
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Effort:
    """An effort that is held: `values` (K,) N m or N from each of `times` (K,) s to the next."""

    times: Array
    values: Array


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
