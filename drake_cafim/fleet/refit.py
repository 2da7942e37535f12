"""The strengths of given effects in one recording, whether or not a diagnosis of it alone would name them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.fit.evidence import scale_of
from drake_cafim.diagnosis.fit.fitting import unbiased_fit
from drake_cafim.diagnosis.fit.intervals import standard_deviations
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.effects.effect import Effect
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

WHITENINGS = 2
"""How often the noise is whitened anew as the fitted model lets it through."""


@dataclass(frozen=True)
class Refit:
    """A strength in one recording: `std` is None where it cannot be computed; for a choice, as a side, too."""

    effect: str
    at: str
    parameter: str
    value: float
    std: float | None
    unit: str


def refit(scene: Scene, recording: Recording, effects: Sequence[Effect]) -> tuple[Refit, ...] | NotComputable:
    """The strengths of `effects` fitted to the recording together with the scene's unknowns, from their values on.

    Their stds are those of a diagnosis, widened where more than noise remains (`standard_deviations`). Raises
    `InputError` for a recording that lacks what the scene needs.
    """
    prepared = prepare(scene, [recording])
    found = compute(lambda: _fitted(prepared.problem(), Model(prepared.scene.priors.mean, tuple(effects))))
    if isinstance(found, NotComputable):
        return found
    model, std = found
    refits, position = [], len(model.unknown)
    for effect in model.effects:
        for strength in effect.strengths:
            value, deviation = float(effect.values[strength.name]), float(std[position])
            usable = deviation if np.isfinite(deviation) and deviation > 0.0 else None
            unit = effect.unit(strength, prepared.scene.tree)
            refits.append(Refit(effect.name, effect.at, strength.name, value, usable, unit))
            position += 1
    return tuple(refits)


def _fitted(problem: SearchProblem, start: Model) -> tuple[Model, Array]:
    """The fitted model, and the (n + k,) stds of its unknowns and strengths."""
    fitted = unbiased_fit(problem, start)
    for _ in range(WHITENINGS - 1):
        problem = problem.rewhitened(fitted.model)
        fitted = unbiased_fit(problem, fitted.model)
    return fitted.model, standard_deviations(problem, fitted, scale_of(fitted))
