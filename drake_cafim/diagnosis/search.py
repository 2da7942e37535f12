"""The search for the effects that explain a misfit: screen to first order, refit exactly, then admit another one."""

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import chi2

from drake_cafim.diagnosis.adequacy import adequacy
from drake_cafim.diagnosis.evidence import accepted, criterion, leaves_noise, luck, scale_of, under_its_noise
from drake_cafim.diagnosis.fitting import Fit, fit, unbiased_fit
from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.problem import Problem
from drake_cafim.diagnosis.robust import wald_p_value
from drake_cafim.diagnosis.screening import Candidate, hypotheses, screen
from drake_cafim.diagnosis.shapes import reshaped
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array

LOOKED_AT = 8
"""Candidates whose first look is followed by a fit before an alarm is raised."""
SUSPICIOUS, CERTAIN = 0.05, 1e-12
PROMISING = 0.1
"""Candidates whose first look gains less than this share of the best one's are not refitted."""
FAR_LESS = 0.5
"""Of what an explanation takes off χ²."""
COMPETES = 100.0
"""Information criterion, in units of the noise that is left, beyond which an explanation has lost."""
RIVALS = 3
CONTENDERS, NEAR = 12, 10.0
"""Explanations fitted without bias before one is chosen, and by how much of the criterion they may look worse."""
MOVED, ROUNDS = 0.3, 3
"""Prior standard deviations that an unknown may have moved before the noise is reckoned anew; and how often it is."""

Key = frozenset[tuple[str, str]]


@dataclass(frozen=True)
class Settings:
    """How hard to search and how sure to be; nothing here depends on the case.

    - `false_alarm_rate`: probability that anything is named where nothing is missing.
    - `most_effects`: how many an explanation may have.
    - `beam`: explanations of each size that are carried on; `refined`: candidates each of them is refitted with.
    """

    false_alarm_rate: float = 0.01
    most_effects: int = 3
    beam: int = 3
    refined: int = 4


@dataclass
class Pool:
    """Every explanation that was fitted, by the effects in it; echoes of noise are none."""

    fits: dict[Key, Fit] = field(default_factory=dict)

    def add(self, one: Fit) -> None:
        """Keep `one` instead of an earlier fit of its effects; where it is an echo of noise, those were as well."""
        if one.echo:
            self.fits.pop(key_of(one), None)
        else:
            self.fits[key_of(one)] = one

    def sized(self, count: int) -> list[Fit]:
        return [one for key, one in self.fits.items() if len(key) == count]


def key_of(one: Fit) -> Key:
    return frozenset(effect.key for effect in one.model.effects)


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


def search(
    problem: Problem,
    settings: Settings,
    progress: Callable[[str], None] = lambda text: None,
    begun: Sequence[Effect] = (),
) -> Outcome:
    """The effects that the recordings ask for, beyond the scene's nominal physics and those `begun` with."""
    progress("fitting the nominal model")
    reckoned, nominal = Model(problem.scene.priors.mean), unbiased_fit(problem, problem.nominal())
    for _ in range(ROUNDS):
        if not _moved(problem, reckoned, nominal.model):
            break
        # other masses let other amounts of noise through, and a throw settles where they have it
        reckoned, problem = nominal.model, problem.rewhitened(nominal.model)
        nominal = unbiased_fit(problem, reckoned)
    effects = hypotheses(problem)
    progress(f"screening {len(effects)} hypotheses")
    screened = screen(problem, nominal, effects)
    trials = sum(candidate.trials for candidate in screened)
    detection = _detection(problem, nominal, screened, trials)
    state = _State(problem, settings, effects, trials, progress)
    state.pool.add(nominal)
    state.screens[key_of(nominal)] = screened
    best = nominal
    if detection <= settings.false_alarm_rate:
        best = _grown(state, _begun(state, nominal, begun))
    if best.model.effects:
        _fit_rivals(state, best)
        _fit_equivalents(state, best)
        best = _pruned(state, _best_of(state, best))
    return Outcome(state.problem, problem, nominal, best, state.pool, trials, tuple(screened), detection)


def _moved(problem: Problem, before: Model, after: Model) -> bool:
    """Whether unknowns moved so far that the noise is to be reckoned anew."""
    return bool(np.any(np.abs(after.unknown - before.unknown) > MOVED * problem.scene.priors.std))


@dataclass
class _State:
    """A search under way: the problem under its present whitening, and what was fitted and screened under it."""

    problem: Problem
    settings: Settings
    effects: Sequence[Effect]
    trials: int
    progress: Callable[[str], None]
    pool: Pool = field(default_factory=Pool)
    screens: dict[Key, list[Candidate]] = field(default_factory=dict)
    frontier: list[Fit] = field(default_factory=list)
    rests: list[tuple[Model, Fit]] = field(default_factory=list)

    def rest(self, model: Model) -> Fit:
        """The fit of what is left of the best explanation without one of its effects, kept."""
        for known, one in self.rests:
            if known.effects == model.effects:
                return one
        self.rests.append((model, fit(self.problem, model)))
        return self.rests[-1][1]

    def screen(self, parent: Fit) -> list[Candidate]:
        """Candidates that may join `parent`, looked for once."""
        key = key_of(parent)
        if key not in self.screens:
            others = parent.model.effects
            free = [effect for effect in self.effects if not any(effect.excludes(other) for other in others)]
            self.screens[key] = screen(self.problem, parent, free)
        return self.screens[key]

    def ranked(self, fits: Iterable[Fit]) -> list[Fit]:
        return sorted(fits, key=lambda one: criterion(one, 1.0, self.trials))

    def rewhiten(self, best: Fit) -> Fit | None:
        """Whiten under `best`, since accepted physics moves the noise too; what still competes is fitted anew.

        None, and nothing is whitened anew, where under its own noise `best` is an echo of it.
        """
        reach = criterion(best, 1.0, self.trials) + COMPETES * scale_of(best)
        competing = [one for one in self.frontier if criterion(one, 1.0, self.trials) < reach]
        problem, pool = self.problem, Pool()
        for _ in range(ROUNDS):
            problem, pool = problem.rewhitened(best.model), Pool()
            for one in (best, *(one for one in competing if key_of(one) != key_of(best))):
                # the width of a sign change is chosen anew as well
                pool.add(unbiased_fit(problem, reshaped(problem, fit(problem, one.model)).model))
                if key_of(best) not in pool.fits:
                    return None
            before, best = best, pool.fits[key_of(best)]
            if not _moved(problem, before.model, best.model):
                break
        self.problem, self.pool, self.screens = problem, pool, {}
        self.frontier = self.ranked(pool.fits.values())
        return best


def _begun(state: _State, nominal: Fit, effects: Sequence[Effect]) -> Fit:
    """The fit with `effects`, the nominal one where there are none, or where they are an echo of noise."""
    if not effects:
        return nominal
    one = unbiased_fit(state.problem, nominal.model.with_effects(effects))
    state.pool.add(one)
    return nominal if one.echo else state.rewhiten(one) or nominal


def _grown(state: _State, best: Fit) -> Fit:
    """The explanation that no further effect improves enough."""
    state.frontier = [best]
    for depth in range(len(best.model.effects) + 1, state.settings.most_effects + 1):
        if not _worth_more(state, best):
            break
        _expand(state, depth)
        for one in state.frontier:
            larger = unbiased_fit(state.problem, one.model)
            state.pool.add(larger)
            if accepted(state.problem, best, larger, state.trials, state.settings.false_alarm_rate):
                grown = state.rewhiten(larger)
                if grown is not None:
                    best = grown
                    break
        else:
            break
    return best


def _detection(problem: Problem, nominal: Fit, screened: Sequence[Candidate], trials: int) -> float:
    """p-value of "nothing is missing": the strongest score, or the worst of the goodness of fit."""
    fit_quality = adequacy(problem, nominal.residual, 0).p_value
    if fit_quality < CERTAIN:
        # whatever a look would say is no news
        return 2.0 * fit_quality
    score = 1.0
    for candidate in screened[:LOOKED_AT]:
        p = float(chi2.sf(candidate.gain, candidate.strengths)) * trials
        if p < SUSPICIOUS:
            # the linear look shares noise with the residual: only an unbiased fit may raise an alarm
            one = unbiased_fit(problem, nominal.model.with_effects([candidate.effect]))
            gained = nominal.chi_square - one.chi_square
            p = trials * max(wald_p_value(problem, one, candidate.effect.key), luck(gained, candidate.strengths))
            if p < SUSPICIOUS:
                before, after = under_its_noise(problem, nominal, one)
                p = max(p, trials * luck(before.chi_square - after.chi_square, candidate.strengths))
        score = min(score, p)
        if score < CERTAIN:
            break
    return float(min(1.0, 2.0 * min(fit_quality, score)))


def _worth_more(state: _State, best: Fit) -> bool:
    """Whether what `best` leaves is worth another effect: the strongest score test over what is not yet in it."""
    scale, alpha = scale_of(best), state.settings.false_alarm_rate
    return any(chi2.sf(c.gain / scale, c.strengths) * state.trials <= alpha for c in state.screen(best))


def _expand(state: _State, depth: int) -> None:
    """Move the frontier to the best explanations with one effect more."""
    found: dict[Key, Fit] = {}
    for parent in state.frontier:
        present = {effect.key for effect in parent.model.effects}
        candidates = state.screen(parent)
        promising = [c for c in candidates if c.gain > PROMISING * candidates[0].gain]
        for candidate in promising[: state.settings.refined]:
            key = frozenset({*present, candidate.effect.key})
            if key in found or _settled(state, parent, found.values(), candidate):
                continue
            state.progress(f"{depth} effect{'s' * (depth > 1)}: {candidate.effect.name} at {candidate.effect.at}")
            one = fit(state.problem, parent.model.with_effects([candidate.effect]))
            if state.problem.plausible(one.model):
                found[key] = one
    ranked = state.ranked(found.values())
    kept = [reshaped(state.problem, one) for one in ranked[: state.settings.beam]]
    for one in (*ranked[state.settings.beam :], *kept):
        state.pool.add(one)
    state.frontier = state.ranked(kept)


def _settled(state: _State, parent: Fit, found: Iterable[Fit], candidate: Candidate) -> bool:
    """Whether one of `found` leaves nothing but noise, and the candidate's look, free of noise, gains far less.

    What does not become a rival need not be fitted.
    """
    if state.problem.regressors_noisy:
        return False
    return any(
        candidate.gain < FAR_LESS * (parent.chi_square - one.chi_square)
        and leaves_noise(state.problem, one, state.settings.false_alarm_rate)
        for one in found
    )


def _fit_rivals(state: _State, best: Fit) -> None:
    """Fit what might stand in for an accepted effect: each one exchanged, and the runners-up with one effect more."""
    state.progress("fitting rivals")
    parents: list[Fit] = []
    for effect in best.model.effects:
        parents.append(state.rest(_without(best.model, effect)))
    size = len(best.model.effects)
    parents += [one for one in state.frontier if one is not best and len(one.model.effects) <= size]
    for parent in parents:
        needed = parent.chi_square - best.chi_square
        for candidate in state.screen(parent)[:RIVALS]:
            model = parent.model.with_effects([candidate.effect])
            key = frozenset(effect.key for effect in model.effects)
            # a first look that gains far less than what was lost does not become a rival by refinement
            if key not in state.pool.fits and candidate.gain > FAR_LESS * needed:
                one = reshaped(state.problem, fit(state.problem, model))
                if state.problem.plausible(one.model):
                    state.pool.add(one)


def _best_of(state: _State, best: Fit) -> Fit:
    """The best explanation of at most as many effects, once all that come near it were fitted without bias.

    A law that bends where a channel is noisy gains by the noise that its regressors share with the residual.
    """
    scale = scale_of(best)

    def cost(one: Fit) -> float:
        return criterion(one, scale, state.trials)

    for _ in range(CONTENDERS):
        alike = [one for one in state.pool.fits.values() if len(one.model.effects) <= len(best.model.effects)]
        least = min(map(cost, alike))
        near = sorted((one for one in alike if not one.unbiased and cost(one) < least + NEAR), key=cost)
        if not near:
            break
        state.pool.add(unbiased_fit(state.problem, near[0].model))
    known = [
        one for one in state.pool.fits.values() if one.unbiased and len(one.model.effects) <= len(best.model.effects)
    ]
    return min(known, key=cost)


def _pruned(state: _State, best: Fit) -> Fit:
    """The explanation without what it does not need.

    Strengths that were fitted beside an effect may do without it: a tilt across a plane shows in second order alone,
    and starts to be fitted only where something else, such as a gain, has stood in for it.
    """
    for effect in best.model.effects if len(best.model.effects) > 1 else ():
        without = unbiased_fit(state.problem, _without(best.model, effect))
        known = state.pool.fits.get(key_of(without))
        if not without.echo and (known is None or without.chi_square < known.chi_square):
            state.pool.add(without)
            if criterion(without, scale_of(best), state.trials) < criterion(best, scale_of(best), state.trials):
                return _pruned(state, without)
    return best


def _fit_equivalents(state: _State, best: Fit) -> None:
    """Fit what may be an accepted effect by another name at the same place.

    The simpler laws of its group, and pairs of effects that have as many strengths.
    """
    for effect in best.model.effects:
        rest = _without(best.model, effect)
        looks = {one.effect.key: one.effect for one in state.screen(state.rest(rest))}
        for one in looks.values():
            if effect.excludes(one) and len(one.strengths) < len(effect.strengths):
                state.pool.add(reshaped(state.problem, fit(state.problem, rest.with_effects([one]))))
        alike = [one for one in state.effects if one.name in effect.alike and one.at == effect.at]
        for first, second in itertools.combinations(alike, 2):
            if len(first.strengths) + len(second.strengths) != len(effect.strengths) or first.key not in looks:
                continue
            beside = fit(state.problem, rest.with_effects([looks[first.key]]))
            found = screen(state.problem, beside, [second])
            if found:
                equivalent = reshaped(state.problem, fit(state.problem, beside.model.with_effects([found[0].effect])))
                if state.problem.plausible(equivalent.model):
                    state.pool.add(equivalent)


def _without(model: Model, effect: Effect) -> Model:
    return Model(model.unknown, tuple(other for other in model.effects if other is not effect))


def inclusion(outcome: Outcome) -> dict[tuple[str, str], float]:
    """Posterior probability of each effect over all fitted explanations, by their information criteria."""
    fits = list(outcome.pool.fits.values())
    scores: Array = np.array([-0.5 * criterion(one, outcome.scale, outcome.hypotheses) for one in fits])
    weights = np.exp(scores - scores.max())
    weights /= weights.sum()
    probability: dict[tuple[str, str], float] = {}
    for one, weight in zip(fits, weights, strict=True):
        for effect in one.model.effects:
            probability[effect.key] = probability.get(effect.key, 0.0) + float(weight)
    return probability
