"""Changes of inertia, joint damping and rotor inertia, applied to a plant before it is finalized."""

from dataclasses import dataclass
from typing import cast

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JointActuator, SpatialInertia, UnitInertia

from drake_cafim.corrected.reading import array
from drake_cafim.dynamics.tree import FREE, OneAxisJoint, Tree
from drake_cafim.typing import Array

LEAST_MASS = 1e-9
"""kg; the mass of the added body where only the first and second moments change, since Drake divides by the mass."""


@dataclass(frozen=True)
class Lump:
    """Mass kg, first moment (3,) kg m and second moment (3, 3) kg m² about a joint's moving frame J."""

    mass: float
    moment: Array
    inertia: Array

    def minus(self, other: "Lump") -> "Lump":
        return Lump(self.mass - other.mass, self.moment - other.moment, self.inertia - other.inertia)

    @property
    def nothing(self) -> bool:
        """Whether all ten inertial parameters are zero."""
        return not (self.mass or np.any(self.moment) or np.any(self.inertia))


def lump(tree: Tree, joint: int) -> Lump:
    """The inertia of all bodies fixed to the joint's moving frame, without those beyond further joints."""
    masses, centers, inertias = tree.lumps
    m, c = float(masses[joint]), centers[joint]
    return Lump(m, m * c, inertias[joint] + m * (c @ c * np.eye(3) - np.outer(c, c)))


def add_inertia(plant: MultibodyPlant, nominal: Tree, changed: Tree) -> None:
    """Adds the differences between `changed` and `nominal`, the plant's model: bodies' inertia and joints' damping.

    A parsed body's default inertia cannot be changed in Drake, so the difference, which may be negative, is welded to
    each joint's child frame as an additional body named `change on <joint>`, or to the floating body (`<body>`).
    """
    for k, (before, after) in enumerate(zip(nominal.moving, changed.moving, strict=True)):
        joint = joint_named(plant, after.name)
        _add_lump(plant, joint.name(), joint.frame_on_child(), lump(changed, k).minus(lump(nominal, k)))
        if after.damping != before.damping:
            joint.set_default_damping(after.damping)
    if nominal.floating:
        body = plant.GetBodyByName(nominal.free_body.name)
        _add_lump(plant, body.name(), body.body_frame(), lump(changed, FREE).minus(lump(nominal, FREE)))


def _add_lump(plant: MultibodyPlant, name: str, frame: Frame, change: Lump) -> None:
    if change.nothing:
        return
    mass = change.mass if abs(change.mass) > LEAST_MASS else LEAST_MASS
    G = change.inertia / mass
    unit = UnitInertia(Ixx=G[0, 0], Iyy=G[1, 1], Izz=G[2, 2], Ixy=G[0, 1], Ixz=G[0, 2], Iyz=G[1, 2])
    # the difference alone need not be physically valid; only its sum with the link's inertia is
    inertia = SpatialInertia(mass, array(change.moment / mass), unit, skip_validity_check=True)
    body = plant.AddRigidBody(f"change on {name}", frame.model_instance(), inertia)
    plant.WeldFrames(frame, body.body_frame())


def set_rotor_inertia(plant: MultibodyPlant, joint: OneAxisJoint, inertia: float) -> None:
    """Sets the reflected rotor inertia of a joint to `inertia` kg m² (kg), whatever actuators it has."""
    # a passive joint may have a rotor too; Drake needs an actuator to hold its inertia
    *others, last = actuators_of(plant, joint) or [plant.AddJointActuator(f"{joint.name()} rotor", joint)]
    # with several actuators on a joint, Drake 1.51 uses the last one's rotor inertia only
    for actuator in others:
        actuator.set_default_rotor_inertia(0.0)
    last.set_default_rotor_inertia(inertia / last.default_gear_ratio() ** 2)


def joint_named(plant: MultibodyPlant, name: str) -> OneAxisJoint:
    """The joint of that name; a scene has checked that it has one axis."""
    return cast(OneAxisJoint, plant.GetJointByName(name))


def actuators_of(plant: MultibodyPlant, joint: OneAxisJoint) -> list[JointActuator]:
    """All actuators of the joint."""
    found = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
    return [actuator for actuator in found if actuator.joint().index() == joint.index()]
