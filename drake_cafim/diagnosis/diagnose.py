"""The whole diagnosis: recordings and a scene in, a verdict out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from drake_cafim.diagnosis.assembly import comparisons_of, parameters_of, verdict_of
from drake_cafim.diagnosis.fit.fitting import unbiased_fit
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.conclusion import record_conclusion, record_data_mistake
from drake_cafim.diagnosis.search.judgement import judge
from drake_cafim.diagnosis.search.search import Outcome
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.thresholds import EFFORT_NOISE_ROUNDS
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.diagnosis.verdict import (
    ChannelNoise,
    Comparison,
    NominalParameter,
    Verdict,
    mistakes_sentence,
)
from drake_cafim.effects.effect import Effect
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene

NO_ESTIMATES = "What follows is fitted to the recordings as they are, and no estimate:"

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
        trace.add(*map(record_data_mistake, prepared.mistakes))
    judgement = judge(prepared.problem(), settings, progress, trace)
    for _ in range(EFFORT_NOISE_ROUNDS):
        finer = prepared.under(judgement.best.model)
        if finer is None:
            break
        progress("searching under the noise that efforts have beside what was found")
        # the verdict stands by the last search: what earlier ones decided under other noise did not shape it
        trace = Trace()
        trace.add(*map(record_data_mistake, finer.mistakes))
        prepared, judgement = finer, judge(finer.problem(), settings, progress, trace)
    verdict = verdict_of(prepared, judgement, progress)
    trace.of_search(judgement.search).add(*record_conclusion(verdict, judgement))
    return replace(verdict, trace=trace.records), judgement.outcome


@dataclass(frozen=True)
class Estimate:
    """The unknown parameters as fitted, how the model then does, and what was noticed while reading.

    `data_mistakes`, `noise_remarks`, `notes` and `noise` are those of a `Verdict`. With a mistake the numbers are those
    of the recordings as they are, and no estimates.
    """

    parameters: tuple[NominalParameter, ...]
    train: Comparison
    data_mistakes: tuple[str, ...] = ()
    noise_remarks: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    noise: Mapping[str, ChannelNoise] = field(default_factory=dict)

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
    train = comparisons_of(prepared, [fitted, fitted])[0]
    return Estimate(
        parameters_of(scene, fitted),
        train,
        prepared.mistakes,
        prepared.noise_remarks,
        (*prepared.notes, *train.missing("train")),
        prepared.channel_noise,
    )
