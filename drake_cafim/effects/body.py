"""Forces on a body other than those of the model's joints and contacts: drag and pushes."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from drake_cafim.dynamics.tree import Body
from drake_cafim.effects.effect import Effect, Episode, P, Place, Strength
from drake_cafim.typing import Array


@dataclass(frozen=True)
class BodyForce(Effect):
    """A force at a point fixed in a body."""

    place: ClassVar[Place] = Place.BODY
    family: ClassVar[str] = "link"
    kind: ClassVar[str] = "body_force"
    stiff: ClassVar[bool] = False
    """Whether it has an onset at some position, as a contact has, and needs as short integration steps."""
    linear: ClassVar[tuple[str, ...]] = ()
    """Strengths in which the force is linear and homogeneous: it is the sum of one term proportional to each."""

    def add_to(self, physics: P) -> P:
        return physics.with_part("body_forces", self)

    def parts(self) -> Iterator[tuple[float, Self]]:
        """Pairs of a coefficient and an effect of unit strength: the force is Σ coefficient × the effect's force."""
        if not self.linear:
            yield 1.0, self
        nothing = dict.fromkeys(self.linear, 0.0)
        for name in self.linear:
            yield self.values[name], self.with_values({**self.values, **nothing, name: 1.0})

    @abstractmethod
    def point(self, body: Body) -> Array:
        """p_BP (3,) m, the point of application in the body's frame."""

    @abstractmethod
    def force(
        self, p_WP: Array, v_WP: Array, time: Array | None, recording: str | None, lasting: Array | float = 0.0
    ) -> Array:
        """f_P_W (N, 3) N at positions (N, 3) m and velocities (N, 3) m/s of the point.

        `time` (N,) s and `recording` are None outside of recordings; `lasting` s is the sample interval, over which a
        force with an onset at some position is averaged.
        """


@dataclass(frozen=True)
class AerodynamicDrag(BodyForce):
    """−c |v| v at the centre of mass."""

    name: ClassVar[str] = "aerodynamic_drag"
    linear: ClassVar[tuple[str, ...]] = ("coefficient",)
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("coefficient", "N s^2/m^2", 0.3, lower=0.0),)
    reference: ClassVar[str] = "Hoerner, Fluid-Dynamic Drag, 1965, ch. 1"
    formula: ClassVar[str] = "−<i>c</i> |<i>v</i>| <i>v</i>"
    words: ClassVar[str] = "opposes the motion with the square of the speed"
    alike: ClassVar[Mapping[str, str]] = {
        "joint_viscous_friction": "both brake; drag grows with the square of the speed, and at all joints before it",
        "payload": "fast curved motion of a drag's body loads the same joints as a mass on it",
    }

    def point(self, body: Body) -> Array:
        return body.p_BBcm

    def force(
        self, p_WP: Array, v_WP: Array, time: Array | None, recording: str | None, lasting: Array | float = 0.0
    ) -> Array:
        speed = np.linalg.norm(v_WP, axis=1, keepdims=True)
        return np.asarray(-self.values["coefficient"] * speed * v_WP)


@dataclass(frozen=True)
class ExternalDisturbance(BodyForce):
    """A pulse of force (x, y, z) sin²(π (t − start)/(stop − start)) at the body's origin, in one recording.

    With `recording` None it acts in every recording.
    """

    recording: str | None = None

    name: ClassVar[str] = "external_disturbance"
    kind: ClassVar[str] = "push"
    brief: ClassVar[bool] = True
    linear: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    difference_step: ClassVar[float] = 1e-3
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("x", "N", 3.0, lower=-1e4, upper=1e4),
        Strength("y", "N", 3.0, lower=-1e4, upper=1e4),
        Strength("z", "N", 3.0, lower=-1e4, upper=1e4),
        Strength("start", "s", 0.1, amplitude=False, required=True),
        Strength("stop", "s", 0.1, amplitude=False, required=True),
    )
    reference: ClassVar[str] = "Haddadin, De Luca, Albu-Schäffer, IEEE Trans. Robotics 33(6), 2017"
    formula: ClassVar[str] = "<i>F</i> sin²(π (<i>t</i> − <i>t</i><sub>0</sub>)/<i>T</i>)"
    words: ClassVar[str] = "pushes the body for a while"
    alike: ClassVar[Mapping[str, str]] = {
        "unmodeled_contact": "a short touch is a push; only a second one at the same place tells them apart",
        "joint_hard_stop": "a stop that is met once is a push",
    }

    @property
    def episode(self) -> Episode:
        return Episode(self.values["start"], self.values["stop"], self.recording)

    def point(self, body: Body) -> Array:
        return np.zeros(3)

    def force(
        self, p_WP: Array, v_WP: Array, time: Array | None, recording: str | None, lasting: Array | float = 0.0
    ) -> Array:
        if time is None or (self.recording is not None and recording != self.recording):
            return np.zeros_like(v_WP)
        peak = np.array([self.values["x"], self.values["y"], self.values["z"]])
        return np.asarray(pulse(time, self.values["start"], self.values["stop"])[:, None] * peak)

    def during(self, start: float, stop: float, recording: str | None) -> Self:
        return type(self)(self.at, {**self.values, "start": start, "stop": stop}, recording)

    def with_values(self, values: Mapping[str, float] | Array) -> Self:
        plain = super().with_values(values)
        return type(self)(self.at, plain.values, self.recording)

    def vanishing(self) -> tuple[Array, Array]:
        """Twice the impulse along each axis and its Jacobian: of a short push only the impulse may be observable."""
        coordinates, slopes = super().vanishing()
        lasting = self.values["stop"] - self.values["start"]
        slopes = lasting * slopes
        slopes[:, 3], slopes[:, 4] = -coordinates, coordinates
        return lasting * coordinates, slopes

    def contradiction(self) -> str:
        start, stop = self.values["start"], self.values["stop"]
        return "" if stop > start else f"interval is from {start:g} to {stop:g} s, expected its stop after its start"

    def plausible(self) -> bool:
        return super().plausible() and self.values["stop"] > self.values["start"]


def pulse(time: Array, start: float, stop: float) -> Array:
    """sin²(π (t − start)/(stop − start)) within the interval, zero outside, (N,)."""
    phase = (time - start) / max(stop - start, 1e-6)
    return np.asarray(np.where((phase > 0.0) & (phase < 1.0), np.sin(np.pi * phase) ** 2, 0.0), dtype=float)
