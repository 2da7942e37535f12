"""The vocabulary of the diagnosis: all effect classes, and look-up by name."""

from collections.abc import Sequence

from drake_cafim.effects.actuator import (
    ActuatorBias,
    ActuatorDeadZone,
    ActuatorDelay,
    ActuatorGainError,
    ActuatorLag,
    ActuatorSaturation,
)
from drake_cafim.effects.body import AerodynamicDrag, ExternalDisturbance
from drake_cafim.effects.command_profile import CommandAccelerationLimit
from drake_cafim.effects.contact_friction import (
    ContactAnisotropicFriction,
    ContactPresliding,
    ContactRollingResistance,
    ContactStribeckFriction,
)
from drake_cafim.effects.contact_law import ContactLawChange
from drake_cafim.effects.coupling import JointBacklash, JointElasticity
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.friction import JointLoadDependentFriction, JointStribeckFriction
from drake_cafim.effects.joint import (
    JointAsymmetricCoulombFriction,
    JointCoulombFriction,
    JointSpring,
    JointViscousFriction,
)
from drake_cafim.effects.kinds import check_kinds
from drake_cafim.effects.link import GravityMisalignment, InertialError, Payload, RotorInertia
from drake_cafim.effects.normal_contact import (
    ContactAdhesion,
    ContactHuntCrossleyDissipation,
    ContactNonlinearStiffness,
    ContactViscoelasticRelaxation,
)
from drake_cafim.effects.plane import UnmodeledContact
from drake_cafim.effects.sensor import SensorBias, SensorDrift, SensorGainError, SensorMisalignment
from drake_cafim.effects.servo_effect import (
    CommandDelay,
    CommandLag,
    CommandRateLimit,
    ServoDeadBand,
    ServoGainError,
    SupplySag,
)
from drake_cafim.effects.speed_limit import ActuatorSpeedLimit
from drake_cafim.effects.surface import SurfaceOffset, SurfaceTilt
from drake_cafim.effects.timing import ClockSkew, SensorDelay, SensorLag
from drake_cafim.effects.transmission import JointHardStop, TorqueRipple
from drake_cafim.errors import InputError, check_type

EFFECTS: tuple[type[Effect], ...] = (
    JointViscousFriction,
    JointCoulombFriction,
    JointAsymmetricCoulombFriction,
    JointStribeckFriction,
    JointLoadDependentFriction,
    JointSpring,
    JointHardStop,
    TorqueRipple,
    JointElasticity,
    JointBacklash,
    RotorInertia,
    ActuatorGainError,
    ActuatorBias,
    ActuatorDelay,
    ActuatorLag,
    ActuatorSaturation,
    ActuatorDeadZone,
    ActuatorSpeedLimit,
    ServoGainError,
    ServoDeadBand,
    SupplySag,
    CommandDelay,
    CommandLag,
    CommandRateLimit,
    CommandAccelerationLimit,
    Payload,
    InertialError,
    GravityMisalignment,
    AerodynamicDrag,
    ExternalDisturbance,
    UnmodeledContact,
    ContactStribeckFriction,
    ContactAdhesion,
    ContactNonlinearStiffness,
    ContactViscoelasticRelaxation,
    ContactHuntCrossleyDissipation,
    ContactRollingResistance,
    ContactAnisotropicFriction,
    ContactPresliding,
    ContactLawChange,
    SurfaceOffset,
    SurfaceTilt,
    SensorBias,
    SensorGainError,
    SensorDrift,
    SensorDelay,
    SensorLag,
    SensorMisalignment,
    ClockSkew,
)


def effect_named(name: str, vocabulary: Sequence[type[Effect]] = EFFECTS) -> type[Effect]:
    """The effect class of that name in `vocabulary`; the `InputError` for an unknown name lists the valid names."""
    for effect in vocabulary:
        if effect.name == name:
            return effect
    raise InputError(f"there is no effect named {name!r}; valid: {', '.join(e.name for e in vocabulary)}")


def vocabulary_with(
    effects: Sequence[type[Effect]], vocabulary: tuple[type[Effect], ...] = EFFECTS
) -> tuple[type[Effect], ...]:
    """`vocabulary` with the `effects` that it lacks appended.

    Raises `InputError` where two classes share a name, or a class is of no known kind.
    """
    check_type("effects", effects, Sequence, "a list of effect classes")
    new = [effect for effect in effects if effect not in vocabulary]
    check_kinds(new)
    taken = {effect.name for effect in vocabulary}
    for effect in new:
        if effect.name in taken:
            raise InputError(f"effect class {effect.__name__}: the name {effect.name!r} is taken, expected another")
        taken.add(effect.name)
    return (*vocabulary, *new)
