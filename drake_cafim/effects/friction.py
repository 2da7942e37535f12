"""Dry joint friction that falls with speed (Stribeck) or grows with the transmitted load."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.effect import Start, Strength
from drake_cafim.effects.joint import SLIP, SLIP_VELOCITY, DryFriction, JointCoulombFriction
from drake_cafim.effects.joint_samples import Force, JointSamples
from drake_cafim.effects.mean_sign import MeanSign
from drake_cafim.numerics.rounding import short
from drake_cafim.typing import Array

MOST_STATIC = 10.0
"""Largest static friction as a multiple of Coulomb's: a limit of what is plausible, no measured value."""


@dataclass(frozen=True)
class JointStribeckFriction(DryFriction):
    """−(Tc + (Ts − Tc) exp(−(v/vs)²)) tanh(v/w); with a slip z is in the place of tanh(v/w)."""

    name: ClassVar[str] = "joint_stribeck_friction"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("coulomb", "N m", 0.3, lower=0.0, linear_unit="N"),
        Strength("static", "N m", 0.5, lower=0.0, linear_unit="N"),
        Strength("velocity", "rad/s", 0.1, lower=1e-3, upper=10.0, linear_unit="m/s", amplitude=False),
    )
    narrows: ClassVar[Mapping[str, tuple[float, ...]]] = {JointCoulombFriction.name: (-1.0, 1.0, 0.0)}
    reference: ClassVar[str] = "Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994, §2.2"
    formula: ClassVar[str] = (
        "−(<i>T</i><sub>c</sub> + (<i>T</i><sub>s</sub> − <i>T</i><sub>c</sub>) "
        "exp(−(<i>v</i>/<i>v</i><sub>s</sub>)²)) tanh(<i>v</i>/<i>w</i>)"
    )
    words: ClassVar[str] = "opposes the motion, more near rest than at speed"
    alike: ClassVar[Mapping[str, str]] = {
        "joint_coulomb_friction": "it is that law where the motion is never slow, or the rise near rest is small",
        "joint_viscous_friction": "the falling branch and a viscous slope cancel over a narrow range of speeds",
        "joint_asymmetric_coulomb_friction": "both are dry friction; slow motion tells them apart",
    }

    def force(self, joint: JointSamples) -> Force:
        coulomb, static, velocity = self.vector
        side, by_q, by_v = self.side(joint)
        bent = self.bent(joint)
        if bent is None:
            rise = _Rise.of(joint, velocity, self.values.get(SLIP_VELOCITY.name, SLIP_VELOCITY.nominal))
        else:
            rise = _Rise.along(joint, velocity, bent)
        more = static - coulomb
        d_strengths = np.stack([rise.value - side, -rise.value, -more * rise.by_velocity], axis=1)
        value, slope = -coulomb * side - more * rise.value, -coulomb * by_v - more * rise.by_v
        return Force(value, -(coulomb + more * rise.bump) * by_q, slope, np.zeros_like(joint.v), d_strengths)

    def starts(self, joint: JointSamples) -> Iterator[Start]:
        speed = float(np.sqrt(np.mean(joint.v**2)))
        for velocity in (0.04, 0.08, 0.15, 0.3, 0.6):
            for width in SLIP_VELOCITY.grid:
                sign = joint.sign(width).value
                rise = _Rise.of(joint, max(velocity * speed, 1e-3), width).value
                columns = np.stack([rise - sign, -rise], axis=1)
                yield Start(columns, {"velocity": max(velocity * speed, 1e-3), "slip_velocity": width})

    def from_coefficients(self, coefficients: Array, shape: Mapping[str, float]) -> "JointStribeckFriction":
        coulomb, static = (float(c) for c in coefficients)
        return type(self)(self.at, {"coulomb": coulomb, "static": static, **shape})

    def bounds_of(self, strength: Strength) -> tuple[float, float]:
        if strength.name != "static":
            return super().bounds_of(strength)
        # what is fitted beyond is how the velocity's noise and delay act while the joint reverses
        return self.values["coulomb"], MOST_STATIC * self.values["coulomb"]

    def plausible(self) -> bool:
        # friction that rises with speed is a different law; here it would only widen the smoothed sign function
        return super().plausible() and self.values["static"] > self.values["coulomb"]


@dataclass(frozen=True)
class _Rise:
    """The mean of exp(−(v/vs)²) σ over v's error, its slopes in v and in vs, and that of exp(−(v/vs)²); each (N,).

    The side σ of the friction is tanh(v/w), or the state z of what builds up.
    """

    value: Array
    by_v: Array
    by_velocity: Array
    bump: Array

    @classmethod
    def of(cls, joint: JointSamples, velocity: float, width: float) -> "_Rise":
        """For vs = `velocity` and σ = tanh(v/w) with w = `width`.

        The product of the Gaussian error's density (std s) and exp(−(v/vs)²) is again Gaussian: vs/b exp(−(v/b)²)
        times a normal density of mean v vs²/b² and standard deviation s vs/b, with b² = vs² + 2 s².
        """
        v, s = joint.v, np.asarray(joint.v_std)
        b = np.sqrt(velocity**2 + 2.0 * s**2)
        near = (velocity / b) ** 2
        sign = MeanSign.of(v * near, s * velocity / b, width)
        bump, bump_by_v, bump_by_velocity = _bump(v, velocity, b)
        near_by_velocity = 4.0 * velocity * s**2 / b**4
        along = sign.by_v * v * near_by_velocity + sign.by_std * 2.0 * (s / b) ** 3
        return cls(
            bump * sign.value,
            bump_by_v * sign.value + bump * sign.by_v * near,
            bump_by_velocity * sign.value + bump * along,
            bump,
        )

    @classmethod
    def along(cls, joint: JointSamples, velocity: float, bent: Array) -> "_Rise":
        """For vs = `velocity` and σ = z, `bent` (N,)."""
        b = np.sqrt(velocity**2 + 2.0 * np.asarray(joint.v_std) ** 2)
        bump, by_v, by_velocity = _bump(joint.v, velocity, b)
        return cls(bump * bent, by_v * bent, by_velocity * bent, bump)


def _bump(v: Array, velocity: float, b: Array) -> tuple[Array, Array, Array]:
    """The mean of exp(−(v/vs)²) over v's error, and its slopes in v and in vs = `velocity`; b² = vs² + 2 s²."""
    bump = velocity / b * np.exp(-((v / b) ** 2))
    return bump, -2.0 * v / b**2 * bump, bump * (1.0 / velocity - velocity / b**2 + 2.0 * velocity * v**2 / b**4)


EXTERNAL = Strength("external", "1", 0.05, lower=0.0, upper=1.0)
"""Share of the load from outside; 0 unless a servo drives the joint, whose gears carry that load back to the motor."""

LOAD_SHARES = (0.25, 0.5, 0.75, 1.0)
"""Parts of friction by load that are tried as friction by the load from outside alone."""


@dataclass(frozen=True)
class JointLoadDependentFriction(DryFriction):
    """−(T + c |u| + e |load|) tanh(v/w), u the effort that acts, the load that of gravity and contacts.

    With a slip z is in the place of tanh(v/w).
    """

    name: ClassVar[str] = "joint_load_dependent_friction"
    shown_over: ClassVar[str] = "load"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("torque", "N m", 0.3, lower=0.0, linear_unit="N", amplitude=False),
        # gears that lose more than half of what goes through them cannot be driven from outside; near 1 the law takes
        # the whole effort away, whatever it is, and so explains anything
        Strength("coefficient", "1", 0.05, lower=0.0, upper=0.5),
    )
    narrows: ClassVar[Mapping[str, tuple[float, ...]]] = {JointCoulombFriction.name: (0.0, 1.0)}
    shapes: ClassVar[tuple[Strength, ...]] = (SLIP_VELOCITY, SLIP, EXTERNAL)
    reference: ClassVar[str] = "Hamon, Gautier, Garrec, IEEE/RSJ IROS, 2010 (load-dependent joint friction)"
    formula: ClassVar[str] = "−(<i>T</i> + <i>c</i> |<i>u</i>| + <i>e</i> |load|) tanh(<i>v</i>/<i>w</i>)"
    words: ClassVar[str] = "opposes the motion, more the more effort the transmission carries"
    alike: ClassVar[Mapping[str, str]] = {
        "joint_coulomb_friction": "it is that law where the load hardly changes",
        "joint_asymmetric_coulomb_friction": "where one direction is the loaded one, both differ by direction",
        "actuator_gain_error": "a loss in proportion to the effort, whichever way the joint moves",
    }

    @property
    def is_absent(self) -> bool:
        return super().is_absent and self.external == 0.0

    @property
    def external(self) -> float:
        """The share of the load from outside that friction grows with."""
        return float(self.values.get("external", 0.0))

    def force(self, joint: JointSamples) -> Force:
        torque, coefficient = self.vector
        side, by_q, by_v = self.side(joint)
        level = torque + coefficient * np.abs(joint.u) + self.external * np.abs(joint.load)
        d_strengths = np.stack([-side, -np.abs(joint.u) * side], axis=1)
        d_u = -coefficient * np.sign(joint.u) * side
        return Force(-level * side, -level * by_q, -level * by_v, d_u, d_strengths)

    def starts(self, joint: JointSamples) -> Iterator[Start]:
        for width in SLIP_VELOCITY.grid:
            sign = joint.sign(width).value
            loaded = -np.abs(joint.u) * sign
            yield Start(np.stack([-sign, loaded], axis=1), {"slip_velocity": width})
            yield Start(loaded[:, None], {"slip_velocity": width})
            if np.any(joint.load):
                outside = -np.abs(joint.load) * sign
                yield Start(np.stack([-sign, loaded, outside], axis=1), {"slip_velocity": width})

    def from_coefficients(self, coefficients: Array, shape: Mapping[str, float]) -> "JointLoadDependentFriction":
        torque, coefficient = (0.0, *coefficients) if len(coefficients) == 1 else coefficients[:2]
        values = {"torque": float(torque), "coefficient": float(coefficient)}
        if len(coefficients) > 2 and coefficients[2] > 0.0:
            values["external"] = float(min(coefficients[2], EXTERNAL.upper))
        return type(self)(self.at, {**values, **shape})

    def restarts(self) -> Iterator["JointLoadDependentFriction"]:
        yield from super().restarts()
        for factor in (0.0, 0.5, 0.75, 1.33, 2.0) if self.external > 0.0 else ():
            yield type(self)(self.at, {**self.values, "external": factor * self.external})

    def restarts_under_servo(self) -> Iterator["JointLoadDependentFriction"]:
        yield from super().restarts_under_servo()
        # at rest the servo carries the load, so that only motions tell which of the two makes friction
        whole = self.values["coefficient"] + self.external
        for external in whole * np.array(LOAD_SHARES):
            values = {"coefficient": float(whole - external), "external": float(min(external, EXTERNAL.upper))}
            yield self.with_values({**self.values, **values})

    def sentence(self, tree: Tree) -> str:
        told = super().sentence(tree)
        return f"{told[:-1]}, external {short(self.external)})" if self.external > 0.0 else told
