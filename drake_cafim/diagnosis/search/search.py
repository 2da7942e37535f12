"""The search for the effects that explain a misfit: screen to first order, refit exactly, then admit another one."""

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import chi2

from drake_cafim.diagnosis.fit.evidence import checks, criterion, leaves_noise, scale_of
from drake_cafim.diagnosis.fit.fitting import Fit, fit, unbiased_fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.search import decisions
from drake_cafim.diagnosis.search.detection import detection_p_value
from drake_cafim.diagnosis.search.law_shapes import fit_shapes
from drake_cafim.diagnosis.search.screening import Candidate, screen
from drake_cafim.diagnosis.thresholds import (
    CANDIDATE_GAIN_SHARE_REFITTED,
    COMPETING_CRITERION_REACH,
    CONTENDER_CRITERION_REACH,
    CONTENDERS_FITTED_UNBIASED,
    GAIN_SHARE_FAR_LESS,
    RIVALS_FITTED_PER_PARENT,
    UNKNOWN_MOVE_IN_PRIOR_STDS,
)
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array

ROUNDS = 3
"""Times, at most, that the noise is reckoned anew as unknowns move."""

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
    """Every explanation that was fitted, by the effects in it; echoes of noise, and what ran away, are none."""

    fits: dict[Key, Fit] = field(default_factory=dict)

    def add(self, one: Fit) -> None:
        """Keep `one` instead of an earlier fit of its effects; where it is an echo of noise, those were as well."""
        if one.echo or not np.isfinite(one.chi_square):
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

    problem: SearchProblem
    nominal_problem: SearchProblem
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
    problem: SearchProblem,
    settings: Settings,
    progress: Callable[[str], None] = lambda text: None,
    begun: Sequence[Effect] = (),
    trace: Trace | None = None,
) -> Outcome:
    """The effects that the recordings ask for, beyond the scene's nominal physics and those `begun` with.

    Each decision is added to `trace`.
    """
    trace = Trace() if trace is None else trace
    progress("fitting the nominal model")
    reckoned, nominal = Model(problem.scene.priors.mean), unbiased_fit(problem, problem.nominal())
    for _ in range(ROUNDS):
        if not _moved(problem, reckoned, nominal.model):
            break
        # other masses let other amounts of noise through, and a throw settles where they have it
        reckoned, problem = nominal.model, problem.rewhitened(nominal.model)
        nominal = unbiased_fit(problem, reckoned)
        trace.add(decisions.whitened(problem, reckoned, nominal.model, UNKNOWN_MOVE_IN_PRIOR_STDS))
    effects = problem.hypotheses()
    progress(f"screening {len(effects)} hypotheses")
    screened = screen(problem, nominal, effects)
    trials = sum(candidate.trials for candidate in screened)
    detection = detection_p_value(problem, nominal, screened, trials)
    trace.add(decisions.detected(detection, settings.false_alarm_rate, trials))
    state = _State(problem, settings, effects, trials, progress, trace)
    state.pool.add(nominal)
    state.screens[key_of(nominal)] = screened
    best = nominal
    if detection <= settings.false_alarm_rate:
        best = _grown(state, _begun(state, nominal, begun))
    else:
        trace.add(*decisions.screened(nominal, screened, effects, trials, settings.false_alarm_rate, None))
    if best.model.effects:
        _fit_rivals(state, best)
        _fit_equivalents(state, best)
        best = _pruned(state, _best_of(state, best))
        scale = scale_of(best)
        trace.add(*decisions.compared(state.pool.fits.values(), best, lambda one: criterion(one, scale, trials)))
    return Outcome(state.problem, problem, nominal, best, state.pool, trials, tuple(screened), detection)


def _moved(problem: SearchProblem, before: Model, after: Model) -> bool:
    """Whether unknowns moved so far that the noise is to be reckoned anew."""
    return bool(np.any(np.abs(after.unknown - before.unknown) > UNKNOWN_MOVE_IN_PRIOR_STDS * problem.scene.priors.std))


@dataclass
class _State:
    """A search under way: the problem under its present whitening, and what was fitted and screened under it."""

    problem: SearchProblem
    settings: Settings
    effects: Sequence[Effect]
    trials: int
    progress: Callable[[str], None]
    trace: Trace = field(default_factory=Trace)
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
        reach = criterion(best, 1.0, self.trials) + COMPETING_CRITERION_REACH * scale_of(best)
        competing = [one for one in self.frontier if criterion(one, 1.0, self.trials) < reach]
        problem, pool = self.problem, Pool()
        for _ in range(ROUNDS):
            problem, pool = problem.rewhitened(best.model), Pool()
            for one in (best, *(one for one in competing if key_of(one) != key_of(best))):
                # the width of a sign change is chosen anew as well
                pool.add(unbiased_fit(problem, fit_shapes(problem, fit(problem, one.model)).model))
                if key_of(best) not in pool.fits:
                    self.trace.add(decisions.echo(best.model))
                    return None
            before, best = best, pool.fits[key_of(best)]
            self.trace.add(decisions.whitened(problem, before.model, best.model, UNKNOWN_MOVE_IN_PRIOR_STDS))
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
            if _admitted(state, best, larger):
                grown = state.rewhiten(larger)
                if grown is not None:
                    best = grown
                    break
        else:
            state.trace.add(decisions.none_admitted(best))
            break
    state.trace.add(*decisions.enough(best, state.settings.most_effects))
    return best


def _worth_more(state: _State, best: Fit) -> bool:
    """Whether what `best` leaves is worth another effect: the strongest score test over what is not yet in it."""
    scale, alpha, candidates = scale_of(best), state.settings.false_alarm_rate, state.screen(best)
    worth = any(chi2.sf(c.gain / scale, c.strengths) * state.trials <= alpha for c in candidates)
    state.trace.add(*decisions.another(best, candidates, state.trials, alpha, worth))
    go_on = decisions.GoOn(state.settings.refined, CANDIDATE_GAIN_SHARE_REFITTED) if worth else None
    state.trace.add(*decisions.screened(best, candidates, state.effects, state.trials, alpha, go_on))
    return worth


def _admitted(state: _State, best: Fit, larger: Fit) -> bool:
    """Whether `larger` is to be accepted instead of `best`."""
    done = list(checks(state.problem, best, larger, state.trials, state.settings.false_alarm_rate))
    state.trace.add(*decisions.admitted(best, larger, done))
    return all(check.passed for check in done)


def _expand(state: _State, depth: int) -> None:
    """Move the frontier to the best explanations with one effect more."""
    found: dict[Key, Fit] = {}
    for parent in state.frontier:
        present = {effect.key for effect in parent.model.effects}
        candidates = state.screen(parent)
        promising = [c for c in candidates if c.gain > CANDIDATE_GAIN_SHARE_REFITTED * candidates[0].gain]
        for candidate in promising[: state.settings.refined]:
            key = frozenset({*present, candidate.effect.key})
            if key in found or _settled(state, parent, found.values(), candidate):
                continue
            state.progress(f"{depth} effect{'s' * (depth > 1)}: {candidate.effect.name} at {candidate.effect.at}")
            one = fit(state.problem, parent.model.with_effects([candidate.effect]))
            if state.problem.plausible(one.model):
                found[key] = one
    ranked = state.ranked(found.values())
    kept = [fit_shapes(state.problem, one) for one in ranked[: state.settings.beam]]
    for one in (*ranked[state.settings.beam :], *kept):
        state.pool.add(one)
    state.frontier = state.ranked(kept)
    state.trace.add(*decisions.fitted(ranked, state.settings.beam, lambda one: criterion(one, 1.0, state.trials)))


def _settled(state: _State, parent: Fit, found: Iterable[Fit], candidate: Candidate) -> bool:
    """Whether one of `found` leaves nothing but noise, and the candidate's look, free of noise, gains far less.

    What does not become a rival need not be fitted.
    """
    if state.problem.regressors_noisy:
        return False
    return any(
        candidate.gain < GAIN_SHARE_FAR_LESS * (parent.chi_square - one.chi_square)
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
        for candidate in state.screen(parent)[:RIVALS_FITTED_PER_PARENT]:
            model = parent.model.with_effects([candidate.effect])
            key = frozenset(effect.key for effect in model.effects)
            # a first look that gains far less than what was lost does not become a rival by refinement
            if key not in state.pool.fits and candidate.gain > GAIN_SHARE_FAR_LESS * needed:
                one = fit_shapes(state.problem, fit(state.problem, model))
                if state.problem.plausible(one.model):
                    state.pool.add(one)


def _best_of(state: _State, best: Fit) -> Fit:
    """The best explanation of at most as many effects, once all that come near it were fitted without bias.

    A law that bends where a channel is noisy gains by the noise that its regressors share with the residual.
    """
    scale = scale_of(best)

    def cost(one: Fit) -> float:
        return criterion(one, scale, state.trials)

    for _ in range(CONTENDERS_FITTED_UNBIASED):
        alike = [one for one in state.pool.fits.values() if len(one.model.effects) <= len(best.model.effects)]
        least = min(map(cost, alike))
        near = sorted(
            (one for one in alike if not one.unbiased and cost(one) < least + CONTENDER_CRITERION_REACH), key=cost
        )
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
            lead = criterion(without, scale_of(best), state.trials) - criterion(best, scale_of(best), state.trials)
            state.trace.add(decisions.pruned(best, effect, lead))
            if lead < 0.0:
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
                state.pool.add(fit_shapes(state.problem, fit(state.problem, rest.with_effects([one]))))
        alike = [one for one in state.effects if one.name in effect.alike and one.at == effect.at]
        for first, second in itertools.combinations(alike, 2):
            if len(first.strengths) + len(second.strengths) != len(effect.strengths) or first.key not in looks:
                continue
            beside = fit(state.problem, rest.with_effects([looks[first.key]]))
            found = screen(state.problem, beside, [second])
            if found:
                equivalent = fit_shapes(state.problem, fit(state.problem, beside.model.with_effects([found[0].effect])))
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
