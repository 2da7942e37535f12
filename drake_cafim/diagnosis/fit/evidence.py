"""Evidence for an effect: the information criterion, and the tests of a larger explanation against a smaller one."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2, norm

from drake_cafim.diagnosis.fit.adequacy import adequacy, by_run
from drake_cafim.diagnosis.fit.fitting import Fit, unbiased_fit
from drake_cafim.diagnosis.fit.model import Key
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.fit.robust_covariance import wald_statistic
from drake_cafim.diagnosis.thresholds import (
    LAW_ACCURACY,
    LEFT_OUT_SEEN_CHI_SQUARE,
    MISFIT_REDUCED_CHI_SQUARE,
    MISFIT_SHARE_TO_EXPLAIN,
    NOISE_STD_TOLERANCE,
    RECORDINGS_SHARE_IMPROVED,
    UNKNOWN_FAR_IN_PRIOR_STDS,
)
from drake_cafim.effects.effect import Effect
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.typing import Array

FAR_UNKNOWN_SURPRISE = -2.0 * float(np.log(2.0 * norm.sf(UNKNOWN_FAR_IN_PRIOR_STDS)))
"""−2 ln P(|z| > `UNKNOWN_FAR_IN_PRIOR_STDS`) for a standard normal z: the cost of setting a prior aside."""


def criterion(fit: Fit, scale: float, trials: int) -> float:
    """Extended Bayesian information criterion χ²/s² + k ln R + 2 m ln H, smaller is better.

    k strengths are fitted to R rows (Schwarz, Ann. Statist. 6(2), 1978); m effects, or unknowns whose prior is set
    aside, are chosen from H = `trials` looks, since a larger catalogue offers more to find by chance (Chen, Chen,
    Biometrika 95(3), 2008). `scale` s² widens the noise where even the best explanation leaves more than noise, so that
    a small gain over a large misfit is no evidence (McCullagh, Nelder, Generalized Linear Models, 1989, §9.2). −2 ln of
    an effect's prior odds, `Effect.surprise`, is added.
    """
    surprise = sum(effect.surprise for effect in fit.model.effects) + len(fit.model.free) * FAR_UNKNOWN_SURPRISE
    cost = fit.strengths * np.log(max(fit.data_rows, 2)) + 2.0 * len(fit.model.keys) * np.log(max(trials, 1))
    return fit.chi_square / scale + float(cost) + surprise


def likelihood_criterion(problem: Problem, fit: Fit, trials: int) -> float:
    """`criterion` with −2 ln likelihood, χ² + ln det C, in place of χ²: for fits whose rows have different noise."""
    return criterion(fit, 1.0, trials) + problem.log_determinant


def cost_of(fit: Fit, effect: Effect) -> float:
    """What `criterion` asks of one more effect, but for its having been chosen from many."""
    return len(effect.strengths) * float(np.log(max(fit.data_rows, 2))) + effect.surprise


def scale_of(fit: Fit) -> float:
    """s²: χ² per degree of freedom, at least 1."""
    return max(1.0, fit.chi_square / max(fit.degrees_of_freedom, 1))


def luck_p_value(gain: float, strengths: int) -> float:
    """Probability that as many strengths lower χ² by `gain` on noise alone, whose std may be a little understated."""
    return float(chi2.sf(max(gain, 0.0) / (1.0 + NOISE_STD_TOLERANCE) ** 2, max(strengths, 1)))


def leaves_noise(problem: Problem, fit: Fit, rate: float) -> bool:
    """Whether the residual of a fit is as the noise predicts; `rate` is the probability of False where it is."""
    return adequacy(problem, fit.residual, fit.strengths).p_value > rate


def refit_under_noise_of(problem: Problem, before: Fit, after: Fit) -> tuple[Fit, Fit]:
    """Both explanations fitted to rows whitened under `after`.

    An effect that changes the inertia also changes the noise covariance of the rows; under the whitening of `before`
    it may gain by that alone.
    """
    if not problem.whitened_by_model:
        return before, after
    own = problem.rewhitened(after.model)
    return unbiased_fit(own, before.model), unbiased_fit(own, after.model)


def gain_over_residual(problem: Problem, before: Fit, after: Fit) -> float:
    """Decrease of χ², Σ_c Δχ²_c / max(s²_c, 1), s²_c the χ² per row that `after` leaves in channel c; and of priors.

    A misfit that remains at one joint is no evidence against an effect at another joint, where only noise remains.
    """
    had, left = (_by_channel(problem, fit) for fit in (before, after))
    per_row = left[0] * len(left[0]) / problem.rows
    return float(np.sum((had[0] - left[0]) / np.maximum(per_row, 1.0))) + had[1] - left[1]


def _by_channel(problem: Problem, fit: Fit) -> tuple[Array, float]:
    """χ² of each channel's rows (r,), and that of the priors and penalties."""
    parts = np.sum([np.sum(z**2, axis=0) for _, z in by_run(problem, fit.residual[: problem.rows])], axis=0)
    return parts, fit.chi_square - float(np.sum(parts))


SHARE_OF_RECORDINGS = "share of recordings"
"""The name of the test whether an explanation improves the fit of most recordings."""
UNDER_ITS_OWN_NOISE = "gain under its own noise"
"""The name of the test whether an explanation gains under the noise that it implies as well."""

FINITE_NOISE = "finite noise"
"""The name of the test whether the noise of the rows can be computed under an explanation: 1 if so, 0 if not."""


@dataclass(frozen=True)
class Check:
    """A test of a larger explanation: `passed` where its `statistic` reaches the `threshold`."""

    name: str
    statistic: float
    threshold: float
    passed: bool


def checks(problem: Problem, before: Fit, after: Fit, trials: int, rate: float) -> Iterator[Check]:
    """The tests of `after`, the best of `trials` looks, against `before` at a false-alarm `rate`; until one fails.

    Where even `after` leaves far more than noise, a small gain means little, since effects that do not exist compensate
    for the wrong law of another one. Then `after` must remove a fair share of χ², in most recordings.
    """
    if problem.has_other_noise(after.model):
        own = compute(lambda: problem.rewhitened(after.model))
        if isinstance(own, NotComputable):
            yield Check(FINITE_NOISE, 0.0, 1.0, False)
            return
        problem = own
        before, after = unbiased_fit(problem, before.model), unbiased_fit(problem, after.model)
    for check in _checks(problem, before, after, trials, rate):
        yield check
        if not check.passed:
            return


def _checks(problem: Problem, before: Fit, after: Fit, trials: int, rate: float) -> Iterator[Check]:
    if scale_of(after) > MISFIT_REDUCED_CHI_SQUARE:
        share = 1.0 - after.chi_square / before.chi_square
        yield Check(
            "share of misfit",
            share,
            MISFIT_SHARE_TO_EXPLAIN,
            after.chi_square < (1.0 - MISFIT_SHARE_TO_EXPLAIN) * before.chi_square,
        )
        better = share_improved(problem, before, after)
        # what exists acts in every recording; what compensates for something else helps in some
        yield Check(SHARE_OF_RECORDINGS, better, RECORDINGS_SHARE_IMPROVED, better >= RECORDINGS_SHARE_IMPROVED)
    inaccuracy = law_inaccuracy(problem, before)
    if inaccuracy > 0.0:
        lowered = before.chi_square - after.chi_square
        yield Check("gain over inaccuracy", lowered, inaccuracy, not lowered < inaccuracy)
    known = {effect.key for effect in before.model.effects}
    new = [effect for effect in after.model.effects if effect.key not in known]
    strengths = len(after.model.vector) - len(before.model.vector)
    gain = (before.chi_square - after.chi_square) / scale_of(after)
    lucky = least_gain(strengths, trials, rate)
    yield Check("gain", gain, lucky, not luck_p_value(gain, strengths) * trials > rate)
    least = strengths * np.log(max(after.data_rows, 2))
    yield Check("gain for its parameters", gain, float(least), not gain < least)
    for effect in new:
        statistic, freedom = wald_statistic(problem, after, effect.key)
        threshold = float(chi2.isf(min(rate / max(trials, 1), 1.0), freedom))
        yield Check("Wald statistic", statistic, threshold, not chi2.sf(statistic, freedom) * trials > rate)
    # last, since it whitens and fits both again
    gain = gain_over_residual(problem, *refit_under_noise_of(problem, before, after))
    yield Check(UNDER_ITS_OWN_NOISE, gain, lucky, luck_p_value(gain, strengths) * trials <= rate)


def law_inaccuracy(problem: Problem, found: Fit) -> float:
    """Largest misfit, as χ², that inaccuracy of the laws in `found` may leave: ε² Σ (z₀ − z)², ε `LAW_ACCURACY`.

    z are the whitened rows with the effects of `found`, z₀ those without them.
    """
    if not found.model.effects:
        return 0.0
    change = problem.residual(replace(found.model, effects=())) - found.residual
    return LAW_ACCURACY**2 * float(change @ change)


def leaves_inaccuracy(problem: Problem, found: Fit) -> bool:
    """Whether the excess of χ² over noise is within `law_inaccuracy`."""
    return found.chi_square - max(found.degrees_of_freedom, 0) <= law_inaccuracy(problem, found)


def least_gain(strengths: int, trials: int, rate: float) -> float:
    """Decrease of χ² by as many strengths that the best of `trials` looks at noise exceeds with probability `rate`."""
    return float(chi2.isf(min(rate / max(trials, 1), 1.0), max(strengths, 1))) * (1.0 + NOISE_STD_TOLERANCE) ** 2


def share_improved(problem: Problem, before: Fit, after: Fit) -> float:
    """Share of the recordings in which χ² is smaller under `after`, among those in which its new effects act.

    Of these, those count that show the difference (`shows_difference`), or all where none does: chance decides in the
    others.
    """
    known = {effect.key for effect in before.model.effects}
    new = [effect for effect in after.model.effects if effect.key not in known]
    pushed = [effect.episode.recording if effect.episode is not None else None for effect in new]
    left, had = by_run(problem, after.residual[: problem.rows]), by_run(problem, before.residual[: problem.rows])
    better, shown = [], []
    for run, (_, a), (_, b) in zip(problem.runs, left, had, strict=True):
        if None in pushed or run.name in pushed:
            better.append(np.sum(a**2) < np.sum(b**2))
            shown.append(shows_difference(a, b))
    return float(np.mean(np.array(better)[shown if any(shown) else slice(None)]))


def shows_difference(first: Array, second: Array) -> bool:
    """Whether two residuals of the same whitened rows differ by three standard deviations of what is left of them."""
    unit = max(min(float(np.mean(first**2)), float(np.mean(second**2))), 1.0)
    return bool(np.sum((second - first) ** 2) > LEFT_OUT_SEEN_CHI_SQUARE * unit)


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
