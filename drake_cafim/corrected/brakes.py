"""Dry friction that a discrete plant's solver takes implicitly, so that a joint at rest stays there.

Drake 1.51 has no dry friction of joints; its `DoorHinge` has a smoothed one, with which a joint under load creeps.
An explicit friction force of a discrete plant turns its sign at every step about rest. A second actuator that holds
the joint at speed zero with at most T is in Drake a constraint of the contact solver: it sticks below T and slides
above. A friction law is then a brake of the level that it has at rest, and what the law says beyond it.
"""

import numpy as np
from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant
from pydrake.multibody.tree import PdControllerGains
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from drake_cafim.dynamics.tree import OneAxisJoint
from drake_cafim.effects.effect import JointSamples
from drake_cafim.effects.joint import DRY_FRICTION, SLIP_VELOCITY, JointForce
from drake_cafim.errors import InputError
from drake_cafim.typing import Array

GAIN = 1e4
"""N m s/rad: at rest under the torque τ a joint creeps with τ/GAIN at most. Ten times more is no longer solved well."""


def brakes(effect: JointForce) -> bool:
    """Whether the law is a dry friction's."""
    return effect.group == DRY_FRICTION


def rest_level(effect: JointForce) -> float:
    """The friction (N m or N) that the law comes to about rest without an effort: half its jump where v = 0."""
    zero = np.zeros(1)
    return -_width(effect) * float(effect.force(JointSamples(zero, zero, zero)).d_v[0])


def beyond_brake(effect: JointForce, joint: JointSamples, level: float) -> Array:
    """What the law (N,) says beyond a brake of `level`.

    A friction that is stronger one way than the other is a brake of the mean and a constant force, at rest as well.
    """
    sign = joint.sign(_width(effect)).value
    return np.asarray(effect.force(joint).value + level * sign + _one_sided(effect) * (1.0 - np.abs(sign)))


def _one_sided(effect: JointForce) -> float:
    """Half the sum of the forces (N m or N) just before and just after v = 0, without an effort."""
    zero, v = np.zeros(2), np.array([-1.0, 1.0]) * 1e-3 * _width(effect)
    forces = effect.force(JointSamples(zero, v, zero)).value
    return float(0.5 * np.sum(forces) / np.tanh(1e-3))


def sliding_speed(effect: JointForce) -> float:
    """rad/s (m/s) from which on the smoothed sign change is over."""
    return 10.0 * _width(effect)


def _width(effect: JointForce) -> float:
    return float(effect.values.get("slip_velocity", SLIP_VELOCITY.nominal))


def add_brake(plant: MultibodyPlant, joint: OneAxisJoint, level: float, name: str) -> None:
    """A brake of `level` N m (N) on the joint of a plant that is not finalized."""
    if plant.get_discrete_contact_approximation() == DiscreteContactApproximation.kTamsi:
        raise InputError(
            f"{name}: TAMSI lets brakes slip, expected discrete_contact_approximation sap, similar, lagged"
        )
    if level > 0.0:
        brake = plant.AddJointActuator(f"{name} brake", joint, level)
        brake.set_controller_gains(PdControllerGains(p=1e-9, d=GAIN))


def connect_brakes(builder: DiagramBuilder, plant: MultibodyPlant) -> None:
    """Tells every brake of the finalized plant to hold speed zero; an instance with none is left alone."""
    braked = {
        actuator.model_instance()
        for actuator in (plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices())
        if actuator.name().endswith(" brake")
    }
    for instance in sorted(braked, key=int):
        # Drake asks for the desired state of all actuators of the instance
        rest: Array = np.zeros(2 * plant.num_actuators(instance))
        source = builder.AddNamedSystem(f"{plant.GetModelInstanceName(instance)} brakes", ConstantVectorSource(rest))
        builder.Connect(source.get_output_port(), plant.get_desired_state_input_port(instance))
