"""Which explanation is stood by, and the kind of verdict: by one search, or by another that reckons with more."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.adequacy import by_run
from drake_cafim.diagnosis.evidence import leaves_noise
from drake_cafim.diagnosis.fitting import Fit
from drake_cafim.diagnosis.problem import Problem
from drake_cafim.diagnosis.search import Outcome, Settings, search
from drake_cafim.diagnosis.search_again import search_again
from drake_cafim.diagnosis.unknown_force import told
from drake_cafim.diagnosis.verdict import Kind
from drake_cafim.diagnosis.weak_problem import WeakProblem
from drake_cafim.typing import Array

EXPLAINS = 0.5
"""Under `unexplained`, effects are named only where they take away more of the excess than they leave, in the channel
that they explain most of: another one may hold what nobody knows."""
WIDER = (2.0, 4.0, 8.0)
"""Times the width of the usual windows, over which what shakes fast is averaged out: up to half a second."""


@dataclass(frozen=True)
class Judgement:
    """The `best` fit of a search's `outcome`, the verdict's kind, and what is to be remarked."""

    outcome: Outcome
    best: Fit
    kind: Kind
    noise_remarks: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def judged(problem: Problem, settings: Settings, progress: Callable[[str], None]) -> Judgement:
    """What the recordings say is missing.

    Where a search ends without an explanation, forces that nobody knows are reckoned with; and where it names nothing,
    what shakes fast is averaged out.
    """
    outcome = search(problem, settings, progress)
    first = _of_search(outcome, settings)
    if first.kind != "unexplained" or not settings.most_effects or not isinstance(problem, WeakProblem):
        return first
    again = search_again(outcome, settings, progress)
    if again is not None:
        return Judgement(again, again.best, "explained", noise_remarks=told(again.problem))
    return first if first.best.model.effects else _over_wider_windows(problem, settings, progress) or first


def _over_wider_windows(problem: WeakProblem, settings: Settings, progress: Callable[[str], None]) -> Judgement | None:
    """What is named over the narrowest of wider windows that name anything; what shakes faster is still there."""
    for times in WIDER:
        wide = problem.over_wider_windows(times)
        if wide is None:
            break
        width = wide.runs[0].weak.samples.windows.width
        progress(f"searching over windows of {width:.2g} s")
        found = _of_search(search(wide, settings, progress), settings)
        if found.best.model.effects:
            note = f"named, and judged, over windows of {width:.2g} s: what shakes faster hid it, and was averaged out"
            shown = replace(found.outcome, nominal_problem=problem)
            return Judgement(shown, found.best, "unexplained", notes=(note,))
    return None


def _of_search(outcome: Outcome, settings: Settings) -> Judgement:
    """What one search says."""
    if outcome.detection_p_value > settings.false_alarm_rate:
        return Judgement(outcome, outcome.nominal, "none")
    best = outcome.best
    if best.model.effects and leaves_noise(outcome.problem, best, settings.false_alarm_rate):
        return Judgement(outcome, best, "explained")
    before, after = _excess(outcome.nominal_problem, outcome.nominal), _excess(outcome.problem, best)
    most = int(np.argmax(before - after))
    if after[most] > (1.0 - EXPLAINS) * before[most]:
        return Judgement(outcome, outcome.nominal, "unexplained")
    return Judgement(outcome, best, "unexplained")


def _excess(problem: Problem, one: Fit) -> Array:
    """What is beyond noise in each kind of row, (r,): the mean square of whitened rows less one."""
    rows = np.concatenate([z for _, z in by_run(problem, one.residual[: problem.rows])])
    return np.asarray(np.mean(rows**2, axis=0) - 1.0)
