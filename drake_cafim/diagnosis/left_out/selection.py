"""Chooses what goes into the corrected scene, effect by effect, by the prediction of training parts that are left out.

First by the likelihood of the rows, then, where more than noise remains, by simulation. Where the residual is noise the
rows' likelihood is the true one, and nothing predicts better by another measure. Where it is not, an effect may take a
share of a misfit that has another cause and simulate worse: then the errors of simulations decide as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit, unbiased_fit
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.left_out import decisions
from drake_cafim.diagnosis.left_out.parts import Part, parts_of
from drake_cafim.diagnosis.left_out.refits import UNKNOWNS, Items, Refits
from drake_cafim.diagnosis.left_out.simulations import (
    ByColumn,
    Errors,
    Predictions,
    both_horizons,
    errors_over,
    mean_differences,
    mean_with_error,
    surprisals,
)
from drake_cafim.diagnosis.predict.forecast import SHORT_HORIZON
from drake_cafim.diagnosis.trace import Record
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.learned_force import LearnedForce
from drake_cafim.typing import Array, Flags

NOTHING: Items = frozenset()


@dataclass(frozen=True)
class Selection:
    """What goes into the corrected scene: the fit of it, and what does not, with the reason of each."""

    fitted: Fit
    """Of the kept effects; its model says whether the unknowns are `held` as given."""
    left_out: tuple[tuple[Effect, str], ...] = ()
    """Named effects that are not in the corrected scene, and why."""
    unknowns_held: str = ""
    """Why the unknowns stay as given; empty where they are fitted, or where there are none."""
    records: tuple[Record, ...] = ()
    learned: tuple[LearnedForce, ...] = ()
    """Laws without a name that the corrected scene has besides."""

    @property
    def as_given(self) -> bool:
        """Whether the corrected scene is the one given."""
        return (
            not self.learned
            and not self.fitted.model.effects
            and (self.fitted.model.held or not len(self.fitted.model.unknown))
        )


def everything(fitted: Fit) -> Selection:
    """All that was found, as fitted."""
    return Selection(fitted)


def select(problem: Problem, fitted: Fit, predictions: Predictions | None, given: Array | None = None) -> Selection:
    """What of `fitted`, a fit to `problem`, predicts left-out parts better.

    With `predictions` the errors of simulations decide as well, else the likelihood of the rows alone. The unknowns of
    the scene as `given` (n,) are the prior means of `problem` unless a search has set some aside: these then stay as
    the search had them with all that is kept.
    """
    parts = parts_of(problem.runs)
    refits = Refits.of(problem, fitted, parts, given)
    if not refits.items:
        return everything(replace(fitted, model=replace(fitted.model, held=len(fitted.model.unknown) > 0)))
    choice = _Elimination(refits, parts, predictions, frozenset(refits.items))
    choice.by_rows()
    if predictions is not None and choice.kept:
        choice.by_simulation()
    if choice.kept:
        choice.against_given()
    return choice.selection(problem)


@dataclass
class _Elimination:
    """The items that are still kept, and the reasons of those that are not."""

    refits: Refits
    parts: Sequence[Part]
    predictions: Predictions | None
    kept: Items
    reasons: dict[int, str] = field(default_factory=dict)
    records: list[Record] = field(default_factory=list)
    simulated: dict[Items, Errors] = field(default_factory=dict)
    filtered: dict[Items, Array] = field(default_factory=dict)

    def by_rows(self) -> None:
        """Takes out, one at a time, the item without which the rows of left-out parts are predicted best."""
        while self.kept:
            now = self.refits.chi_square(self.kept)
            gains = {item: self._judged(item, self.refits.chi_square(self.kept - {item}) - now) for item in self.kept}
            item, gain = min(gains.items(), key=lambda found: (found[1], found[0]))
            if gain > 0.0:
                self.records += [
                    decisions.by_rows(self._name(k), value, len(self.parts)) for k, value in sorted(gains.items())
                ]
                break
            self._drop(item, decisions.by_rows(self._name(item), gain, len(self.parts)))

    def by_simulation(self) -> None:
        """Takes out the items with which simulations of left-out parts are worse by more than a standard error.

        All are tried over 0.1 s. Over a second, which takes ten times as long, they are tried from the one that
        matters least over 0.1 s on, until one is needed.
        """
        gains = self._by_short_simulation()
        for item in sorted(gains, key=lambda k: (gains[k], k)):
            worse = self._errors(self.kept).worse_than(self._errors(self.kept - {item}))
            worse = np.where(self.refits.shown(item), worse, np.nan)
            record = decisions.by_simulation(self._name(item), *mean_with_error(worse), "1 s")
            if record.passed:
                self.records.append(record)
                break
            self._drop(item, record)

    def _by_short_simulation(self) -> dict[int, float]:
        """By kept item, the mean of ln(error without it/error with it) over 0.1 s."""
        assert self.predictions is not None
        tried, gains = sorted(self.kept), dict[int, float]()
        while tried:
            now = self._short(self.kept)
            outcomes = {}
            for item in tried:
                worse = mean_differences(now, self._short(self.kept - {item}))
                outcomes[item] = mean_with_error(np.where(self.refits.shown(item), worse, np.nan))
                gains[item] = -outcomes[item][0]
            records = {k: decisions.by_simulation(self._name(k), *found, "0.1 s") for k, found in outcomes.items()}
            worst = min(tried, key=lambda k: (gains[k], k))
            if records[worst].passed:
                self.records += [records[k] for k in tried]
                break
            self._drop(worst, records[worst])
            del gains[worst]
            # taking one out seldom makes another one worse that was not
            tried = [k for k in tried if k != worst and not records[k].passed]
        return gains

    def against_given(self) -> None:
        """Keeps what predicts left-out parts better than the scene as given by both measures, or else nothing.

        Parts that say nothing of what is kept are not counted.

        The measures are the errors of simulations and the likelihood of innovations, or the rows alone. Tried are all
        that is still kept, the same with the unknowns as given, and the unknowns alone.
        """
        judging = np.any([self.refits.shown(item) for item in self.kept], axis=0)
        if not np.any(judging):
            return
        alone = frozenset({UNKNOWNS}) & frozenset(self.refits.items)
        choices = [choice for choice in dict.fromkeys((self.kept, self.kept - {UNKNOWNS}, alone)) if choice]
        errors = {choice: self._worse_than_given(choice, judging) for choice in choices}
        scores = {self.kept: (errors[self.kept], self._less_likely_than_given(self.kept, judging))}
        best = NOTHING
        # by the errors first: of what is no better than another choice, the likelihood, which takes long, is not asked
        for choice in sorted(choices, key=lambda choice: errors[choice]):
            if choice not in scores:
                scores[choice] = errors[choice], self._less_likely_than_given(choice, judging)
            if _is_better(scores[choice]):
                best = choice
                break
        record = decisions.against_given(best == self.kept, scores[self.kept], self.predictions is not None)
        self.records.append(record)
        why = decisions.BEATEN if _is_better(scores[self.kept]) else record.words
        self.reasons |= dict.fromkeys(self.kept - best, why)
        self.kept = best

    def _worse_than_given(self, choice: Items, judging: Flags) -> float:
        """The mean over the `judging` parts of ln(error/error as given); of the rows where nothing is simulated."""
        if self.predictions is None:
            return self._by_rows_than_given(choice, judging)
        worse = self._errors(choice).worse_than(self._errors(NOTHING))
        known = worse[np.isfinite(worse) & judging]
        return float(np.mean(known)) if len(known) else self._by_rows_than_given(choice, judging)

    def _less_likely_than_given(self, choice: Items, judging: Flags) -> float:
        """The same of the differences of −ln likelihood of a sample."""
        if self.predictions is None:
            return self._by_rows_than_given(choice, judging)
        difference = self._surprisal(choice) - self._surprisal(NOTHING)
        known = difference[np.isfinite(difference) & judging]
        return float(np.mean(known)) if len(known) else self._by_rows_than_given(choice, judging)

    def _by_rows_than_given(self, choice: Items, judging: Flags) -> float:
        return float(np.mean((self.refits.chi_square(choice) - self.refits.chi_square(NOTHING))[judging]))

    def _surprisal(self, kept: Items) -> Array:
        """(p,) −ln likelihood of a sample's innovation, the mean over each part; NaN where it cannot be computed."""
        assert self.predictions is not None
        if kept not in self.filtered:
            self.filtered[kept] = surprisals(self.predictions, self.refits.models(kept), self.parts)
        return self.filtered[kept]

    def selection(self, problem: Problem) -> Selection:
        """The choice, fitted to all recordings."""
        fitted, model = self.refits.fitted, self.refits.fitted.model
        held = len(model.unknown) > 0 and UNKNOWNS not in self.kept
        unknown = self.refits.prior_mean if self.kept else self.refits.given
        # what a search has set aside is not as given
        aside = unknown != self.refits.given
        if self.kept != frozenset(self.refits.items):
            effects = tuple(effect for k, effect in enumerate(model.effects) if k in self.kept)
            start = replace(model, effects=effects)
            if held:
                start = replace(start, unknown=self.refits.prior_mean, free=(), held=True)
            fitted = unbiased_fit(problem, start)
            if held:
                # held by a prior that is narrow, not of width zero
                fitted = replace(fitted, model=replace(fitted.model, unknown=unknown, held=not np.any(aside)))
        left = tuple((model.effects[k], reason) for k, reason in sorted(self.reasons.items()) if k != UNKNOWNS)
        why = self.reasons.get(UNKNOWNS, "") if held and not np.all(aside) else ""
        return Selection(fitted, left, why, tuple(self.records))

    def _judged(self, item: int, gains: Array) -> float:
        """The mean of `gains` (p,) over the parts that tell something of the item; infinite where none does."""
        shown = self.refits.shown(item)
        return float(np.mean(gains[shown])) if np.any(shown) else np.inf

    def _drop(self, item: int, record: Record) -> None:
        self.kept = self.kept - {item}
        self.reasons[item] = record.words
        self.records.append(record)

    def _name(self, item: int) -> str:
        if item == UNKNOWNS:
            return decisions.UNKNOWNS
        effect = self.refits.fitted.model.effects[item]
        return f"{effect.name}@{effect.at}"

    def _short(self, kept: Items) -> Sequence[ByColumn]:
        """ln rms errors of each part over 0.1 s."""
        assert self.predictions is not None
        return errors_over(self.predictions, self.refits.models(kept), self.parts, SHORT_HORIZON)[0]

    def _errors(self, kept: Items) -> Errors:
        assert self.predictions is not None
        if kept not in self.simulated:
            self.simulated[kept] = both_horizons(self.predictions, self.refits.models(kept), self.parts)
        return self.simulated[kept]


def _is_better(scores: tuple[float, float]) -> bool:
    """Whether by one measure it is better, and by none worse."""
    return max(scores) <= 0.0 and min(scores) < 0.0
