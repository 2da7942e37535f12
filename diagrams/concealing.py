"""Adds effects to a world's plant but not to its controllers, for a diagnosis of its recordings to find."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import cast

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.controllers import InverseDynamicsController
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Adder, MatrixGain

from drake_cafim.corrected.world import AffectedRobot
from drake_cafim.diagrams.arm import add_model
from drake_cafim.diagrams.arrays import as_array
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.tree import Tree, tree_of
from drake_cafim.effects.body import ExternalDisturbance
from drake_cafim.effects.catalogue import EFFECTS, effect_named
from drake_cafim.effects.contact import ContactEffect
from drake_cafim.effects.effect import Effect, Place, Strength
from drake_cafim.effects.stated import allows, bounds
from drake_cafim.effects.surface import SurfaceEffect
from drake_cafim.errors import InputError
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.schema import EffectEntry
from drake_cafim.typing import Array

OF_CONTACTS = (ContactEffect, SurfaceEffect)


@dataclass(frozen=True)
class Concealed:
    """One effect of the vocabulary at a joint, body or channel of the robot, its parameters in SI units."""

    effect: str
    at: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    asked: str = "--conceal"
    """The option or file that asked for it, for messages."""
    contacts: tuple[SphereContact, ...] = ()
    """Contacts under `contact:` of the scenario, one of which an effect on contacts or surfaces changes."""

    @property
    def touches(self) -> bool:
        """Whether it is an effect on a contact or on a surface."""
        return any(kind.name == self.effect and issubclass(kind, OF_CONTACTS) for kind in EFFECTS)

    @property
    def address(self) -> str:
        """The effect, its place and what asked for it, for messages."""
        return f"{self.asked} {self.effect}@{self.at}"


def scenario_effects(entries: Sequence[EffectEntry], source: str) -> tuple[Concealed, ...]:
    """The effects that a scenario's `effects:` add to its world; `source` names the file in messages.

    Effects of a single recording, such as a push, are left out.
    """
    return tuple(
        Concealed(entry.effect, entry.at, {**entry.parameters, **_interval(entry)}, f"{source}: effects:")
        for entry in entries
        if entry.recording is None
    )


def _interval(entry: EffectEntry) -> dict[str, float]:
    return dict(zip(("start", "stop"), entry.interval, strict=False))


def conceal(plant: MultibodyPlant, robot: ModelInstanceIndex, effects: Sequence[Concealed]) -> AffectedRobot:
    """The robot with `effects`; those that are parameters of the plant are applied to it, before it is finalized.

    Raises `InputError` for an effect that a world cannot have, an unknown joint, body, contact or channel, and for
    missing, unknown or implausible parameters.
    """
    tree = _tree(plant.GetModelInstanceName(robot))
    gravity = np.array(plant.gravity_field().gravity_vector(), dtype=float)
    contacts = next((effect.contacts for effect in effects if effect.contacts), ())
    physics = Physics(tree, gravity, contacts).with_effects([_effect(effect, tree) for effect in effects])
    affected = AffectedRobot(tree, physics, contacts)
    affected.prepare(plant)
    return affected


def connect_concealed(
    builder: DiagramBuilder, plant: MultibodyPlant, affected: AffectedRobot
) -> list[tuple[int, OutputPort]]:
    """Connects the forces of the concealed effects to the plant; the builder must hold the robot's control already.

    Returns the wrenches (6,) that effects on contacts add, see `AffectedRobot.connect`.
    """
    control = cast(InverseDynamicsController, builder.GetSubsystemByName("joint_control"))
    return affected.connect(builder, plant, control.get_output_port_control())


def total_force(
    builder: DiagramBuilder, link: int, wrenches: Sequence[tuple[int, OutputPort]], axes: Array, force: OutputPort
) -> OutputPort:
    """`force` (ny,) N along `axes` (ny, 3) in W, plus the forces of those `wrenches` (6,) that act on the link."""
    own = [wrench for joint, wrench in wrenches if joint == link]
    if not own:
        return force
    total = builder.AddNamedSystem("force with what is concealed", Adder(1 + len(own), len(axes)))
    builder.Connect(force, total.get_input_port(0))
    for number, wrench in enumerate(own, start=1):
        gain = MatrixGain(as_array(np.pad(axes, ((0, 0), (3, 0)))))  # a wrench is the moment, then the force
        along = builder.AddNamedSystem(f"concealed force {number}", gain)
        builder.Connect(wrench, along.get_input_port())
        builder.Connect(along.get_output_port(), total.get_input_port(number))
    return total.get_output_port()


def _tree(model: str) -> Tree:
    """The tree of that model's robot alone, its base welded to the world."""
    plant = MultibodyPlant(0.0)
    robot = add_model(plant, model)
    base = plant.get_body(plant.GetBodyIndices(robot)[0])
    plant.WeldFrames(plant.world_frame(), base.body_frame())
    plant.Finalize()
    return tree_of(plant)


def _effect(concealed: Concealed, tree: Tree) -> Effect:
    names = [kind.name for kind in EFFECTS if kind.name != "sensor_misalignment"]
    if concealed.effect not in names:
        raise InputError(f"{concealed.address}: a world cannot have this effect, expected one of {', '.join(names)}")
    kind = effect_named(concealed.effect)
    _check_place(concealed, kind, tree)
    valid = [strength.name for strength in (*kind.strengths, *kind.shapes)]
    lacking = [s.name for s in kind.strengths if _needed(s, kind) and s.name not in concealed.parameters]
    if lacking or not set(concealed.parameters) <= set(valid):
        found = ", ".join(sorted(concealed.parameters)) or "no parameters"
        raise InputError(f"{concealed.address}: found {found}, expected {', '.join(valid)}")
    for strength in (*kind.strengths, *kind.shapes):
        value = concealed.parameters.get(strength.name)
        if value is not None and not allows(strength, value):
            raise InputError(f"{concealed.address}: {strength.name} is {value:g}, expected {bounds(strength)}")
    values = {s.name: s.nominal for s in kind.strengths} | dict(concealed.parameters)
    effect = kind(concealed.at, values)
    if not effect.plausible():
        limits = ", ".join(f"{s.lower:g} <= {s.name} <= {s.upper:g}" for s in kind.strengths)
        raise InputError(f"{concealed.address}: found {dict(concealed.parameters)}, expected {limits}")
    return effect


def _needed(strength: Strength, kind: type[Effect]) -> bool:
    """Whether this parameter must be given: of a payload the mass, while x, y and z default to 0."""
    timed = issubclass(kind, ExternalDisturbance) and not strength.amplitude
    return timed or strength.inverse or not strength.amplitude or strength == kind.strengths[0]


def _check_place(concealed: Concealed, kind: type[Effect], tree: Tree) -> None:
    if issubclass(kind, OF_CONTACTS):
        if not any(kind(concealed.at).meets(contact) for contact in concealed.contacts):
            if not concealed.contacts:
                raise InputError(f"{concealed.address}: found no contact under contact:, expected one")
            boxes = [contact.name for contact in concealed.contacts if not contact.flat]
            if kind.needs_plane and boxes:
                raise InputError(
                    f"{concealed.address}: it is of a plane, and {', '.join(boxes)} is a box touched all round"
                )
            sites = dict.fromkeys(kind.site(contact) for contact in concealed.contacts)
            raise InputError(f"{concealed.address}: the scenario's contacts (contact:) have it at {', '.join(sites)}")
        return
    bodies = [body.name for body in tree.bodies if body.joint >= 0]
    channels = [f"{letter}.{name}" for letter in "qv" for name in tree.joint_names]
    places: dict[Place, tuple[str, Sequence[str]]] = {
        Place.JOINT: ("joints", tree.joint_names),
        Place.ACTUATOR: ("joints", tree.joint_names),
        Place.BODY: ("bodies", bodies),
        Place.CHANNEL: ("channels", channels),
        Place.WORLD: ("surroundings", ["world"]),
    }
    what, valid = places[kind.place]
    if concealed.at not in valid:
        raise InputError(f"{concealed.address}: the robot's {what} are {', '.join(valid)}")
