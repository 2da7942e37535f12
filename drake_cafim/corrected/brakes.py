"""Dry friction that a discrete plant's contact solver treats implicitly, so that a joint at rest sticks.

Drake 1.51 has no dry friction of joints; its `DoorHinge` has a smoothed one, with which a joint under load creeps.
An explicit friction force in a discrete plant changes sign at every step near rest. A second actuator that holds
the joint at speed zero with an effort of at most T is a constraint of Drake's contact solver: it sticks below T and
slides above. A friction law is thus split into a brake of its level at rest and an explicit remainder.
"""

from collections.abc import Sequence
from itertools import chain, count

import numpy as np
from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant
from pydrake.multibody.tree import PdControllerGains
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from drake_cafim.dynamics.tree import OneAxisJoint
from drake_cafim.effects.joint import DRY_FRICTION, SLIP_VELOCITY, JointForce
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.errors import InputError
from drake_cafim.typing import Array

GAIN = 1e4
"""N m s/rad (N s/m): at rest under a torque τ a joint creeps at up to τ/GAIN. Ten times more is ill-conditioned."""


def brakes(effect: JointForce) -> bool:
    """Whether the effect is a dry friction law, which a brake represents; not one that builds up with displacements."""
    return effect.group == DRY_FRICTION and effect.slip is None


def rest_level(effect: JointForce) -> float:
    """The friction level (N m or N) at rest without an effort: half the law's jump at v = 0."""
    zero = np.zeros(1)
    return -_width(effect) * float(effect.force(JointSamples(zero, zero, zero)).d_v[0])


def brake_levels(effects: Sequence[JointForce]) -> list[float]:
    """The level, N m or N, of the brake of each of a robot's joint forces; 0 without one.

    What of a joint's friction builds up with displacements, by another law there, holds nothing at rest: as much less
    is the brake's. One that grows with the load keeps its own, which the law beyond the brake is made for.
    """
    built_up = {effect.at: effect.built_up for effect in effects if effect.built_up > 0.0}
    levels = []
    for effect in effects:
        level = rest_level(effect) if brakes(effect) else 0.0
        if level > 0.0 and not grows_with_load(effect):
            less = min(level, built_up.get(effect.at, 0.0))
            built_up[effect.at] = built_up.get(effect.at, 0.0) - less
            level -= less
        levels.append(level)
    return levels


def grows_with_load(effect: JointForce) -> bool:
    """Whether a dry friction's level depends on the effort."""
    moving, loaded = np.ones(1), np.ones(1)
    return brakes(effect) and bool(effect.force(JointSamples(moving, moving, loaded)).d_u[0] != 0.0)


def beyond_brake(effect: JointForce, joint: JointSamples, level: float) -> Array:
    """The remainder (N,) of the law's force beyond a brake of `level`, N m or N.

    An asymmetric friction is a brake of the mean level and a constant force, which acts at rest as well.
    """
    sign = joint.sign(_width(effect)).value
    return np.asarray(effect.force(joint).value + level * sign + _one_sided(effect) * (1.0 - np.abs(sign)))


def _one_sided(effect: JointForce) -> float:
    """Half the sum of the forces (N m or N) on either side of v = 0, without an effort: the law's asymmetry."""
    zero, v = np.zeros(2), np.array([-1.0, 1.0]) * 1e-3 * _width(effect)
    forces = effect.force(JointSamples(zero, v, zero)).value
    return float(0.5 * np.sum(forces) / np.tanh(1e-3))


def sliding_speed(effect: JointForce) -> float:
    """Speed, rad/s (m/s), above which the smoothed sign function tanh(v/w) is saturated: 10 w."""
    return 10.0 * _width(effect)


def _width(effect: JointForce) -> float:
    return float(effect.values.get("slip_velocity", SLIP_VELOCITY.nominal))


def add_brake(plant: MultibodyPlant, joint: OneAxisJoint, level: float, name: str) -> None:
    """Adds a brake of `level` N m (N) to the joint of a plant that is not finalized.

    Raises `InputError` for the TAMSI approximation, whose brakes slip.
    """
    if plant.get_discrete_contact_approximation() == DiscreteContactApproximation.kTamsi:
        raise InputError(
            f"{name}: TAMSI lets brakes slip, expected discrete_contact_approximation sap, similar, lagged"
        )
    if level > 0.0:
        # the model may state a dry friction where another one was found, and a joint may have several that follow it
        names = (f"{name}{number} brake" for number in chain([""], (f" ({k})" for k in count(2))))
        free = next(item for item in names if not plant.HasJointActuatorNamed(item))
        brake = plant.AddJointActuator(free, joint, level)
        brake.set_controller_gains(PdControllerGains(p=1e-9, d=GAIN))


def connect_brakes(builder: DiagramBuilder, plant: MultibodyPlant) -> None:
    """Connects a zero desired state to every model instance of the finalized plant that has a brake."""
    braked = {
        actuator.model_instance()
        for actuator in (plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices())
        if actuator.name().endswith(" brake")
    }
    for instance in sorted(braked, key=int):
        # Drake's port takes the desired state of all actuators of the instance
        rest: Array = np.zeros(2 * plant.num_actuators(instance))
        source = builder.AddNamedSystem(f"{plant.GetModelInstanceName(instance)} brakes", ConstantVectorSource(rest))
        builder.Connect(source.get_output_port(), plant.get_desired_state_input_port(instance))
