"""Couplings between a joint's rotor and its link: elasticity and backlash, with the rotor's unmeasured motion.

The rotor, of reflected inertia J, is driven by the effort u; the coupling exerts the torque f(ψ, ψ̇) on the link, with
the twist ψ = θ − q of the rotor against the link:

    J θ̈ = u − f,      q̈ = r + b f      ⇒      ψ̈ = g − m f,      g = u/J − r,      m = 1/J + b,

where r is the link's acceleration without the coupling and b its mobility. r, b follow from the rigid-body model at
the measured positions and velocities, so that ψ contains no differentiated measurement: its noise is negligible, and
it cannot explain noise away. The rotor's momentum J θ̇ replaces J q̇ in the equation of motion: it adds J ψ̇.
"""

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drake_cafim.dynamics.tree import Tree
from drake_cafim.effects.effect import Effect, P, Place, Strength
from drake_cafim.effects.twist import backlash_twist_rate, linear_twist_rate, transition
from drake_cafim.typing import Array

STEP = 1e-6
"""rad and rad/s, step of finite differences of a coupling law."""
LONGEST_STEP = 0.5e-3
"""s, longest step of the integration across a gap: impacts on its flanks are resolved within such a step."""
GAPS = tuple(3e-4 * 1.25**k for k in range(23))
"""rad, gaps tried in screening. The grid is fine (factor 1.25): with a gap a third too wide the impacts come so late
that the fit is worse than without backlash."""


@dataclass(frozen=True)
class RotorDrive:
    """The coefficients of ψ̈ = g − m f, each (N,): `push` g and `mobility` m, constant from each of `time` to the next.

    `inertia` is the rotor's reflected inertia J, kg m² or kg.
    """

    time: Array
    push: Array
    mobility: Array
    inertia: float


@dataclass(frozen=True)
class JointCoupling(Effect):
    """A force law f(ψ, ψ̇) between rotor and link of one joint."""

    place: ClassVar[Place] = Place.JOINT
    family: ClassVar[str] = "joint"
    kind: ClassVar[str] = "coupling"
    needs_motion: ClassVar[bool] = True
    shapes_about_values: ClassVar[bool] = True

    def add_to(self, physics: P) -> P:
        return physics.with_part("couplings", self)

    @abstractmethod
    def torque(self, twist: float, rate: float) -> float:
        """f(ψ, ψ̇), N m or N."""

    @abstractmethod
    def balance(self, torque: float) -> float:
        """The static twist ψ that transmits `torque`: f(ψ, 0) = torque."""

    @abstractmethod
    def twist_rate(self, drive: RotorDrive) -> Array:
        """ψ̇ (N,) at the samples, starting at rest in static equilibrium with the first push."""

    def twist_rate_by_start(self, drive: RotorDrive) -> Array:
        """∂ψ̇/∂start (N, c): sensitivity to the unknown initial twist and rate, in units of their prior std.

        A recording may begin in the middle of a motion with its joint already oscillating; the prior std is the largest
        static twist. All coupling laws have the same prior, otherwise one without it would seem the better explanation.
        """
        phi, rest = self.linear_steps(drive)
        twist, still = float(np.max(np.abs(rest))), np.zeros_like(rest)
        rate = twist * float(np.sqrt(self.values["stiffness"] * np.mean(drive.mobility)))
        return np.stack([linear_twist_rate(phi, still, twist, 0.0), linear_twist_rate(phi, still, 0.0, rate)], axis=1)

    def linear_steps(self, drive: RotorDrive) -> tuple[Array, Array]:
        """Transition matrices Φ (4, N − 1) of the intervals and equilibria x_e (N,): x' = Φ (x − x_e) + x_e."""
        stiffness, damping = self.values["stiffness"], self.values["damping"]
        pull, drag = stiffness * drive.mobility, damping * drive.mobility
        return np.asarray(transition(pull[:-1], drag[:-1], np.diff(drive.time))), drive.push / pull

    def twist_rates_from(self, drive: RotorDrive) -> Array:
        """ψ̇ (N, c) from alternative initial equilibria of the twist, where these are not a small change."""
        return np.zeros((len(drive.time), 0))

    def slopes(self, twist: Array, rate: Array) -> tuple[Array, Array, Array]:
        """f (B,), ∂f/∂ψ and ∂f/∂ψ̇ (B,); by central differences unless a subclass gives them analytically."""

        def value(psi: Array, psi_rate: Array) -> Array:
            return np.array([self.torque(float(a), float(b)) for a, b in zip(psi, psi_rate, strict=True)])

        by_twist = (value(twist + STEP, rate) - value(twist - STEP, rate)) / (2.0 * STEP)
        by_rate = (value(twist, rate + STEP) - value(twist, rate - STEP)) / (2.0 * STEP)
        return value(twist, rate), by_twist, by_rate

    @abstractmethod
    def trials(self, drive: RotorDrive, prismatic: bool) -> Iterator[Mapping[str, float]]:
        """Parameter values to test in screening; `drive` holds all recordings, concatenated."""

    def from_trial(self, values: Mapping[str, float], coefficient: float) -> "JointCoupling | None":
        """The effect for which `coefficient` times the change by `values` fits best; None if that is implausible."""
        # 1 if the trial values are right; a start of a fit need not be exact, hence the wide bounds
        return self.with_values(values) if 0.3 < coefficient < 3.0 else None

    @classmethod
    def places(cls, tree: Tree) -> Iterator[str]:
        """Joints whose model has rotor inertia: without it the rotor cannot be distinguished from the link."""
        yield from (joint.name for joint in tree.joints if joint.rotor_inertia > 0.0)


@dataclass(frozen=True)
class JointElasticity(JointCoupling):
    """f = k ψ + d ψ̇."""

    name: ClassVar[str] = "joint_elasticity"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("stiffness", "N m/rad", 1000.0, lower=1e-3, upper=1e8, inverse=True, linear_unit="N/m"),
        Strength("damping", "N m s/rad", 1.0, lower=0.0, linear_unit="N s/m", amplitude=False),
    )
    reference: ClassVar[str] = "Spong, J. Dynamic Systems, Measurement, and Control 109(4), 1987"
    formula: ClassVar[str] = "<i>k</i> ψ + <i>d</i> ψ̇, ψ the twist of the rotor against the link"
    words: ClassVar[str] = "couples rotor and link by a spring in place of a rigid shaft"
    alike: ClassVar[Mapping[str, str]] = {
        "actuator_delay": "below the resonance a soft joint passes an effort on late",
        "actuator_lag": "below the resonance a soft joint passes an effort on late",
        "joint_backlash": "a gap is soft while it is crossed",
        "rotor_inertia": "near the resonance the rotor moves more than the link, as if it were heavier",
    }

    def torque(self, twist: float, rate: float) -> float:
        stiffness, damping = self.vector
        return float(stiffness * twist + damping * rate)

    def balance(self, torque: float) -> float:
        return torque / self.values["stiffness"]

    def slopes(self, twist: Array, rate: Array) -> tuple[Array, Array, Array]:
        stiffness, damping = self.vector
        unit = np.ones_like(twist)
        return stiffness * twist + damping * rate, stiffness * unit, damping * unit

    def twist_rate(self, drive: RotorDrive) -> Array:
        phi, rest = self.linear_steps(drive)
        return np.asarray(linear_twist_rate(phi, rest, float(rest[0]), 0.0), dtype=float)

    def trials(self, drive: RotorDrive, prismatic: bool) -> Iterator[Mapping[str, float]]:
        mobility = float(np.mean(drive.mobility))
        for frequency in 4.0 * 1.22 ** np.arange(17):
            # rounded to a fixed grid, so that a slightly different mobility leads to the same trial values
            stiffness = 10.0 ** (round(20.0 * float(np.log10((2.0 * np.pi * frequency) ** 2 / mobility))) / 20.0)
            for ratio in (0.05, 0.2):
                yield {"stiffness": stiffness, "damping": 4.0 * np.pi * ratio * float(frequency) / mobility}

    def restarts(self) -> Iterator["JointElasticity"]:
        # while a joint's initial oscillation decays, each wrong frequency fits some periods: local optima
        for factor in (0.35, 0.6, 1.6, 2.8):
            yield self.with_values({**self.values, "stiffness": factor * self.values["stiffness"]})

    def from_trial(self, values: Mapping[str, float], coefficient: float) -> "JointElasticity | None":
        # far above the motion's frequencies the twist is in proportion to the compliance
        if not 0.02 < coefficient < 3.0:
            return None
        return self.with_values({**values, "stiffness": values["stiffness"] / min(coefficient, 1.5)})


@dataclass(frozen=True)
class JointBacklash(JointCoupling):
    """f = max(0, k (ψ − gap/2) + d ψ̇) on one flank, its mirror image on the other flank, 0 between them."""

    name: ClassVar[str] = "joint_backlash"
    impacts: ClassVar[bool] = True
    difference_step: ClassVar[float] = 1e-2
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("gap", "rad", 2e-3, lower=0.0, upper=0.5, linear_unit="m"),
        Strength(
            "stiffness", "N m/rad", 1000.0, lower=1e-3, upper=1e8, inverse=True, linear_unit="N/m", amplitude=False
        ),
        Strength("damping", "N m s/rad", 1.0, lower=0.0, linear_unit="N s/m", amplitude=False),
    )
    reference: ClassVar[str] = "Nordin, Gutman, Automatica 38(10), 2002 (backlash with a dead zone and damped flanks)"
    formula: ClassVar[str] = "0 within the gap; a stiff, damped flank on either side"
    words: ClassVar[str] = "lets the rotor turn freely over a gap before it moves the link"
    alike: ClassVar[Mapping[str, str]] = {
        "joint_elasticity": "a gap is soft while it is crossed; a gap that is never crossed is a soft joint",
        "actuator_dead_zone": "efforts too small to cross the gap do nothing",
        "joint_coulomb_friction": "both act at reversals of the motion",
    }

    def torque(self, twist: float, rate: float) -> float:
        gap, stiffness, damping = (float(x) for x in self.vector)
        side = 1.0 if twist > 0.0 else -1.0
        depth = side * twist - 0.5 * gap
        return side * max(0.0, stiffness * depth + damping * side * rate) if depth > 0.0 else 0.0

    def balance(self, torque: float) -> float:
        return torque / self.values["stiffness"] + 0.5 * self.values["gap"] * float(np.sign(torque))

    def slopes(self, twist: Array, rate: Array) -> tuple[Array, Array, Array]:
        gap, stiffness, damping = self.vector
        beyond = twist - np.clip(twist, -0.5 * gap, 0.5 * gap)
        torque = stiffness * beyond + damping * rate
        # teeth push and do not pull; without a gap they stay engaged in both directions
        meshed = np.asarray((gap == 0.0) | (torque * beyond > 0.0), dtype=float)
        return meshed * torque, meshed * stiffness, meshed * damping

    def twist_rate(self, drive: RotorDrive) -> Array:
        side = float(np.sign(drive.push[0]))
        return self._from_rest(drive, side)

    def twist_rates_from(self, drive: RotorDrive) -> Array:
        """ψ̇ (N, 2) from rest at the opposite flank, and from rest midway between the flanks."""
        side = float(np.sign(drive.push[0]))
        return np.stack([self._from_rest(drive, -side), self._from_rest(drive, 0.0)], axis=1)

    def _from_rest(self, drive: RotorDrive, side: float) -> Array:
        """ψ̇ (N,) from rest at the flank of `side` 1 or −1, or from rest midway between the flanks for `side` 0.

        On the flank that the first push acts against, it starts as deep as balances that push.
        """
        gap, stiffness, damping = (float(x) for x in self.vector)
        steps = np.diff(drive.time)
        parts = max(int(np.ceil(float(np.median(steps)) / LONGEST_STEP)), 1)
        flank = transition(stiffness * drive.mobility[:-1], damping * drive.mobility[:-1], steps / parts)
        rest = drive.push / (stiffness * drive.mobility)
        twist = side * 0.5 * gap + (float(rest[0]) if side * rest[0] > 0.0 else 0.0)
        rates, push, mobility = np.empty(len(drive.time)), drive.push, drive.mobility
        flanks = (stiffness, damping, parts, steps / parts, flank, rest)
        return np.asarray(backlash_twist_rate(0.5 * gap, *flanks, push, mobility, twist, rates), dtype=float)

    def restarts(self) -> Iterator["JointBacklash"]:
        # impacts at wrong times make local optima, so the fit is restarted from distant gaps and stiffnesses
        for name, factors in (("gap", (0.5, 0.7, 1.4, 2.0)), ("stiffness", (0.4, 2.5))):
            for factor in factors:
                yield self.with_values({**self.values, name: factor * self.values[name]})
        # a fit that ran off to rigid, undamped flanks has no slope back, and no factor of one of the two leads back
        usual = {strength.name: strength.typical for strength in self.strengths if strength.name != "gap"}
        yield self.with_values({**self.values, **usual})

    def between_shapes(self, ratio: float) -> Iterator["JointBacklash"]:
        for factor in (ratio, 1.0 / ratio):
            yield self.with_values({**self.values, "gap": factor * self.values["gap"]})

    def trials(self, drive: RotorDrive, prismatic: bool) -> Iterator[Mapping[str, float]]:
        scale = 0.2 if prismatic else 1.0
        for gap in GAPS:
            for frequency in (18.0, 45.0):
                stiffness = drive.inertia * (2.0 * np.pi * frequency) ** 2
                damping = 0.6 * float(np.sqrt(stiffness * drive.inertia))
                yield {"gap": scale * gap, "stiffness": stiffness, "damping": damping}
