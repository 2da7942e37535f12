"""What a model's files say acts in its joints, as effects of the nominal physics."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from drake_cafim.description.description import ModelStatements
from drake_cafim.dynamics.motion import equations_of_motion, motion
from drake_cafim.dynamics.tree import Joint, Tree
from drake_cafim.effects.actuator import ActuatorSaturation
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

LEAST_INERTIA = 1e-15
"""kg m² (kg): below it nothing says how a joint moves."""


def model_effects(said: ModelStatements, tree: Tree, vocabulary: Sequence[type[Effect]]) -> list[Effect]:
    """The frictions and springs that the files state, in the joints that move."""
    acting = [one for one in said.acting if one.at in tree.joint_names]
    return [effect_named(one.effect, vocabulary)(one.at, dict(one.parameters)) for one in acting]


def with_limits(tree: Tree, said: ModelStatements) -> Tree:
    """The tree with the effort limits that the files state for joints without an actuator in the plant."""
    return tree.with_joints(
        replace(joint, effort_limit=said.effort_limits[joint.name])
        for joint in tree.joints
        if joint.effort_limit == np.inf and joint.name in said.effort_limits
    )


def limited_efforts(physics: Physics, joints: Iterable[str]) -> Physics:
    """The physics whose efforts in `joints` stay within the model's limits before anything else changes them."""
    named = set(joints)
    limits = [
        ActuatorSaturation(joint.name, {"limit": joint.effort_limit})
        for joint in physics.tree.joints
        if joint.name in named and 0.0 < joint.effort_limit < np.inf
    ]
    return replace(physics, actuators=(*limits, *physics.actuators))


def _largest(effort: Array) -> float:
    return float(np.max(np.nan_to_num(np.abs(effort)), initial=0.0))


def beyond_limits(tree: Tree, recordings: Sequence[Recording]) -> list[str]:
    """The joints whose recorded efforts go beyond the model's limits."""
    return [
        joint.name
        for joint in tree.joints
        if any(
            0.0 < joint.effort_limit < _largest(one.columns[f"u.{joint.name}"])
            for one in recordings
            if f"u.{joint.name}" in one.columns
        )
    ]


def check_inertias(tree: Tree, said: ModelStatements, source: str) -> None:
    """Raises `InputError` for a joint that moves nothing that has mass or inertia."""
    if tree.floating or not tree.joints:
        return
    aside = np.full((1, len(tree.joints)), 0.3)
    M, _ = equations_of_motion(motion(tree, aside, 0.0 * aside), np.zeros(3))
    for joint, inertia in zip(tree.joints, np.diag(M[0]), strict=True):
        if inertia + joint.rotor_inertia <= LEAST_INERTIA:
            raise InputError(
                f"{said.places.get(joint.name, source)}: joint {joint.name!r} moves {_carried(tree, joint)} without "
                "mass or inertia, expected some in the model, or the joint under `lock:`"
            )


def _carried(tree: Tree, joint: Joint) -> str:
    """The bodies that ride the joint itself."""
    index = tree.joint_index(joint.name)
    return ", ".join(repr(body.name) for body in tree.bodies if body.joint == index) or "nothing"
