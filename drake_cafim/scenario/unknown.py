"""Nominal parameters that may be wrong: from a scenario's entries to numbers in the physics."""

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
CONTACT_PARAMETERS = {"stiffness": "N/m", "damping": "N s/m", "dissipation": "s/m", "friction": "1"}
_ABOVE_ZERO = (*SIZES, "mass", "inertia", "stiffness")
_POSITIVE = (*_ABOVE_ZERO, "damping", "rotor_inertia", "dissipation", "friction")


@dataclass(frozen=True)
class UnknownParameter:
    """One unknown: which number of which thing."""

    parameter: str
    kind: str
    """body, joint, contact or effect."""
    at: str
    prior: Parameter
    effect: str | None = None
    """Of a parameter of an effect that the scenario states: the effect's name."""

    @property
    def key(self) -> tuple[str, str, str | None]:
        """What tells it from the scenario's other unknowns."""
        return self.parameter, self.at, self.effect

    def of(self, effect: Effect) -> bool:
        """Whether it is a parameter of this effect."""
        return self.effect == effect.name and self.at == effect.at

    def apply(self, physics: Physics, value: float) -> Physics:
        """The physics with this number set; numbers of effects are none of the nominal physics."""
        if self.kind == "effect":
            return physics
        if self.kind == "body" and self.parameter in SIZES:
            sized = (one.with_parameter(self.parameter, value) if one.bodies[0] == self.at else one
                     for one in physics.contacts)  # fmt: skip
            return replace(physics, contacts=tuple(sized))
        if self.kind == "body":
            body = physics.tree.body(self.at)
            return replace(physics, tree=physics.tree.with_bodies([_changed(body, self.parameter, value)]))
        if self.kind == "joint":
            joint = physics.tree.joints[physics.tree.joint_index(self.at)]
            changed = replace(joint, **{self.parameter: value})  # type: ignore[arg-type]
            return replace(physics, tree=physics.tree.with_joints([changed]))
        contacts = tuple(
            contact.with_parameter(self.parameter, value) if contact.name == self.at else contact
            for contact in physics.contacts
        )
        return replace(physics, contacts=contacts)


def _changed(body: Body, parameter: str, value: float) -> Body:
    if parameter == "mass":
        # the scale of the inertia goes with the mass, the centre of mass stays
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
    """The scenario's `unknown:` against its model and the `effects` that it states.

    Raises `InputError` for a parameter or a place that they lack, with the valid choices, for a value that cannot be,
    and for an unknown that is given twice.
    """
    found: list[UnknownParameter] = []
    for i, entry in enumerate(entries):
        key = f"{source}: unknown[{i}]"
        one = _of_effect(entry, physics, effects, key) if entry.effect is not None else _unknown(entry, physics, key)
        twice = [k for k, other in enumerate(found) if other.key == one.key]
        if twice:
            raise InputError(f"{key} is {one.parameter} of {one.at} a second time, after unknown[{twice[0]}]")
        found.append(one)
    return tuple(found)


def _unknown(entry: Unknown, physics: Physics, key: str) -> UnknownParameter:
    kind, at, valid, present = _place(entry, physics, key)
    if entry.parameter not in valid:
        raise InputError(f"{key}.parameter is {entry.parameter!r}, which a {kind} has not; valid: {', '.join(valid)}")
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
    """Kind and name of what has the parameter, its valid parameters with their units, and the model's value."""
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
    stated = [one for one in effects if one.name == entry.effect and _same_place(one.at, entry.at or "")]
    if len(stated) != 1:
        known = ", ".join(f"{one.name} at {one.at}" for one in effects) or "none"
        found = f"{len(stated)} times" if stated else "not"
        raise InputError(f"{key}: {entry.effect} at {entry.at} is {found} under effects:, expected one of: {known}")
    effect = stated[0]
    numbers = {one.name: one for one in (*effect.strengths, *effect.shapes) if not one.choices}
    if entry.parameter not in numbers:
        raise InputError(
            f"{key}.parameter is {entry.parameter!r}, which {effect.name} has not; valid: {', '.join(numbers)}"
        )
    strength = numbers[entry.parameter]
    mean = effect.values.get(strength.name, strength.nominal) if entry.mean is None else entry.mean
    allowed = bounds(strength)
    allowed.check(mean, f"{key}.mean")
    name = f"{effect.name}.{strength.name}@{effect.at}"
    prior = Parameter(name, mean, entry.std, allowed.least, allowed.most, effect.unit(strength, physics.tree))
    return UnknownParameter(strength.name, "effect", effect.at, prior, effect.name)


def _same_place(first: str, second: str) -> bool:
    """Whether two names are of one place; those of a contact are read in either order."""
    return first == second or ("/" in first and set(first.split("/")) == set(second.split("/")))


def _body_value(physics: Physics, entry: Unknown) -> float:
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
    """The sizes that the body's shape has, where it is in contact with something."""
    shapes = [contact for contact in physics.contacts if contact.bodies[0] == body]
    names = {name for one in shapes for name in (EXTENTS if isinstance(one, BoxContact) else ("radius",))}
    return {name: SIZES[name] for name in SIZES if name in names}


def priors(unknown: Sequence[UnknownParameter]) -> Parameters:
    """The priors as one vector."""
    return Parameters.of(one.prior for one in unknown)


def applied(unknown: Sequence[UnknownParameter], physics: Physics, vector: Array) -> Physics:
    """The physics with all unknowns set, `vector` (n,) in their order."""
    for one, value in zip(unknown, vector.tolist(), strict=True):
        physics = one.apply(physics, value)
    return physics


def with_unknowns(unknown: Sequence[UnknownParameter], effects: Sequence[Effect], vector: Array) -> tuple[Effect, ...]:
    """The scenario's `effects` with those of their numbers that are unknown at their value in `vector` (n,)."""
    found = []
    for effect in effects:
        values = {one.parameter: x for one, x in zip(unknown, vector.tolist(), strict=True) if one.of(effect)}
        found.append(effect.with_values({**effect.values, **values}) if values else effect)
    return tuple(found)
