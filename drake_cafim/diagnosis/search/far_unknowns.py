"""Unknowns of the scenario that are not where their priors say: a mismatch at their place, and rivals of effects.

A fit holds each unknown near its prior. Where the truth is far from it, some effect takes the difference: a mass twice
as large as stated looks like an actuator's gain. So each unknown is fitted with its prior set aside as well, alone and
in the place of each accepted effect, and such an explanation competes with all others.
"""

from collections.abc import Iterator

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.thresholds import UNKNOWN_FAR_IN_PRIOR_STDS
from drake_cafim.scenario.unknown import UnknownParameter
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


def far_unknowns(scene: Scene, model: Model) -> tuple[UnknownParameter, ...]:
    """The unknowns whose values in `model` are more than `UNKNOWN_FAR_IN_PRIOR_STDS` from their prior means."""
    distance = distances(scene, model)
    return tuple(one for one, z in zip(scene.unknown, distance, strict=True) if z > UNKNOWN_FAR_IN_PRIOR_STDS)


def distances(scene: Scene, model: Model) -> Array:
    """(n,) |value − mean|/std of each unknown, by its stated prior."""
    return np.asarray(np.abs(model.unknown - scene.priors.mean) / scene.priors.std, dtype=float)


def freed(scene: Scene, parent: Fit, least: float) -> Iterator[Model]:
    """`parent`'s model with one unknown's prior set aside: each that gains more than `least` in χ², to first order.

    Linearised about `parent`, χ² without the prior row i of unknown i is min over d of |z + J d|², that row left out.
    """
    n = len(scene.unknown)
    data = len(parent.residual) - n
    for i, unknown in enumerate(scene.unknown):
        if unknown in parent.model.free:
            continue
        rows = np.arange(len(parent.residual)) != data + i
        J, z = parent.jacobian[rows], parent.residual[rows]
        size = np.linalg.norm(J, axis=0)
        scaled = J / np.where(size > 0.0, size, 1.0)
        left = z + scaled @ np.linalg.lstsq(scaled, -z, rcond=None)[0]
        if float(parent.residual @ parent.residual - left @ left) > least:
            yield parent.model.freed(unknown)
