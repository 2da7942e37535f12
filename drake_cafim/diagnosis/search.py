"""The search for the effects that explain a misfit: screen to first order, refit exactly, then admit another one."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import chi2

from drake_cafim.diagnosis.adequacy import adequacy
from drake_cafim.diagnosis.fitting import Fit, fit
from drake_cafim.diagnosis.problem import Problem
from drake_cafim.diagnosis.robust import wald_p_value
from drake_cafim.diagnosis.screening import Candidate, hypotheses, screen
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array

Key = frozenset[tuple[str, str]]


@dataclass(frozen=True)
class Settings:
    """How hard to search and how sure to be; nothing here depends on the case."""

    false_alarm_rate: float = 0.01
    """Probability that anything is named where nothing is missing."""
    most_effects: int = 5
    beam: int = 3
    """Explanations of each size that are carried on."""
    refined: int = 5
    """Candidates that each of them is refitted with."""


@dataclass
class Pool:
    """Every explanation that was fitted, by the effects in it."""

    fits: dict[Key, Fit] = field(default_factory=dict)

    def add(self, one: Fit) -> None:
        self.fits[key_of(one)] = one

    def sized(self, count: int) -> list[Fit]:
        return [one for key, one in self.fits.items() if len(key) == count]


def key_of(one: Fit) -> Key:
    return frozenset(effect.key for effect in one.model.effects)


def criterion(one: Fit, scale: float) -> float:
    """Bayesian information criterion χ²/s² + k ln R, smaller is better (Schwarz, Ann. Statist. 6(2), 1978).

    `scale` s² widens the noise where even the best explanation leaves more than noise, so that a small gain over a
    large misfit does not count as evidence (McCullagh, Nelder, Generalized Linear Models, 1989, §9.2).
    """
    strengths = len(one.model.vector) - len(one.model.unknown)
    return one.chi_square / scale + strengths * float(np.log(max(one.data_rows, 2)))


def scale_of(one: Fit) -> float:
    """s²: χ² per degree of freedom, at least 1."""
    return max(1.0, one.chi_square / max(one.degrees_of_freedom, 1))


@dataclass(frozen=True)
class Outcome:
    """What the search found: the best fit, all that were tried, and the first look at the nominal model."""

    problem: Problem
    nominal_problem: Problem
    nominal: Fit
    best: Fit
    pool: Pool
    hypotheses: int
    screened: tuple[Candidate, ...]
    detection_p_value: float

    @property
    def scale(self) -> float:
        return scale_of(self.best)


def search(problem: Problem, settings: Settings, progress: Callable[[str], None] = lambda text: None) -> Outcome:
    """The effects that the recordings ask for, beyond the scene's nominal physics."""
    progress("fitting the nominal model")
    nominal = fit(problem, problem.nominal())
    effects = hypotheses(problem)
    progress(f"screening {len(effects)} hypotheses")
    screened = screen(problem, nominal, effects)
    trials = sum(candidate.trials for candidate in screened)
    detection = _detection(problem, nominal, screened, trials)
    pool = Pool()
    pool.add(nominal)
    best, frontier = nominal, [nominal]
    whitened = problem
    if detection <= settings.false_alarm_rate:
        for depth in range(1, settings.most_effects + 1):
            if not _worth_more(whitened, best, effects, trials, settings):
                break
            frontier = _expand(whitened, pool, frontier, effects, settings, depth, progress)
            if not frontier or not _accepted(whitened, best, frontier[0], trials, settings):
                break
            best = frontier[0]
            # the accepted physics moves the noise too: whiten anew and refit before going on
            whitened = whitened.rewhitened(best.model)
            refitted = Pool({key: fit(whitened, one.model) for key, one in pool.fits.items()
                             if key in {key_of(f) for f in frontier} or not key})
            frontier = sorted((refitted.fits[key_of(f)] for f in frontier), key=lambda f: criterion(f, 1.0))
            pool = Pool(pool.fits | refitted.fits)
            best = refitted.fits[key_of(best)]
    return Outcome(whitened, problem, nominal, best, pool, trials, tuple(screened), detection)


def _detection(problem: Problem, nominal: Fit, screened: Sequence[Candidate], trials: int) -> float:
    """p-value of "nothing is missing": the strongest score, or the worst of the goodness of fit."""
    scores = [float(chi2.sf(c.gain, c.strengths)) * trials for c in screened]
    fit_quality = adequacy(problem, nominal.residual, 0).p_value
    return float(min(1.0, 2.0 * min([fit_quality, *scores])))


def _worth_more(
    problem: Problem, best: Fit, effects: Sequence[Effect], trials: int, settings: Settings
) -> bool:
    """Whether what `best` leaves is worth another effect: the strongest score test over what is not yet in it."""
    present = {effect.key for effect in best.model.effects}
    left = screen(problem, best, [effect for effect in effects if effect.key not in present])
    return any(chi2.sf(c.gain / scale_of(best), c.strengths) * trials <= settings.false_alarm_rate for c in left)


def _expand(
    problem: Problem,
    pool: Pool,
    frontier: Sequence[Fit],
    effects: Sequence[Effect],
    settings: Settings,
    depth: int,
    progress: Callable[[str], None],
) -> list[Fit]:
    """The best explanations with one effect more."""
    found: dict[Key, Fit] = {}
    for parent in frontier:
        present = {effect.key for effect in parent.model.effects}
        candidates = screen(problem, parent, [effect for effect in effects if effect.key not in present])
        promising = [c for c in candidates if c.gain > 0.1 * candidates[0].gain]
        for candidate in promising[: settings.refined]:
            key = frozenset({*present, candidate.effect.key})
            if key in found:
                continue
            progress(f"{depth} effect{'s' * (depth > 1)}: trying {candidate.effect.name} at {candidate.effect.at}")
            found[key] = fit(problem, parent.model.with_effects([candidate.effect]))
    for one in found.values():
        pool.add(one)
    ranked = sorted(found.values(), key=lambda one: criterion(one, 1.0))
    return ranked[: settings.beam]


def _accepted(problem: Problem, before: Fit, after: Fit, trials: int, settings: Settings) -> bool:
    """Whether the larger explanation is more than the luck of the best of `trials` looks."""
    strengths = len(after.model.vector) - len(before.model.vector)
    gain = (before.chi_square - after.chi_square) / scale_of(after)
    p = float(chi2.sf(max(gain, 0.0), max(strengths, 1))) * trials
    if p > settings.false_alarm_rate or gain < strengths * np.log(max(after.data_rows, 2)):
        return False
    new = [effect.key for effect in after.model.effects if effect.key not in {e.key for e in before.model.effects}]
    return all(wald_p_value(problem, after, key) * trials <= settings.false_alarm_rate for key in new)


def inclusion(outcome: Outcome) -> dict[tuple[str, str], float]:
    """Posterior probability of each effect over all fitted explanations, by their information criteria."""
    # explanations that were fitted under different covariances are compared by size only where refitted
    fits = list(outcome.pool.fits.values())
    scores: Array = np.array([-0.5 * criterion(one, outcome.scale) for one in fits])
    weights = np.exp(scores - scores.max())
    weights /= weights.sum()
    probability: dict[tuple[str, str], float] = {}
    for one, weight in zip(fits, weights, strict=True):
        for effect in one.model.effects:
            probability[effect.key] = probability.get(effect.key, 0.0) + float(weight)
    return probability
