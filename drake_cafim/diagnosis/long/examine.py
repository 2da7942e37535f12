"""Diagnoses recordings in parts: the first minute, a look at all, a search on those that tell most, a fit to all."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.assembly import parameters_of, verdict_of
from drake_cafim.diagnosis.diagnose import judge_prepared, select_findings
from drake_cafim.diagnosis.fit.adequacy import adequacy
from drake_cafim.diagnosis.fit.evidence import scale_of
from drake_cafim.diagnosis.fit.intervals import standard_deviations
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.left_out.selection import Selection
from drake_cafim.diagnosis.long.budget import FIRST_SECONDS, Budget
from drake_cafim.diagnosis.long.choice import choose
from drake_cafim.diagnosis.long.fit_of_all import FitOfAll, fit_all
from drake_cafim.diagnosis.long.parts import Parts
from drake_cafim.diagnosis.long.scan import scan
from drake_cafim.diagnosis.preparation import Prepared, PreparedRecordings, prepare
from drake_cafim.diagnosis.search.conclusion import record_conclusion
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.search.search import Outcome
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.trace import names_of, spoken
from drake_cafim.diagnosis.verdict import Explanation, Verdict
from drake_cafim.errors import InputError
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.recordings.long import LongRecording
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

Progress = Callable[[str], None]


@dataclass(frozen=True)
class LongDiagnosis:
    """The verdict, the outcome of the search, and the parts that were in memory for it, fitted to and held out."""

    verdict: Verdict
    outcome: Outcome
    searched: tuple[Recording, ...]
    held_out: tuple[Recording, ...]


def examine_parts(
    scene: Scene,
    recordings: Sequence[LongRecording],
    held_out: Sequence[LongRecording],
    budget: Budget,
    settings: Settings | None = None,
    progress: Progress = lambda text: None,
) -> LongDiagnosis:
    """The diagnosis of recordings of joints that together are longer than `budget` allows to hold at once.

    Strengths, their intervals, parameters and the test of what remains are of all parts; which effects there are, and
    figures of simulations, of those that were searched. Raises `InputError` as `diagnose` does.
    """
    settings, parts = settings or Settings(), Parts(recordings)
    held = tuple(_spread(Parts(held_out), max(1, budget.most(budget.part) // 2)))
    prepared, judgement = _first(scene, parts, budget, settings, progress)
    seen, notes = scan(parts, prepared, judgement.best.model, progress)
    if not seen:
        raise InputError(f"{parts.name(0)}: no part of it can be used: {notes[0]}")
    usable = [part.number for part in seen]
    most = budget.most(max(part.samples for part in seen))
    chosen = choose(seen, most)
    progress(f"searching {parts.words(chosen)}")
    searched = tuple(parts.read(number) for number in chosen)
    found, judgement, trace = judge_prepared(prepare(scene, searched, held), settings, progress)
    selection, unselected = select_findings(found, judgement, progress)
    assert isinstance(found, Prepared)
    whole = fit_all(found.scene, _LayOut(parts, found, judgement), usable, judgement.best.model, progress)
    judgement = _judged(judgement, whole, settings)
    notes = [*_reading_notes(parts, chosen, usable, whole, len(held)), *notes]
    notes += [f"{recording.name}: {note}" for recording in recordings for note in recording.notes]
    judgement = replace(judgement, notes=(*judgement.notes, *unselected))
    kept = _of_all(selection, whole)
    verdict = verdict_of(found, judgement, kept, progress)
    trace.of_search(judgement.search).add(*kept.records, *record_conclusion(verdict, judgement))
    verdict = _with_all(replace(verdict, trace=trace.records), found, judgement, whole)
    return LongDiagnosis(replace(verdict, notes=(*notes, *verdict.notes)), judgement.outcome, searched, held)


@dataclass(frozen=True)
class _LayOut:
    """Sets up one part as the search was: its noise, its unknown forces, the width of its windows."""

    parts: Parts
    prepared: Prepared
    judgement: Judgement

    def __call__(self, number: int, model: Model) -> WeakProblem:
        searched, form = self.judgement.outcome.problem, self.prepared.laid_out(self.parts.read(number))
        assert isinstance(searched, WeakProblem)
        problem = WeakProblem.of(self.prepared.scene, [form], model, searched.unknown_force)
        times = searched.runs[0].weak.samples.windows.width / form.samples.windows.width
        wider = problem.over_wider_windows(times) if times > 1.5 else None
        return problem if wider is None else wider[0]


def _first(
    scene: Scene, parts: Parts, budget: Budget, settings: Settings, progress: Progress
) -> tuple[Prepared, Judgement]:
    """What the beginning says alone, told on the way; it sets the noise under which the other parts are looked at."""
    numbers: list[int] = []
    for number in range(min(len(parts), budget.most(budget.part))):
        if numbers and parts.span(number)[1] - parts.span(0)[0] > FIRST_SECONDS:
            break
        numbers.append(number)
    words = parts.words(numbers)
    progress(f"diagnosing {words} first")
    first: PreparedRecordings = prepare(scene, [parts.read(number) for number in numbers])
    first, judgement, _ = judge_prepared(first, settings, lambda text: progress(f"{words}: {text}"))
    assert isinstance(first, Prepared)
    named = judgement.best.model.effects
    names = spoken(names_of(effect.key for effect in named)) if named else "no effect"
    progress(f"{words} alone say: {judgement.kind}, {names}; reading on\n")
    return first, judgement


def _spread(parts: Parts, most: int) -> list[Recording]:
    """At most so many parts, evenly spread; all where there are no more."""
    chosen = sorted({round(at) for at in np.linspace(0, len(parts) - 1, min(most, len(parts)))}) if len(parts) else []
    return [parts.read(number) for number in chosen]


def _judged(judgement: Judgement, whole: FitOfAll, settings: Settings) -> Judgement:
    """The judgement with what all parts say of the remains: a verdict that holds for the searched ones alone falls."""
    fitted = whole.fitted
    left = adequacy(whole.problem, fitted.residual, fitted.strengths).p_value
    fine = left > (settings.false_alarm_rate if judgement.kind == "none" else settings.adequacy_level)
    if judgement.kind == "unexplained" or fine or whole.leaves_inaccuracy:
        return judgement
    return replace(judgement, kind="unexplained", adequate=False)


def _of_all(selection: Selection, whole: FitOfAll) -> Selection:
    """The selection with the values that all parts give, where it keeps all that was found."""
    model, kept = whole.fitted.model, selection.fitted
    if kept.model.held or kept.model.keys != model.keys:
        return selection
    return replace(selection, fitted=replace(kept, model=model, covariance=whole.fitted.covariance))


def _with_all(verdict: Verdict, prepared: Prepared, judgement: Judgement, whole: FitOfAll) -> Verdict:
    """The verdict with strengths, parameters and misfit of all parts."""
    fitted, scene = whole.fitted, prepared.scene
    std = compute(lambda: standard_deviations(whole.problem, fitted, scale_of(fitted)))
    known: Array = fitted.std if isinstance(std, NotComputable) else std
    explanation = tuple(_explained(accepted, fitted.model, known, scene) for accepted in verdict.explanation)
    after = fitted.reduced_chi_square if judgement.left is None else judgement.left
    return replace(
        verdict,
        explanation=explanation,
        parameters=parameters_of(scene, fitted),
        reduced_chi_square=(whole.before, after),
    )


def _explained(accepted: Explanation, model: Model, std: Array, scene: Scene) -> Explanation:
    position = len(model.unknown)
    for effect in model.effects:
        if effect.key != accepted.effect.key:
            position += len(effect.strengths)
            continue
        values = dict(accepted.values)
        for strength in effect.strengths:
            own = values[strength.name]
            value = effect.values[strength.name]
            values[strength.name] = replace(own, value=value, std=float(std[position]), efficiency=None)
            position += 1
        return replace(accepted, effect=effect, values=values, sentence=effect.sentence(scene.tree))
    return accepted


def _reading_notes(
    parts: Parts, chosen: Sequence[int], usable: Sequence[int], whole: FitOfAll, held: int
) -> tuple[str, ...]:
    notes = [
        f"the recordings are longer than the memory allows to search at once: effects were looked for in "
        f"{parts.words(chosen)}, {len(chosen)} of {len(parts)} parts, which tell most",
        f"strengths, parameters, their intervals and the test of what remains are of all {len(usable)} parts; the "
        "figures of fit and the pictures are of the parts that were searched",
    ]
    if held:
        notes.append(f"held-out figures are of {held} parts, evenly spread")
    if not whole.settled:
        notes.append("the fit to all parts has not settled: its steps still change a value by more than a tenth of std")
    return tuple(notes)
