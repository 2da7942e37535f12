"""Frictions, springs and effort limits that a model's files state, as part of the nominal physics."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace

import numpy as np

from drake_cafim.description.description import ModelStatements, StatedEffect
from drake_cafim.dynamics.motion import equations_of_motion, motion
from drake_cafim.dynamics.tree import Follower, Joint, Tree
from drake_cafim.effects.actuator import ActuatorSaturation
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

LEAST_INERTIA = 1e-15
"""kg m² (kg), least inertia of a joint; with less, its acceleration is not determined."""


def model_effects(statements: ModelStatements, tree: Tree, vocabulary: Sequence[type[Effect]]) -> list[Effect]:
    """The frictions and springs that the files state, in the joints that move; a follower's act on its leader."""
    followers = {follower.joint.name: follower for follower in tree.followers}
    acting = [
        _on_leader(effect, followers[effect.at], tree) if effect.at in followers else effect
        for effect in statements.acting
        if effect.at in tree.joint_names or effect.at in followers
    ]
    return [effect_named(effect.effect, vocabulary)(effect.at, dict(effect.parameters)) for effect in acting]


def _on_leader(effect: StatedEffect, follower: Follower, tree: Tree) -> StatedEffect:
    """A follower's law as that of its leader, which does the same work: with q = a q_leader + o, forces times a.

    A dry friction T is |a| T, a spring k (q − rest) one of a² k about (rest − o)/a.
    """
    a, values = follower.multiplier, effect.parameters
    if effect.effect == "joint_spring":
        rest = (values["rest"] - follower.offset) / a if a else 0.0
        values = {"stiffness": a**2 * values["stiffness"], "rest": rest}
    else:
        values = {name: abs(a) * value for name, value in values.items()}
    return replace(effect, at=tree.joints[follower.leader].name, parameters=values)


def with_effort_limits(tree: Tree, statements: ModelStatements, unlimited: Collection[str] = ()) -> Tree:
    """The tree with the effort limits that the files state for joints without an actuator in the plant.

    None acts at the joints that are `unlimited`.
    """
    limits = {joint.name: statements.effort_limits.get(joint.name, np.inf) for joint in tree.joints}
    limits |= {joint.name: joint.effort_limit for joint in tree.joints if joint.effort_limit < np.inf}
    limits |= dict.fromkeys(unlimited, np.inf)
    return tree.with_joints(replace(joint, effort_limit=limits[joint.name]) for joint in tree.joints)


def with_saturation(physics: Physics, joints: Iterable[str]) -> Physics:
    """The physics in which efforts at `joints` saturate at the model's limits, before any other actuator effect."""
    named = set(joints)
    limits = [
        ActuatorSaturation(joint.name, {"limit": joint.effort_limit})
        for joint in physics.tree.joints
        if joint.name in named and 0.0 < joint.effort_limit < np.inf
    ]
    return replace(physics, actuators=(*limits, *physics.actuators))


def _largest(effort: Array) -> float:
    """The largest absolute effort; missing samples (NaN) do not count."""
    return float(np.max(np.nan_to_num(np.abs(effort)), initial=0.0))


def joints_beyond_limits(tree: Tree, recordings: Sequence[Recording]) -> list[str]:
    """The joints whose recorded efforts exceed the model's limits in at least one sample."""
    return [
        joint.name
        for joint in tree.joints
        if any(
            0.0 < joint.effort_limit < _largest(recording.columns[f"u.{joint.name}"])
            for recording in recordings
            if f"u.{joint.name}" in recording.columns
        )
    ]


def check_inertias(tree: Tree, statements: ModelStatements, source: str) -> None:
    """Raises `InputError` for a joint whose diagonal element of M, rotor included, is at most `LEAST_INERTIA`.

    M is evaluated at q = 0.3 in all joints, since at q = 0 all masses may lie on the axis.
    """
    if tree.floating or not tree.joints:
        return
    aside = np.full((1, len(tree.joints)), 0.3)
    M, _ = equations_of_motion(motion(tree, aside, 0.0 * aside), np.zeros(3))
    for joint, inertia in zip(tree.joints, np.diag(M[0]), strict=True):
        if inertia + joint.rotor_inertia <= LEAST_INERTIA:
            raise InputError(
                f"{statements.places.get(joint.name, source)}: joint {joint.name!r} moves "
                f"{_carried_bodies(tree, joint)} without mass or inertia, expected some in the model, or the joint "
                "under `lock:`"
            )


def _carried_bodies(tree: Tree, joint: Joint) -> str:
    """The names of the bodies that the joint moves directly."""
    index = tree.joint_index(joint.name)
    return ", ".join(repr(body.name) for body in tree.bodies if body.joint == index) or "nothing"
