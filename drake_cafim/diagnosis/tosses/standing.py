"""Where a surface stands, by what a tracked body does not go through: no simulation, and so from afar as well.

Under a surface that is far off, flights bounce where none was, and slopes of what they do say nothing of where it is.
"""

import numpy as np
from scipy.optimize import least_squares

from drake_cafim.diagnosis.fitting import Fit, fit
from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.tosses.problem import TossProblem
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.rotations import rotation_matrices
from drake_cafim.effects.surface import SurfaceEffect
from drake_cafim.typing import Array

NEAR = 3e-3
"""m that a body on a surface may be off it, deeper or above."""


def standing(problem: TossProblem, at: Fit, effect: SurfaceEffect, contact: SphereContact) -> SurfaceEffect:
    """The effect that fits best near where the tracks have the surface, each arc being thrown anew."""
    points = [
        track.p[:, None] + np.einsum("nij,kj->nki", rotation_matrices(track.quaternion), contact.points)
        for track in problem.arcs.tracks
    ]
    first = _seen(np.concatenate(points), effect, contact)
    others = at.model.effects
    model = Model(problem.scene.priors.mean, (*others, first))
    anew = TossProblem.settled(problem.scene, problem.arcs, problem.noise, model)
    found = fit(anew, model).model
    problem.lead(found, anew.shot(found))
    return found.effects[-1]  # type: ignore[return-value]


def _seen(points: Array, effect: SurfaceEffect, contact: SphereContact) -> SurfaceEffect:
    """The surface that `points` (N, K, 3) of what may touch come to and do not pass."""

    def misses(vector: Array) -> Array:
        on = effect.with_values(vector).on(contact)
        gap = np.min((points - on.point) @ on.normal, axis=1) - on.radius
        # how far above it something flies says nothing
        return np.asarray(np.where(gap < 0.0, gap / NEAR, np.tanh(gap / NEAR)), dtype=float)

    bounds = [[getattr(s, side) for s in effect.strengths] for side in ("lower", "upper")]
    typical = np.array([s.typical for s in effect.strengths])
    # what touches last is another point from one slope to the next: valleys are many and narrow
    tried = [
        least_squares(misses, effect.with_values(values).vector, bounds=bounds, x_scale=typical, diff_step=1e-4)
        for values in effect.grid()
    ]
    return effect.with_values(min(tried, key=lambda one: float(one.cost)).x)
