"""The uncertainty of a model's unknowns: physics with the unknowns somewhat off, in directions that are felt."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.predict.innovations import changes_by
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

OFF = 0.1
"""How far the unknowns are off, in standard deviations: what they change is then linear in them."""
UNFELT = 1e-6
"""Share of the variance of each predicted position and velocity by the doubts up to which some of them are left out."""


def doubts(scene: Scene, model: Model, covariance: Array, forms: Sequence[WeakForm]) -> list[Physics]:
    """Physics with the unknowns `OFF` standard deviations off along independent directions that the recordings feel.

    These are the principal axes of what the unknowns' `covariance` (n, n), in units of the priors, whose standard
    deviations are not exceeded, changes within a sample: many sets of inertias move an arm alike.
    """
    priors = scene.priors
    if not len(priors.std):
        return []
    # recordings cannot make an unknown less certain than its prior
    spread, axes = np.linalg.eigh(covariance / np.outer(priors.std, priors.std))
    off = (axes * (OFF * np.sqrt(np.clip(spread, 0.0, 1.0)))).T * priors.std

    def physics(changes: Array) -> list[Physics]:
        return [replace(model, unknown=priors.clip(model.unknown + change)).physics(scene) for change in changes]

    changes = changes_by(forms, model.physics(scene), physics(off))
    if not np.all(np.isfinite(changes)):
        return physics(off)
    # each position and velocity counts alike
    total = np.sqrt(np.sum(changes**2, axis=(0, 2)))
    scaled = (changes / np.where(total > 0.0, total, 1.0)[:, None]).reshape(-1, len(off))
    felt, along = np.linalg.eigh(scaled.T @ scaled)
    return physics(along[:, np.cumsum(felt) > UNFELT].T @ off)
