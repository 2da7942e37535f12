"""Posterior probabilities of effects: among the competing explanations of a search, or the laws at a place."""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Key
from drake_cafim.diagnosis.fit.rivals import Lead
from drake_cafim.diagnosis.fit.robust_covariance import wald_statistics
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from drake_cafim.effects.effect import Effect


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


def evidence_unit(growth: GrowthByPlace, effect: Effect) -> float:
    """How many times less the blocks of time tell of an effect than independent rows would, at least 1.

    What remains is correlated, so that differences of χ² are larger than their evidence by this factor (composite
    likelihood; Varin, Vidoni, Biometrika 92(3), 2005).
    """
    by_noise, _ = wald_statistics(growth.problem, growth.best, effect.key)
    shown = growth.wald(growth.problem, growth.best, effect)[0]
    return max(1.0, by_noise / shown) if shown > 0.0 else 1.0


def probabilities_by_place(growth: GrowthByPlace, found: Mapping[Key, Sequence[Lead]]) -> dict[Key, float]:
    """By effect: P ∝ exp(−Δ/2), Δ its criterion beyond the best one's, over the laws at its place and none of them."""
    probability: dict[Key, float] = {}
    for effect in growth.best.model.effects:
        unit = evidence_unit(growth, effect)
        by_noise, _ = wald_statistics(growth.problem, growth.best, effect.key)
        none = by_noise / unit - growth.price(effect)
        leads = [(effect.key, 0.0), *((law.key, lead) for lead, _, law in found[effect.key])]
        weights = np.array([np.exp(-0.5 * max(lead, 0.0)) for _, lead in leads])
        total = float(weights.sum()) + float(np.exp(-0.5 * max(none, 0.0)))
        for (key, _), weight in zip(leads, weights, strict=True):
            probability[key] = max(probability.get(key, 0.0), float(weight) / total)
    return probability
