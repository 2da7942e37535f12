"""Probabilities of explanations and of what is in them, over all explanations that a search lets compete."""

from collections.abc import Callable, Iterable

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Key


def inclusion(fits: Iterable[Fit], cost: Callable[[Fit], float]) -> dict[Key, float]:
    """Posterior probability of each effect, and of each unknown whose prior is wrong, by (name, place).

    P(m) ∝ exp(−cost(m)/2) of each of the competing `fits`, the cost an information criterion (Kass, Raftery, J. Am.
    Stat. Assoc. 90(430), 1995, §4); of an effect it is the sum over the fits that hold it.
    """
    models = list(fits)
    scores = np.array([-0.5 * cost(fit) for fit in models])
    weights = np.exp(scores - scores.max())
    weights /= weights.sum()
    probability: dict[Key, float] = {}
    for fit, weight in zip(models, weights, strict=True):
        for key in fit.model.keys:
            probability[key] = probability.get(key, 0.0) + float(weight)
    return probability
