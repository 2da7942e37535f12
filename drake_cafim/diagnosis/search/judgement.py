"""Chooses the explanation and the kind of verdict: from the first search, or from one under other assumptions."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.fit.evidence import leaves_inaccuracy, leaves_noise
from drake_cafim.diagnosis.fit.fitting import CONVERGED, Fit, fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.search import decisions
from drake_cafim.diagnosis.search.determined import Descent, descend
from drake_cafim.diagnosis.search.far_unknowns import far_unknowns
from drake_cafim.diagnosis.search.nested_laws import simplify
from drake_cafim.diagnosis.search.search import Outcome, fit_nominal, search
from drake_cafim.diagnosis.search.search_under_unknown_force import (
    UNKNOWN_FORCES,
    geometric_mean,
    geometric_misfit,
    is_explained,
    mean_square,
    misfit_by_row,
    search_again,
)
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.thresholds import MISFIT_GROWTH_ALLOWED, NAMED_EXCESS_SHARE, WIDER_WINDOW_RATIOS
from drake_cafim.diagnosis.trace import Record, Trace
from drake_cafim.diagnosis.verdict import Kind
from drake_cafim.effects.effect import Effect
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Judgement:
    """The accepted fit `best` of a search's `outcome`, the kind of verdict, and remarks and notes for the report."""

    outcome: Outcome
    best: Fit
    kind: Kind
    noise_remarks: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    search: str = ""
    """The name of the search in the trace; empty for the first one."""
    left: float | None = None
    """Mean square of the rows that `best` leaves, in units of the channels' noise; None where its χ² says that."""
    adequate: bool = False
    """Whether `best` leaves only noise, and only an unknown far from its prior makes the verdict `unexplained`."""
    withheld: tuple[Effect, ...] = ()
    """Effects that the search accepted and that are not named, since the recordings support others as much."""
    rivals: Mapping[Key, float] = field(default_factory=dict)
    """Probabilities of laws that were compared with what is named otherwise than by the rows."""
    std: Array | None = None
    """(n + k,) standard deviations of the numbers of `best`, where the rows do not tell them."""
    corrected: Fit | None = None
    """What goes into the corrected scene, where that is settled; None where it is still to be chosen."""


def judge(
    problem: SearchProblem,
    settings: Settings,
    progress: Callable[[str], None],
    trace: Trace | None = None,
    begin: Sequence[Effect] = (),
) -> Judgement:
    """The judgement on `problem`; each decision is added to `trace`. A search for many effects begins with `begin`.

    Where the first search ends `unexplained`, a second one counts unknown forces at the joints as noise. If no effect
    stands out of these and none is named, searches over wider windows average fast vibration out. An unknown parameter
    that is far from its prior makes the verdict `unexplained`, whatever remains. Where no search can be computed, the
    unknowns alone are fitted.
    """
    trace = Trace() if trace is None else trace
    found = compute(lambda: _judge_searches(problem, settings, progress, trace, begin))
    if isinstance(found, NotComputable):
        bare = replace(settings, most_effects=0)
        judgement = _of_search(search(problem, bare, progress, trace=trace), bare, trace)
        found = _with_note(judgement, f"no search for effects can be computed: {found.reason}")
    return _with_far_unknowns(problem, found, settings, trace)


def judge_again(
    problem: SearchProblem, before: Judgement, settings: Settings, progress: Callable[[str], None], trace: Trace
) -> Judgement | None:
    """The judgement `before`, made under unknown forces, on the same recordings with less noise of the efforts.

    Its effects, and those that explained less than was left, are fitted and compared with others again. No more are
    looked for: the noise of the efforts was among the forces out of which they stood. None where no effect stands out.
    """
    progress("fitting the nominal model")
    problem, nominal = fit_nominal(problem, trace)
    outcome = replace(before.outcome, problem=problem, nominal_problem=problem, nominal=nominal)
    own = trace.of_search(UNKNOWN_FORCES)
    begin = _all_found(before).effects
    found = _under_unknown_forces(outcome, settings, progress, own, begin, more=False)
    return None if found is None else _with_far_unknowns(problem, found, settings, trace)


def fit_again(problem: SearchProblem, before: Judgement) -> Model:
    """The effects that `judge_again` begins with, fitted under the forces that they leave."""
    model = _all_found(before)
    force = problem.likeliest_force(model)
    return model if force is None else fit(problem.with_unknown_force(force, model), model, tolerance=CONVERGED).model


def _all_found(judgement: Judgement) -> Model:
    """What is named, and what explained less than was left at its place."""
    return judgement.best.model.with_effects(judgement.outcome.unsupported)


def _with_far_unknowns(problem: SearchProblem, judgement: Judgement, settings: Settings, trace: Trace) -> Judgement:
    """The judgement, `unexplained` where an unknown parameter is far from its prior."""
    far = far_unknowns(problem.scene, judgement.best.model) if settings.most_effects else ()
    own = trace.of_search(judgement.search)
    own.add(*(decisions.record_far_unknown(problem.scene, unknown, judgement.best.model) for unknown in far))
    return replace(judgement, kind="unexplained", adequate=judgement.kind != "unexplained") if far else judgement


def _judge_searches(
    problem: SearchProblem,
    settings: Settings,
    progress: Callable[[str], None],
    trace: Trace,
    begin: Sequence[Effect] = (),
) -> Judgement:
    """`judge` without the check of how far the unknowns are from their priors."""
    outcome = search(problem, settings, progress, trace=trace, put_off=True, many=bool(begin))
    first = _of_search(outcome, settings, trace) if outcome.compare is None else None
    if first is not None and (first.kind != "unexplained" or not settings.most_effects):
        return first
    again = compute(lambda: _under_unknown_forces(outcome, settings, progress, trace.of_search(UNKNOWN_FORCES), begin))
    if isinstance(again, Judgement) and first is None and _explains_little(outcome, again):
        outcome = outcome.compared()
        first = _of_search(outcome, settings, trace)
        if first.kind != "unexplained":
            return first
    if isinstance(again, Judgement):
        preferred = _preference(first, again) if first else None
        if preferred is None:
            return again
        trace.add(preferred)
    if first is None:
        outcome = outcome.compared()
        first = _of_search(outcome, settings, trace)
        if first.kind != "unexplained":
            return first
    if isinstance(again, NotComputable):
        first = _with_note(first, f"a search that counts unknown forces as noise cannot be computed: {again.reason}")
    if first.best.model.effects:
        return first
    wider = compute(lambda: _over_wider_windows(problem, settings, progress, trace))
    if isinstance(wider, NotComputable):
        return _with_note(first, f"a search over wider windows cannot be computed: {wider.reason}")
    return wider or first


def _under_unknown_forces(
    outcome: Outcome,
    settings: Settings,
    progress: Callable[[str], None],
    trace: Trace,
    begin: Sequence[Effect] = (),
    more: bool = True,
) -> Judgement | None:
    """The judgement under unknown forces at the joints; None where no effect stands out of them."""
    again = search_again(outcome, settings, progress, trace, begin, more)
    if again is None:
        return None
    explained = is_explained(again, outcome.nominal, settings, trace)
    left, had = (geometric_misfit(outcome.nominal_problem, found) for found in (again.best, outcome.nominal))
    if not left < had:
        trace.add(decisions.record_worse_than_none(again.best, left, had))
        return None
    return Judgement(
        again,
        again.best,
        "explained" if explained else "unexplained",
        noise_remarks=again.problem.force_remarks,
        search=UNKNOWN_FORCES,
        left=mean_square(outcome.nominal_problem, again.best),
    )


def _preference(first: Judgement, again: Judgement) -> Record | None:
    """Why what the first search named is preferred to what the second one, under unknown forces, did; None if not.

    Unknown forces as noise hide what acts as white forces do: a few laws may leave less without them, or the second
    search may fit some kinds of rows at the cost of others.
    """
    if not first.best.model.effects:
        return None
    problem, ended = first.outcome.nominal_problem, (first.outcome.nominal, first.best, again.best)
    had, by_first, by_second = (misfit_by_row(problem, found.model) for found in ended)
    less, more = geometric_mean(by_first), geometric_mean(by_second)
    if less < more:
        return decisions.record_leaves_less(first.best, again.best, less, more)
    # what leaves only noise and small forces explains all rows
    if again.kind == "unexplained" and _costs_others(had, by_first, by_second):
        return decisions.record_cost_of_others(again.best, _growth(had, by_second), MISFIT_GROWTH_ALLOWED)
    return None


def _explains_little(outcome: Outcome, again: Judgement) -> bool:
    """Whether the second search leaves more than half of the misfit, so that the first one should be ended, too.

    Or far more of some kind of row than there was. Only where the first search had found effects before it was put off
    that are better: to compare them with their rivals takes long, and in vain where the second search explains more.
    """
    if not outcome.best.model.effects:
        return False
    ended = (outcome.nominal, outcome.best, again.best)
    had, by_first, left = (misfit_by_row(outcome.nominal_problem, found.model) for found in ended)
    little = geometric_mean(left) - 1.0 > (1.0 - NAMED_EXCESS_SHARE) * (geometric_mean(had) - 1.0)
    costly = again.kind == "unexplained" and _costs_others(had, by_first, left)
    return costly or (little and geometric_mean(by_first) < geometric_mean(left))


def _costs_others(had: Array, by_first: Array, by_second: Array) -> bool:
    """Whether the second search's effects, and not the first one's, leave far more of a kind of row than there was.

    Each is the misfit (r,) of the kinds of rows; `had` is that without any effect.
    """
    return _growth(had, by_first) <= MISFIT_GROWTH_ALLOWED < _growth(had, by_second)


def _growth(had: Array, left: Array) -> float:
    """The largest factor by which what is `left` (r,) of a kind of row exceeds what it `had`, or noise."""
    return float(np.max(left / np.maximum(had, 1.0)))


def narrowed(judgement: Judgement, narrow: Callable[[Judgement], Judgement]) -> Judgement:
    """`narrow(judgement)`, which withholds names; the judgement as it is, with a note, where that has no result."""
    found = compute(lambda: narrow(judgement))
    if isinstance(found, NotComputable):
        return _with_note(judgement, f"whether the recordings refute what is named cannot be computed: {found.reason}")
    return found


def _with_note(judgement: Judgement, note: str) -> Judgement:
    return replace(judgement, notes=(*judgement.notes, note))


def _over_wider_windows(
    problem: SearchProblem, settings: Settings, progress: Callable[[str], None], trace: Trace
) -> Judgement | None:
    """The judgement over the narrowest wider windows over which an effect is named; None where none is.

    Its kind is `unexplained`, since the vibration that was averaged out is not explained.
    """
    for times in WIDER_WINDOW_RATIOS:
        found = problem.over_wider_windows(times)
        if found is None:
            break
        wide, width = found
        progress(f"searching over windows of {width:.2g} s")
        own = trace.of_search(f"windows of {width:.2g} s")
        outcome = search(wide, settings, progress, trace=own)
        judgement = _of_search(outcome, settings, own)
        if not judgement.best.model.effects:
            judgement = _under_unknown_forces(outcome, settings, progress, own) or judgement
        own.add(decisions.record_wider_windows(judgement.best, width))
        if judgement.best.model.effects:
            note = (
                f"the effects were found over windows of {width:.2g} s, which average out fast vibration that hid them"
            )
            shown = replace(judgement.outcome, nominal_problem=problem)
            return Judgement(shown, judgement.best, "unexplained", notes=(note,), search=own.search)
    return None


def _of_search(outcome: Outcome, settings: Settings, trace: Trace) -> Judgement:
    """The judgement on the outcome of one search."""
    if outcome.detection_p_value > settings.false_alarm_rate:
        return Judgement(outcome, outcome.nominal, "none")
    problem, best, descents = simplify(
        outcome.problem, outcome.best, settings.false_alarm_rate / max(outcome.hypotheses, 1), settings.adequacy_level
    )
    trace.add(*(decisions.record_descent(outcome.best.model, descent) for descent in descents))
    outcome = _with_simpler(outcome, problem, best, descents)
    trace.add(*decisions.record_residual(outcome.problem, best, settings.adequacy_level))
    if best.model.named and leaves_noise(outcome.problem, best, settings.adequacy_level):
        return Judgement(outcome, best, "explained")
    if best.model.named and leaves_inaccuracy(outcome.problem, best):
        trace.add(*decisions.record_inaccuracy(outcome.problem, best))
        return Judgement(outcome, best, "explained")
    before, after = _excess(outcome.nominal_problem, outcome.nominal), _excess(outcome.problem, best)
    most = int(np.argmax(before - after))
    # under its own covariance an explanation may leave more than the nominal model does: then it is none
    if best.model.named and not best.reduced_chi_square < outcome.nominal.reduced_chi_square:
        trace.add(decisions.record_worse_than_none(best, best.reduced_chi_square, outcome.nominal.reduced_chi_square))
        return Judgement(outcome, outcome.nominal, "unexplained")
    if best.model.named:
        row = outcome.problem.pictures.row_labels[most]
        share = float(1.0 - after[most] / before[most]) if before[most] > 0.0 else 0.0
        trace.add(decisions.record_support(best, row, share, NAMED_EXCESS_SHARE))
    if after[most] > (1.0 - NAMED_EXCESS_SHARE) * before[most]:
        return Judgement(outcome, outcome.nominal, "unexplained")
    simpler, descents = descend(outcome.problem, best, outcome.problem.hypotheses())
    trace.add(*(decisions.record_descent(best.model, descent) for descent in descents))
    outcome = _with_simpler(outcome, outcome.problem, simpler, descents)
    return Judgement(outcome, simpler, "unexplained")


def _with_simpler(outcome: Outcome, problem: SearchProblem, simpler: Fit, descents: Sequence[Descent]) -> Outcome:
    """The outcome with the `simpler` explanation, fitted to `problem`, that `descents` left of its best one."""
    if not descents:
        return outcome
    probability = dict(outcome.probability)
    for descent in descents:
        # the laws are nested: what speaks for the larger one speaks for the simpler one
        larger = probability.pop(descent.effect.key, 1.0)
        if descent.law is not None:
            probability[descent.law.key] = min(probability.get(descent.law.key, 0.0) + larger, 1.0)
    replaced = {descent.effect.key for descent in descents}
    others = tuple(other for other in outcome.competing if not other.model.keys & replaced)
    return replace(outcome, problem=problem, best=simpler, competing=(simpler, *others), probability=probability)


def _excess(problem: Problem, found: Fit) -> Array:
    """(r,) excess over noise of each row of a window: mean square of the whitened rows − 1."""
    rows = np.concatenate([z for _, z in by_run(problem, found.residual[: problem.rows])])
    return np.asarray(np.mean(rows**2, axis=0) - 1.0)
