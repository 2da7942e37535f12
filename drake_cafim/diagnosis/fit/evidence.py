"""What counts as evidence for an effect: criteria, and the tests that a larger explanation has to pass."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, norm

from drake_cafim.diagnosis.fit.adequacy import adequacy, by_run
from drake_cafim.diagnosis.fit.fitting import Fit, unbiased_fit
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.fit.robust_covariance import wald_statistic
from drake_cafim.diagnosis.thresholds import (
    MISFIT_REDUCED_CHI_SQUARE,
    MISFIT_SHARE_TO_EXPLAIN,
    NOISE_STD_TOLERANCE,
    RECORDINGS_SHARE_IMPROVED,
    UNKNOWN_FAR_IN_PRIOR_STDS,
)
from drake_cafim.typing import Array

FAR_UNKNOWN_SURPRISE = -2.0 * float(np.log(2.0 * norm.sf(UNKNOWN_FAR_IN_PRIOR_STDS)))
"""−2 ln of the probability, under its stated prior, that an unknown is as far from its mean as is called far."""


def criterion(one: Fit, scale: float, trials: int) -> float:
    """Extended Bayesian information criterion χ²/s² + k ln R + 2 m ln H, smaller is better.

    k strengths over R rows (Schwarz, Ann. Statist. 6(2), 1978), and m effects, or unknowns whose prior is set aside,
    chosen from H looks: a larger catalogue
    offers more to find by chance (Chen, Chen, Biometrika 95(3), 2008).
    `scale` s² widens the noise where even the best explanation leaves more than noise, so that a small gain over a
    large misfit does not count as evidence (McCullagh, Nelder, Generalized Linear Models, 1989, §9.2). What is known
    beforehand of an effect's odds, −2 ln of them, counts as well.
    """
    surprise = sum(effect.surprise for effect in one.model.effects) + len(one.model.free) * FAR_UNKNOWN_SURPRISE
    cost = one.strengths * np.log(max(one.data_rows, 2)) + 2.0 * len(one.model.keys) * np.log(max(trials, 1))
    return one.chi_square / scale + float(cost) + surprise


def scale_of(one: Fit) -> float:
    """s²: χ² per degree of freedom, at least 1."""
    return max(1.0, one.chi_square / max(one.degrees_of_freedom, 1))


def luck(gain: float, strengths: int) -> float:
    """Probability that so many strengths take so much off χ² where they stand for nothing, and noise is loud."""
    return float(chi2.sf(max(gain, 0.0) / (1.0 + NOISE_STD_TOLERANCE) ** 2, max(strengths, 1)))


def leaves_noise(problem: Problem, one: Fit, rate: float) -> bool:
    """Whether what a fit leaves is as the noise predicts, at a `rate` of mistakes where it is."""
    return adequacy(problem, one.residual, one.strengths).p_value > rate


def under_its_noise(problem: Problem, before: Fit, after: Fit) -> tuple[Fit, Fit]:
    """Both fits where the rows are whitened under `after`.

    An effect that moves the inertia also moves how much noise reaches the rows; under the whitening of `before` it may
    gain by that alone.
    """
    if not problem.regressors_noisy:
        return before, after
    own = problem.rewhitened(after.model)
    return unbiased_fit(own, before.model), unbiased_fit(own, after.model)


def gain_over_what_is_left(problem: Problem, before: Fit, after: Fit) -> float:
    """What `after` takes off χ², each channel's part over its own χ² per row, at least 1, that `after` leaves.

    What is missing at one joint says nothing against what is found at another, where noise is all that is left.
    """
    had, left = (_by_channel(problem, one) for one in (before, after))
    per_row = left[0] * len(left[0]) / problem.rows
    return float(np.sum((had[0] - left[0]) / np.maximum(per_row, 1.0))) + had[1] - left[1]


def _by_channel(problem: Problem, one: Fit) -> tuple[Array, float]:
    """χ² of each channel's rows (r,), and what the priors cost beside them."""
    parts = np.sum([np.sum(z**2, axis=0) for _, z in by_run(problem, one.residual[: problem.rows])], axis=0)
    return parts, one.chi_square - float(np.sum(parts))


@dataclass(frozen=True)
class Check:
    """One test that a larger explanation has to pass: its `statistic` must reach the `threshold`."""

    name: str
    statistic: float
    threshold: float
    passed: bool


def accepted(problem: Problem, before: Fit, after: Fit, trials: int, rate: float) -> bool:
    """Whether the larger explanation passes every test, see `checks`."""
    return all(check.passed for check in checks(problem, before, after, trials, rate))


def checks(problem: Problem, before: Fit, after: Fit, trials: int, rate: float) -> Iterator[Check]:
    """The tests of whether `after` is more than the luck of the best of `trials` looks, at a false-alarm `rate`.

    They end with the first one that fails. Where even the larger one leaves far more than noise, small gains mean
    little: the wrong law of one effect is patched by others that are not there. It must then take away a fair part of
    what was left, again and again.
    """
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
        better = share_repeated(problem, before, after)
        yield Check("share of recordings", better, RECORDINGS_SHARE_IMPROVED, better >= RECORDINGS_SHARE_IMPROVED)
    known = {effect.key for effect in before.model.effects}
    new = [effect for effect in after.model.effects if effect.key not in known]
    strengths = len(after.model.vector) - len(before.model.vector)
    gain = (before.chi_square - after.chi_square) / scale_of(after)
    lucky = least_gain(strengths, trials, rate)
    yield Check("gain", gain, lucky, not luck(gain, strengths) * trials > rate)
    least = strengths * np.log(max(after.data_rows, 2))
    yield Check("gain for its parameters", gain, float(least), not gain < least)
    for effect in new:
        statistic, freedom = wald_statistic(problem, after, effect.key)
        threshold = float(chi2.isf(min(rate / max(trials, 1), 1.0), freedom))
        yield Check("Wald statistic", statistic, threshold, not chi2.sf(statistic, freedom) * trials > rate)
    gain = gain_over_what_is_left(problem, *under_its_noise(problem, before, after))
    yield Check("gain under its own noise", gain, lucky, luck(gain, strengths) * trials <= rate)


def least_gain(strengths: int, trials: int, rate: float) -> float:
    """What so many strengths must take off χ² where the best of `trials` looks at noise takes less, but at a `rate`."""
    return float(chi2.isf(min(rate / max(trials, 1), 1.0), max(strengths, 1))) * (1.0 + NOISE_STD_TOLERANCE) ** 2


def repeated(problem: Problem, before: Fit, after: Fit) -> bool:
    """Whether `after` explains the recordings that the new effects act in better, all but a quarter of them."""
    return share_repeated(problem, before, after) >= RECORDINGS_SHARE_IMPROVED


def share_repeated(problem: Problem, before: Fit, after: Fit) -> float:
    """Share of the recordings that the new effects act in which `after` explains better."""
    known = {effect.key for effect in before.model.effects}
    new = [effect for effect in after.model.effects if effect.key not in known]
    pushed = [effect.episode.recording if effect.episode is not None else None for effect in new]
    left, had = by_run(problem, after.residual[: problem.rows]), by_run(problem, before.residual[: problem.rows])
    better = []
    for run, (_, a), (_, b) in zip(problem.runs, left, had, strict=True):
        if None in pushed or run.name in pushed:
            better.append(np.sum(a**2) < np.sum(b**2))
    return float(np.mean(better))
