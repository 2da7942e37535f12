"""The uncertainty of a model's unknowns: physics with the unknowns somewhat off along independent directions."""

from dataclasses import replace

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

OFF = 1e-3
"""How far the unknowns are off, in standard deviations: what they change is then linear in them."""


def doubts(scene: Scene, model: Model, covariance: Array) -> list[Physics]:
    """Physics with the unknowns `OFF` standard deviations off along each principal axis of their `covariance` (n, n).

    The axes are those in units of the priors, whose standard deviations are not exceeded.
    """
    priors = scene.priors
    # recordings cannot make an unknown less certain than its prior
    spread, axes = np.linalg.eigh(covariance / np.outer(priors.std, priors.std))
    off = (axes * (OFF * np.sqrt(np.clip(spread, 0.0, 1.0)))).T * priors.std
    return [replace(model, unknown=priors.clip(model.unknown + change)).physics(scene) for change in off]
