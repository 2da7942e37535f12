"""Forward selection at all places at once: friction at one joint does not show in the equations of another."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2

from drake_cafim.diagnosis.fit.evidence import cost_of, leaves_noise, likelihood_criterion
from drake_cafim.diagnosis.fit.fitting import CONVERGED, Fit, fit, fit_at_first_order, fit_beside
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.places import ELSEWHERE, equations_of, joint_of
from drake_cafim.diagnosis.fit.rivals import changed_effects
from drake_cafim.diagnosis.fit.robust_covariance import contrast_statistics
from drake_cafim.diagnosis.fit.screening import Candidate, screen
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.fit.without_effects import (
    fit_without,
    noise_beside,
    parts_that_show,
    residual_left_by_others,
    share_improved,
    share_removed,
)
from drake_cafim.diagnosis.search import decisions_by_place as decisions
from drake_cafim.diagnosis.search.determined import is_unknown, simpler_laws, strength_at_bound, undetermined_in
from drake_cafim.diagnosis.search.law_shapes import fit_shapes
from drake_cafim.diagnosis.search.pairs_by_place import best_pairs
from drake_cafim.diagnosis.search.refused import Refused
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.thresholds import (
    LEAST_PARTS_THAT_SHOW,
    MISFIT_SHARE_TO_EXPLAIN,
    NAMED_EXCESS_SHARE,
    NOISE_STD_TOLERANCE,
    RECORDINGS_SHARE_IMPROVED,
)
from drake_cafim.diagnosis.trace import Record, Trace
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array

MOST_ROUNDS = 12
"""Largest number of rounds; each adds at most one effect at each joint."""
MOST_REFUSALS = 8
"""Number of effects tried in vain, one after another, after which the growth ends."""
FIRST_ORDER_SHORTFALL = 0.3
"""By what share a test may be missed to first order by an effect that is fitted nevertheless."""

Looked = tuple[Fit, dict[bool, list[Candidate]]]
"""An explanation, and the candidates beyond it that last, and that act once."""


@dataclass
class GrowthByPlace:
    """The explanation `best` grown so far, and the `problem` whitened with the unknown forces that it leaves."""

    nominal: SearchProblem
    """Whitened with the noise of the channels alone."""
    problem: SearchProblem
    best: Fit
    effects: Sequence[Effect]
    trials: int
    settings: Settings
    progress: Callable[[str], None]
    trace: Trace = field(default_factory=Trace)
    refused: Refused = field(default_factory=Refused)
    failed: set[Key] = field(default_factory=set)
    """Effects that failed a test beside the others when an explanation with them was settled."""
    settled_lead: float = 0.0
    """The criterion of the explanation that was settled last beyond the one before; 0 where a test decided."""
    _looks: Looked | None = None
    """Cache: the explanation that was looked beyond last, and what was found there that lasts, and that acts once."""
    _own: tuple[Fit, float] | None = None
    """Cache: the explanation, and its criterion under the forces that it leaves itself."""
    _before: Looked | None = None
    """As `_looks`, before."""

    @classmethod
    def of(
        cls,
        nominal: SearchProblem,
        model: Model,
        trials: int,
        settings: Settings,
        progress: Callable[[str], None],
    ) -> "GrowthByPlace | None":
        """Begins with `model`, which leaves all that is missing to unknown forces; None where there can be none."""
        force = nominal.likeliest_force(model)
        if force is None:
            return None
        problem = nominal.with_unknown_force(force, model)
        best = fit(problem, model)
        return cls(nominal, problem, best, nominal.hypotheses(), max(trials, 1), settings, progress)

    def grow(self) -> None:
        """Adds effects while one stands out."""
        refusals = 0
        for number in range(MOST_ROUNDS):
            additions: list[Effect] = []
            while not additions and refusals <= MOST_REFUSALS:
                promising = [candidate.effect for candidate in self._promising()]
                if not promising:
                    break
                additions = self._that_may_stand(self.best, promising)
                refusals += 0 if additions else len(promising)
                self.refused.add((effect for effect in promising if effect not in additions), self.best.model)
            if not additions and not self._settle_pair():
                return
            if not additions:
                continue
            size = len(self.best.model.effects)
            self.progress(f"round {number + 1}, {size} effects: {len(additions)} more under unknown forces")
            self.failed.clear()
            grown = self.settle(self.best.model.with_effects(additions))
            passed = [effect for effect in additions if effect.key not in self.failed]
            if not grown and len(passed) > 1:
                # they may all be turned away by the fault of one
                alone = [self.settle(self.best.model.with_effects([effect])) for effect in passed]
                grown = any(alone)
            refusals = 0 if grown else refusals + len(additions)
            gone = [effect for effect in additions if effect.key not in self.best.model.keys]
            self.refused.add(gone, self.best.model)

    def settle(self, model: Model, needed: Collection[Key] = ()) -> bool:
        """Whether `model`, without its effects that fail a test, becomes the explanation: none that is `needed` may.

        It does where its likelihood, under the forces that it leaves and the noise that it has itself, pays for its
        parameters. Then these whiten the rows, and what stood out by the former ones may fail.
        """
        needed, self.settled_lead = frozenset(needed), 0.0
        known = self.best.model.keys
        fitted = fit_beside(self.problem, self.best, model)
        shaped = fit_shapes(self.problem, fitted, model.keys - known, CONVERGED, own_noise=False)
        kept = self._without_failing(self.problem, shaped, own_noise=False)
        self.failed |= model.keys - kept.model.keys
        if kept.model.keys == known or not needed <= kept.model.keys:
            return False
        problem = self._under_force_of(kept.model)
        best = self._without_failing(problem, fit(problem, kept.model, tolerance=CONVERGED))
        self.failed |= kept.model.keys - best.model.keys
        if not needed <= best.model.keys:
            return False
        evidence = likelihood_criterion(problem, best, self.trials)
        lead = evidence - likelihood_criterion(self.problem, self.best, self.trials)
        self.settled_lead = lead = lead if lead < 0.0 else evidence - _own_evidence(self)
        self.trace.add(decisions.record_likelihood(best.model, self.best.model, lead))
        if lead < 0.0:
            self.problem, self.best = problem, best
        return lead < 0.0

    def converge(self) -> None:
        """Fits the explanation until χ² falls no more: a fit that stopped early would seem worse than another law's."""
        for _ in range(MOST_ROUNDS):
            before = self.best
            self.best = fit(self.problem, before.model, tolerance=CONVERGED)
            if before.chi_square - self.best.chi_square < CONVERGED:
                break

    def drop(self, effects: Sequence[Effect]) -> None:
        """Takes `effects` out of the explanation, whatever that costs."""
        best = self.best.model
        self.take(replace(best, effects=tuple(effect for effect in best.effects if effect not in effects)))

    def take(self, model: Model) -> None:
        """Makes `model` the explanation, under the forces that it leaves, whatever that costs."""
        self.problem = self._under_force_of(fit(self.problem, model, tolerance=CONVERGED).model)
        self.best = fit(self.problem, model, tolerance=CONVERGED)

    def drop_failing(self, badly: float = 0.0) -> None:
        """Drops the effects that fail a test at least as `badly` as that (see `_failure`), beside laws that came later.

        The worst one goes first, since others may fail by its fault.
        """
        while True:
            failures = [(self._failure(self.problem, self.best, effect), effect) for effect in self.best.model.effects]
            told = [(*failure, effect) for failure, effect in failures if failure is not None and failure[1] >= badly]
            if not told:
                return
            record, _, worst = max(told, key=lambda entry: entry[1])
            self.trace.add(record)
            self.drop([worst])

    def lead_of(self, model: Model, accept: bool = False) -> float:
        """By how much the criterion of `model`, under the unknown forces that it leaves, exceeds the best one's.

        With `accept`, a model whose criterion is lower becomes the explanation.
        """
        problem = self._under_force_of(model)
        found = fit(problem, model, tolerance=CONVERGED)
        before = likelihood_criterion(self.problem, self.best, self.trials)
        lead = likelihood_criterion(problem, found, self.trials) - before
        if accept:
            self.trace.add(decisions.record_likelihood(found.model, self.best.model, lead))
            if lead < 0.0:
                self.problem, self.best = problem, found
        return lead

    def _under_force_of(self, model: Model) -> SearchProblem:
        """The problem with the unknown forces as noise that `model` leaves, searched from those of the explanation."""
        force = self.nominal.likeliest_force(model, self.problem)
        assert force is not None
        return self.nominal.with_unknown_force(force, model)

    def criterion_gain(self, candidate: Candidate) -> float:
        """Decrease of the information criterion by a candidate, to first order; see `evidence.criterion`."""
        return candidate.gain - self.price(candidate.effect)

    def price(self, effect: Effect) -> float:
        """What the information criterion asks for an effect that is chosen from all."""
        return cost_of(self.best, effect) + 2.0 * float(np.log(self.trials))

    def beside(self, model: Model) -> list[Effect]:
        """The effects that may be added to `model`."""
        present = model.effects
        return [
            effect
            for effect in self.effects
            if effect.key not in model.keys and not any(effect.excludes(other) for other in present)
        ]

    def _promising(self) -> list[Candidate]:
        """The best candidates for each joint's motion and readings; or the best one elsewhere, where it gains more.

        Those that act once are looked for where none that lasts is left: a push explains any moment of a law that is
        not there yet.
        """
        if self._looks is None or self._looks[0] is not self.best:
            self._before, self._looks = self._looks, (self.best, {})
        for brief in (False, True):
            if brief not in self._looks[1]:
                self._looks[1][brief] = _candidates(self, self._before, brief)
            found = best_by_place(self, self._looks[1][brief])
            if not found and self._before is not None:
                # what was missing at other joints may have hidden some
                self._before, self._looks[1][brief] = None, _candidates(self, None, brief)
                found = best_by_place(self, self._looks[1][brief])
            if found:
                return found
        return []

    def _settle_pair(self) -> bool:
        """Whether two effects at one joint that hide each other become part of the explanation, see `best_pairs`."""
        for pair in best_pairs(self.problem, self.best, self.effects, self.price, CONVERGED):
            if not self.refused.is_new(pair) or len(self._that_may_stand(pair.rest, pair.effects)) < 2:
                continue
            self.progress(f"{' and '.join(effect.name for effect in pair.effects)} at {pair.effects[0].at}")
            if self.settle(pair.in_place(self.best.model), {effect.key for effect in pair.effects}):
                return True
        return False

    def _that_may_stand(self, beside: Fit, additions: Sequence[Effect]) -> list[Effect]:
        """The `additions` that pass the tests, or nearly, where they are fitted `beside` others to first order.

        All of them where they would fit worse than without them: so far from linear, only a fit can tell.
        """
        known, kept = len(beside.model.effects), list(additions)
        model = beside.model.with_effects(kept)
        columns = [self.problem.effect_columns(model, known + number) for number in range(len(kept))]
        while kept:
            first = fit_at_first_order(self.problem, beside, beside.model.with_effects(kept), columns)
            if float(first.residual @ first.residual) > float(beside.residual @ beside.residual):
                break
            failures = [self._failure(self.problem, first, effect) for effect in first.model.effects[known:]]
            badness = [0.0 if failure is None else failure[1] for failure in failures]
            worst = max(badness)
            if worst < FIRST_ORDER_SHORTFALL:
                break
            # one may fail by another's fault, as in `_without_failing`
            stays = [bad < min(worst, 1.0) for bad in badness]
            self.trace.add(*(failure[0] for failure, it in zip(failures, stays, strict=True) if failure and not it))
            kept = [effect for effect, it in zip(kept, stays, strict=True) if it]
            columns = [column for column, it in zip(columns, stays, strict=True) if it]
        return kept

    def _without_failing(self, problem: SearchProblem, found: Fit, own_noise: bool = True) -> Fit:
        """The fit without the effects that fail a test, the clearest failures first; `own_noise` is as for `fit`."""
        exact = found
        while found.model.effects:
            failures = {it.key: failed for it in found.model.effects if (failed := self._failure(problem, found, it))}
            self.trace.add(*(record for record, _ in failures.values()))
            if not failures and found is exact:
                for effect in found.model.effects:
                    statistic, freedom = self.wald(problem, found, effect)
                    self.trace.add(decisions.record_wald(found.model, effect, statistic, self.threshold(freedom)))
                return found
            # those that hardly act go together, others one at a time, since each may fail by another's fault
            worst = max((badness for _, badness in failures.values()), default=0.0)
            if worst > 1.0 and found is not exact:
                # better without an effect than with it: so far from linear, only a fit can tell
                found = exact = fit(problem, found.model, tolerance=CONVERGED, own_noise=own_noise)
                continue
            dropped = {key for key, (_, badness) in failures.items() if badness >= min(worst, 1.0)}
            gone = [effect for effect in found.model.effects if effect.key in dropped]
            larger = [effect for effect in gone if is_unknown(found, effect)]
            # what fails besides shows to first order; only what is left is fitted
            if gone and not larger:
                found = fit_without(problem, found, gone)
                continue
            fewer = replace(found.model, effects=tuple(it for it in found.model.effects if it not in gone))
            found = exact = fit(problem, fewer, tolerance=CONVERGED, own_noise=own_noise)
            simpler = simpler_laws(problem, found, larger, self.beside(found.model), self.criterion_gain)
            if simpler:
                found = exact = fit(problem, fewer.with_effects(simpler), tolerance=CONVERGED, own_noise=own_noise)
        return found if found is exact else fit(problem, found.model, tolerance=CONVERGED, own_noise=own_noise)

    def _failure(self, problem: SearchProblem, found: Fit, effect: Effect) -> tuple[Record, float] | None:
        """The record of the test that `effect` fails, and how badly: 1 and more where nothing can save it."""
        bound = strength_at_bound(effect)
        if bound is not None:
            return decisions.record_bound(found.model, effect, bound), 1.0
        # unknown forces of any size leave noise alone, beside which a law that hardly acts would pass
        if not self.nominal.plausible(Model(found.model.unknown, (effect,))):
            return decisions.record_implausible(found.model, effect), 1.0
        wide = undetermined_in(found, effect, found.std * noise_beside(problem, found, effect))
        if wide is not None:
            return decisions.record_undetermined(found.model, effect, *wide), 1.0
        statistic, freedom = self.wald(problem, found, effect)
        threshold = self.threshold(freedom)
        if statistic < threshold:
            return decisions.record_wald(found.model, effect, statistic, threshold), 1.0 - statistic / threshold
        if leaves_noise(problem, found, self.settings.adequacy_level):
            return None
        shown = parts_that_show(problem, found, effect)
        if effect.episode is None and np.count_nonzero(shown) < LEAST_PARTS_THAT_SHOW:
            return decisions.record_unconfirmed("admit", found.model, effect, shown, LEAST_PARTS_THAT_SHOW), 1.0
        without = residual_left_by_others(problem, found, effect)
        share = share_removed(problem, found.residual, without)
        # what acts once would be dropped in the end, if it explains less than is left: see `rivals_by_place`
        least = MISFIT_SHARE_TO_EXPLAIN if effect.episode is None else NAMED_EXCESS_SHARE
        if share < least:
            return decisions.record_share(found.model, effect, share, least), 1.0 - share / least
        better = share_improved(problem, found.residual, without)
        if better < RECORDINGS_SHARE_IMPROVED and effect.episode is None:
            return decisions.record_improved(found.model, effect, better, RECORDINGS_SHARE_IMPROVED), 1.0 - better
        return None

    def wald(self, problem: SearchProblem, found: Fit, effect: Effect) -> tuple[float, int]:
        """χ² of "the effect is absent" and its degrees of freedom: by blocks of time, unless the residual is white.

        A covariance by few blocks is itself uncertain, so that a faint effect would not be seen; it is needed where
        the residual is correlated. What is far from linear is worth no more than χ² rises by without it.
        """
        difference, slope = effect.vanishing()
        without = residual_left_by_others(problem, found, effect)
        risen = float(without @ without - found.residual @ found.residual)
        return min(self.shown(problem, found, effect.key, difference, slope), risen), len(difference)

    def shown(self, problem: SearchProblem, found: Fit, key: Key, difference: Array, slope: Array) -> float:
        """χ² of "`difference` (c,) of an effect's strengths is zero", as `wald` has it; see `contrast_statistics`."""
        by_noise, by_blocks = contrast_statistics(problem, found, key, difference, slope)
        statistic = by_noise if leaves_noise(problem, found, self.settings.adequacy_level) else min(by_noise, by_blocks)
        return statistic / (1.0 + NOISE_STD_TOLERANCE) ** 2

    def threshold(self, freedom: int) -> float:
        """Wald statistic that noise alone exceeds in the best of all looks at the false-alarm rate."""
        return float(chi2.isf(self.settings.false_alarm_rate / self.trials, freedom))


def _candidates(growth: GrowthByPlace, before: Looked | None, brief: bool) -> list[Candidate]:
    """All candidates that are `brief`, or all others; where nothing has changed, as they were found `before`."""
    problem, best = growth.problem, growth.best
    effects = [effect for effect in growth.beside(best.model) if effect.brief == brief]
    known, again = [], effects
    if before is not None and brief in before[1]:
        changed = {joint_of(effect) for effect in changed_effects(before[0], best, moved=True)}
        again = [effect for effect in effects if ELSEWHERE in changed or joint_of(effect) in {ELSEWHERE, *changed}]
        others = {effect.key for effect in effects} - {effect.key for effect in again}
        known = [candidate for candidate in before[1][brief] if candidate.effect.key in others]
    return sorted([*known, *screen(problem, best, again, jobs=growth.settings.jobs)], key=lambda look: -look.gain)


def best_by_place(growth: GrowthByPlace, looks: Sequence[Candidate]) -> list[Candidate]:
    """The best of the `looks` for each joint's motion and readings; or the best one elsewhere, where it gains more.

    What acts at one place alone does not show in the equations of another, so that their gains add up.
    """
    by_place: dict[str, Candidate] = {}
    for candidate in sorted(looks, key=growth.criterion_gain, reverse=True):
        luck = float(chi2.sf(candidate.gain, candidate.strengths)) * growth.trials
        if growth.refused.holds(candidate.effect, growth.best.model) or luck > growth.settings.false_alarm_rate:
            continue
        if growth.criterion_gain(candidate) > 0.0:
            by_place.setdefault(equations_of(candidate.effect), candidate)
    elsewhere = by_place.pop(ELSEWHERE, None)
    if elsewhere is None:
        return list(by_place.values())
    together = sum(map(growth.criterion_gain, by_place.values()))
    return [elsewhere] if growth.criterion_gain(elsewhere) > together else list(by_place.values())


def _own_evidence(growth: GrowthByPlace) -> float:
    """The information criterion of the explanation, the rows whitened under it as it is; cached.

    Its own rows may be whitened under what was before its last fit, by which it seems some tens better or worse.
    """
    if growth._own is None or growth._own[0] is not growth.best:
        problem = growth._under_force_of(growth.best.model)
        found = fit(problem, growth.best.model, tolerance=CONVERGED)
        growth._own = (growth.best, likelihood_criterion(problem, found, growth.trials))
    return growth._own[1]
