"""The search for the effects that explain a misfit: screen to first order, refit exactly, then admit another one."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import chi2

from drake_cafim.diagnosis.adequacy import adequacy
from drake_cafim.diagnosis.fitting import Fit, fit, unbiased_fit
from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.problem import Problem
from drake_cafim.diagnosis.robust import wald_p_value
from drake_cafim.diagnosis.screening import Candidate, hypotheses, screen
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array

LOOKED_AT = 8
"""Candidates whose first look is followed by a fit before an alarm is raised."""
SUSPICIOUS = 0.05

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


def criterion(one: Fit, scale: float, trials: int) -> float:
    """Extended Bayesian information criterion χ²/s² + k ln R + 2 m ln H, smaller is better.

    k strengths over R rows (Schwarz, Ann. Statist. 6(2), 1978), and m effects chosen from H looks: a larger catalogue
    offers more to find by chance (Chen, Chen, Biometrika 95(3), 2008).
    `scale` s² widens the noise where even the best explanation leaves more than noise, so that a small gain over a
    large misfit does not count as evidence (McCullagh, Nelder, Generalized Linear Models, 1989, §9.2).
    """
    cost = one.strengths * np.log(max(one.data_rows, 2)) + 2.0 * len(one.model.effects) * np.log(max(trials, 1))
    return one.chi_square / scale + float(cost)


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
    nominal = unbiased_fit(problem, problem.nominal())
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
            frontier = _expand(whitened, pool, frontier, effects, settings, depth, trials, progress)
            if not frontier or not _accepted(whitened, best, frontier[0], trials, settings):
                break
            best = frontier[0]
            # the accepted physics moves the noise too: whiten anew and refit before going on
            whitened = whitened.rewhitened(best.model)
            refitted = Pool(
                {
                    key: unbiased_fit(whitened, one.model)
                    for key, one in pool.fits.items()
                    if key in {key_of(f) for f in frontier} or not key
                }
            )
            frontier = sorted((refitted.fits[key_of(f)] for f in frontier), key=lambda f: criterion(f, 1.0, trials))
            pool = Pool(pool.fits | refitted.fits)
            best = refitted.fits[key_of(best)]
    if best.model.effects:
        _rivals(whitened, pool, best, frontier[1:], effects, progress)
    return Outcome(whitened, problem, nominal, best, pool, trials, tuple(screened), detection)


def _detection(problem: Problem, nominal: Fit, screened: Sequence[Candidate], trials: int) -> float:
    """p-value of "nothing is missing": the strongest score, or the worst of the goodness of fit."""
    fit_quality = adequacy(problem, nominal.residual, 0).p_value
    score = 1.0
    for candidate in screened[:LOOKED_AT]:
        p = float(chi2.sf(candidate.gain, candidate.strengths)) * trials
        if p < SUSPICIOUS:
            # the linear look shares noise with the residual: only an unbiased fit may raise an alarm
            one = unbiased_fit(problem, nominal.model.with_effects([candidate.effect]))
            p = wald_p_value(problem, one, candidate.effect.key) * trials
        score = min(score, p)
        if score < 1e-12:
            break
    return float(min(1.0, 2.0 * min(fit_quality, score)))


def _worth_more(problem: Problem, best: Fit, effects: Sequence[Effect], trials: int, settings: Settings) -> bool:
    """Whether what `best` leaves is worth another effect: the strongest score test over what is not yet in it."""
    left = screen(problem, best, _compatible(effects, best))
    return any(chi2.sf(c.gain / scale_of(best), c.strengths) * trials <= settings.false_alarm_rate for c in left)


def _compatible(effects: Sequence[Effect], parent: Fit) -> list[Effect]:
    return [effect for effect in effects if not any(effect.excludes(other) for other in parent.model.effects)]


def _expand(
    problem: Problem,
    pool: Pool,
    frontier: Sequence[Fit],
    effects: Sequence[Effect],
    settings: Settings,
    depth: int,
    trials: int,
    progress: Callable[[str], None],
) -> list[Fit]:
    """The best explanations with one effect more."""
    found: dict[Key, Fit] = {}
    for parent in frontier:
        present = {effect.key for effect in parent.model.effects}
        candidates = screen(problem, parent, _compatible(effects, parent))
        promising = [c for c in candidates if c.gain > 0.1 * candidates[0].gain]
        for candidate in promising[: settings.refined]:
            key = frozenset({*present, candidate.effect.key})
            if key in found:
                continue
            progress(f"{depth} effect{'s' * (depth > 1)}: trying {candidate.effect.name} at {candidate.effect.at}")
            found[key] = fit(problem, parent.model.with_effects([candidate.effect]))
    ranked = sorted(found.values(), key=lambda one: criterion(one, 1.0, trials))
    kept = [_reshaped(problem, one) for one in ranked[: settings.beam]]
    for one in (*ranked[settings.beam :], *kept):
        pool.add(one)
    return sorted(kept, key=lambda one: criterion(one, 1.0, trials))


def _rivals(
    problem: Problem,
    pool: Pool,
    best: Fit,
    others: Sequence[Fit],
    effects: Sequence[Effect],
    progress: Callable[[str], None],
) -> None:
    """Fit what might stand in for an accepted effect: each one exchanged, and the runners-up with one effect more."""
    progress("fitting rivals")
    parents: list[tuple[Fit, int]] = []
    for effect in best.model.effects:
        rest = Model(best.model.unknown, tuple(e for e in best.model.effects if e is not effect))
        parents.append((fit(problem, rest), 2))
    parents += [(other, 3) for other in others]
    for parent, count in parents:
        for candidate in screen(problem, parent, _compatible(effects, parent))[:count]:
            model = parent.model.with_effects([candidate.effect])
            key = frozenset(effect.key for effect in model.effects)
            if key not in pool.fits:
                pool.add(fit(problem, model))


def _reshaped(problem: Problem, one: Fit) -> Fit:
    """The fit with the best shape of each effect, one after the other."""
    for position, effect in enumerate(one.model.effects):
        for other in effect.reshaped():
            effects = list(one.model.effects)
            effects[position] = other
            trial = fit(problem, Model(one.model.unknown, tuple(effects)))
            if trial.chi_square < one.chi_square:
                one = trial
    return one


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
    scores: Array = np.array([-0.5 * criterion(one, outcome.scale, outcome.hypotheses) for one in fits])
    weights = np.exp(scores - scores.max())
    weights /= weights.sum()
    probability: dict[tuple[str, str], float] = {}
    for one, weight in zip(fits, weights, strict=True):
        for effect in one.model.effects:
            probability[effect.key] = probability.get(effect.key, 0.0) + float(weight)
    return probability
