"""What differs between a scene and its model file, as numbers that a model file can hold, and what cannot be held."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from drake_cafim.dynamics.tree import Body, Tree
from drake_cafim.effects.effect import Effect, Place
from drake_cafim.effects.joint import SLIP
from drake_cafim.effects.kinds import ByKind
from drake_cafim.effects.link import TreeEffect
from drake_cafim.scenario.unknown import apply_unknowns, with_stated_friction
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

Form = Literal["urdf", "sdf", "mjcf"]
HELD: Mapping[str, tuple[Form, ...]] = {
    "payload": ("urdf", "sdf", "mjcf"),
    "inertial_error": ("urdf", "sdf", "mjcf"),
    "rotor_inertia": ("urdf", "sdf", "mjcf"),
    "joint_viscous_friction": ("urdf", "sdf", "mjcf"),
    "joint_coulomb_friction": ("urdf", "sdf", "mjcf"),
    "joint_spring": ("sdf", "mjcf"),
    "actuator_saturation": ("urdf", "sdf", "mjcf"),
    "actuator_gain_error": ("mjcf",),
    "gravity_misalignment": ("mjcf",),
}
"""The effects that each format can hold."""
READ_BACK = (
    "payload",
    "inertial_error",
    "rotor_inertia",
    "joint_viscous_friction",
    "joint_coulomb_friction",
    "joint_spring",
)
"""Those that a scene reads from the file again; the others stay in the exported scenario: recorded efforts are those
before a motor's gain, and gravity is the scenario's."""
WHY = {
    Place.CHANNEL: "a model file says nothing of a sensor's errors",
    Place.CONTACT: "a model file has no such law of contact",
    Place.WORLD: "gravity is the world's, and not in this file",
    Place.ACTUATOR: "the format's actuators have no such law",
    Place.JOINT: "the format has no such law of a joint",
    Place.BODY: "the format has no such force",
}


@dataclass(frozen=True)
class JointValues:
    """What a file says of a joint, SI; None: as it is. `gain` is a factor of the efforts of its motor."""

    damping: float | None = None
    friction: float | None = None
    spring: tuple[float, float] | None = None
    rotor_inertia: float | None = None
    effort_limit: float | None = None
    gain: float | None = None
    prismatic: bool = False


@dataclass(frozen=True)
class Values:
    """The numbers to be written into the file, by names of bodies and joints; `gravity` (3,) None: as it is.

    `held` are the effects in them; `lost` is a sentence for each value that the format cannot hold.
    """

    bodies: Mapping[str, Body] = field(default_factory=dict)
    joints: Mapping[str, JointValues] = field(default_factory=dict)
    gravity: Array | None = None
    held: tuple[Effect, ...] = ()
    lost: tuple[str, ...] = ()


def values_of(scene: Scene, form: Form) -> Values:
    """The values of the scene, its unknowns at their means and its effects, that differ from its model's file."""
    held = tuple(effect for effect in scene.known if form in HELD.get(effect.name, ()))
    lost = [f"{effect.sentence(scene.tree)}: {_why(effect)}" for effect in scene.known if effect not in held]
    lost += [
        f"{unknown.parameter} of {unknown.at}, {unknown.prior.mean:.6g} {unknown.prior.unit}: {why}"
        for unknown in scene.unknown
        if (why := _why_not(unknown.kind, unknown.parameter))
    ]
    lost += [
        f"{effect.sentence(scene.tree)}: in the file it jumps, since no format's friction builds up over a displacement"
        for effect in held
        if effect.values.get(SLIP.name)
    ]
    tilted = any(effect.name == "gravity_misalignment" for effect in held)
    return Values(
        _bodies(scene, held), _joints(scene, held), scene.physics.gravity if tilted else None, held, tuple(lost)
    )


def _why(effect: Effect) -> str:
    return "it acts once, in a recording" if effect.brief else WHY[effect.place]


def _why_not(kind: str, parameter: str) -> str:
    if kind == "contact":
        return "the contact is the scenario's, and not in the model file"
    return "the size of the shape is left as it is" if parameter in ("length", "width", "height", "radius") else ""


class _ChangeOfTree(ByKind[TreeEffect | None]):
    """The effect if it is one that changes the bodies, else None."""

    def other(self, effect: Effect) -> None:
        return None

    def tree(self, effect: TreeEffect) -> TreeEffect:
        return effect


_CHANGE_OF_TREE = _ChangeOfTree()


def _bodies(scene: Scene, held: tuple[Effect, ...]) -> dict[str, Body]:
    """The bodies that differ, with what rides on them as part of them."""
    before = {body.name: body for body in scene.tree.bodies}
    after = _at_unknowns(scene)
    bodies = {body.name: body for body in after.bodies}
    for effect in held:
        change = _CHANGE_OF_TREE(effect)
        if change is not None and effect.place is Place.BODY:
            changed, _ = change.change(replace(after, bodies=tuple(bodies.values())), scene.physics.gravity)
            extra = [body for body in changed.bodies if body.name not in bodies]
            bodies = {body.name: body for body in changed.bodies if body.name in bodies}
            for item in extra:
                bodies[effect.at] = _joined(bodies[effect.at], item)
    return {name: body for name, body in bodies.items() if not _same(body, before[name])}


def _at_unknowns(scene: Scene) -> Tree:
    """The tree with the unknowns at their means, before any effect."""
    return apply_unknowns(scene.unknown, scene.bare or scene.physics, scene.priors.mean).tree


def _same(first: Body, second: Body) -> bool:
    return (
        first.mass == second.mass
        and bool(np.array_equal(first.p_BBcm, second.p_BBcm))
        and bool(np.array_equal(first.I_BBcm_B, second.I_BBcm_B))
    )


def _joined(body: Body, rider: Body) -> Body:
    """One rigid body of both, which have one frame (the parallel axis theorem)."""
    mass = body.mass + rider.mass
    if mass == 0.0:
        return body
    center = (body.mass * body.p_BBcm + rider.mass * rider.p_BBcm) / mass
    inertia = np.zeros((3, 3))
    for part in (body, rider):
        apart = part.p_BBcm - center
        inertia = inertia + part.I_BBcm_B + part.mass * (apart @ apart * np.eye(3) - np.outer(apart, apart))
    return replace(body, mass=mass, p_BBcm=center, I_BBcm_B=inertia)


def _joints(scene: Scene, held: tuple[Effect, ...]) -> dict[str, JointValues]:
    """The values that differ from the file's, of the joints that have some.

    The dry friction of such a joint is among them in any case: a file may say of it how soon it holds.
    """
    before = {joint.name: joint for joint in scene.tree.joints}
    of_model = with_stated_friction(scene.unknown, scene.of_model, scene.priors.mean)
    estimated = {unknown.at for unknown in scene.unknown if unknown.is_stated_friction}
    found = {}
    for joint in _at_unknowns(scene).joints:
        own = [effect for effect in held if effect.at == joint.name]
        file = [effect for effect in of_model if effect.at == joint.name]

        def total(name: str, parameter: str, among: list[Effect]) -> float:
            return sum(effect.values[parameter] for effect in among if effect.name == name)

        damping = joint.damping + total("joint_viscous_friction", "coefficient", own)
        rotor = joint.rotor_inertia + total("rotor_inertia", "inertia", own)
        limits = [effect.values["limit"] for effect in own if effect.name == "actuator_saturation"]
        gains = [effect.values["gain"] for effect in own if effect.name == "actuator_gain_error"]
        rubs = joint.name in estimated or any(effect.name == "joint_coulomb_friction" for effect in own)
        springs = [effect for effect in own if effect.name == "joint_spring"]
        friction = total("joint_coulomb_friction", "torque", [*file, *own])
        values = JointValues(
            damping=damping if damping != before[joint.name].damping else None,
            friction=friction if rubs else None,
            spring=_spring([item for item in (*file, *own) if item.name == "joint_spring"]) if springs else None,
            rotor_inertia=rotor if rotor != before[joint.name].rotor_inertia else None,
            effort_limit=min(limits) if limits else None,
            gain=float(np.prod(gains)) if gains else None,
            prismatic=joint.prismatic,
        )
        if values != JointValues(prismatic=joint.prismatic):
            found[joint.name] = replace(values, friction=friction) if friction else values
    return found


def _spring(springs: list[Effect]) -> tuple[float, float]:
    """Stiffness and rest position of springs side by side."""
    stiffness = sum(spring.values["stiffness"] for spring in springs)
    pull = sum(spring.values["stiffness"] * spring.values["rest"] for spring in springs)
    return stiffness, pull / stiffness if stiffness else 0.0
