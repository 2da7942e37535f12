"""Effects that are parameters of the plant: inertia, gravity, damping, brakes, locked joints."""

from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint

from drake_cafim.corrected.brakes import add_brake, brake_levels, brakes
from drake_cafim.corrected.inertia import actuators_of, add_inertia, joint_named, set_rotor_inertia
from drake_cafim.corrected.reading import array
from drake_cafim.dynamics.tree import Tree
from drake_cafim.errors import InputError
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


def hold_joints(plant: MultibodyPlant, locked: Mapping[str, float]) -> None:
    """Replaces the joints of `locked` by welds at these positions, rad or m; the plant must not be finalized."""
    for name, position in locked.items():
        joint = joint_named(plant, name)
        for actuator in actuators_of(plant, joint):
            plant.RemoveJointActuator(actuator)
        if isinstance(joint, RevoluteJoint):
            X_FM = RigidTransform(RotationMatrix(AngleAxis(position, joint.revolute_axis())), array(np.zeros(3)))
        else:
            X_FM = RigidTransform(array(position * array(joint.translation_axis())))
        parent, child = joint.frame_on_parent(), joint.frame_on_child()
        plant.RemoveJoint(joint)
        plant.WeldFrames(parent, child, X_FM)


def couple_followers(plant: MultibodyPlant, tree: Tree, source: str) -> None:
    """Couples the joints that follow others, by constraints of a plant that is not finalized, and places them.

    Raises `InputError` for a plant that cannot have such constraints.
    """
    for follower in tree.followers:
        joint, leader = (joint_named(plant, name) for name in (follower.joint.name, tree.joints[follower.leader].name))
        tamsi = plant.get_discrete_contact_approximation() == DiscreteContactApproximation.kTamsi
        if plant.time_step() == 0.0 or tamsi:
            raise InputError(
                f"{source}: joint {joint.name()} follows {leader.name()}, which only a discrete plant can simulate; "
                "expected a time_step above 0, and a contact approximation other than tamsi"
            )
        plant.AddCouplerConstraint(joint, leader, follower.multiplier, follower.offset)
        start = float(leader.default_positions()[0])
        joint.set_default_positions(array([follower.multiplier * start + follower.offset]))


def change_plant(plant: MultibodyPlant, nominal: Tree, physics: Physics) -> None:
    """Applies to a plant that is not finalized the differences between `physics` and `nominal`, its model's tree.

    Raises `InputError` where a brake is needed and the plant's contact approximation does not support it.
    """
    add_inertia(plant, nominal, physics.tree)
    plant.mutable_gravity_field().set_gravity_vector(physics.gravity)
    for effect, level in zip(physics.joint_forces, brake_levels(physics.joint_forces), strict=True):
        joint = joint_named(plant, effect.at)
        if effect.damping is not None:
            joint.set_default_damping(joint.default_damping() + effect.damping)
        elif plant.time_step() > 0.0 and brakes(effect):
            add_brake(plant, joint, level, f"{effect.name} at {effect.at}")
    hidden = {coupling.at for coupling in physics.couplings}  # these rotors are systems of their own, see `rotors`
    for before, after in zip(nominal.joints, physics.tree.joints, strict=True):
        joint = joint_named(plant, after.name)
        inertia = 0.0 if after.name in hidden else after.rotor_inertia
        if inertia != before.rotor_inertia or len(actuators_of(plant, joint)) > 1:
            set_rotor_inertia(plant, joint, inertia)


def free_state_selection(plant: MultibodyPlant, body: str) -> Array:
    """Selection matrix (13, nx) from the finalized plant's state to that of a floating body in `free_motion`."""
    free = plant.GetBodyByName(body)
    selection = np.zeros((13, plant.num_multibody_states()))
    first, then = free.floating_positions_start(), plant.num_positions() + free.floating_velocities_start_in_v()
    selection[np.arange(7), first + np.arange(7)] = 1.0
    selection[7 + np.arange(6), then + np.arange(6)] = 1.0
    return selection


def state_selection(plant: MultibodyPlant, joints: Sequence[str]) -> Array:
    """Selection matrix (2n, nx) from the finalized plant's state to the joints' positions, then velocities.

    Its lower right block, transposed, maps forces at the joints to the plant's generalized forces.
    """
    selection = np.zeros((2 * len(joints), plant.num_multibody_states()))
    for k, name in enumerate(joints):
        joint = plant.GetJointByName(name)
        selection[k, joint.position_start()] = 1.0
        selection[len(joints) + k, plant.num_positions() + joint.velocity_start()] = 1.0
    return selection
