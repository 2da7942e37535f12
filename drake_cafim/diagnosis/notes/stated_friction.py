"""Friction that a model file states and the recordings refute, as the round numbers of many public descriptions."""

from collections.abc import Iterator

import numpy as np

from drake_cafim.diagnosis.fit.columns import Nuisance
from drake_cafim.diagnosis.fit.fitting import CONVERGED, Fit, fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.fit.screening import by_row, solve_beside
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.diagnosis.thresholds import NAMED_EXCESS_SHARE
from drake_cafim.effects.joint import JointCoulombFriction, JointViscousFriction
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.numerics.rounding import rounded
from drake_cafim.typing import Array

FAR_LESS = 0.5
"""Share of a stated friction below which what fits best is told as far less."""


def overstated_friction(problem: Problem, nominal: Model) -> dict[str, str]:
    """By name a note for each joint whose stated friction is far too large, by the fit of the `nominal` model.

    No effect can say so: friction that is missing resists. Told are joints where far less friction, viscous and
    Coulomb's fitted together, removes half of what the model leaves in the joint's equation.
    """
    if not isinstance(problem, WeakFormRows) or any(form.samples.commands for form in problem.forms):
        return {}
    if not np.any(nominal.physics(problem.scene).dampings) and not problem.scene.of_model:
        return {}
    notes = compute(lambda: dict(_notes(problem, fit(problem, nominal, tolerance=CONVERGED))))
    return {} if isinstance(notes, NotComputable) else notes


def _notes(problem: WeakFormRows, nominal: Fit) -> Iterator[tuple[str, str]]:
    scene, physics, nuisance = problem.scene, nominal.model.physics(problem.scene), Nuisance.of(nominal)
    left = by_row(problem, nominal.residual)
    windows = sum(run.shape[0] for run in problem.runs)
    for j, joint in enumerate(scene.tree.joints):
        torque = sum(law.values["torque"] for law in scene.of_model if _is_dry(law.name) and law.at == joint.name)
        stated = np.array([physics.dampings[j], torque])
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
        removed = left[row] - after > NAMED_EXCESS_SHARE * (left[row] - windows)
        found = stated + solved[0]
        smaller = (stated > 0.0) & (found < FAR_LESS * stated)
        if left[row] > windows and removed and np.any(smaller):
            yield joint.name, _words(joint.name, joint.prismatic, stated, found, problem.scene.scenario.model)


def _is_dry(name: str) -> bool:
    return name == JointCoulombFriction.name


def _words(name: str, prismatic: bool, stated: Array, found: Array, model: str) -> str:
    units = ("N s/m", "N") if prismatic else ("N m s/rad", "N m")
    kinds = ("a damping of", "a dry friction of")
    said = " and ".join(
        f"{kind} {value:g} {unit}" for kind, value, unit in zip(kinds, stated, units, strict=True) if value
    )
    fitted = " and ".join(f"{rounded(max(value, 0.0), 2)} {unit}" for value, unit in zip(found, units, strict=True))
    return (
        f"{name}: {model or 'the model'} states {said}, of which the recordings show far less: {fitted} of viscous and "
        "Coulomb friction fit best; correct the file, or state damping as unknown"
    )
