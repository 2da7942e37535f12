"""The whole diagnosis: recordings and a scene in, a verdict out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit, unbiased_fit
from drake_cafim.diagnosis.fit.intervals import standard_deviations
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.effort_noise import effort_noise, effort_notes, with_std
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.joints.quality import qualities
from drake_cafim.diagnosis.joints.recording_notes import mistakes_of, notes_of, strangers
from drake_cafim.diagnosis.noise.coloured import (
    estimate_memories,
    stated_memories,
    step_of,
)
from drake_cafim.diagnosis.noise.differences import correct_for_memory
from drake_cafim.diagnosis.noise.quantised import quantised_memories
from drake_cafim.diagnosis.noise.slow_channels import bridge_slow_channels
from drake_cafim.diagnosis.noise.stated import needed_columns, noise_of
from drake_cafim.diagnosis.rows.samples import moves, samples_of
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.search.conclusion import concluded, data_mistake
from drake_cafim.diagnosis.search.judgement import Judgement, judged
from drake_cafim.diagnosis.search.push_locations import locate_named
from drake_cafim.diagnosis.search.search import Outcome, Settings, inclusion, key_of
from drake_cafim.diagnosis.thresholds import EFFORT_NOISE_ROUNDS, EFFORT_NOISE_SETTLED, RIVAL_EXCESS_CHI_SQUARE
from drake_cafim.diagnosis.tosses.preparation import PreparedTosses, prepare_tosses
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.diagnosis.verdict import (
    Comparison,
    Explanation,
    Location,
    Mismatch,
    NominalParameter,
    Quality,
    Rival,
    Value,
    Verdict,
    mistakes_sentence,
)
from drake_cafim.effects.effect import Effect
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.recordings.recording import Recording
from drake_cafim.recordings.usable import check_usable
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

MADE_UP_FOR = (
    "the unknowns, fitted alone, make up for what is missing and predict these recordings worse than as given; in the "
    "corrected scenario they are as given"
)

NO_ESTIMATES = "What follows is fitted to the recordings as they are, and no estimate:"

NOTHING_MOVES = "nothing moves in the recordings beyond its noise, so that no effect was looked for"
Progress = Callable[[str], None]


def diagnose(
    scene: Scene,
    recordings: Sequence[Recording],
    *,
    held_out: Sequence[Recording] = (),
    effects: Sequence[type[Effect]] = (),
    settings: Settings | None = None,
    progress: Progress = lambda text: None,
) -> Verdict:
    """What the recordings say is missing in the scene's model.

    `held_out` chooses and fits nothing: it is only simulated with and without what was found. `effects` are effect
    classes of one's own that are looked for beside the catalogue's. `settings` say how hard to search and how sure to
    be. `progress` is told, in a few words each time, what is being done.

        verdict = drake_cafim.diagnose(scene, [drake_cafim.read("run_1.parquet")])
        print(verdict)                # the sentence
        verdict.explanation           # effect, place, strengths with their stds, probability
        verdict.corrected             # the scene with the missing physics in it

    Raises `InputError` for recordings that lack what the scene needs.
    """
    return examine(scene, recordings, held_out=held_out, effects=effects, settings=settings, progress=progress)[0]


def examine(
    scene: Scene,
    recordings: Sequence[Recording],
    *,
    held_out: Sequence[Recording] = (),
    effects: Sequence[type[Effect]] = (),
    settings: Settings | None = None,
    progress: Progress = lambda text: None,
) -> tuple[Verdict, Outcome]:
    """`diagnose`, with the search's own account beside the verdict, for pictures."""
    settings = settings or Settings()
    progress("reading noise and laying windows")
    prepared = prepare(scene.with_effect_classes(effects), recordings, held_out)
    trace = Trace()
    if prepared.mistakes or not prepared.moves:
        # physics that would make up for a mistake of the data is none, nor is what nothing moves by
        settings = replace(settings, most_effects=0)
        trace.add(*map(data_mistake, prepared.mistakes))
    judgement = judged(prepared.problem(), settings, progress, trace)
    for _ in range(EFFORT_NOISE_ROUNDS):
        finer = prepared.under(judgement.best.model)
        if finer is None:
            break
        progress("searching under the noise that efforts have beside what was found")
        # the verdict stands by the last search: what earlier ones decided under other noise did not shape it
        trace = Trace()
        trace.add(*map(data_mistake, finer.mistakes))
        prepared, judgement = finer, judged(finer.problem(), settings, progress, trace)
    verdict = _verdict(prepared, judgement, progress)
    trace.of_search(judgement.search).add(*concluded(verdict, judgement))
    return replace(verdict, trace=trace.records), judgement.outcome


@dataclass(frozen=True)
class Prepared:
    """Recordings laid out as weak forms, with what was noticed while reading them."""

    scene: Scene
    weak: list[WeakForm]
    held_out: list[WeakForm]
    notes: tuple[str, ...]
    mistakes: tuple[str, ...]
    noise_remarks: tuple[str, ...]
    effort_noise: Mapping[str, float]
    """Std by column of the efforts whose noise nobody stated, N m or N."""

    def under(self, model: Model) -> "Prepared | None":
        """The same under the noise of efforts that is left beside `model`; None where it is much as it was.

        What physics was missing when it was first estimated may have passed for noise in part.
        """
        joints = [self.scene.tree.joint_index(column.removeprefix("u.")) for column in self.effort_noise]
        exact = [with_std(form, dict.fromkeys(self.effort_noise, 0.0)) for form in self.weak]
        noise = effort_noise(self.scene, exact, model, joints)
        if all(noise[column] >= EFFORT_NOISE_SETTLED * std for column, std in self.effort_noise.items()):
            return None
        before = effort_notes(self.scene, self.effort_noise)
        return replace(
            self,
            weak=[with_std(form, noise) for form in self.weak],
            held_out=[with_std(form, noise) for form in self.held_out],
            notes=(*(note for note in self.notes if note not in before), *effort_notes(self.scene, noise)),
            effort_noise=noise,
        )

    @property
    def moves(self) -> bool:
        """Whether any joint moves in any of the recordings, beyond its noise."""
        return any(moves(form.samples) for form in self.weak)

    def problem(self) -> WeakProblem:
        """The recordings' whitened equations, under the model as given."""
        return WeakProblem.of(self.scene, self.weak, Model(self.scene.priors.mean))

    def qualities(self, model: Model, covariance: Array) -> list[Quality]:
        """How `model` does on the recordings, and on those held out where there are any.

        `covariance` (n, n) is of its unknowns.
        """
        groups = [self.weak, self.held_out] if self.held_out else [self.weak]
        return qualities(groups, self.scene, model, covariance)


def prepare(
    scene: Scene, recordings: Sequence[Recording], held_out: Sequence[Recording] = ()
) -> Prepared | PreparedTosses:
    """The recordings' weak forms, or a thrown body's poses, under the noise that was stated or, where not, is seen.

    Raises `InputError` for recordings that lack what the scene needs.
    """
    scene = scene.for_recordings([*recordings, *held_out])
    if scene.tree.floating:
        return prepare_tosses(scene, recordings, held_out, (*scene.stated.notes, *notes_of(recordings)))
    for recording in (*recordings, *held_out):
        check_usable(recording, needed_columns(scene))
    scene = _facing(scene, recordings)
    std, notes = noise_of(scene, recordings)
    stated = stated_memories(scene, list(std))
    estimated = {column for column in std if scene.std(column) is None}
    seen, told = estimate_memories(recordings, std, stated, estimated)
    known = stated | seen
    std = correct_for_memory(std, known, estimated, step_of(recordings))

    def laid(recording: Recording, std: dict[str, float]) -> WeakForm:
        memories = quantised_memories(recording, std) | known
        recording, bridges = bridge_slow_channels(recording)
        samples = samples_of(scene, recording, std, memories=memories, bridges=bridges)
        return WeakForm(samples, scene.wrench_sensors)

    even = [bridge_slow_channels(recording)[0] for recording in recordings]
    forms = [laid(recording, std) for recording in recordings]
    measured = [j for j, name in enumerate(scene.tree.joint_names) if f"u.{name}" in estimated]
    noise: dict[str, float] = {}
    if measured:
        # what the equations say of it can only be known once they are laid out with efforts taken as exact
        noise = effort_noise(scene, forms, Model(scene.priors.mean), measured)
        std, notes = std | noise, (*notes, *effort_notes(scene, noise))
        forms = [laid(recording, std) for recording in recordings]
    return Prepared(
        scene,
        forms,
        [laid(recording, std) for recording in held_out],
        (
            *scene.stated.notes,
            *notes,
            *notes_of(even),
            *strangers(scene, recordings),
            *(f"held out: {mistake}" for mistake in mistakes_of(scene, held_out, std)),
        ),
        mistakes_of(scene, recordings, std),
        told,
        noise,
    )


@dataclass(frozen=True)
class Estimate:
    """The unknown parameters as fitted, how the model then does, and what was noticed while reading.

    `data_mistakes`, `noise_remarks` and `notes` are those of a `Verdict`. With a mistake the numbers are those of the
    recordings as they are, and no estimates.
    """

    parameters: tuple[NominalParameter, ...]
    train: Comparison
    data_mistakes: tuple[str, ...] = ()
    noise_remarks: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        """What is to be known first, a line each, then the numbers."""
        lines = [mistakes_sentence(self.data_mistakes), NO_ESTIMATES] if self.data_mistakes else []
        lines += [f"{one.parameter} of {one.at}: {one.value:.6g} ± {one.std:.2g} {one.unit}" for one in self.parameters]
        lines += [f"{remark[0].upper()}{remark[1:]}." for remark in self.noise_remarks]
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])


def estimate(scene: Scene, recordings: Sequence[Recording], *, progress: Progress = lambda text: None) -> Estimate:
    """The scenario's `unknown` parameters from recordings; the model's own effects are in it, no others are sought.

        found = drake_cafim.estimate(scene, [drake_cafim.read("run_1.parquet")])
        for one in found.parameters:
            print(one.parameter, one.at, one.value, one.std, one.unit)

    `found.train` compares the model as given with the fitted one. `progress` is told what is being done. Raises
    `InputError` for recordings that lack what the scene needs.
    """
    prepared = prepare(scene, recordings)
    scene, problem = prepared.scene, prepared.problem()
    progress("fitting the unknown parameters")
    fitted = unbiased_fit(problem, problem.nominal())
    finer = prepared.under(fitted.model)
    if finer is not None:
        prepared, problem = finer, finer.problem()
        fitted = unbiased_fit(problem, fitted.model)
    progress("simulating")
    train = _comparisons(prepared, [fitted, fitted])[0]
    return Estimate(
        _parameters(scene, fitted),
        train,
        prepared.mistakes,
        prepared.noise_remarks,
        (*prepared.notes, *train.missing("train")),
    )


def _facing(scene: Scene, recordings: Sequence[Recording]) -> Scene:
    """The scene with its contact planes on the side on which the first recording starts."""
    q = recordings[0].matrix("q", scene.tree.joint_names)
    return scene.with_surfaces_at(q[np.flatnonzero(np.all(np.isfinite(q), axis=1))[0]])


def _verdict(prepared: Prepared | PreparedTosses, judgement: Judgement, progress: Progress) -> Verdict:
    scene, outcome, best, kind = prepared.scene, judgement.outcome, judgement.best, judgement.kind
    # where the mismatch is: of the nominal physics at the numbers that the explanation found, or of what remains
    lacking = best.model if kind == "unexplained" else Model(best.model.unknown)
    nominally = outcome.nominal_problem
    locations: tuple[Location, ...] = ()
    where: tuple[str, ...] = ()
    found = compute(lambda: locate_named(nominally, best.model, lacking)) if kind != "none" else ()
    if isinstance(found, NotComputable):
        where = (f"mismatch.locations cannot be computed: {found.reason}",)
    else:
        locations = found
    corrected = scene.corrected(best.model.unknown, best.model.effects)
    notes = (*prepared.notes, *judgement.notes, *where, *(() if prepared.moves else (NOTHING_MOVES,)))
    progress("simulating with and without the effects")
    comparisons = _comparisons(prepared, [outcome.nominal, best])
    given, fitted = comparisons[0].nominal_as_given.nll, comparisons[0].corrected.nll
    if kind == "unexplained" and not best.model.effects and fitted > given:
        corrected, notes = scene.corrected(scene.priors.mean, ()), (*notes, MADE_UP_FOR)
        comparisons = [replace(one, corrected=one.nominal_as_given) for one in comparisons]
    train, *held_out = comparisons
    explanation, unknown_std = _explanations(scene, outcome, best)
    notes = (*notes, *unknown_std, *train.missing("train"), *(held_out[0].missing("held_out") if held_out else ()))
    return Verdict(
        kind=kind,
        mismatch=Mismatch(kind != "none", outcome.detection_p_value, locations),
        explanation=explanation,
        rivals=_rivals(outcome, best),
        parameters=_parameters(scene, best),
        train=train,
        held_out=held_out[0] if held_out else None,
        corrected=corrected,
        data_mistakes=prepared.mistakes,
        noise_remarks=(*prepared.noise_remarks, *judgement.noise_remarks),
        notes=notes,
        reduced_chi_square=(
            outcome.nominal.reduced_chi_square,
            best.reduced_chi_square,
        ),
    )


def _explanations(scene: Scene, outcome: Outcome, best: Fit) -> tuple[tuple[Explanation, ...], tuple[str, ...]]:
    """The accepted effects, and a note where their standard deviations cannot be computed."""
    probability = inclusion(outcome)
    std = compute(lambda: standard_deviations(outcome.problem, best, outcome.scale))
    notes: tuple[str, ...] = ()
    if isinstance(std, NotComputable):
        notes = (f"the std of the named effects' parameters cannot be computed: {std.reason}",)
        std = np.full(len(best.model.vector), np.nan)
    position = len(best.model.unknown)
    found = []
    for effect in best.model.effects:
        values = {}
        for strength in effect.strengths:
            unit = effect.unit(strength, scene.tree)
            values[strength.name] = Value(effect.values[strength.name], float(std[position]), unit)
            position += 1
        values |= {one.name: Value(value, None, one.unit) for one, value in effect.choices.items()}
        sentence = effect.sentence(scene.tree)
        found.append(Explanation(effect, probability.get(effect.key, 1.0), values, sentence))
    return tuple(sorted(found, key=lambda e: -e.probability)), notes


def _rivals(outcome: Outcome, best: Fit) -> tuple[Rival, ...]:
    """Effects of the explanations that fit as well as the accepted one, which is preferred for its fewer effects."""
    present = key_of(best)
    probability = inclusion(outcome)
    found: dict[tuple[str, str], float] = {}
    for key, one in outcome.pool.fits.items():
        as_good = one.chi_square - best.chi_square < RIVAL_EXCESS_CHI_SQUARE * outcome.scale
        if not present or present <= key or not as_good or len(key) > len(present) + 1:
            continue
        found |= {effect: probability[effect] for effect in key - present}
    return tuple(
        Rival(name, at, value, _why_alike(best, name))
        for (name, at), value in sorted(found.items(), key=lambda item: (-item[1], item[0]))
    )


def _why_alike(best: Fit, name: str) -> str:
    reasons = [effect.alike[name] for effect in best.model.effects if name in effect.alike]
    return reasons[0] if reasons else "over these motions the two move the measurements alike"


def _parameters(scene: Scene, best: Fit) -> tuple[NominalParameter, ...]:
    return tuple(
        NominalParameter(
            one.parameter,
            one.at,
            float(value),
            float(std),
            one.prior.unit,
            one.prior.mean,
            one.prior.std,
            one.effect,
        )
        for one, value, std in zip(scene.unknown, best.model.unknown, best.std, strict=False)
    )


def _comparisons(prepared: Prepared | PreparedTosses, fits: Sequence[Fit]) -> list[Comparison]:
    """Each group of recordings under the scene as given, and under the two `fits`."""
    priors, n = prepared.scene.priors, len(prepared.scene.unknown)
    candidates = [(Model(priors.mean), np.diag(priors.std**2))]
    candidates += [(one.model, one.covariance[:n, :n]) for one in fits]
    found: list[list[Quality]] = []
    for k, (model, covariance) in enumerate(candidates):
        # where nothing is missing, two of the three are the same
        same = [
            j
            for j, (other, doubt) in enumerate(candidates[:k])
            if other.effects == model.effects
            and np.all(other.vector == model.vector)
            and np.array_equal(doubt, covariance)
        ]
        found.append(found[same[0]] if same else prepared.qualities(model, covariance))
    return [Comparison(*(one[k] for one in found)) for k in range(len(found[0]))]
