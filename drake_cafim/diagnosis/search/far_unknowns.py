"""Unknown parameters far from their prior means: each is a mismatch at its place, and a rival of effects.

A fit holds each unknown near its prior. Where the truth is far from it, some effect takes the difference: a mass twice
as large as stated looks like an actuator's gain. So each unknown is fitted with its prior set aside as well, alone and
in the place of each accepted effect, and such an explanation competes with all others.
"""

from collections.abc import Iterator

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.thresholds import UNKNOWN_FAR_IN_PRIOR_STDS
from drake_cafim.scenario.inertials import INERTIALS, distance_together
from drake_cafim.scenario.unknown import UnknownParameter, inertials
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


def far_unknowns(scene: Scene, model: Model) -> tuple[UnknownParameter, ...]:
    """The unknowns whose values in `model` are more than `UNKNOWN_FAR_IN_PRIOR_STDS` from their prior means."""
    distance = distances(scene, model)
    return tuple(unknown for unknown, z in zip(scene.unknown, distance, strict=True) if z > UNKNOWN_FAR_IN_PRIOR_STDS)


def distances(scene: Scene, model: Model) -> Array:
    """(n,) |value − mean|/std of each unknown, by its stated prior.

    The ten inertials of a link have one distance together, at the first of them, and zero at the others.
    """
    shift = (model.unknown - scene.priors.mean) / scene.priors.std
    distance = np.abs(shift)
    for own in inertials(scene.unknown).values():
        distance[own] = 0.0
        distance[own.start] = distance_together(shift[own])
    return np.asarray(distance, dtype=float)


def free_priors(scene: Scene, parent: Fit, least: float) -> Iterator[Model]:
    """`parent`'s model without the prior of an unknown, for each unknown that so lowers χ² by more than `least`.

    With z and J linearised about `parent`, and the prior row of the unknown left out, χ² falls to zᵀz − gᵀ H⁻¹ g with
    g = Jᵀz and H = JᵀJ.
    """
    data = len(parent.residual) - len(scene.unknown)
    size = np.linalg.norm(parent.jacobian, axis=0)
    J, z = parent.jacobian / np.where(size > 0.0, size, 1.0), parent.residual
    H, g = J.T @ J, J.T @ z
    for i, unknown in enumerate(scene.unknown):
        # of a link's inertials, ten of one prior, the effect `inertial_error` is what no prior holds
        if unknown in parent.model.free or unknown.kind == INERTIALS or unknown.settled:
            continue
        prior, distance = J[data + i], z[data + i]
        own_H, own_g = H - np.outer(prior, prior), g - prior * distance
        step = np.linalg.lstsq(own_H, own_g, rcond=None)[0]
        if float(distance**2 + own_g @ step) > least:
            yield parent.model.without_prior(unknown)
