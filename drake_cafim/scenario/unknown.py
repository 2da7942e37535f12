"""Unknown nominal parameters: from the entries of `unknown:` to values in the physics, with their priors."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.dynamics.box_contact import EXTENTS, BoxContact
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.sphere_on_box import SphereOnBox
from drake_cafim.dynamics.tree import Body, Tree
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointCoulombFriction
from drake_cafim.effects.stated import bounds
from drake_cafim.errors import InputError
from drake_cafim.numerics.ranges import LARGEST, Range
from drake_cafim.parameters import Parameter, Parameters
from drake_cafim.scenario.inertials import INERTIALS, PHYSICAL, LinkInertials, check_body, priors_of, with_change
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.schema import Unknown
from drake_cafim.scenario.servos import SERVO_PARAMETERS, servo_parameters, with_servo_parameter
from drake_cafim.typing import Array

BODY_PARAMETERS = {"mass": "kg", "com_x": "m", "com_y": "m", "com_z": "m", "inertia": "1"}
JOINT_PARAMETERS = {"damping": "N m s/rad", "rotor_inertia": "kg m^2"}
DRY_FRICTION = "dry_friction"
"""The parameter of a joint that is the dry friction which the model's files state."""
STATED_PARAMETERS = {DRY_FRICTION: "N m"}
"""Parameters of those joints for which the model's files state them."""
SIZES = {"length": "m", "width": "m", "height": "m", "radius": "m"}
CONTACT_PARAMETERS = {
    "stiffness": "N/m",
    "damping": "N s/m",
    "dissipation": "s/m",
    "modulus": "Pa",
    "friction": "1",
}
_ABOVE_ZERO = (*SIZES, "mass", "inertia", "stiffness", "modulus", "servo_stiffness", "servo_limit")
_POSITIVE = (*_ABOVE_ZERO, "damping", "rotor_inertia", "dissipation", "friction", DRY_FRICTION, "servo_damping")


@dataclass(frozen=True)
class UnknownParameter:
    """One unknown parameter: its name, the body, joint, contact or effect that has it, and its prior."""

    parameter: str
    kind: str
    """body, joint, contact or effect; inertials: one of a link's ten log-Cholesky parameters."""
    at: str
    prior: Parameter
    effect: str | None = None
    """The effect's name, for a parameter of an effect that the scenario states; else None."""
    through: str = ""
    """The effect's parameter that this one is multiplied by in its law, as a place by the mass that is there."""
    typical: float = np.inf
    """The usual size of an effect's parameter, which a prior may be far wider than."""
    settled: bool = False
    """Whether its prior is what simulations of the recordings tell of it, so that no search sets it aside."""
    left_out: bool = False
    """Whether a search has none of it, so that no fit moves it from its prior mean."""

    @property
    def key(self) -> tuple[str, str, str | None]:
        """The parameter, its place and its effect, by which two unknowns differ."""
        return self.parameter, self.at, self.effect

    def of(self, effect: Effect) -> bool:
        """Whether it is a parameter of this effect."""
        return self.effect == effect.name and self.at == effect.at

    @property
    def is_stated_friction(self) -> bool:
        """Whether it is the dry friction of a joint that the model's files state."""
        return self.parameter == DRY_FRICTION

    def apply(self, physics: Physics, value: float) -> Physics:
        """The physics with this parameter at `value`.

        Unchanged for a parameter of an effect (see `with_unknowns`), for dry friction that the model's files state (see
        `with_stated_friction`), and for one of a link's inertials, which act together (see `apply_unknowns`).
        """
        if self.kind in ("effect", INERTIALS) or self.is_stated_friction:
            return physics
        if self.kind == "body" and self.parameter in SIZES:
            sized = (
                contact.with_parameter(self.parameter, value) if _sized(contact) == self.at else contact
                for contact in physics.contacts
            )
            return replace(physics, contacts=tuple(sized))
        if self.kind == "body":
            body = physics.tree.body(self.at)
            return replace(physics, tree=physics.tree.with_bodies([_with_value(body, self.parameter, value)]))
        if self.parameter in SERVO_PARAMETERS:
            return replace(physics, servos=with_servo_parameter(physics.servos, self.at, self.parameter, value))
        if self.kind == "joint":
            joint = physics.tree.joints[physics.tree.joint_index(self.at)]
            changed = replace(joint, **{self.parameter: value})  # type: ignore[arg-type]
            return replace(physics, tree=physics.tree.with_joints([changed]))
        contacts = tuple(
            contact.with_parameter(self.parameter, value) if contact.name == self.at else contact
            for contact in physics.contacts
        )
        return replace(physics, contacts=contacts)


def _with_value(body: Body, parameter: str, value: float) -> Body:
    """The body with one of `BODY_PARAMETERS` at `value`; "inertia" is a factor of the model's I_BBcm_B."""
    if parameter == "mass":
        # the inertia scales with the mass, as of a body of another density; the centre of mass stays
        scale = value / body.mass
        return replace(body, mass=value, I_BBcm_B=scale * body.I_BBcm_B)
    if parameter == "inertia":
        return replace(body, I_BBcm_B=value * body.I_BBcm_B)
    p_BBcm = body.p_BBcm.copy()
    p_BBcm["xyz".index(parameter[-1])] = value
    return replace(body, p_BBcm=p_BBcm)


def unknown_parameters(
    entries: Sequence[Unknown],
    physics: Physics,
    effects: Sequence[Effect],
    source: str,
    of_model: Sequence[Effect] = (),
) -> tuple[UnknownParameter, ...]:
    """The unknown parameters of the entries of `unknown:`, for the model and the `effects` that the scenario states.

    `of_model` are the effects that the model's files state.

    Raises `InputError` for a parameter or a place that they lack, with the valid choices, for a value out of range,
    and for an unknown that is given twice.
    """
    found: list[list[UnknownParameter]] = []
    for i, entry in enumerate(entries):
        key = f"{source}: unknown[{i}]"
        if entry.parameter == INERTIALS and entry.effect is None:
            own = _inertials(entry, physics, key)
        elif entry.effect is not None:
            own = [_of_effect(entry, physics, effects, key)]
        else:
            own = [_unknown(entry, physics, stated_friction(of_model), key)]
        for k, others in enumerate(found):
            if {other.key for other in others} & {unknown.key for unknown in own}:
                raise InputError(f"{key} is {entry.parameter} of {own[0].at} a second time, after unknown[{k}]")
            if _inertials_of(others, own) or _inertials_of(own, others):
                raise InputError(
                    f"{key} is {entry.parameter} of {own[0].at}, beside unknown[{k}], of which one is its inertials: "
                    "these hold mass, centre of mass and inertia together; expected one of the two"
                )
        found.append(own)
    return tuple(unknown for own in found for unknown in own)


def _inertials_of(own: Sequence[UnknownParameter], others: Sequence[UnknownParameter]) -> bool:
    """Whether `own` are the inertials of a body of which the `others` are a part."""
    return own[0].kind == INERTIALS and others[0].kind == "body" and own[0].at == others[0].at


def _inertials(entry: Unknown, physics: Physics, key: str) -> list[UnknownParameter]:
    """The ten unknowns of the inertials of a body."""
    if entry.body is None:
        raise InputError(f"{key} (inertials) needs body, expected a link of the model or all")
    if entry.mean is not None:
        raise InputError(f"{key} (inertials) has a mean, expected log_cholesky with ten numbers, or none: the model's")
    _check(entry.body, [*(body.name for body in physics.tree.bodies), "all"], f"{key}.body")
    check_body(physics.tree.body(entry.body), key)
    priors = priors_of(entry)
    return [UnknownParameter(name, INERTIALS, entry.body, prior) for name, prior in zip(PHYSICAL, priors, strict=True)]


def _unknown(entry: Unknown, physics: Physics, friction: Mapping[str, float], key: str) -> UnknownParameter:
    kind, at, valid, present = _place(entry, physics, key)
    if kind == "joint" and at in friction:
        valid = valid | STATED_PARAMETERS
        present = friction[at] if entry.parameter == DRY_FRICTION else present
    if entry.parameter not in valid:
        raise InputError(f"{key}.parameter is {entry.parameter!r}, which a {kind} lacks; valid: {', '.join(valid)}")
    if kind == "body" and entry.parameter in ("mass", "inertia"):
        body = physics.tree.body(at)
        if not body.mass > 0.0 or (entry.parameter == "inertia" and not np.any(body.I_BBcm_B)):
            raise InputError(f"{key}.body is {at}, which has no {entry.parameter} in the model that could be scaled")
    least = 0.0 if entry.parameter in _POSITIVE else -LARGEST
    allowed = Range(least, LARGEST, valid[entry.parameter], entry.parameter in _ABOVE_ZERO)
    mean = present if entry.mean is None else entry.mean
    allowed.check(mean, f"{key}.mean")
    prior = Parameter(
        name=f"{entry.parameter}@{at}",
        mean=mean,
        std=entry.std,
        lower=0.0 if entry.parameter in _POSITIVE else -np.inf,
        unit=valid[entry.parameter],
    )
    return UnknownParameter(entry.parameter, kind.split()[0], at, prior)


def _place(entry: Unknown, physics: Physics, key: str) -> tuple[str, str, dict[str, str], float]:
    """Kind and name of the body, joint or contact, its valid parameters with their units, and the model's value."""
    tree = physics.tree
    if entry.body is not None:
        _check(entry.body, [body.name for body in tree.bodies], f"{key}.body")
        return "body", entry.body, BODY_PARAMETERS | _sizes(physics, entry.body), _body_value(physics, entry)
    if entry.joint is not None:
        _check(entry.joint, tree.joint_names, f"{key}.joint")
        joint = tree.joints[tree.joint_index(entry.joint)]
        of_servo = servo_parameters(physics.servos, entry.joint)
        valid = JOINT_PARAMETERS | {name: SERVO_PARAMETERS[name] for name in of_servo}
        present = of_servo.get(entry.parameter, float(getattr(joint, entry.parameter, np.nan)))
        return "joint", entry.joint, valid, present
    for contact in physics.contacts:
        if set(contact.bodies) == set(entry.contact):
            values, law = contact.parameters, contact.law.normal
            present = float(getattr(values, entry.parameter, None) or 0.0)
            absent = {"damping" if law in ("hunt_crossley", "hydroelastic") else "dissipation"}
            absent.add("stiffness" if law == "hydroelastic" else "modulus")
            if values.slip_velocity is None and values.resistance is None:
                absent.add("friction")
            valid = {name: unit for name, unit in CONTACT_PARAMETERS.items() if name not in absent}
            return f"contact by the law {law}", contact.name, valid, present
    known = ", ".join(contact.name for contact in physics.contacts) or "none"
    raise InputError(f"{key}.contact is {'/'.join(entry.contact)}, which the scenario lacks; it has: {known}")


def _check(name: str, valid: Sequence[str], key: str) -> None:
    if name not in valid:
        raise InputError(f"{key} is {name!r}, which the model lacks; it has: {', '.join(valid)}")


def _of_effect(entry: Unknown, physics: Physics, effects: Sequence[Effect], key: str) -> UnknownParameter:
    """A parameter of an effect that the scenario states under `effects:`."""
    stated = [effect for effect in effects if effect.name == entry.effect and same_place(effect.at, entry.at or "")]
    if len(stated) != 1:
        known = ", ".join(f"{effect.name} at {effect.at}" for effect in effects) or "none"
        found = f"{len(stated)} times" if stated else "not"
        raise InputError(f"{key}: {entry.effect} at {entry.at} is {found} under effects:, expected one of: {known}")
    effect = stated[0]
    numbers = {strength.name: strength for strength in (*effect.strengths, *effect.shapes) if not strength.choices}
    if entry.parameter not in numbers:
        raise InputError(
            f"{key}.parameter is {entry.parameter!r}, which {effect.name} lacks; valid: {', '.join(numbers)}"
        )
    strength = numbers[entry.parameter]
    mean = effect.values.get(strength.name, strength.nominal) if entry.mean is None else entry.mean
    allowed = bounds(strength)
    allowed.check(mean, f"{key}.mean")
    name = f"{effect.name}.{strength.name}@{effect.at}"
    prior = Parameter(name, mean, entry.std, allowed.least, allowed.most, effect.unit(strength, physics.tree))
    return UnknownParameter(strength.name, "effect", effect.at, prior, effect.name, strength.through, strength.typical)


def same_place(first: str, second: str) -> bool:
    """Whether two names mean the same place; the bodies of a contact may be in either order."""
    return first == second or ("/" in first and set(first.split("/")) == set(second.split("/")))


def _body_value(physics: Physics, entry: Unknown) -> float:
    """The model's value of a body's parameter; NaN where the body has no such parameter."""
    body = physics.tree.body(entry.body or "")
    values = {"mass": body.mass, "inertia": 1.0}
    values |= {f"com_{axis}": float(x) for axis, x in zip("xyz", body.p_BBcm, strict=True)}
    for contact in physics.contacts:
        if _sized(contact) != entry.body:
            continue
        if isinstance(contact, BoxContact | SphereOnBox):
            values |= dict(zip(EXTENTS, contact.size.tolist(), strict=True))
        else:
            values["radius"] = contact.radius
    return values.get(entry.parameter, np.nan)


def _sizes(physics: Physics, body: str) -> dict[str, str]:
    """The size parameters of the body's contact shape with their units; empty where it has no contact."""
    shapes = [contact for contact in physics.contacts if _sized(contact) == body]
    boxes = (BoxContact, SphereOnBox)
    names = {name for shape in shapes for name in (EXTENTS if isinstance(shape, boxes) else ("radius",))}
    return {name: SIZES[name] for name in SIZES if name in names}


def _sized(contact: SphereContact) -> str:
    """The body whose size is a parameter of the contact: the fixed box that a sphere touches, else what moves."""
    return contact.bodies[1] if isinstance(contact, SphereOnBox) else contact.bodies[0]


def priors(unknown: Sequence[UnknownParameter]) -> Parameters:
    """The priors of the unknowns, in their order."""
    return Parameters.of(parameter.prior for parameter in unknown)


def apply_unknowns(unknown: Sequence[UnknownParameter], physics: Physics, vector: Array) -> Physics:
    """The physics with all unknowns of the nominal model at their values in `vector` (n,)."""
    for parameter, value in zip(unknown, vector.tolist(), strict=True):
        physics = parameter.apply(physics, value)
    links = inertials(unknown)
    if links:
        tree = physics.tree
        changed = [with_change(tree.body(link), vector[own]) for link, own in links.items()]
        physics = replace(physics, tree=tree.with_bodies(changed))
    return physics


def inertials(unknown: Sequence[UnknownParameter]) -> dict[str, slice]:
    """The links with unknown inertials, and where their ten log-Cholesky parameters are in a vector of the unknowns."""
    first = [i for i, parameter in enumerate(unknown) if parameter.kind == INERTIALS][:: len(PHYSICAL)]
    return {unknown[i].at: slice(i, i + len(PHYSICAL)) for i in first}


def vector_of(
    unknown: Sequence[UnknownParameter], bare: Physics, known: Mapping[tuple[str, str, str | None], float]
) -> Array:
    """The vector (n,) of the unknowns by the values that a report states, of links' inertials the physical ones.

    `bare` is the physics before any effect.
    """
    vector = np.array([known[parameter.key] for parameter in unknown], dtype=float)
    for link, own in inertials(unknown).items():
        vector[own] = LinkInertials(bare.tree.body(link)).theta(vector[own])
    return vector


def entries_at(entries: Sequence[Unknown], vector: Array) -> list[Unknown]:
    """The `entries` of `unknown:`, one for each link with unknown inertials, with their means at `vector` (n,)."""
    found, start = [], 0
    for entry in entries:
        if entry.parameter == INERTIALS and entry.effect is None:
            own = vector[start : start + len(PHYSICAL)]
            found.append(replace(entry, log_cholesky=own.tolist() if np.any(own) else []))
            start += len(PHYSICAL)
        else:
            found.append(replace(entry, mean=float(vector[start])))
            start += 1
    return found


def with_unknowns(unknown: Sequence[UnknownParameter], effects: Sequence[Effect], vector: Array) -> tuple[Effect, ...]:
    """The scenario's `effects` with their unknown parameters at their values in `vector` (n,)."""
    found = []
    for effect in effects:
        parameters = zip(unknown, vector.tolist(), strict=True)
        values = {parameter.parameter: value for parameter, value in parameters if parameter.of(effect)}
        found.append(effect.with_values({**effect.values, **values}) if values else effect)
    return tuple(found)


def stated_friction(of_model: Sequence[Effect]) -> dict[str, float]:
    """The dry friction, N m or N, by joint, of the effects that the model's files state; that of followers is added."""
    found: dict[str, float] = {}
    for effect in of_model:
        if effect.name == JointCoulombFriction.name and effect.values["torque"] > 0.0:
            found[effect.at] = found.get(effect.at, 0.0) + effect.values["torque"]
    return found


def entries_of_stated(
    tree: Tree,
    of_model: Sequence[Effect],
    known: Sequence[UnknownParameter],
    friction: bool,
    rotors: Collection[str],
) -> list[Unknown]:
    """The entries of `unknown:` by which what the model's files state is unknown, with stds as large.

    With `friction` all damping and dry friction, and the rotor inertias of the joints `rotors`. Without parameters that
    are unknown already.
    """
    damped = {joint.name: joint.damping for joint in tree.joints if friction and joint.damping > 0.0}
    dry = stated_friction(of_model) if friction else {}
    turning = {joint.name: joint.rotor_inertia for joint in tree.joints if joint.name in rotors}
    before = {(unknown.parameter, unknown.at) for unknown in known if unknown.kind == "joint"}
    return [
        Unknown(parameter, std=value, joint=at)
        for parameter, values in (
            ("damping", damped),
            (DRY_FRICTION, dry),
            ("rotor_inertia", turning),
        )
        for at, value in values.items()
        if (parameter, at) not in before
    ]


def with_stated_friction(
    unknown: Sequence[UnknownParameter], of_model: Sequence[Effect], vector: Array
) -> tuple[Effect, ...]:
    """The effects that the model's files state, dry friction that is unknown at its value in `vector` (n,).

    Of a joint with several, that of joints which follow it, each keeps its share.
    """
    total = stated_friction(of_model)
    both = zip(unknown, vector.tolist(), strict=True)
    scale = {parameter.at: value / total[parameter.at] for parameter, value in both if parameter.is_stated_friction}
    return tuple(
        effect.with_values({"torque": scale[effect.at] * effect.values["torque"]})
        if effect.name == JointCoulombFriction.name and effect.at in scale
        else effect
        for effect in of_model
    )
