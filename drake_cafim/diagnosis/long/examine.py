"""Diagnoses recordings in parts: the first minute, a look at all, a search on those that tell most, a fit to all."""

import gc
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, cast

import numpy as np

from drake_cafim.diagnosis.assembly import parameters_of, verdict_of
from drake_cafim.diagnosis.diagnose import judge_prepared, select_findings, with_overstated_unknown
from drake_cafim.diagnosis.fit.adequacy import adequacy
from drake_cafim.diagnosis.fit.evidence import leaves_inaccuracy, scale_of
from drake_cafim.diagnosis.fit.intervals import standard_deviations
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.left_out.selection import Selection
from drake_cafim.diagnosis.long.budget import FIRST_SECONDS, Budget
from drake_cafim.diagnosis.long.changes import with_changes
from drake_cafim.diagnosis.long.choice import choose
from drake_cafim.diagnosis.long.fit_of_all import FitOfAll, fit_all
from drake_cafim.diagnosis.long.model_as_json import model_as_json, model_from_json
from drake_cafim.diagnosis.long.parts import Parts
from drake_cafim.diagnosis.long.scan import scan
from drake_cafim.diagnosis.long.stretches import Change, cut_at_changes, stretches_of
from drake_cafim.diagnosis.notes.overstated import Overstated
from drake_cafim.diagnosis.preparation import Prepared, PreparedRecordings, prepare
from drake_cafim.diagnosis.search.conclusion import record_conclusion
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.search.search import Outcome
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.trace import Trace, names_of, spoken
from drake_cafim.diagnosis.verdict import Explanation, Kind, Value, Verdict
from drake_cafim.errors import InputError
from drake_cafim.kept import NOTHING_KEPT, Kept
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.recordings.long import LongRecording
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

Progress = Callable[[str], None]
SEARCHED_ALONE = "the recordings are longer than can be simulated at once: all that is told is of"


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
    jobs: int = 1,
    kept: Kept = NOTHING_KEPT,
) -> LongDiagnosis:
    """The diagnosis of recordings of joints that together are longer than `budget` allows to hold at once.

    Strengths, their intervals, parameters and the test of what remains are of all parts; which effects there are, and
    figures of simulations, of those that were searched. `jobs` processes look at parts and fit to them. What is
    finished goes into `kept`, and is not done again where it is there: all but the last search. Raises `InputError` as
    `diagnose` does.
    """
    settings, parts = settings or Settings(), Parts.of(recordings)
    held = tuple(_spread(Parts.of(held_out), max(1, budget.most(budget.part) // 2)))
    first, model = _first(scene, parts, budget, settings, progress, kept)
    seen, unused = scan(parts, first, model, progress, jobs, kept)
    if not seen:
        raise InputError(f"{parts.name(0)}: no part of it can be used: {unused[0]}")
    most = budget.most(max(part.samples for part in seen))
    searches: list[_Search] = []
    state: tuple[Prepared, Judgement, Trace] | None = None
    stretches = stretches_of(seen, settings.false_alarm_rate)
    for index, stretch in enumerate(stretches):
        name = f"search_{index}"
        before = kept.read(name, partial(_Search.from_json, first.scene)) if index < len(stretches) - 1 else None
        if before is not None and before.numbers == stretch.numbers:
            searches.append(before)
            continue
        chosen = choose(stretch.inner, most)
        words = parts.words(chosen)
        progress(f"searching {words}")
        # what an earlier search had in memory goes before the next one begins
        state = None
        gc.collect()
        searched = tuple(parts.read(number) for number in chosen)
        state = _judge(_prepared(scene, searched, held, first.overstated), None, settings, progress)
        best = state[1].best.model
        probability = dict(state[1].outcome.probability)
        searches.append(_Search(stretch.numbers, words, len(chosen), best, state[1].kind, probability))
        kept.write(name, searches[-1].as_json(first.scene))
    assert state is not None
    prepared, judgement, trace = state
    selection, unselected = select_findings(prepared, judgement, progress, jobs)
    if judgement.std is not None:
        # the equations of all parts would move what simulations settle
        told = replace(judgement, notes=(*judgement.notes, *unselected))
        verdict = verdict_of(prepared, told, selection, progress, jobs)
        trace.of_search(judgement.search).add(*selection.records, *record_conclusion(verdict, judgement))
        notes = [f"{SEARCHED_ALONE}: {searches[-1].words}", *unused]
        return LongDiagnosis(
            replace(verdict, trace=trace.records, notes=(*notes, *verdict.notes)), judgement.outcome, searched, held
        )
    searches = _joined(searches)
    lay_out = _LayOut(parts, prepared, judgement)
    whole, changes = _fit_whole(lay_out, searches, progress, jobs, kept)
    judgement = _judged(judgement, searches, whole, settings)
    notes = [*_reading_notes(searches, changes, len(parts), whole, len(held)), *unused]
    notes += [f"{recording.name}: {note}" for recording in recordings for note in recording.notes]
    judgement = replace(judgement, notes=(*judgement.notes, *unselected))
    selection = _of_all(selection, whole)
    verdict = verdict_of(prepared, judgement, selection, progress, jobs)
    trace.of_search(judgement.search).add(*selection.records, *record_conclusion(verdict, judgement))
    verdict = _with_all(replace(verdict, trace=trace.records), prepared.scene, judgement, searches, whole)
    verdict = with_changes(verdict, [search.effects for search in searches], changes)
    return LongDiagnosis(replace(verdict, notes=(*notes, *verdict.notes)), judgement.outcome, searched, held)


@dataclass(frozen=True)
class _Search:
    """What a search found in a stretch, whose parts have these `numbers`: `words` say which `count` of them it read."""

    numbers: tuple[int, ...]
    words: str
    count: int
    model: Model
    kind: Kind
    probability: dict[Key, float]

    @property
    def effects(self) -> frozenset[Key]:
        """The keys of the effects that it names."""
        return frozenset(effect.key for effect in self.model.effects)

    def as_json(self, scene: Scene) -> dict[str, Any] | None:
        """As plain values; None for a model of effects that are not of the scene's vocabulary."""
        model = model_as_json(self.model, scene)
        probability = [[*key, value] for key, value in self.probability.items()]
        return model and vars(self) | {"model": model, "probability": probability}

    @classmethod
    def from_json(cls, scene: Scene, raw: dict[str, Any]) -> "_Search":
        """What `as_json` wrote."""
        probability = {(effect, at): float(value) for effect, at, value in raw["probability"]}
        model, numbers = model_from_json(raw["model"], scene), tuple(raw["numbers"])
        return cls(**raw | {"numbers": numbers, "model": model, "probability": probability})


def _joined(searches: Sequence[_Search]) -> list[_Search]:
    """The searches, neighbours that name the same effects as one: there is no change between them."""
    found: list[_Search] = []
    for search in searches:
        if found and found[-1].effects == search.effects:
            before = found.pop()
            search = replace(
                search,
                numbers=(*before.numbers, *search.numbers),
                words=f"{before.words}; {search.words}",
                count=before.count + search.count,
                kind=_worst({before.kind, search.kind}),
                probability=before.probability | search.probability,
            )
        found.append(search)
    return found


def _worst(kinds: set[Kind]) -> Kind:
    """The kind of verdict on several stretches."""
    return "unexplained" if "unexplained" in kinds else "explained" if "explained" in kinds else "none"


def _prepared(
    scene: Scene, searched: Sequence[Recording], held: Sequence[Recording], overstated: Overstated | None
) -> Prepared:
    # throws are never in parts
    prepared = cast(Prepared, prepare(scene, searched, held))
    return prepared if overstated is None else prepared.with_overstated_unknown(overstated)


def _judge(
    prepared: PreparedRecordings, problem: SearchProblem | None, settings: Settings, progress: Progress
) -> tuple[Prepared, Judgement, Trace]:
    judged, judgement, trace = judge_prepared(prepared, problem, settings, progress)
    return cast(Prepared, judged), judgement, trace


def _scene_of(prepared: Prepared) -> Scene:
    """The scene whose priors a fit to all parts has: as stated, but without friction of which far too much is."""
    return prepared.scene if prepared.overstated is None else prepared.searched


@dataclass(frozen=True)
class _LayOut:
    """Sets up one part as the last search was: its noise, its unknown forces, the width of its windows."""

    parts: Parts
    prepared: Prepared
    judgement: Judgement

    def __call__(self, number: int, model: Model) -> WeakProblem:
        searched = cast(WeakProblem, self.judgement.outcome.problem)
        form = self.prepared.laid_out(self.parts.read(number))
        problem = WeakProblem.of(_scene_of(self.prepared), [form], model, searched.unknown_force)
        times = searched.runs[0].weak.samples.windows.width / form.samples.windows.width
        wider = problem.over_wider_windows(times) if times > 1.5 else None
        return problem if wider is None else wider[0]


def _fit_whole(
    lay_out: _LayOut, searches: Sequence[_Search], progress: Progress, jobs: int, kept: Kept
) -> tuple[FitOfAll, tuple[Change, ...]]:
    """The fit to all parts, cut where stretches meet, and where that is."""

    def costs(number: int, stretch: int) -> tuple[Array, Array]:
        problem = lay_out(number, searches[stretch].model)
        rows = problem.rows_of(searches[stretch].model).reshape(problem.runs[0].shape)
        return np.sum(rows**2, axis=1), problem.runs[0].time

    parts, numbers, changes = cut_at_changes(lay_out.parts, [search.numbers for search in searches], costs)
    last = searches[-1].model
    known, earlier = set(last.keys), []
    for search in searches[:-1]:
        earlier += [effect for effect in search.model.effects if effect.key not in known]
        known |= search.effects
    acting = {number: search.effects for search, own in zip(searches, numbers, strict=True) for number in own}
    there = [acting[number] for number in range(len(parts))]
    lay_out, scene = replace(lay_out, parts=parts), _scene_of(lay_out.prepared)
    return fit_all(scene, lay_out, there, last.with_effects(earlier), progress, jobs, kept), changes


def _first(
    scene: Scene, parts: Parts, budget: Budget, settings: Settings, progress: Progress, kept: Kept
) -> tuple[Prepared, Model]:
    """The model and the noise under which the other parts are looked at: what the beginning says, told on the way."""
    before = kept.read("first", lambda raw: _restored(scene, parts, raw))
    if before is not None:
        return before
    numbers: list[int] = []
    reasons: list[InputError] = []
    for number in range(len(parts)):
        if numbers and parts.items[number].end - parts.items[numbers[0]].begin > FIRST_SECONDS:
            break
        try:
            prepare(scene, [parts.read(number)])
            numbers.append(number)
        except InputError as error:
            reasons.append(error)
        if len(numbers) == budget.most(budget.part):
            break
    if not numbers:
        raise reasons[0]
    words = parts.words(numbers)
    progress(f"diagnosing {words} first")
    read = [parts.read(number) for number in numbers]
    prepared = with_overstated_unknown(prepare(scene, read))
    first, judgement, _ = _judge(*prepared, settings, lambda text: progress(f"{words}: {text}"))
    named = judgement.best.model.effects
    names = spoken(names_of(effect.key for effect in named)) if named else "no effect"
    progress(f"{words} alone say: {judgement.kind}, {names}; reading on\n")
    model = model_as_json(judgement.best.model, first.scene)
    overstated = None if first.overstated is None else vars(first.overstated)
    noise = dict(first.effort_noise)
    kept.write("first", model and {"parts": numbers, "effort_noise": noise, "model": model, "overstated": overstated})
    # only its noise is needed, and not what it had in memory
    return replace(first, weak=[]), judgement.best.model


def _restored(scene: Scene, parts: Parts, raw: dict[str, Any]) -> tuple[Prepared, Model]:
    """What `_first` found, from what it kept."""
    overstated = None if raw["overstated"] is None else Overstated(**raw["overstated"])
    first = _prepared(scene, [parts.read(number) for number in raw["parts"]], (), overstated)
    return replace(first, weak=[], effort_noise=raw["effort_noise"]), model_from_json(raw["model"], first.scene)


def _spread(parts: Parts, most: int) -> list[Recording]:
    """At most so many parts, evenly spread; all where there are no more."""
    chosen = sorted({round(at) for at in np.linspace(0, len(parts) - 1, min(most, len(parts)))}) if len(parts) else []
    return [parts.read(number) for number in chosen]


def _judged(judgement: Judgement, searches: Sequence[_Search], whole: FitOfAll, settings: Settings) -> Judgement:
    """The judgement with what all parts say of the remains: a verdict that holds for the searched ones alone falls."""
    kind = _worst({search.kind for search in searches} | {judgement.kind})
    fitted = whole.fitted
    left = adequacy(whole.problem, fitted.residual, fitted.strengths).p_value
    fine = left > (settings.false_alarm_rate if kind == "none" else settings.adequacy_level)
    fine = fine or (kind == "explained" and leaves_inaccuracy(whole.problem, fitted))
    if kind == judgement.kind and (kind == "unexplained" or fine):
        return judgement
    kind = kind if fine else "unexplained"
    return replace(judgement, kind=kind, adequate=False)


def _of_all(selection: Selection, whole: FitOfAll) -> Selection:
    """The selection with the values that all parts give, where it keeps all that was found."""
    model, kept = whole.fitted.model, selection.fitted
    if kept.model.held or selection.unknowns_held or kept.model.keys != model.keys:
        return selection
    return replace(selection, fitted=replace(kept, model=model, covariance=whole.fitted.covariance))


def _with_all(
    verdict: Verdict, scene: Scene, judgement: Judgement, searches: Sequence[_Search], whole: FitOfAll
) -> Verdict:
    """The verdict with strengths, parameters and misfit of all parts, and with what was there only earlier."""
    fitted = whole.fitted
    std = compute(lambda: standard_deviations(whole.problem, fitted, scale_of(fitted)))
    known: Array = fitted.std if isinstance(std, NotComputable) else std
    named = {accepted.effect.key: accepted.probability for accepted in verdict.explanation}
    probability = {key: value for search in searches for key, value in search.probability.items()} | named
    found, at = [], len(fitted.model.unknown)
    for effect in fitted.model.effects:
        values = {}
        for strength in effect.strengths:
            unit = effect.unit(strength, scene.tree)
            values[strength.name] = Value(effect.values[strength.name], float(known[at]), unit)
            at += 1
        values |= {choice.name: Value(value, None, choice.unit) for choice, value in effect.choices.items()}
        found.append(Explanation(effect, probability.get(effect.key, 1.0), values, effect.sentence(scene.tree)))
    after = fitted.reduced_chi_square if judgement.left is None else judgement.left
    return replace(
        verdict,
        explanation=tuple(sorted(found, key=lambda accepted: -accepted.probability)),
        parameters=parameters_of(scene, fitted),
        reduced_chi_square=(whole.before, after),
    )


def _reading_notes(
    searches: Sequence[_Search], changes: Sequence[Change], count: int, whole: FitOfAll, held: int
) -> list[str]:
    read = sum(search.count for search in searches)
    notes = [
        "the recordings are longer than the memory allows to search at once: effects were looked for in "
        f"{'; and in '.join(search.words for search in searches)}: {read} of {count} parts, which tell most",
        f"strengths, parameters, their intervals and the test of what remains are of all {len(whole.problem.runs)} "
        "parts that can be used; the figures of fit and the pictures are of the parts that were searched last",
    ]
    notes += [f"what is missing changes at {change.time:.6g} s of {change.recording}" for change in changes]
    if held:
        notes.append(f"held-out figures are of {held} parts, evenly spread")
    if not whole.settled:
        notes.append("the fit to all parts has not settled: its steps still change a value by more than a tenth of std")
    return notes
