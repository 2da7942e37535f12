"""Joint force effects: laws of position, velocity and effort that the model lacks."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drake_cafim.effects.effect import Effect, P, Place, Start, Strength
from drake_cafim.effects.joint_samples import Force, JointSamples
from drake_cafim.effects.mean_sign import mean_sides
from drake_cafim.effects.servo import Servo
from drake_cafim.typing import Array

SLIP_VELOCITY = Strength(
    "slip_velocity",
    "rad/s",
    0.005,
    lower=1e-6,
    upper=10.0,
    nominal=0.005,
    linear_unit="m/s",
    grid=(0.0005, 0.0015, 0.005, 0.015),
)
"""Width w of the smoothed sign function tanh(v/w) of dry friction; observable where slow motion is well measured."""
DRY_FRICTION = "dry friction"
SLIDING = 20.0
"""Velocity in widths w at which a joint slides for certain."""
HIDDEN_WIDTH, HIDDEN_SHARPNESS = 2.0, 4.0
"""Width of a sign change, in standard deviations of the velocity, at which half of it is hidden, and the power of their
ratio by which it is: a jump would make models whose widths hardly differ incomparable."""
FAINT = 1e-3
"""Share of a dry friction below which its doubt counts as none."""


@dataclass(frozen=True)
class JointForce(Effect):
    """A force at one joint, added to the right-hand side of its equation of motion."""

    place: ClassVar[Place] = Place.JOINT
    family: ClassVar[str] = "joint"
    kind: ClassVar[str] = "joint_force"
    shown_over: ClassVar[str] = "variable"
    all_but_linear: ClassVar[bool] = True

    def add_to(self, physics: P) -> P:
        return physics.with_part("joint_forces", self)

    @property
    def damping(self) -> float | None:
        """Coefficient N m s/rad (N s/m) where the law is the same as Drake's joint damping; None for other laws."""
        return None

    @property
    def slip(self) -> float | None:
        """The displacement, rad or m, over which a part of the force builds up; None where none does."""
        return None

    @property
    def built_up(self) -> float:
        """The friction, N m or N, that the force takes from another dry friction and builds up over `slip` instead."""
        return 0.0

    @abstractmethod
    def force(self, joint: JointSamples) -> Force:
        """The force (N,) at this effect's values, with its derivatives."""

    @abstractmethod
    def starts(self, joint: JointSamples) -> Iterator[Start]:
        """Linear regressors of the law, over a grid of the parameters in which it is not linear."""

    @abstractmethod
    def from_coefficients(self, coefficients: Array, shape: Mapping[str, float]) -> "JointForce":
        """The effect whose force is `columns @ coefficients`, for the columns of the start with this `shape`."""

    def bounded(self, servo: Servo) -> Servo:
        """The servo at this joint with the law's bounds of its effort; only of a law that `bounds_effort`."""
        raise TypeError(f"effect {self.name}: it does not bound the effort")

    def plausible_over(self, joint: JointSamples) -> bool:
        """Whether values fitted over this motion still describe the phenomenon of the effect's name."""
        return True

    def stands_out(self, joint: JointSamples) -> bool:
        """Whether its force exceeds the model error of other laws; asked where the residual is not white."""
        return True


def doubt_at_rest(effect: JointForce, joint: JointSamples) -> tuple[Array, Array]:
    """(N,) the size of a dry friction, N m or N, and (N,) the share of it that the velocity does not tell.

    That is 1 − |mean of tanh(v/w) over the velocity's error|, w the width of the sign change or, where it is not known,
    the nominal one. Where that error does not hide the width, the force is a function of the velocity, and only what
    the error makes of it is not known: |tanh(v/w)| − |mean of tanh(v/w)|. In between it is the share h of the one and
    1 − h of the other, h = 1/(1 + (w/2σ)⁴) with σ the velocity's std.
    """
    known = effect.values.get(SLIP_VELOCITY.name)
    width = SLIP_VELOCITY.nominal if known is None else known
    sliding = np.full_like(joint.v, SLIDING * width)
    forward, backward = (effect.force(JointSamples(joint.q, v, joint.u, load=joint.load)) for v in (sliding, -sliding))
    ratio = (HIDDEN_WIDTH * np.asarray(joint.v_std) / width) ** HIDDEN_SHARPNESS
    hidden = 1.0 if known is None else ratio / (1.0 + ratio)
    sure = hidden + (1.0 - hidden) * np.abs(np.tanh(joint.v / width))
    share = np.maximum(sure - np.abs(joint.sign(width).value), 0.0)
    return 0.5 * np.abs(forward.value - backward.value), np.where(share > FAINT, share, 0.0)


def _zeros(joint: JointSamples) -> Array:
    return np.zeros_like(joint.v)


@dataclass(frozen=True)
class JointViscousFriction(JointForce):
    """−c v."""

    name: ClassVar[str] = "joint_viscous_friction"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("coefficient", "N m s/rad", 0.3, lower=0.0, linear_unit="N s/m"),
    )
    reference: ClassVar[str] = "Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994, §2"
    formula: ClassVar[str] = "−<i>c</i> <i>v</i>"
    words: ClassVar[str] = "opposes the motion, in proportion to its speed"
    alike: ClassVar[Mapping[str, str]] = {
        "joint_coulomb_friction": "both oppose the motion; only a range of speeds tells a slope from a step",
        "joint_stribeck_friction": "its falling branch and a viscous slope cancel over a narrow range of speeds",
        "actuator_lag": "under a motion at one frequency both shift the effort's phase",
    }

    @property
    def damping(self) -> float:
        return self.values["coefficient"]

    def force(self, joint: JointSamples) -> Force:
        c = self.values["coefficient"]
        return Force(-c * joint.v, _zeros(joint), np.full_like(joint.v, -c), _zeros(joint), -joint.v[:, None])

    def starts(self, joint: JointSamples) -> Iterator[Start]:
        yield Start(-joint.v[:, None])

    def from_coefficients(self, coefficients: Array, shape: Mapping[str, float]) -> "JointViscousFriction":
        return self.with_values(coefficients)


@dataclass(frozen=True)
class JointCoulombFriction(JointForce):
    """−T tanh(v/w)."""

    name: ClassVar[str] = "joint_coulomb_friction"
    group: ClassVar[str | None] = DRY_FRICTION
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("torque", "N m", 0.3, lower=0.0, linear_unit="N"),)
    shapes: ClassVar[tuple[Strength, ...]] = (SLIP_VELOCITY,)
    reference: ClassVar[str] = "Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994, §2"
    formula: ClassVar[str] = "−<i>T</i> tanh(<i>v</i>/<i>w</i>)"
    words: ClassVar[str] = "opposes the motion with the same force at every speed"
    alike: ClassVar[Mapping[str, str]] = {
        "joint_viscous_friction": "both oppose the motion; only a range of speeds tells a step from a slope",
        "joint_asymmetric_coulomb_friction": "it is this law with two strengths; evidence decides",
        "joint_load_dependent_friction": "it is this law where the load hardly changes",
        "joint_stribeck_friction": "it is this law away from rest",
    }

    def force(self, joint: JointSamples) -> Force:
        sign = joint.sign(self.values.get("slip_velocity", SLIP_VELOCITY.nominal))
        T = self.values["torque"]
        return Force(-T * sign.value, _zeros(joint), -T * sign.by_v, _zeros(joint), -sign.value[:, None])

    def starts(self, joint: JointSamples) -> Iterator[Start]:
        for width in SLIP_VELOCITY.grid:
            yield Start(-joint.sign(width).value[:, None], {"slip_velocity": width})

    def from_coefficients(self, coefficients: Array, shape: Mapping[str, float]) -> "JointCoulombFriction":
        return type(self)(self.at, shape).with_values(coefficients)


@dataclass(frozen=True)
class JointAsymmetricCoulombFriction(JointForce):
    """−T₊ tanh(v/w) for v > 0 and −T₋ tanh(v/w) for v < 0."""

    name: ClassVar[str] = "joint_asymmetric_coulomb_friction"
    group: ClassVar[str | None] = DRY_FRICTION
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("torque_positive", "N m", 0.3, lower=0.0, linear_unit="N"),
        Strength("torque_negative", "N m", 0.3, lower=0.0, linear_unit="N"),
    )
    narrows: ClassVar[Mapping[str, tuple[float, ...]]] = {JointCoulombFriction.name: (1.0, -1.0)}
    shapes: ClassVar[tuple[Strength, ...]] = (SLIP_VELOCITY,)
    reference: ClassVar[str] = "Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994, §2.1"
    formula: ClassVar[str] = "−<i>T</i><sub>+</sub> for <i>v</i> &gt; 0, +<i>T</i><sub>−</sub> for <i>v</i> &lt; 0"
    words: ClassVar[str] = "opposes the motion with a constant force, of another size in each direction"
    alike: ClassVar[Mapping[str, str]] = {
        "joint_coulomb_friction": "with equal strengths it is the symmetric law",
        "actuator_bias": "with Coulomb friction beside it, a constant effort is the same force: half the difference",
    }

    def force(self, joint: JointSamples) -> Force:
        width = self.values.get("slip_velocity", SLIP_VELOCITY.nominal)
        columns, slopes = mean_sides(joint.sign(width), joint.v, joint.v_std, width)
        return Force(columns @ self.vector, _zeros(joint), slopes @ self.vector, _zeros(joint), columns)

    def starts(self, joint: JointSamples) -> Iterator[Start]:
        for width in SLIP_VELOCITY.grid:
            yield Start(mean_sides(joint.sign(width), joint.v, joint.v_std, width)[0], {"slip_velocity": width})

    def from_coefficients(self, coefficients: Array, shape: Mapping[str, float]) -> "JointAsymmetricCoulombFriction":
        return type(self)(self.at, shape).with_values(coefficients)


@dataclass(frozen=True)
class JointSpring(JointForce):
    """−k (q − rest)."""

    name: ClassVar[str] = "joint_spring"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("stiffness", "N m/rad", 1.0, lower=0.0, linear_unit="N/m"),
        Strength("rest", "rad", 0.5, linear_unit="m", through="stiffness"),
    )
    reference: ClassVar[str] = "Spong, Hutchinson, Vidyasagar, Robot Modeling and Control, 2006, §7"
    formula: ClassVar[str] = "−<i>k</i> (<i>q</i> − <i>q</i><sub>rest</sub>)"
    words: ClassVar[str] = "pulls the joint towards a rest position"
    alike: ClassVar[Mapping[str, str]] = {
        "actuator_bias": "a soft spring with a far rest position is a constant effort",
        "torque_ripple": "over a small range of positions a slow ripple is a slope",
        "gravity_misalignment": "near the horizontal, tilted gravity changes with position as a spring does",
    }

    def force(self, joint: JointSamples) -> Force:
        k, rest = self.values["stiffness"], self.values["rest"]
        d_strengths = np.stack([-(joint.q - rest), np.full_like(joint.q, k)], axis=1)
        return Force(-k * (joint.q - rest), np.full_like(joint.q, -k), _zeros(joint), _zeros(joint), d_strengths)

    def starts(self, joint: JointSamples) -> Iterator[Start]:
        yield Start(np.stack([-joint.q, np.ones_like(joint.q)], axis=1))

    def from_coefficients(self, coefficients: Array, shape: Mapping[str, float]) -> "JointSpring":
        k = float(coefficients[0]) or 1e-12
        return self.with_values({"stiffness": k, "rest": float(coefficients[1]) / k})
