"""What is not known of a model's unknowns, as physics."""

from dataclasses import replace

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


def doubts(scene: Scene, model: Model, covariance: Array) -> list[Physics]:
    """The physics a standard deviation off along each axis of what is not known of its unknowns, priors aside."""
    priors = scene.priors
    # nothing is known worse than before anything was recorded
    spread, axes = np.linalg.eigh(covariance / np.outer(priors.std, priors.std))
    off = (axes * np.sqrt(np.clip(spread, 0.0, 1.0))).T * priors.std
    return [replace(model, unknown=priors.clip(model.unknown + one)).physics(scene) for one in off]
