"""Position-dependent joint forces of the transmission and the stops: torque ripple, hard stop."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drake_cafim.effects.effect import Start, Strength
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.joint_samples import Force, JointSamples
from drake_cafim.effects.onset import FREE, Onset
from drake_cafim.typing import Array

LEAST_PERIODS, MOST_PERIODS = 1.5, 40.0
"""Numbers of ripple periods over the joint's range of motion that the search tries: with fewer nothing repeats."""
PATCH = 0.05
"""Assumed model error of other joint laws, as a fraction of the largest effort, where the residual is not white."""


@dataclass(frozen=True)
class TorqueRipple(JointForce):
    """A sin(cycles·q + phase)."""

    name: ClassVar[str] = "torque_ripple"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("amplitude", "N m", 0.3, lower=0.0, linear_unit="N"),
        Strength("cycles", "1/rad", 20.0, lower=0.0, linear_unit="1/m", amplitude=False, required=True),
        Strength("phase", "rad", 1.0, amplitude=False),
    )
    reference: ClassVar[str] = "Holtz, Springob, IEEE Trans. Industrial Electronics 43(2), 1996 (cogging)"
    formula: ClassVar[str] = "<i>A</i> sin(<i>n</i> <i>q</i> + φ)"
    words: ClassVar[str] = "pushes back and forth as the joint turns, as cogging does"
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
        # what has not come again is a slope, a weight or a mass off its axis as well as a ripple
        return bool(self.values["cycles"] * np.ptp(joint.q) > 2.0 * np.pi * LEAST_PERIODS)

    def starts(self, joint: JointSamples) -> Iterator[Start]:
        span = float(np.ptp(joint.q))
        if span < 1e-4:
            return
        # half a grid step off, the phase error at the ends of the range is at most 0.6 rad: the fit still converges
        for periods in np.arange(LEAST_PERIODS, MOST_PERIODS, 0.38):
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
    shapes: ClassVar[tuple[Strength, ...]] = (Strength("side", "1", 1.0, nominal=1.0, choices=(1.0, -1.0)),)
    reference: ClassVar[str] = "Brogliato, Nonsmooth Mechanics, 2016, §2 (compliant unilateral constraint)"
    formula: ClassVar[str] = "−(<i>k</i> δ + <i>d</i> δ̇) beyond the stop, 0 before it"
    words: ClassVar[str] = "pushes the joint back beyond a position"
    shown_over: ClassVar[str] = "position"
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
        # a stop may be soft, or in contact for most of the time; but one that is never touched has no effect, one that
        # is never left is a spring, and one without stiffness is a friction. The evidence decides how certain it is
        depth = self.values.get("side", 1.0) * (joint.q - self.values["position"])
        met, free = np.any(depth > joint.q_reach), np.mean(depth < -joint.q_reach) > FREE
        return bool(met and free and self.values["stiffness"] > 0.0)

    def stands_out(self, joint: JointSamples) -> bool:
        # friction and drive laws are accurate to a few per cent of the effort: at the ends of the range, where motion
        # reverses, their model error resembles a soft stop. Beyond most of the range it is a law that bends, no stop
        depth = self.values.get("side", 1.0) * (joint.q - self.values["position"])
        pushed = self.values["stiffness"] * np.max(depth)
        return bool(pushed > PATCH * np.max(np.abs(joint.u)) and np.median(depth) < 0.0)

    def starts(self, joint: JointSamples) -> Iterator[Start]:
        for side in (1.0, -1.0):
            for share in (0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.75, 0.82, 0.88, 0.92, 0.95, 0.97, 0.985, 0.995):
                position = side * float(np.quantile(side * joint.q, share))
                depth = np.maximum(0.0, side * (joint.q - position))
                rate = np.where(depth > 0.0, joint.v, 0.0)
                yield Start(-np.stack([side * depth, rate], axis=1), {"side": side, "position": position})

    def from_coefficients(self, coefficients: Array, shape: Mapping[str, float]) -> "JointHardStop":
        # the stop's position is only a grid value here, so the damping may come out negative
        values = {"stiffness": float(coefficients[0]), "damping": max(float(coefficients[1]), 0.0)}
        return type(self)(self.at, {**values, **shape})
