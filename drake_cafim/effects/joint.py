"""Joint force effects: laws of position, velocity and effort that the model lacks."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.effect import Effect, P, Place, Start, Strength
from drake_cafim.effects.joint_samples import Force, JointSamples
from drake_cafim.effects.mean_sign import mean_sides
from drake_cafim.effects.servo import Servo
from drake_cafim.numerics.rounding import short
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
SLIP = Strength("slip", "rad", 1e-3, lower=0.0, upper=1.0, linear_unit="m", amplitude=False)
"""Displacement s over which dry friction builds up after the motion turns round, see `effects.bristle`; 0 for none."""
SLIPS = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2)
"""Displacements, rad (m), over which friction may build up, as a search tries them."""
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

    Friction that builds up over a displacement is a function of the path: there is no doubt of it. Else the share is
    1 − |mean of tanh(v/w) over the velocity's error|, w the width of the sign change or, where it is not known,
    the nominal one. Where that error does not hide the width, the force is a function of the velocity, and only what
    the error makes of it is not known: |tanh(v/w)| − |mean of tanh(v/w)|. In between it is the share h of the one and
    1 − h of the other, h = 1/(1 + (w/2σ)⁴) with σ the velocity's std.
    """
    if effect.slip is not None:
        return _zeros(joint), _zeros(joint)
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
class DryFriction(JointForce):
    """Friction that is on one side or the other: the side is tanh(v/w) or, with a slip s, z of ż = (v − |v| z)/s.

    Where nothing is known of the past, sliding is what is most probable, where z is the sign of v.
    """

    group: ClassVar[str | None] = DRY_FRICTION
    shapes: ClassVar[tuple[Strength, ...]] = (SLIP_VELOCITY, SLIP)
    slips: ClassVar[tuple[float, ...]] = SLIPS

    @property
    def slip(self) -> float | None:
        return self.values.get(SLIP.name) or None

    def bent(self, joint: JointSamples) -> Array | None:
        """(N,) the state z; None of friction without a slip, and where the past is not known."""
        return None if self.slip is None else joint.bent(self.slip)

    def side(self, joint: JointSamples) -> tuple[Array, Array, Array]:
        """The side σ from −1 to 1 that the friction is on, and its slopes in q and in v; each (N,)."""
        bent = self.bent(joint)
        if bent is None or self.slip is None:
            sign = joint.sign(self.values.get(SLIP_VELOCITY.name, SLIP_VELOCITY.nominal))
            return sign.value, _zeros(joint), sign.by_v
        return bent, (1.0 - np.sign(joint.v) * bent) / self.slip, _zeros(joint)

    def between_shapes(self, ratio: float) -> Iterator[Self]:
        if self.slip is None:
            yield from super().between_shapes(ratio)
            return
        for scaled in (self.slip * ratio, self.slip / ratio):
            if SLIPS[0] <= scaled <= SLIPS[-1]:
                yield type(self)(self.at, {**self.values, SLIP.name: scaled})

    def sentence(self, tree: Tree) -> str:
        told = super().sentence(tree)
        return told if self.slip is None else f"{told[:-1]}, built up over {short(self.slip)} {self.unit(SLIP, tree)})"


@dataclass(frozen=True)
class JointCoulombFriction(DryFriction):
    """−T tanh(v/w); with a slip −T z."""

    name: ClassVar[str] = "joint_coulomb_friction"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("torque", "N m", 0.3, lower=0.0, linear_unit="N"),)
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
        side, by_q, by_v = self.side(joint)
        T = self.values["torque"]
        return Force(-T * side, -T * by_q, -T * by_v, _zeros(joint), -side[:, None])

    def starts(self, joint: JointSamples) -> Iterator[Start]:
        for width in SLIP_VELOCITY.grid:
            yield Start(-joint.sign(width).value[:, None], {"slip_velocity": width})

    def from_coefficients(self, coefficients: Array, shape: Mapping[str, float]) -> "JointCoulombFriction":
        return type(self)(self.at, shape).with_values(coefficients)


@dataclass(frozen=True)
class JointAsymmetricCoulombFriction(DryFriction):
    """−T₊ tanh(v/w) for v > 0 and −T₋ tanh(v/w) for v < 0; with a slip −T₊ z for z > 0 and −T₋ z for z < 0."""

    name: ClassVar[str] = "joint_asymmetric_coulomb_friction"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("torque_positive", "N m", 0.3, lower=0.0, linear_unit="N"),
        Strength("torque_negative", "N m", 0.3, lower=0.0, linear_unit="N"),
    )
    narrows: ClassVar[Mapping[str, tuple[float, ...]]] = {JointCoulombFriction.name: (1.0, -1.0)}
    reference: ClassVar[str] = "Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994, §2.1"
    formula: ClassVar[str] = "−<i>T</i><sub>+</sub> for <i>v</i> &gt; 0, +<i>T</i><sub>−</sub> for <i>v</i> &lt; 0"
    words: ClassVar[str] = "opposes the motion with a constant force, of another size in each direction"
    alike: ClassVar[Mapping[str, str]] = {
        "joint_coulomb_friction": "with equal strengths it is the symmetric law",
        "actuator_bias": "with Coulomb friction beside it, a constant effort is the same force: half the difference",
    }

    def force(self, joint: JointSamples) -> Force:
        if self.bent(joint) is not None:
            side, by_q, _ = self.side(joint)
            columns = np.stack([-np.maximum(side, 0.0), np.maximum(-side, 0.0)], axis=1)
            slopes = -by_q[:, None] * np.stack([side > 0.0, side < 0.0], axis=1)
            return Force(columns @ self.vector, slopes @ self.vector, _zeros(joint), _zeros(joint), columns)
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
