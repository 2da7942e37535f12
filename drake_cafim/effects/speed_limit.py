"""The torque–speed envelope of an electric actuator."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from drake_cafim.effects.actuator import EFFORT_LIMIT
from drake_cafim.effects.effect import Place, Start, Strength
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.joint_samples import Force, JointSamples
from drake_cafim.effects.servo import Servo
from drake_cafim.typing import Array


@dataclass(frozen=True)
class ActuatorSpeedLimit(JointForce):
    """|effort| ≤ stall torque·(1 − v·sign(effort)/no-load speed), and no effort along the motion beyond that speed.

    As a force beside the effort u it is what the envelope takes off, clip(u, lower(v), upper(v)) − u.
    """

    name: ClassVar[str] = "actuator_speed_limit"
    place: ClassVar[Place] = Place.ACTUATOR
    family: ClassVar[str] = "actuator"
    group: ClassVar[str | None] = EFFORT_LIMIT
    shown_over: ClassVar[str] = "variable"
    all_but_linear: ClassVar[bool] = False
    bounds_effort: ClassVar[bool] = True
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength(
            "no_load_speed", "rad/s", 10.0, lower=1e-3, upper=1e4, inverse=True, amplitude=False, linear_unit="m/s"
        ),
        Strength("stall_torque", "N m", 10.0, lower=1e-6, upper=1e6, inverse=True, linear_unit="N"),
    )
    reference: ClassVar[str] = "Krishnan, Electric Motor Drives, 2001, §2 (torque–speed characteristic)"
    formula: ClassVar[str] = "|effort| ≤ <i>T</i> (1 − <i>v</i> sign(effort)/<i>v</i><sub>0</sub>)"
    words: ClassVar[str] = "makes the less effort the faster the joint moves along with it"
    alike: ClassVar[Mapping[str, str]] = {
        "actuator_saturation": "where the joint is slow, the envelope is a constant limit",
        "joint_viscous_friction": "efforts that are always at the envelope fall with speed as by friction",
        "command_rate_limit": "both bound the joint's speed",
    }

    def force(self, joint: JointSamples) -> Force:
        speed, stall = self.values["no_load_speed"], self.values["stall_torque"]
        along, against = 1.0 - joint.v / speed, 1.0 + joint.v / speed
        above, below = np.maximum(along, 0.0), np.maximum(against, 0.0)
        upper, lower = stall * above, -stall * below
        high, low = joint.u > upper, joint.u < lower
        value = np.clip(joint.u, lower, upper) - joint.u
        by_v = np.where((high & (along > 0.0)) | (low & (against > 0.0)), -stall / speed, 0.0)
        by_stall = np.where(high, above, np.where(low, -below, 0.0))
        by_speed = -by_v * joint.v / speed
        return Force(
            value, np.zeros_like(value), by_v, np.where(high | low, -1.0, 0.0), np.stack([by_speed, by_stall], axis=1)
        )

    def bounded(self, servo: Servo) -> Servo:
        return replace(servo, stall_torque=self.values["stall_torque"], no_load_speed=self.values["no_load_speed"])

    def starts(self, joint: JointSamples) -> Iterator[Start]:
        fastest = float(np.max(np.abs(joint.v), initial=0.0))
        for ratio in (1.05, 1.4, 2.0, 4.0):
            speed = max(ratio * fastest, 1e-3)
            needed = np.abs(joint.u) / np.maximum(1.0 - joint.v * np.sign(joint.u) / speed, 1e-3)
            for share in (0.5, 0.8, 0.95):
                stall = float(np.quantile(needed, share))
                if stall > 0.0:
                    shape = {"no_load_speed": speed, "stall_torque": stall}
                    law = type(self)(self.at, shape).force(joint)
                    yield Start(np.stack([law.value, law.d_strengths[:, 1]], axis=1), shape)

    def from_coefficients(self, coefficients: Array, shape: Mapping[str, float]) -> "ActuatorSpeedLimit":
        """While the same samples are at the envelope, L(T′) = L(T) + (T′ − T) ∂L/∂T in the stall torque T."""
        acting, added = coefficients.tolist()
        stall = shape["stall_torque"] + (added / acting if acting > 0.0 else 0.0)
        # a stall torque below nothing is no step within the linear range; a start need not be exact
        return self.with_values({**shape, "stall_torque": stall if stall > 0.0 else shape["stall_torque"]})

    def plausible_over(self, joint: JointSamples) -> bool:
        return bool(np.any(self.force(joint).d_u < 0.0))
