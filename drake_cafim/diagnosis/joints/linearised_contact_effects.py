"""First-order tests (looks) of effects of a contact, and of its surface's offset and tilt."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields

import numpy as np

from drake_cafim.contact.change import Touch
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.diagnosis.thresholds import WHOLE_EFFECT_LARGEST_COEFFICIENT, WHOLE_EFFECT_LEAST_COEFFICIENT
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.effects.contact import ContactEffect
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.surface import SurfaceEffect
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

IMPROVEMENTS = 8
"""Number of Levenberg–Marquardt steps from the best surface of a grid."""


def contact_looks(
    problem: WeakFormRows, at: Fit, effect: ContactEffect | SurfaceEffect
) -> Iterator[tuple[Array, Callable[[Array], Effect | None]]]:
    """Whitened columns (R, c) of each look, and the function from their coefficients to the effect."""
    physics = at.model.physics(problem.scene)
    contact = next((candidate for candidate in physics.contacts if effect.meets(candidate)), None)
    if contact is None:
        return
    touches = [contact.touch(run.weak.motion(physics)) for run in problem.runs]
    looks = list(effect.looks(contact, _concatenate(touches)))
    if not looks:
        return
    parts = []
    for run in problem.runs:
        here = run.weak.contact_rows(physics)
        columns = []
        for step in (step for look in looks for step in look.steps):
            ahead = _rows(run, physics, effect, step.ahead)
            behind = here if step.behind is None else _rows(run, physics, effect, step.behind)
            columns.append((ahead - behind) / step.size)
        parts.append(run.whitened(np.stack(columns, axis=-1)))
    rows = np.concatenate(parts)
    first = 0
    for look in looks:
        stop = first + len(look.steps)
        yield rows[:, first:stop], look.build
        first = stop


def surface_looks(
    problem: WeakFormRows, at: Fit, effect: SurfaceEffect
) -> Iterator[tuple[Array, Callable[[Array], Effect | None]]]:
    """`contact_looks`, and one column of a whole change of the surface, fitted from a grid of surfaces.

    A surface that moves far changes when it is touched, which no derivative at the nominal surface shows.
    """
    yield from contact_looks(problem, at, effect)
    physics = at.model.physics(problem.scene)
    if any(effect.meets(contact) for contact in physics.contacts):
        found = _fit_surface(problem, at, physics, effect)
        whole = _change(problem, physics, found)[:, None]
        yield (
            whole,
            lambda c: found if WHOLE_EFFECT_LEAST_COEFFICIENT < c[0] < WHOLE_EFFECT_LARGEST_COEFFICIENT else None,
        )


def _fit_surface(problem: WeakFormRows, at: Fit, physics: Physics, effect: SurfaceEffect) -> SurfaceEffect:
    """The best surface of a grid, improved by Levenberg–Marquardt steps; other parameters adapt to first order."""
    basis = np.linalg.qr(at.jacobian)[0][: problem.rows]
    here = at.residual[: problem.rows]

    def residual_with(surface: SurfaceEffect) -> Array:
        rows = here + _change(problem, physics, surface)
        return rows - basis @ (basis.T @ rows)

    trials = [effect.with_values(values) for values in effect.grid()]
    best = min(trials, key=lambda surface: float(np.sum(residual_with(surface) ** 2)))
    rows, damping = residual_with(best), 1e-4
    steps = np.array([effect.difference_step * strength.typical for strength in effect.strengths])
    for _ in range(IMPROVEMENTS):
        columns = [
            (residual_with(best.with_values(best.vector + change)) - rows) / np.sum(change) for change in np.diag(steps)
        ]
        J = np.stack(columns, axis=1)
        normal = J.T @ J
        step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), J.T @ rows)
        trial = best.with_values(best.vector + step)
        trial_rows = residual_with(trial) if trial.plausible() else rows
        if trial_rows @ trial_rows < rows @ rows:
            best, rows, damping = trial, trial_rows, 0.1 * damping
        else:
            damping *= 30.0
    return best


def _change(problem: WeakFormRows, physics: Physics, effect: SurfaceEffect) -> Array:
    """Change of the whitened rows (R,) by the effect."""
    changed = physics.with_effects([effect])
    parts = [run.weak.contact_rows(changed) - run.weak.contact_rows(physics) for run in problem.runs]
    return np.concatenate([run.whitened(part) for run, part in zip(problem.runs, parts, strict=True)])


def _rows(run: Run, physics: Physics, effect: ContactEffect | SurfaceEffect, values: Mapping[str, float]) -> Array:
    return run.weak.contact_rows(physics.with_effects([effect.with_values(values)]))


def _concatenate(touches: list[Touch]) -> Touch:
    """The touches of several recordings, concatenated."""
    names = [field.name for field in fields(Touch) if field.name not in ("arm", "axes")]
    together = {name: np.concatenate([getattr(touch, name) for touch in touches]) for name in names}
    arm = touches[0].arm if len(touches[0].arm) == 1 else np.concatenate([touch.arm for touch in touches])
    return Touch(**together, arm=arm, axes=touches[0].axes)
