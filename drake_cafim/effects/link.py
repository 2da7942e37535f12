"""Effects on inertia and gravity: rotor inertia, payload, wrong inertials, tilted gravity."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from drake_cafim.dynamics.pseudo_inertia import (
    inertial_parameters,
    pseudo_inertia,
    pseudo_inertia_of,
    with_pseudo_inertia,
)
from drake_cafim.dynamics.tree import Body, Tree
from drake_cafim.effects.effect import Direction, Effect, P, Place, Strength
from drake_cafim.effects.surroundings import Surroundings
from drake_cafim.typing import Array


@dataclass(frozen=True)
class TreeEffect(Effect):
    """Inertia or gravity that the model lacks."""

    kind: ClassVar[str] = "tree"
    changes_inertia: ClassVar[bool] = True
    of_inertia_alone: ClassVar[bool] = False
    """Whether inertial parameters and rotors' inertias are all that it changes: rows are linear in these."""

    def add_to(self, physics: P) -> P:
        tree, gravity = self.change(physics.tree, physics.gravity)
        return physics.changed(tree=tree, gravity=gravity)

    @abstractmethod
    def change(self, tree: Tree, gravity: Array) -> tuple[Tree, Array]:
        """The tree and the gravity (3,) m/s², world axes, with the effect included."""


@dataclass(frozen=True)
class RotorInertia(TreeEffect):
    """Reflected rotor inertia that the model lacks: it adds to M(q) on the joint's diagonal."""

    place: ClassVar[Place] = Place.JOINT
    of_inertia_alone: ClassVar[bool] = True
    family: ClassVar[str] = "joint"
    name: ClassVar[str] = "rotor_inertia"
    shown_over: ClassVar[str] = "acceleration"
    strengths: ClassVar[tuple[Strength, ...]] = (Strength("inertia", "kg m^2", 0.05, lower=0.0, linear_unit="kg"),)
    reference: ClassVar[str] = "Spong, Hutchinson, Vidyasagar, Robot Modeling and Control, 2006, §6"
    formula: ClassVar[str] = "−<i>J</i> <i>v̇</i>"
    words: ClassVar[str] = "resists acceleration of this joint alone, as a motor's rotor does"
    alike: ClassVar[Mapping[str, str]] = {
        "payload": "seen from one joint a point mass is an inertia; gravity and the other joints tell them apart",
        "actuator_gain_error": "where inertia dominates, more of it and less effort look alike",
    }

    def change(self, tree: Tree, gravity: Array) -> tuple[Tree, Array]:
        joint = tree.joints[tree.joint_index(self.at)]
        changed = replace(joint, rotor_inertia=joint.rotor_inertia + self.values["inertia"])
        return tree.with_joints([changed]), gravity


FARTHEST, USUAL = 0.5, 0.15
"""m from a body's origin: the largest plausible distance of a payload, and a usual one."""


@dataclass(frozen=True)
class Payload(TreeEffect):
    """A point mass fixed to a body."""

    place: ClassVar[Place] = Place.BODY
    of_inertia_alone: ClassVar[bool] = True
    family: ClassVar[str] = "link"
    name: ClassVar[str] = "payload"
    kind: ClassVar[str] = "load"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("mass", "kg", 0.3, lower=0.0),
        Strength("x", "m", 0.1, lower=-2.0, upper=2.0, through="mass"),
        Strength("y", "m", 0.1, lower=-2.0, upper=2.0, through="mass"),
        Strength("z", "m", 0.1, lower=-2.0, upper=2.0, through="mass"),
    )
    reference: ClassVar[str] = "Atkeson, An, Hollerbach, Int. J. Robotics Research 5(3), 1986"
    formula: ClassVar[str] = "a point mass <i>m</i> at (<i>x</i>, <i>y</i>, <i>z</i>) of the body"
    words: ClassVar[str] = "rides on the body as a point mass"
    alike: ClassVar[Mapping[str, str]] = {
        "gravity_misalignment": "both change the weight that the joints carry; inertia tells them apart",
        "actuator_gain_error": "more load and less effort look alike at one joint",
        "rotor_inertia": "seen from one joint a point mass is an inertia",
        "sensor_bias": "a position offset at the last joint changes the weight torque as a side load does",
    }

    def change(self, tree: Tree, gravity: Array) -> tuple[Tree, Array]:
        carrier = tree.body(self.at)
        point = Body(
            name=f"payload on {self.at}",
            joint=carrier.joint,
            R_JB=carrier.R_JB,
            p_JB=carrier.p_JB,
            mass=self.values["mass"],
            p_BBcm=np.array([self.values["x"], self.values["y"], self.values["z"]]),
            I_BBcm_B=np.zeros((3, 3)),
        )
        return replace(tree, bodies=(*tree.bodies, point)), gravity

    def directions(self) -> tuple[Direction, ...]:
        # linear in the mass and, but for the small second moment, in the first moments m x, m y, m z
        origin = {"mass": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}
        moments = [Direction(origin | {axis: 0.1}, origin | {axis: -0.1}, 0.2) for axis in "xyz"]
        return (Direction(origin, None, 1.0), *moments)

    def from_directions(self, coefficients: Array) -> "Payload":
        mass, moment = float(coefficients[0]), float(np.linalg.norm(coefficients[1:]))
        if moment > FARTHEST * mass or mass == 0.0:
            # an unknown link mass has absorbed the payload's mass: estimate it from the first moment alone
            mass = max(moment / USUAL, 1e-3)
        x, y, z = coefficients[1:] / mass
        return self.with_values({"mass": mass, "x": float(x), "y": float(y), "z": float(z)})


@dataclass(frozen=True)
class InertialError(TreeEffect):
    """Mass, centre of mass and inertia of a body that differ from the model's.

    The strengths are differences; the inertia's are about the body's origin, in its axes. It is a hypothesis where the
    scenario says that the body's inertials are unknown: then it is what their prior does not hold.
    """

    place: ClassVar[Place] = Place.BODY
    of_inertia_alone: ClassVar[bool] = True
    family: ClassVar[str] = "link"
    name: ClassVar[str] = "inertial_error"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("mass", "kg", 0.3),
        *(Strength(f"com_{axis}", "m", 0.03) for axis in "xyz"),
        *(Strength(name, "kg m^2", 0.02) for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")),
    )
    reference: ClassVar[str] = "Wensing, Kim, Slotine, IEEE Robotics and Automation Letters 3(1), 2018"
    formula: ClassVar[str] = "<i>m</i> + Δ<i>m</i>, <i>c</i> + Δ<i>c</i>, <i>I</i> + Δ<i>I</i> of the body"
    words: ClassVar[str] = "has another mass, centre of mass and inertia than the model says"
    alike: ClassVar[Mapping[str, str]] = {
        "payload": "a point mass on the body changes its mass, centre of mass and inertia",
        "rotor_inertia": "about its joint's axis a body's inertia is like a rotor's",
        "actuator_gain_error": "more load and less effort look alike at one joint",
    }

    @classmethod
    def attachments(cls, where: Surroundings) -> Iterator[str]:
        yield from where.inertials if where.thrown is None else ()

    def change(self, tree: Tree, gravity: Array) -> tuple[Tree, Array]:
        return tree.with_bodies([self.changed(tree.body(self.at))]), gravity

    def changed(self, body: Body) -> Body:
        """The `body` with the differences added."""
        v = {s.name: self.values.get(s.name, s.nominal) for s in self.strengths}
        J = inertial_parameters(pseudo_inertia(body))
        mass = J[0] + v["mass"]
        moment = mass * (body.p_BBcm + np.array([v["com_x"], v["com_y"], v["com_z"]]))
        inertia = J[4:] + np.array([v[name] for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")])
        return with_pseudo_inertia(body, pseudo_inertia_of(np.array([mass, *moment, *inertia])))

    def contradiction_in(self, tree: Tree) -> str:
        J = pseudo_inertia(tree.body(self.at))
        if np.all(np.isfinite(J)) and np.linalg.eigvalsh(J)[0] > 0.0:
            return ""
        return (
            f"with these differences no mass has the inertia of {self.at}, expected a positive mass and a positive "
            "definite pseudo-inertia of model and differences together"
        )


@dataclass(frozen=True)
class GravityMisalignment(TreeEffect):
    """g = Rx(roll) Ry(pitch) (0, 0, −9.81)."""

    place: ClassVar[Place] = Place.WORLD
    family: ClassVar[str] = "link"
    name: ClassVar[str] = "gravity_misalignment"
    strengths: ClassVar[tuple[Strength, ...]] = (
        Strength("roll", "rad", 0.03, lower=-np.pi, upper=np.pi),
        Strength("pitch", "rad", 0.03, lower=-np.pi / 2, upper=np.pi / 2),
    )
    reference: ClassVar[str] = "Khalil, Dombre, Modeling, Identification and Control of Robots, 2002, ch. 12"
    formula: ClassVar[str] = "<i>g</i> = R<sub>x</sub>(roll) R<sub>y</sub>(pitch) (0, 0, −9.81)"
    words: ClassVar[str] = "tilts gravity: the robot does not stand upright"
    alike: ClassVar[Mapping[str, str]] = {
        "payload": "both change the weight that the joints carry",
        "joint_spring": "near the horizontal, tilted gravity changes with position as a spring does",
        "actuator_bias": "over a small range of positions a tilt is a constant effort",
    }

    def change(self, tree: Tree, gravity: Array) -> tuple[Tree, Array]:
        roll, pitch = self.values["roll"], self.values["pitch"]
        magnitude = np.linalg.norm(gravity)
        tilted = np.array([-np.sin(pitch), np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch)], dtype=float)
        return tree, magnitude * tilted
