"""The whole diagnosis: recordings and a scene in, a verdict out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.coloured_noise import (
    seen_memories,
    stated_memories,
    step_of,
    widened,
)
from drake_cafim.diagnosis.data_mistakes import data_mistakes
from drake_cafim.diagnosis.fitting import Fit, unbiased_fit
from drake_cafim.diagnosis.forecast import forecasts, root_mean_square
from drake_cafim.diagnosis.innovations import innovations
from drake_cafim.diagnosis.intervals import standard_deviations
from drake_cafim.diagnosis.judgement import Judgement, judged
from drake_cafim.diagnosis.location import locate
from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.named_pushes import locate_named
from drake_cafim.diagnosis.problem import Problem
from drake_cafim.diagnosis.quantisation import quantised_memories
from drake_cafim.diagnosis.samples import samples_of
from drake_cafim.diagnosis.search import Outcome, Settings, inclusion, key_of
from drake_cafim.diagnosis.slow_channels import bridged
from drake_cafim.diagnosis.stated_noise import noise_of
from drake_cafim.diagnosis.tosses.prepared import PreparedTosses, prepare_tosses
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
)
from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.diagnosis.weak_problem import WeakProblem
from drake_cafim.effects.effect import Effect
from drake_cafim.recordings.recording import Recording
from drake_cafim.recordings.units import unit_mistakes
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.scene import Scene
from drake_cafim.typing import Array

RIVAL = 9.0
"""χ², in units of the noise that is left, by which a rival may fit worse: three standard deviations."""
MADE_UP_FOR = (
    "the unknowns, fitted alone, make up for what is missing and predict these recordings worse than as given; in the "
    "corrected scenario they are as given"
)

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
    prepared = prepare(scene.knowing(effects), recordings, held_out)
    if prepared.mistakes:
        # physics that would make up for a mistake of the data is none
        settings = replace(settings, most_effects=0)
    judgement = judged(prepared.problem(), settings, progress)
    return _verdict(prepared, judgement, progress), judgement.outcome


@dataclass(frozen=True)
class Prepared:
    """Recordings laid out as weak forms, with what was noticed while reading them."""

    scene: Scene
    weak: list[WeakForm]
    held_out: list[WeakForm]
    notes: tuple[str, ...]
    mistakes: tuple[str, ...]
    noise_remarks: tuple[str, ...]

    def problem(self) -> WeakProblem:
        """The recordings' whitened equations, under the model as given."""
        return WeakProblem.of(self.scene, self.weak, Model(self.scene.priors.mean))

    def locate(self, problem: WeakProblem, lacking: Model) -> tuple[Location, ...]:
        """Where the recordings differ from `lacking`."""
        return locate(problem, lacking)

    def qualities(self, model: Model, covariance: Array) -> list[Quality]:
        """How `model` does on the recordings, and on those held out where there are any.

        `covariance` (n, n) is of its unknowns.
        """
        groups = [self.weak, self.held_out] if self.held_out else [self.weak]
        return _qualities(groups, self.scene, model, covariance)


def prepare(
    scene: Scene, recordings: Sequence[Recording], held_out: Sequence[Recording] = ()
) -> Prepared | PreparedTosses:
    """The recordings' weak forms, or a thrown body's poses, under the noise that was stated or, where not, is seen.

    Raises `InputError` for recordings that lack what the scene needs.
    """
    if scene.tree.floating:
        return prepare_tosses(scene, recordings, held_out, _notes(recordings))
    scene = _facing(scene, recordings)
    std, notes = noise_of(scene, recordings)
    stated = stated_memories(scene, list(std))
    estimated = {column for column in std if scene.std(column) is None}
    seen, told = seen_memories(recordings, std, stated, estimated)
    known = stated | seen
    std = widened(std, known, estimated, step_of(recordings))

    def laid(recording: Recording) -> WeakForm:
        memories = quantised_memories(recording, std) | known
        recording, bridges = bridged(recording)
        samples = samples_of(scene, recording, std, memories=memories, bridges=bridges)
        return WeakForm(samples, scene.wrench_sensors)

    even = [bridged(recording)[0] for recording in recordings]
    return Prepared(
        scene,
        [laid(recording) for recording in recordings],
        [laid(recording) for recording in held_out],
        (*notes, *_notes(even)),
        _unit_mistakes(scene, recordings) or data_mistakes(scene, even, std),
        told,
    )


@dataclass(frozen=True)
class Estimate:
    """The unknown parameters as fitted, and how the model then does."""

    parameters: tuple[NominalParameter, ...]
    train: Comparison


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
    progress("simulating")
    return Estimate(_parameters(scene, fitted), _comparisons(prepared, [fitted, fitted])[0])


def _facing(scene: Scene, recordings: Sequence[Recording]) -> Scene:
    """The scene with its contact planes on the side on which the first recording starts."""
    q = recordings[0].matrix("q", scene.tree.joint_names)
    return scene.facing(q[np.flatnonzero(np.all(np.isfinite(q), axis=1))[0]])


def _verdict(prepared: Prepared | PreparedTosses, judgement: Judgement, progress: Progress) -> Verdict:
    scene, outcome, best, kind = prepared.scene, judgement.outcome, judgement.best, judgement.kind
    # where the mismatch is: of the nominal physics at the numbers that the explanation found, or of what remains
    lacking = best.model if kind == "unexplained" else Model(best.model.unknown)
    locations = () if kind == "none" else _locations(prepared, outcome.nominal_problem, best.model, lacking)
    corrected, notes = scene.corrected(best.model.unknown, best.model.effects), (*prepared.notes, *judgement.notes)
    progress("simulating with and without the effects")
    comparisons = _comparisons(prepared, [outcome.nominal, best])
    given, fitted = comparisons[0].nominal_as_given.nll, comparisons[0].corrected.nll
    if kind == "unexplained" and not best.model.effects and fitted > given:
        corrected, notes = scene.corrected(scene.priors.mean, ()), (*notes, MADE_UP_FOR)
        comparisons = [replace(one, corrected=one.nominal_as_given) for one in comparisons]
    train, *held_out = comparisons
    return Verdict(
        kind=kind,
        mismatch=Mismatch(kind != "none", outcome.detection_p_value, locations),
        explanation=_explanations(scene, outcome, best),
        rivals=_rivals(outcome, best),
        parameters=_parameters(scene, best),
        train=train,
        held_out=held_out[0] if held_out else None,
        corrected=corrected,
        data_mistakes=prepared.mistakes,
        noise_remarks=(*prepared.noise_remarks, *judgement.noise_remarks),
        notes=notes,
        reduced_chi_square=(
            outcome.nominal.chi_square / outcome.nominal.degrees_of_freedom,
            best.chi_square / best.degrees_of_freedom,
        ),
    )


def _locations(
    prepared: Prepared | PreparedTosses, problem: Problem, best: Model, lacking: Model
) -> tuple[Location, ...]:
    """Where the recordings differ from `lacking`, the pushes that `best` names by their own ends."""
    return locate_named(problem, best, lacking, lambda model: prepared.locate(problem, model))  # type: ignore[arg-type]


def _explanations(scene: Scene, outcome: Outcome, best: Fit) -> tuple[Explanation, ...]:
    probability = inclusion(outcome)
    std = standard_deviations(outcome.problem, best, outcome.scale)
    position = len(best.model.unknown)
    found = []
    for effect in best.model.effects:
        values = {}
        for strength in effect.strengths:
            unit = effect.unit(strength, scene.tree)
            values[strength.name] = Value(effect.values[strength.name], float(std[position]), unit)
            position += 1
        sentence = effect.sentence(scene.tree)
        found.append(Explanation(effect, probability.get(effect.key, 1.0), values, sentence))
    return tuple(sorted(found, key=lambda e: -e.probability))


def _rivals(outcome: Outcome, best: Fit) -> tuple[Rival, ...]:
    """Effects of the explanations that fit as well as the accepted one, which is preferred for its fewer effects."""
    present = key_of(best)
    probability = inclusion(outcome)
    found: dict[tuple[str, str], float] = {}
    for key, one in outcome.pool.fits.items():
        as_good = one.chi_square - best.chi_square < RIVAL * outcome.scale
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
        NominalParameter(one.parameter, one.at, float(value), float(std), one.prior.unit, one.prior.mean, one.prior.std)
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


def _qualities(groups: Sequence[list[WeakForm]], scene: Scene, model: Model, covariance: Array) -> list[Quality]:
    """Of each group; the recordings of all are simulated side by side."""
    physics = model.physics(scene)
    forms = [form for group in groups for form in group]
    likelihoods = [
        one.negative_log_likelihood for one in innovations(forms, physics, _doubts(scene, model, covariance))
    ]
    simulated = forecasts(forms, physics)
    result, first = [], 0
    for group in groups:
        own = slice(first, first + len(group))
        result.append(Quality(float(np.mean(np.concatenate(likelihoods[own]))), root_mean_square(simulated[own])))
        first = own.stop
    return result


def _doubts(scene: Scene, model: Model, covariance: Array) -> list[Physics]:
    """The physics a standard deviation off along each axis of what is not known of its unknowns, priors aside."""
    priors = scene.priors
    # nothing is known worse than before anything was recorded
    spread, axes = np.linalg.eigh(covariance / np.outer(priors.std, priors.std))
    off = (axes * np.sqrt(np.clip(spread, 0.0, 1.0))).T * priors.std
    return [Model(priors.clip(model.unknown + one), model.effects).physics(scene) for one in off]


def _unit_mistakes(scene: Scene, recordings: Sequence[Recording]) -> tuple[str, ...]:
    limits = {
        j.name: j.position_limits for j in scene.tree.joints if not j.prismatic and np.isfinite(j.position_limits[0])
    }
    return tuple(sentence for recording in recordings for sentence in unit_mistakes(recording, limits))


def _notes(recordings: Sequence[Recording]) -> tuple[str, ...]:
    notes: list[str] = []
    for recording in recordings:
        notes.extend(f"{recording.name}: {note}" for note in recording.notes)
        if recording.other_columns:
            notes.append(f"{recording.name}: left alone: {', '.join(recording.other_columns)}")
    return tuple(notes)
