"""Posterior probabilities of effects, summed over the competing explanations of a search."""

from collections.abc import Callable, Iterable

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Key


def inclusion_probabilities(fits: Iterable[Fit], cost: Callable[[Fit], float]) -> dict[Key, float]:
    """Posterior probability of each effect, and of each unknown without its prior, by (name, place).

    The probability of each model m of `fits` is P(m) ∝ exp(−cost(m)/2), with an information criterion as its cost
    (Kass, Raftery, J. Am. Stat. Assoc. 90(430), 1995, §4). That of an effect is the sum over the models with it.
    """
    models = list(fits)
    scores = np.array([-0.5 * cost(fit) for fit in models])
    # relative to the best one, so that the exponentials do not underflow
    weights = np.exp(scores - scores.max())
    weights /= weights.sum()
    probability: dict[Key, float] = {}
    for fit, weight in zip(models, weights, strict=True):
        for key in fit.model.keys:
            probability[key] = probability.get(key, 0.0) + float(weight)
    return probability
