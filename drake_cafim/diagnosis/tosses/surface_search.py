"""Where a surface stands, by what a tracked body does not go through: no simulation, and so from afar as well."""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares

from drake_cafim.diagnosis.thresholds import RESTING_HEIGHT_TOLERANCE
from drake_cafim.diagnosis.tosses.poses import PoseTrack
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.dynamics.rotations import rotation_matrices
from drake_cafim.effects.surface import SurfaceEffect
from drake_cafim.typing import Array


def standing(tracks: Sequence[PoseTrack], contact: SphereContact, effect: SurfaceEffect) -> SurfaceEffect:
    """The surface that what may touch comes to and does not pass."""
    turned = [np.einsum("nij,kj->nki", rotation_matrices(track.quaternion), contact.points) for track in tracks]
    points = np.concatenate([track.p[:, None] + one for track, one in zip(tracks, turned, strict=True)])

    def misses(vector: Array) -> Array:
        on = effect.with_values(vector).on(contact)
        gap = np.min((points - on.point) @ on.normal, axis=1) - on.radius
        # how far above it something flies says nothing
        return np.asarray(
            np.where(gap < 0.0, gap / RESTING_HEIGHT_TOLERANCE, np.tanh(gap / RESTING_HEIGHT_TOLERANCE)), dtype=float
        )

    bounds = [[getattr(s, side) for s in effect.strengths] for side in ("lower", "upper")]
    typical = np.array([s.typical for s in effect.strengths])
    # what touches last is another point from one slope to the next: valleys are many and narrow
    tried = [
        least_squares(misses, effect.with_values(values).vector, bounds=bounds, x_scale=typical, diff_step=1e-4)
        for values in effect.grid()
    ]
    return effect.with_values(min(tried, key=lambda one: float(one.cost)).x)
