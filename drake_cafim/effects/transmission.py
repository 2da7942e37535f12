"""Forces of position that a joint's transmission and its stops add."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drake_cafim.effects.effect import Force, JointSamples, Start, Strength
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.onset import FREE, Onset
from drake_cafim.typing import Array

MOST_PERIODS = 40.0
"""Ripples are looked for with up to so many periods over the range that the joint moves through."""
PATCH = 0.05
"""Of the largest effort, that other laws may be wrong by where more than noise is left."""


@dataclass(frozen=True)
class TorqueRipple(JointForce):
    """A sin(cycles·q + phase)."""

    name: ClassVar[str] = "torque_ripple"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("amplitude", "N m", 0.3, lower=0.0, linear_unit="N"),
        Strength("cycles", "1/rad", 20.0, lower=0.0, linear_unit="1/m", amplitude=False),
        Strength("phase", "rad", 1.0, amplitude=False),
    )
    reference: ClassVar[str] = "Holtz, Springob, IEEE Trans. Industrial Electronics 43(2), 1996 (cogging)"
    alike: ClassVar[Mapping[str, str]] = {
        "joint_spring": "over a small range of positions a slow ripple is a slope",
        "gravity_misalignment": "one period a turn is what a tilt does to a joint's weight",
        "payload": "one period a turn is what an unbalanced mass does to a joint",
    }

    def force(self, joint: JointSamples) -> Force:
        amplitude, cycles, phase = self.vector
        sine, cosine = np.sin(cycles * joint.q + phase), np.cos(cycles * joint.q + phase)
        d_strengths = np.stack([sine, amplitude * cosine * joint.q, amplitude * cosine], axis=1)
        zero = np.zeros_like(joint.q)
        return Force(amplitude * sine, amplitude * cycles * cosine, zero, zero, d_strengths)

    def plausible_over(self, joint: JointSamples) -> bool:
        # less than three quarters of a period is a slope or an offset, not a ripple
        return bool(self.values["cycles"] * np.ptp(joint.q) > 1.5 * np.pi)

    def starts(self, joint: JointSamples) -> Iterator[Start]:
        span = float(np.ptp(joint.q))
        if span < 1e-4:
            return
        # half a step off, the phase is wrong by at most 0.6 rad at the ends of the range: still in the basin
        for periods in np.arange(1.0, MOST_PERIODS, 0.38):
            cycles = float(2.0 * np.pi * periods / span)
            columns = np.stack([np.sin(cycles * joint.q), np.cos(cycles * joint.q)], axis=1)
            yield Start(columns, {"cycles": cycles})

    def from_coefficients(self, coefficients: Array, shape: Mapping[str, float]) -> "TorqueRipple":
        sine, cosine = (float(c) for c in coefficients)
        return self.with_values(
            {"amplitude": float(np.hypot(sine, cosine)), "phase": float(np.arctan2(cosine, sine)), **shape}
        )


@dataclass(frozen=True)
class JointHardStop(JointForce):
    """A one-sided spring and damper beyond `position`, above (side +1) or below (−1), that never pulls."""

    name: ClassVar[str] = "joint_hard_stop"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("position", "rad", 1.0, linear_unit="m", amplitude=False),
        Strength("stiffness", "N m/rad", 10.0, lower=0.0, linear_unit="N/m"),
        Strength("damping", "N m s/rad", 0.1, lower=0.0, linear_unit="N s/m", amplitude=False),
    )
    shapes: ClassVar[tuple[Strength, ...]] = (Strength("side", "1", 1.0, nominal=1.0),)
    reference: ClassVar[str] = "Brogliato, Nonsmooth Mechanics, 2016, §2 (compliant unilateral constraint)"
    alike: ClassVar[Mapping[str, str]] = {
        "joint_spring": "a stop that is hardly ever left is a spring",
        "unmodeled_contact": "an obstacle met at the end of the range; other joints feel it too",
        "actuator_saturation": "the largest efforts may come at the end of the range",
    }

    def force(self, joint: JointSamples) -> Force:
        position, stiffness, damping = self.vector
        side = self.values.get("side", 1.0)
        depth, rate = side * (joint.q - position), side * joint.v
        onset = Onset.of(depth, joint.q_reach)
        push = stiffness * onset.depth + damping * rate * onset.share
        touching = push > 0.0
        by_depth = stiffness * onset.share + damping * rate * onset.slope
        d_strengths = np.stack([side * by_depth, -onset.depth, -rate * onset.share], axis=1) * side
        zero = np.zeros_like(depth)
        return Force(
            np.where(touching, -side * push, 0.0),
            np.where(touching, -by_depth, 0.0),
            np.where(touching, -damping * onset.share, 0.0),
            zero,
            np.where(touching[:, None], d_strengths, 0.0),
        )

    def plausible_over(self, joint: JointSamples) -> bool:
        # a stop may be soft, or leant on for most of the time; but what is never touched stops nothing, what is never
        # left is a spring, and what does not push back at rest is a friction. How surely it does, evidence tells
        depth = self.values.get("side", 1.0) * (joint.q - self.values["position"])
        met, free = np.any(depth > joint.q_reach), np.mean(depth < -joint.q_reach) > FREE
        return bool(met and free and self.values["stiffness"] > 0.0)

    def stands_out(self, joint: JointSamples) -> bool:
        # laws of friction and drives are right to some hundredths of the effort: at the ends of the range, where motion
        # turns, what they leave looks like a soft stop
        depth = self.values.get("side", 1.0) * (joint.q - self.values["position"])
        return bool(self.values["stiffness"] * np.max(depth) > PATCH * np.max(np.abs(joint.u)))

    def starts(self, joint: JointSamples) -> Iterator[Start]:
        for side in (1.0, -1.0):
            for share in (0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.75, 0.82, 0.88, 0.92, 0.95, 0.97, 0.985, 0.995):
                position = side * float(np.quantile(side * joint.q, share))
                depth = np.maximum(0.0, side * (joint.q - position))
                rate = np.where(depth > 0.0, joint.v, 0.0)
                yield Start(-np.stack([side * depth, rate], axis=1), {"side": side, "position": position})

    def from_coefficients(self, coefficients: Array, shape: Mapping[str, float]) -> "JointHardStop":
        # the start's depth at first touch is rough, so its damping may come out below zero
        values = {"stiffness": float(coefficients[0]), "damping": max(float(coefficients[1]), 0.0)}
        return JointHardStop(self.at, {**values, **shape})
