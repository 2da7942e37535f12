"""Physics put into a world's plant and into nothing else: what a diagnosis of its recordings has to find."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    JointActuator,
    ModelInstanceIndex,
    PdControllerGains,
    PrismaticJoint,
    RevoluteJoint,
    SpatialInertia,
    UnitInertia,
)

from drake_cafim.diagrams.arrays import as_array
from drake_cafim.errors import InputError


@dataclass(frozen=True)
class Concealed:
    """One effect of the vocabulary at a joint or body of the robot, its parameters in SI units."""

    effect: str
    at: str
    parameters: Mapping[str, float] = field(default_factory=dict)


def conceal(plant: MultibodyPlant, robot: ModelInstanceIndex, effects: Sequence[Concealed]) -> None:
    """Puts `effects` into `plant` before it is finalized.

    Raises `InputError` for an effect that worlds cannot conceal, a joint or body that the robot lacks, and for
    parameters that are not the effect's own.
    """
    for one in effects:
        if one.effect not in _WAYS:
            raise InputError(
                f"--conceal {one.effect}@{one.at}: a world cannot have this effect, expected one of {', '.join(_WAYS)}"
            )
        needed, optional, put = _WAYS[one.effect]
        given = set(one.parameters)
        if not set(needed) <= given <= {*needed, *optional}:
            found = ", ".join(sorted(given)) or "no parameters"
            raise InputError(
                f"--conceal {one.effect}@{one.at}: found {found}, expected {', '.join((*needed, *optional))}"
            )
        wrong = [name for name in needed if not one.parameters[name] > 0]
        if wrong:
            raise InputError(
                f"--conceal {one.effect}@{one.at}: {wrong[0]} is {one.parameters[wrong[0]]}, expected a positive number"
            )
        put(plant, robot, one)


_BRAKE = "_brake"


def _joint(plant: MultibodyPlant, robot: ModelInstanceIndex, one: Concealed) -> RevoluteJoint | PrismaticJoint:
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    own = {
        joint.name(): joint
        for joint in joints
        if joint.model_instance() == robot and isinstance(joint, RevoluteJoint | PrismaticJoint)
    }
    if one.at not in own:
        raise InputError(f"--conceal {one.effect}@{one.at}: the robot's joints are {', '.join(own)}")
    return own[one.at]


def _actuator(plant: MultibodyPlant, robot: ModelInstanceIndex, one: Concealed) -> JointActuator:
    joint = _joint(plant, robot, one)
    actuators = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
    return next(actuator for actuator in actuators if actuator.joint().index() == joint.index())


def _put_viscous_friction(plant: MultibodyPlant, robot: ModelInstanceIndex, one: Concealed) -> None:
    joint = _joint(plant, robot, one)
    joint.set_default_damping(joint.default_damping() + one.parameters["coefficient"])


def _put_coulomb_friction(plant: MultibodyPlant, robot: ModelInstanceIndex, one: Concealed) -> None:
    """A second actuator that holds the joint at speed zero with at most `torque`: the solver takes it implicitly."""
    joint = _joint(plant, robot, one)
    brake = plant.AddJointActuator(f"{one.at}{_BRAKE}", joint, one.parameters["torque"])
    brake.set_controller_gains(PdControllerGains(p=1e-9, d=1e4))


def _put_rotor_inertia(plant: MultibodyPlant, robot: ModelInstanceIndex, one: Concealed) -> None:
    actuator = _actuator(plant, robot, one)
    more = one.parameters["inertia"] / actuator.default_gear_ratio() ** 2
    actuator.set_default_rotor_inertia(actuator.default_rotor_inertia() + more)


def _put_payload(plant: MultibodyPlant, robot: ModelInstanceIndex, one: Concealed) -> None:
    if not plant.HasBodyNamed(one.at, robot):
        names = ", ".join(plant.get_body(index).name() for index in plant.GetBodyIndices(robot))
        raise InputError(f"--conceal {one.effect}@{one.at}: the robot's bodies are {names}")
    # Drake wants a rotational inertia of any body: that of a ball of a millimetre
    inertia = SpatialInertia(one.parameters["mass"], as_array(np.zeros(3)), UnitInertia.SolidSphere(1e-3))
    load = plant.AddRigidBody(f"load_on_{one.at}", plant.AddModelInstance(f"load_on_{one.at}"), inertia)
    place = RigidTransform(as_array([one.parameters.get(axis, 0.0) for axis in "xyz"]))
    plant.WeldFrames(plant.GetBodyByName(one.at, robot).body_frame(), load.body_frame(), place)


_Put = Callable[[MultibodyPlant, ModelInstanceIndex, Concealed], None]
_WAYS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...], _Put]] = {  # needed and optional parameters
    "joint_viscous_friction": (("coefficient",), (), _put_viscous_friction),
    "joint_coulomb_friction": (("torque",), (), _put_coulomb_friction),
    "rotor_inertia": (("inertia",), (), _put_rotor_inertia),
    "payload": (("mass",), ("x", "y", "z"), _put_payload),
}
