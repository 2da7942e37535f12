"""Nominal parameters that may be wrong: from a scenario's entries to numbers in the physics."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.dynamics.box_contact import EXTENTS, BoxContact
from drake_cafim.dynamics.tree import Body
from drake_cafim.errors import InputError
from drake_cafim.parameters import Parameter, Parameters
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.schema import Unknown
from drake_cafim.typing import Array

BODY_PARAMETERS = {"mass": "kg", "com_x": "m", "com_y": "m", "com_z": "m", "inertia": "1"}
JOINT_PARAMETERS = {"damping": "N m s/rad", "rotor_inertia": "kg m^2"}
SIZES = {"length": "m", "width": "m", "height": "m", "radius": "m"}
CONTACT_PARAMETERS = {"stiffness": "N/m", "damping": "N s/m", "dissipation": "s/m", "friction": "1"}
_POSITIVE = (*SIZES, "mass", "inertia", "damping", "rotor_inertia", "stiffness", "dissipation", "friction")


@dataclass(frozen=True)
class UnknownParameter:
    """One unknown: which number of which thing."""

    parameter: str
    kind: str
    """body, joint or contact."""
    at: str
    prior: Parameter

    def apply(self, physics: Physics, value: float) -> Physics:
        """The physics with this number set."""
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


def unknown_parameters(entries: Sequence[Unknown], physics: Physics, source: str) -> tuple[UnknownParameter, ...]:
    """The scenario's `unknown:` against its model.

    Raises `InputError` for a parameter or a place that the model lacks, with the valid choices.
    """
    return tuple(_unknown(entry, physics, source) for entry in entries)


def _unknown(entry: Unknown, physics: Physics, source: str) -> UnknownParameter:
    if entry.body is not None:
        kind, at, valid = "body", entry.body, BODY_PARAMETERS | _sizes(physics, entry.body)
        present = _body_value(physics, entry)
    elif entry.joint is not None:
        kind, at, valid = "joint", entry.joint, JOINT_PARAMETERS
        joint = physics.tree.joints[physics.tree.joint_index(entry.joint)]
        present = float(getattr(joint, entry.parameter, np.nan))
    elif entry.contact:
        kind, at, valid = "contact", _contact_name(entry.contact, physics, source), CONTACT_PARAMETERS
        contact = next(c for c in physics.contacts if c.name == at)
        present = float(getattr(contact.parameters, entry.parameter, np.nan))
    else:
        raise InputError(f"{source}: unknown {entry.parameter} of effect {entry.effect} is not among the effects")
    if entry.parameter not in valid:
        raise InputError(f"{source}: a {kind} has no unknown {entry.parameter!r}; valid: {', '.join(valid)}")
    prior = Parameter(
        name=f"{entry.parameter}@{at}",
        mean=present if entry.mean is None else entry.mean,
        std=entry.std,
        lower=0.0 if entry.parameter in _POSITIVE else -np.inf,
        unit=valid[entry.parameter],
    )
    return UnknownParameter(entry.parameter, kind, at, prior)


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


def _contact_name(bodies: Sequence[str], physics: Physics, source: str) -> str:
    for contact in physics.contacts:
        if set(contact.bodies) == set(bodies):
            return contact.name
    known = ", ".join(contact.name for contact in physics.contacts) or "none"
    raise InputError(f"{source}: unknown names the contact {'/'.join(bodies)}; the scenario has: {known}")


def priors(unknown: Sequence[UnknownParameter]) -> Parameters:
    """The priors as one vector."""
    return Parameters.of(one.prior for one in unknown)


def applied(unknown: Sequence[UnknownParameter], physics: Physics, vector: Array) -> Physics:
    """The physics with all unknowns set, `vector` (n,) in their order."""
    for one, value in zip(unknown, vector.tolist(), strict=True):
        physics = one.apply(physics, value)
    return physics
