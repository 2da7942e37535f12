"""Which explanation is stood by, and the kind of verdict: by one search, or by another that reckons with more."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.fit.evidence import leaves_noise
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.search import decisions
from drake_cafim.diagnosis.search.far_unknowns import far_unknowns
from drake_cafim.diagnosis.search.search import Outcome, search
from drake_cafim.diagnosis.search.search_under_unknown_force import UNKNOWN_FORCES, search_again
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.thresholds import NAMED_EXCESS_SHARE, WIDER_WINDOW_RATIOS
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.diagnosis.verdict import Kind
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Judgement:
    """The `best` fit of a search's `outcome`, the verdict's kind, and what is to be remarked."""

    outcome: Outcome
    best: Fit
    kind: Kind
    noise_remarks: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    search: str = ""
    """The search that it is of, as the trace calls it."""
    adequate: bool = False
    """Whether `best` leaves nothing but noise, and an unknown far from its prior is all that is unexplained."""


def judged(
    problem: SearchProblem, settings: Settings, progress: Callable[[str], None], trace: Trace | None = None
) -> Judgement:
    """What the recordings say is missing; each decision is added to `trace`.

    Where a search ends without an explanation, unknown forces are added to the noise; and where it names nothing, what
    shakes fast is averaged out. An unknown parameter that is far from its prior is a mismatch by itself.
    """
    trace = Trace() if trace is None else trace
    judgement = _judged(problem, settings, progress, trace)
    far = far_unknowns(problem.scene, judgement.best.model) if settings.most_effects else ()
    own = trace.of_search(judgement.search)
    own.add(*(decisions.far(problem.scene, unknown, judgement.best.model) for unknown in far))
    return replace(judgement, kind="unexplained", adequate=judgement.kind != "unexplained") if far else judgement


def _judged(problem: SearchProblem, settings: Settings, progress: Callable[[str], None], trace: Trace) -> Judgement:
    """`judged`, wherever the unknowns are."""
    outcome = search(problem, settings, progress, trace=trace)
    first = _of_search(outcome, settings, trace)
    if first.kind != "unexplained" or not settings.most_effects:
        return first
    again = compute(lambda: search_again(outcome, settings, progress, trace.of_search(UNKNOWN_FORCES)))
    if isinstance(again, NotComputable):
        first = _noted(first, f"a search that reckons with forces that nobody knows cannot be computed: {again.reason}")
    elif again is not None:
        remarks = again.problem.force_remarks
        return Judgement(again, again.best, "explained", noise_remarks=remarks, search=UNKNOWN_FORCES)
    if first.best.model.effects:
        return first
    wider = compute(lambda: _over_wider_windows(problem, settings, progress, trace))
    if isinstance(wider, NotComputable):
        return _noted(first, f"a search over wider windows cannot be computed: {wider.reason}")
    return wider or first


def _noted(judgement: Judgement, note: str) -> Judgement:
    return replace(judgement, notes=(*judgement.notes, note))


def _over_wider_windows(
    problem: SearchProblem, settings: Settings, progress: Callable[[str], None], trace: Trace
) -> Judgement | None:
    """What is named over the narrowest of wider windows that name anything; what shakes faster is still there."""
    for times in WIDER_WINDOW_RATIOS:
        found = problem.over_wider_windows(times)
        if found is None:
            break
        wide, width = found
        progress(f"searching over windows of {width:.2g} s")
        own = trace.of_search(f"windows of {width:.2g} s")
        judgement = _of_search(search(wide, settings, progress, trace=own), settings, own)
        own.add(decisions.over_wider_windows(judgement.best, width))
        if judgement.best.model.effects:
            note = f"named, and judged, over windows of {width:.2g} s: what shakes faster hid it, and was averaged out"
            shown = replace(judgement.outcome, nominal_problem=problem)
            return Judgement(shown, judgement.best, "unexplained", notes=(note,), search=own.search)
    return None


def _of_search(outcome: Outcome, settings: Settings, trace: Trace) -> Judgement:
    """What one search says."""
    if outcome.detection_p_value > settings.false_alarm_rate:
        return Judgement(outcome, outcome.nominal, "none")
    best = outcome.best
    trace.add(*decisions.remaining(outcome.problem, best, settings.false_alarm_rate))
    if best.model.named and leaves_noise(outcome.problem, best, settings.false_alarm_rate):
        return Judgement(outcome, best, "explained")
    before, after = _excess(outcome.nominal_problem, outcome.nominal), _excess(outcome.problem, best)
    most = int(np.argmax(before - after))
    if best.model.named and not best.reduced_chi_square < outcome.nominal.reduced_chi_square:
        trace.add(decisions.worse_than_none(best, outcome.nominal))
        return Judgement(outcome, outcome.nominal, "unexplained")
    if best.model.named:
        row = outcome.problem.pictures.row_labels[most]
        share = float(1.0 - after[most] / before[most]) if before[most] > 0.0 else 0.0
        trace.add(decisions.supported(best, row, share, NAMED_EXCESS_SHARE))
    if after[most] > (1.0 - NAMED_EXCESS_SHARE) * before[most]:
        return Judgement(outcome, outcome.nominal, "unexplained")
    return Judgement(outcome, best, "unexplained")


def _excess(problem: Problem, one: Fit) -> Array:
    """What is beyond noise in each kind of row, (r,): the mean square of whitened rows less one."""
    rows = np.concatenate([z for _, z in by_run(problem, one.residual[: problem.rows])])
    return np.asarray(np.mean(rows**2, axis=0) - 1.0)
