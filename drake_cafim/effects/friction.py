"""Dry friction beyond Coulomb's: it falls with speed, or grows with the load that the transmission carries."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drake_cafim.effects.effect import Force, JointSamples, Start, Strength
from drake_cafim.effects.joint import DRY_FRICTION, SLIP_VELOCITY, JointForce, smooth_sign
from drake_cafim.typing import Array


@dataclass(frozen=True)
class JointStribeckFriction(JointForce):
    """−(Tc + (Ts − Tc) exp(−(v/vs)²)) tanh(v/w)."""

    name: ClassVar[str] = "joint_stribeck_friction"
    group: ClassVar[str | None] = DRY_FRICTION
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("coulomb", "N m", 0.3, lower=0.0, linear_unit="N"),
        Strength("static", "N m", 0.5, lower=0.0, linear_unit="N"),
        Strength("velocity", "rad/s", 0.1, lower=1e-3, upper=10.0, linear_unit="m/s", amplitude=False),
    )
    shapes: ClassVar[tuple[Strength, ...]] = (SLIP_VELOCITY,)
    reference: ClassVar[str] = "Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994, §2.2"
    alike: ClassVar[Mapping[str, str]] = {
        "joint_coulomb_friction": "it is that law where the motion is never slow, or the rise near rest is small",
        "joint_viscous_friction": "the falling branch and a viscous slope cancel over a narrow range of speeds",
        "joint_asymmetric_coulomb_friction": "both are dry friction; slow motion tells them apart",
    }

    def force(self, joint: JointSamples) -> Force:
        coulomb, static, velocity = self.vector
        sign, slope = smooth_sign(joint.v, joint.v_std, self.values.get("slip_velocity", SLIP_VELOCITY.nominal))
        bump, d_v, d_velocity = _bump(joint, velocity)
        level = coulomb + (static - coulomb) * bump
        d_strengths = np.stack([-(1.0 - bump) * sign, -bump * sign, -(static - coulomb) * d_velocity * sign], axis=1)
        zero = np.zeros_like(joint.v)
        return Force(-level * sign, zero, -level * slope - (static - coulomb) * d_v * sign, zero, d_strengths)

    def starts(self, joint: JointSamples) -> Iterator[Start]:
        speed = float(np.sqrt(np.mean(joint.v**2)))
        for velocity in (0.04, 0.08, 0.15, 0.3, 0.6):
            bump, _, _ = _bump(joint, max(velocity * speed, 1e-3))
            for width in SLIP_VELOCITY.grid:
                sign, _ = smooth_sign(joint.v, joint.v_std, width)
                columns = np.stack([-(1.0 - bump) * sign, -bump * sign], axis=1)
                yield Start(columns, {"velocity": max(velocity * speed, 1e-3), "slip_velocity": width})

    def from_coefficients(self, coefficients: Array, shape: Mapping[str, float]) -> "JointStribeckFriction":
        coulomb, static = (float(c) for c in coefficients)
        return JointStribeckFriction(self.at, {"coulomb": coulomb, "static": static, **shape})

    def plausible(self) -> bool:
        # friction that rises with speed is another law; here it would only widen the sign change
        return super().plausible() and self.values["static"] > self.values["coulomb"]


def _bump(joint: JointSamples, velocity: float) -> tuple[Array, Array, Array]:
    """exp(−(v/vs)²) averaged over a Gaussian error of v, its slope in v and in vs.

    With error s the mean is vs/b exp(−(v/b)²), b² = vs² + 2 s².
    """
    b_squared = velocity**2 + 2.0 * np.asarray(joint.v_std) ** 2
    b = np.sqrt(b_squared)
    bump = velocity / b * np.exp(-(joint.v**2) / b_squared)
    d_v = -2.0 * joint.v / b_squared * bump
    d_velocity = bump * (1.0 / velocity - velocity / b_squared + 2.0 * velocity * joint.v**2 / b_squared**2)
    return bump, d_v, d_velocity


@dataclass(frozen=True)
class JointLoadDependentFriction(JointForce):
    """−(T + c |u|) tanh(v/w), u the commanded effort."""

    name: ClassVar[str] = "joint_load_dependent_friction"
    group: ClassVar[str | None] = DRY_FRICTION
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("torque", "N m", 0.3, lower=0.0, linear_unit="N", amplitude=False),
        Strength("coefficient", "1", 0.05, lower=0.0, upper=1.0),
    )
    shapes: ClassVar[tuple[Strength, ...]] = (SLIP_VELOCITY,)
    reference: ClassVar[str] = "Hamon, Gautier, Garrec, IEEE/RSJ IROS, 2010 (load-dependent joint friction)"
    alike: ClassVar[Mapping[str, str]] = {
        "joint_coulomb_friction": "it is that law where the load hardly changes",
        "joint_asymmetric_coulomb_friction": "where one direction is the loaded one, both differ by direction",
        "actuator_gain_error": "a loss in proportion to the effort, whichever way the joint moves",
    }

    def force(self, joint: JointSamples) -> Force:
        torque, coefficient = self.vector
        sign, slope = smooth_sign(joint.v, joint.v_std, self.values.get("slip_velocity", SLIP_VELOCITY.nominal))
        level = torque + coefficient * np.abs(joint.u)
        d_strengths = np.stack([-sign, -np.abs(joint.u) * sign], axis=1)
        d_u = -coefficient * np.sign(joint.u) * sign
        return Force(-level * sign, np.zeros_like(joint.v), -level * slope, d_u, d_strengths)

    def starts(self, joint: JointSamples) -> Iterator[Start]:
        for width in SLIP_VELOCITY.grid:
            sign, _ = smooth_sign(joint.v, joint.v_std, width)
            loaded = -np.abs(joint.u) * sign
            yield Start(np.stack([-sign, loaded], axis=1), {"slip_velocity": width})
            yield Start(loaded[:, None], {"slip_velocity": width})

    def from_coefficients(self, coefficients: Array, shape: Mapping[str, float]) -> "JointLoadDependentFriction":
        torque, coefficient = (0.0, *coefficients) if len(coefficients) == 1 else coefficients
        values = {"torque": float(torque), "coefficient": float(coefficient)}
        return JointLoadDependentFriction(self.at, {**values, **shape})
