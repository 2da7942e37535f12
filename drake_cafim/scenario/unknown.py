"""Unknown nominal parameters: from the entries of `unknown:` to values in the physics, with their priors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.dynamics.box_contact import EXTENTS, BoxContact
from drake_cafim.dynamics.tree import Body
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.stated import bounds
from drake_cafim.errors import InputError
from drake_cafim.numerics.ranges import LARGEST, Range
from drake_cafim.parameters import Parameter, Parameters
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.schema import Unknown
from drake_cafim.typing import Array

BODY_PARAMETERS = {"mass": "kg", "com_x": "m", "com_y": "m", "com_z": "m", "inertia": "1"}
JOINT_PARAMETERS = {"damping": "N m s/rad", "rotor_inertia": "kg m^2"}
SIZES = {"length": "m", "width": "m", "height": "m", "radius": "m"}
CONTACT_PARAMETERS = {
    "stiffness": "N/m",
    "damping": "N s/m",
    "dissipation": "s/m",
    "modulus": "Pa",
    "friction": "1",
}
_ABOVE_ZERO = (*SIZES, "mass", "inertia", "stiffness", "modulus")
_POSITIVE = (*_ABOVE_ZERO, "damping", "rotor_inertia", "dissipation", "friction")


@dataclass(frozen=True)
class UnknownParameter:
    """One unknown parameter: its name, the body, joint, contact or effect that has it, and its prior."""

    parameter: str
    kind: str
    """body, joint, contact or effect."""
    at: str
    prior: Parameter
    effect: str | None = None
    """The effect's name, for a parameter of an effect that the scenario states; else None."""
    through: str = ""
    """The effect's parameter that this one is multiplied by in its law, as a place by the mass that is there."""
    typical: float = np.inf
    """The usual size of an effect's parameter, which a prior may be far wider than."""

    @property
    def key(self) -> tuple[str, str, str | None]:
        """The parameter, its place and its effect, by which two unknowns differ."""
        return self.parameter, self.at, self.effect

    def of(self, effect: Effect) -> bool:
        """Whether it is a parameter of this effect."""
        return self.effect == effect.name and self.at == effect.at

    def apply(self, physics: Physics, value: float) -> Physics:
        """The physics with this parameter at `value`; unchanged for a parameter of an effect (see `with_unknowns`)."""
        if self.kind == "effect":
            return physics
        if self.kind == "body" and self.parameter in SIZES:
            sized = (
                contact.with_parameter(self.parameter, value) if contact.bodies[0] == self.at else contact
                for contact in physics.contacts
            )
            return replace(physics, contacts=tuple(sized))
        if self.kind == "body":
            body = physics.tree.body(self.at)
            return replace(physics, tree=physics.tree.with_bodies([_with_value(body, self.parameter, value)]))
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
    entries: Sequence[Unknown], physics: Physics, effects: Sequence[Effect], source: str
) -> tuple[UnknownParameter, ...]:
    """The unknown parameters of the entries of `unknown:`, for the model and the `effects` that the scenario states.

    Raises `InputError` for a parameter or a place that they lack, with the valid choices, for a value out of range,
    and for an unknown that is given twice.
    """
    found: list[UnknownParameter] = []
    for i, entry in enumerate(entries):
        key = f"{source}: unknown[{i}]"
        unknown = (
            _of_effect(entry, physics, effects, key) if entry.effect is not None else _unknown(entry, physics, key)
        )
        twice = [k for k, other in enumerate(found) if other.key == unknown.key]
        if twice:
            raise InputError(f"{key} is {unknown.parameter} of {unknown.at} a second time, after unknown[{twice[0]}]")
        found.append(unknown)
    return tuple(found)


def _unknown(entry: Unknown, physics: Physics, key: str) -> UnknownParameter:
    kind, at, valid, present = _place(entry, physics, key)
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
    return UnknownParameter(entry.parameter, kind, at, prior)


def _place(entry: Unknown, physics: Physics, key: str) -> tuple[str, str, dict[str, str], float]:
    """Kind and name of the body, joint or contact, its valid parameters with their units, and the model's value."""
    tree = physics.tree
    if entry.body is not None:
        _check(entry.body, [body.name for body in tree.bodies], f"{key}.body")
        return "body", entry.body, BODY_PARAMETERS | _sizes(physics, entry.body), _body_value(physics, entry)
    if entry.joint is not None:
        _check(entry.joint, tree.joint_names, f"{key}.joint")
        joint = tree.joints[tree.joint_index(entry.joint)]
        return "joint", entry.joint, JOINT_PARAMETERS, float(getattr(joint, entry.parameter, np.nan))
    for contact in physics.contacts:
        if set(contact.bodies) == set(entry.contact):
            present = float(getattr(contact.parameters, entry.parameter, None) or 0.0)
            return "contact", contact.name, CONTACT_PARAMETERS, present
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
        if contact.bodies[0] == entry.body and isinstance(contact, BoxContact):
            values |= dict(zip(EXTENTS, contact.size.tolist(), strict=True))
        elif contact.bodies[0] == entry.body:
            values["radius"] = contact.radius
    return values.get(entry.parameter, np.nan)


def _sizes(physics: Physics, body: str) -> dict[str, str]:
    """The size parameters of the body's contact shape with their units; empty where it has no contact."""
    shapes = [contact for contact in physics.contacts if contact.bodies[0] == body]
    names = {name for shape in shapes for name in (EXTENTS if isinstance(shape, BoxContact) else ("radius",))}
    return {name: SIZES[name] for name in SIZES if name in names}


def priors(unknown: Sequence[UnknownParameter]) -> Parameters:
    """The priors of the unknowns, in their order."""
    return Parameters.of(parameter.prior for parameter in unknown)


def apply_unknowns(unknown: Sequence[UnknownParameter], physics: Physics, vector: Array) -> Physics:
    """The physics with all unknowns of the nominal model at their values in `vector` (n,)."""
    for parameter, value in zip(unknown, vector.tolist(), strict=True):
        physics = parameter.apply(physics, value)
    return physics


def with_unknowns(unknown: Sequence[UnknownParameter], effects: Sequence[Effect], vector: Array) -> tuple[Effect, ...]:
    """The scenario's `effects` with their unknown parameters at their values in `vector` (n,)."""
    found = []
    for effect in effects:
        parameters = zip(unknown, vector.tolist(), strict=True)
        values = {parameter.parameter: value for parameter, value in parameters if parameter.of(effect)}
        found.append(effect.with_values({**effect.values, **values}) if values else effect)
    return tuple(found)
