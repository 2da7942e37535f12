"""First-order test of an unmodelled plane: its normal from the directions of missing forces, its depth from a grid."""

from collections.abc import Callable, Iterator

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows, touched_and_left
from drake_cafim.diagnosis.thresholds import (
    PLANE_EXCESS_SHARE,
    PLANE_FORCE_CHI_SQUARE,
    PLANE_TOUCHED_TIME_SHARES,
    WHOLE_EFFECT_LARGEST_COEFFICIENT,
    WHOLE_EFFECT_LEAST_COEFFICIENT,
)
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.plane import UnmodeledContact
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

IMPROVEMENTS = 10
"""Number of Levenberg–Marquardt steps from the best plane of the grid."""


def plane_looks(
    problem: WeakFormRows, at: Fit, effect: UnmodeledContact
) -> Iterator[tuple[Array, Callable[[Array], Effect | None]]]:
    """The best plane as one column (R, 1), its whole force, and the function from its coefficient to the effect.

    Nothing where no force is missing, or where the plane explains too little or is not touched and left.
    """
    physics = at.model.physics(problem.scene)
    normal = _direction(problem, physics, effect.at)
    if normal is None:
        return
    basis = np.linalg.qr(at.jacobian)[0][: problem.rows]
    here = at.residual[: problem.rows] - basis @ (basis.T @ at.residual[: problem.rows])
    start, gain = _best_of_grid(problem, physics, effect, normal, here, basis)
    if start is None or gain < PLANE_EXCESS_SHARE * (float(here @ here) - problem.rows):
        return
    found = _improved(problem, physics, start, here, basis)
    if not touched_and_left(problem.runs, found, physics):
        return
    column = problem.plane_columns(found, physics, slopes=False)
    yield column, lambda c: found if WHOLE_EFFECT_LEAST_COEFFICIENT < c[0] < WHOLE_EFFECT_LARGEST_COEFFICIENT else None


def _path(run: Run, physics: Physics, at: str) -> tuple[Array, Array, Array]:
    """Position and velocity (N, 3) of the body's origin, and the generalized forces (N, n, 3) by unit forces there."""
    moving, body = run.weak.motion(physics), physics.tree.body(at)
    return *moving.point(body.joint, body.p_JB), moving.force_at(body.joint, body.p_JB)


def _direction(problem: WeakFormRows, physics: Physics, at: str) -> Array | None:
    """The unit vector (3,) along which forces on the body are missing; None where no window misses one.

    It is the main axis of the windows' missing forces, each by least squares.
    """
    spread, mean = np.zeros((3, 3)), np.zeros(3)
    for run in problem.runs:
        weak = run.weak
        rows = run.noisy_rows(physics)[:, weak.dynamic]
        _, _, along = _path(run, physics, at)
        unit = -run.pushed(along, physics.effort_gains)[:, weak.dynamic]
        weight = np.linalg.inv(run.covariance[:, weak.dynamic, weak.dynamic])
        information = np.einsum("mja,mjk,mkb->mab", unit, weight, unit)
        score = np.einsum("mja,mjk,mk->ma", unit, weight, rows)
        force = np.einsum("mab,mb->ma", np.linalg.pinv(information, rcond=1e-3, hermitian=True), score)
        gain = np.sum(force * score, axis=1)
        strong = gain > PLANE_FORCE_CHI_SQUARE
        # weighted by significance instead of size
        weighted = (
            force[strong] * np.sqrt(gain[strong] / np.maximum(np.sum(force[strong] ** 2, axis=1), 1e-300))[:, None]
        )
        spread += weighted.T @ weighted
        mean += weighted.sum(axis=0)
    if not np.any(mean):
        return None
    normal = np.linalg.eigh(spread)[1][:, -1]
    # a plane pushes: the normal points along the force
    return np.asarray(normal if normal @ mean > 0.0 else -normal)


def _best_of_grid(
    problem: WeakFormRows, physics: Physics, effect: UnmodeledContact, normal: Array, here: Array, basis: Array
) -> tuple[UnmodeledContact | None, float]:
    """The best plane of a grid of offsets along `normal`, with least-squares stiffness and damping; and its gain."""
    heights = np.concatenate([_path(run, physics, effect.at)[0] @ normal for run in problem.runs])
    best, best_gain = None, 0.0
    nx, ny, nz = (float(x) for x in normal)
    for part in PLANE_TOUCHED_TIME_SHARES:
        offset = float(np.quantile(heights, part))
        values = {"offset": offset, "stiffness": 1.0, "damping": 0.0, "nx": nx, "ny": ny, "nz": nz}
        columns = problem.plane_columns(effect.with_values(values), physics)[:, 1:3]
        columns = columns - basis @ (basis.T @ columns)
        for used in (columns, columns[:, :1]):
            solved = -np.linalg.lstsq(used, here, rcond=None)[0]
            gain = -2.0 * float(here @ (used @ solved)) - float(np.sum((used @ solved) ** 2))
            strengths = [*solved.tolist(), 0.0][:2]
            if min(strengths) >= 0.0 and strengths[0] > 0.0 and gain > best_gain:
                best_gain = gain
                best = effect.with_values(values | {"stiffness": strengths[0], "damping": strengths[1]})
    return best, best_gain


def _improved(
    problem: WeakFormRows, physics: Physics, start: UnmodeledContact, here: Array, basis: Array
) -> UnmodeledContact:
    """The best plane near `start` by Levenberg–Marquardt steps; the model's parameters adapt to first order."""

    def residual_with(plane: UnmodeledContact) -> Array:
        change = problem.plane_columns(plane, physics, slopes=False)[:, 0]
        return np.asarray(here + change - basis @ (basis.T @ change))

    best, rows, damping = start, residual_with(start), 1e-3
    for _ in range(IMPROVEMENTS):
        J = problem.plane_columns(best, physics)
        J = J - basis @ (basis.T @ J)
        size = np.linalg.norm(J, axis=0)
        size[size == 0.0] = 1.0
        scaled = J / size
        step = -np.linalg.solve(scaled.T @ scaled + damping * np.eye(len(size)), scaled.T @ rows) / size
        lower = np.array([s.lower for s in best.strengths])
        vector = np.maximum(best.vector + step, lower)
        vector[3:] /= np.linalg.norm(vector[3:])
        trial = best.with_values(vector)
        trial_rows = residual_with(trial)
        if trial.plausible() and trial_rows @ trial_rows < rows @ rows:
            best, rows, damping = trial, trial_rows, max(0.2 * damping, 1e-9)
        else:
            damping = min(damping * 10.0, 1e6)
    return best
