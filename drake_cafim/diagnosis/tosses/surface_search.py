"""Estimate of a surface's pose from the tracked points that it stops, without a simulation or a close start value."""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares

from drake_cafim.diagnosis.thresholds import RESTING_HEIGHT_TOLERANCE
from drake_cafim.diagnosis.tosses.poses import PoseTrack
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.rotations import rotation_matrices
from drake_cafim.effects.surface import SurfaceEffect
from drake_cafim.typing import Array


def fit_surface(tracks: Sequence[PoseTrack], contact: SphereContact, effect: SurfaceEffect) -> SurfaceEffect:
    """The surface that the touch points reach and do not pass.

    Minimises over the strengths the sum over samples of squared gaps g of the lowest point, in units of
    `RESTING_HEIGHT_TOLERANCE` t: g/t below the surface, tanh(g/t) above it.
    """
    levers = [np.einsum("nij,kj->nki", rotation_matrices(track.quaternion), contact.points) for track in tracks]
    points = np.concatenate([track.p[:, None] + lever for track, lever in zip(tracks, levers, strict=True)])

    def residual(vector: Array) -> Array:
        on = effect.with_values(vector).on(contact)
        gap = np.min((points - on.point) @ on.normal, axis=1) - on.radius
        # the height of a point in flight carries no information, hence a residual that saturates above the surface
        return np.asarray(
            np.where(gap < 0.0, gap / RESTING_HEIGHT_TOLERANCE, np.tanh(gap / RESTING_HEIGHT_TOLERANCE)), dtype=float
        )

    bounds = [[getattr(s, side) for s in effect.strengths] for side in ("lower", "upper")]
    typical = np.array([s.typical for s in effect.strengths])
    # which point is the lowest changes with the slope, so that there are many local minima: start on a grid
    tried = [
        least_squares(residual, effect.with_values(values).vector, bounds=bounds, x_scale=typical, diff_step=1e-4)
        for values in effect.grid()
    ]
    return effect.with_values(min(tried, key=lambda fit: float(fit.cost)).x)
