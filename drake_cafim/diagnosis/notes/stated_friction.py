"""Friction that a model file states and the recordings refute, as the round numbers of many public descriptions."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.fit.adequacy import adequacy
from drake_cafim.diagnosis.fit.columns import Nuisance
from drake_cafim.diagnosis.fit.fitting import CONVERGED, Fit, fit
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.fit.screening import by_row, solve_beside
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.diagnosis.thresholds import NAMED_EXCESS_SHARE
from drake_cafim.diagnosis.trace import NOMINAL, Record
from drake_cafim.effects.joint import JointCoulombFriction, JointViscousFriction
from drake_cafim.numerics.rounding import rounded
from drake_cafim.scenario.unknown import DRY_FRICTION, stated_friction
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

STEP = "stated friction"
"""The step of the trace at which it is found."""
NEGLIGIBLE = 1e-6
"""Share of a stated friction that hardly acts."""
FAR_LESS = 0.5
"""Share of a stated friction below which what fits best is told as far less."""


@dataclass(frozen=True)
class OverstatedFriction:
    """Far too large friction that a model file states: by joint a note, and the p-value of the model as it states it.

    `share` is that of the excess over noise in the joint's equation which less friction removes.
    """

    notes: Mapping[str, str]
    share: Mapping[str, float]
    p_value: float

    @property
    def records(self) -> list[Record]:
        """The decisions, for a trace."""
        return [
            Record(STEP, NOMINAL, self.share[at], NAMED_EXCESS_SHARE, True, note, "share of the excess over noise")
            for at, note in self.notes.items()
        ]


def overstated_friction(problem: Problem) -> OverstatedFriction | None:
    """The joints whose stated friction is far too large, by a fit of the nominal model; None without one.

    No effect can say so: friction that is missing resists. Told are joints where far less friction, viscous and
    Coulomb's fitted together, removes half of what the model leaves in the joint's equation.
    """
    if not isinstance(problem, WeakFormRows) or any(form.samples.commands for form in problem.forms):
        return None
    nominal = problem.nominal()
    if not np.any(nominal.physics(problem.scene).dampings) and not stated_friction(problem.scene.of_model):
        return None
    fitted = fit(problem, nominal, tolerance=CONVERGED)
    found = list(_overstated(problem, fitted))
    if not found:
        return None
    p_value = adequacy(problem, fitted.residual, 0).p_value
    return OverstatedFriction({at: note for at, _, note in found}, {at: share for at, share, _ in found}, p_value)


def without_friction(scene: Scene, joints: Collection[str]) -> Scene:
    """The scene in which the friction that the model file states at `joints` is known to be none.

    `scene` has that friction unknown. What is there instead a search finds as effects, in all shapes that they have.
    """
    return replace(
        scene,
        unknown=tuple(
            replace(unknown, prior=replace(unknown.prior, mean=0.0, std=NEGLIGIBLE * unknown.prior.std), settled=True)
            if unknown.kind == "joint" and unknown.parameter in ("damping", DRY_FRICTION) and unknown.at in joints
            else unknown
            for unknown in scene.unknown
        ),
    )


def _overstated(problem: WeakFormRows, nominal: Fit) -> Iterator[tuple[str, float, str]]:
    """Joint, share and note."""
    scene, physics, nuisance = problem.scene, nominal.model.physics(problem.scene), Nuisance.of(nominal)
    left = by_row(problem, nominal.residual)
    windows = sum(run.shape[0] for run in problem.runs)
    known = {(unknown.parameter, unknown.at) for unknown in scene.unknown if unknown.kind == "joint"}
    torques = stated_friction(scene.of_model)
    for j, joint in enumerate(scene.tree.joints):
        damping, torque = joint.damping, torques.get(joint.name, 0.0)
        # of what is unknown already, nothing is stated
        stated = np.array(
            [
                damping if ("damping", joint.name) not in known else 0.0,
                torque if (DRY_FRICTION, joint.name) not in known else 0.0,
            ]
        )
        if not np.any(stated > 0.0):
            continue
        laws = (
            JointViscousFriction(joint.name, {"coefficient": 1.0}),
            JointCoulombFriction(joint.name, {"torque": 1.0}),
        )
        along = [run.weak.law_samples(physics)[j] for run in problem.runs]
        columns = [np.concatenate([law.force(samples).d_strengths for law in laws], axis=1) for samples in along]
        X = problem.joint_columns(j, columns)
        solved = solve_beside(X, nuisance)
        if solved is None:
            continue
        change = X @ solved[0]
        basis, row = nuisance.basis[: len(change)], problem.runs[0].weak.dynamic.start + j
        after = by_row(problem, nuisance.residual[: len(change)] + change - basis @ (basis.T @ change))[row]
        share = (left[row] - after) / (left[row] - windows) if left[row] > windows else 0.0
        found = stated + solved[0]
        smaller = (stated > 0.0) & (found < FAR_LESS * stated)
        if share > NAMED_EXCESS_SHARE and np.any(smaller):
            yield joint.name, float(share), _words(joint.name, joint.prismatic, stated, found, scene.scenario.model)


def _words(name: str, prismatic: bool, stated: Array, found: Array, model: str) -> str:
    units = ("N s/m", "N") if prismatic else ("N m s/rad", "N m")
    kinds = ("a damping of", "a dry friction of")
    said = " and ".join(
        f"{kind} {value:g} {unit}" for kind, value, unit in zip(kinds, stated, units, strict=True) if value
    )
    fitted = " and ".join(f"{rounded(max(value, 0.0), 2)} {unit}" for value, unit in zip(found, units, strict=True))
    return (
        f"{name}: {model or 'the model'} states {said}, of which the recordings show far less: {fitted} of viscous and "
        "Coulomb friction fit best"
    )
