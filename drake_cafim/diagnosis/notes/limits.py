"""Effort limits of a model file that the recordings refute, as the round numbers of many public files."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from drake_cafim.description.description import list_names
from drake_cafim.diagnosis.fit.columns import Nuisance
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.screening import solve_beside
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.notes.overstated import friction_columns
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import UNDETERMINED_STD_SHARE
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.model_physics import joints_beyond_limits
from drake_cafim.scene.scene import Scene


def refuted_limits(scene: Scene, recordings: Sequence[Recording], forms: Sequence[WeakForm]) -> tuple[str, ...]:
    """The joints that follow commands beyond the effort limit that the model states.

    With r the whitened rows under the limits and r_j those without the one of joint j, the shares s of
    r + Σ s_j (r_j − r) are fitted beside viscous and Coulomb friction at these joints and the scene's unknowns, by
    least squares: 0 where the limit acts and 1 where it does not. It is refuted where s_j is above a half and
    determined. A friction that is missing opposes the motion, as a limit does.
    """
    beyond = [name for name in joints_beyond_limits(scene.tree, recordings) if name in scene.limited]
    if not beyond:
        return ()
    model = Model(scene.priors.mean)
    problem = WeakProblem.of(scene, forms, model)
    residual, jacobian = problem.residual(model), problem.jacobian(model)
    basis = np.linalg.qr(jacobian)[0] if jacobian.shape[1] else np.zeros((len(residual), 0))
    nuisance = Nuisance(basis, residual - basis @ (basis.T @ residual))
    frictions = np.concatenate(
        [friction_columns(problem, model, scene.tree.joint_index(name)) for name in beyond], axis=1
    )
    under = problem.rows_of(model)
    others = [tuple(other for other in scene.limited if other != name) for name in beyond]
    unlimited = [replace(scene, limited=limited).physics_at(model.unknown) for limited in others]
    free = [problem.data_rows(physics) - under for physics in unlimited]
    columns = np.column_stack([frictions, *free])
    together = solve_beside(columns, nuisance)
    if together is None:
        return ()
    shares, decrease = together
    left = float(nuisance.residual @ nuisance.residual - decrease) / max(len(residual) - columns.shape[1], 1)
    refuted = []
    for k, name in enumerate(beyond, frictions.shape[1]):
        rest = solve_beside(np.delete(columns, k, axis=1), nuisance)
        # (value / std)² by the decrease of χ², in units of what remains
        ratio = (decrease - (rest[1] if rest else 0.0)) / max(left, 1.0)
        if shares[k] > 0.5 and ratio > UNDETERMINED_STD_SHARE**-2.0:
            refuted.append(name)
    return tuple(refuted)


def without_limits(scene: Scene, joints: Collection[str]) -> Scene:
    """The scene in which no effort limit acts at `joints`, as its scenario then says."""
    tree = scene.tree.with_joints(
        replace(joint, effort_limit=np.inf) for joint in scene.tree.joints if joint.name in joints
    )
    limited = tuple(name for name in scene.limited if name not in joints)
    scenario = replace(scene.scenario, unlimited=[*scene.scenario.unlimited, *joints])
    return replace(scene, scenario=scenario, tree=tree, limited=limited).with_surfaces_at(np.zeros(len(tree.joints)))


def notes_on_effort_limits(scene: Scene, recordings: Sequence[Recording], refuted: Sequence[str]) -> list[str]:
    """What of the limits acts that commands exceed, and what was `refuted`."""
    acting = [name for name in joints_beyond_limits(scene.tree, recordings) if name in scene.limited]
    notes = [f"commands above the model's effort limits act at the limits ({list_names(acting)})"] if acting else []
    if refuted:
        notes.append(
            f"the recordings follow commands above the model's effort limits, which are ignored ({list_names(refuted)})"
        )
    return notes
