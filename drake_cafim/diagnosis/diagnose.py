"""Runs a diagnosis from recordings and a scene to a verdict, and the estimation of a scenario's unknown parameters."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from drake_cafim.diagnosis.assembly import bounds_of, comparisons_of, parameters_of, verdict_of
from drake_cafim.diagnosis.fit.evidence import scale_of
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.goodness_of_fit import GoodnessOfFit, goodness_of_fit
from drake_cafim.diagnosis.fit.intervals import standard_deviations
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.left_out.feedback import withhold_unconfirmed_by_simulation
from drake_cafim.diagnosis.left_out.learned import learn
from drake_cafim.diagnosis.left_out.parts import Part
from drake_cafim.diagnosis.left_out.selection import Selection, everything, select
from drake_cafim.diagnosis.notes.overstated import STEP, Overstated, find_overstated
from drake_cafim.diagnosis.output_error.decisions import SEARCH as SIMULATED
from drake_cafim.diagnosis.output_error.decisions import record_servos
from drake_cafim.diagnosis.predict.forecast import Forecast
from drake_cafim.diagnosis.preparation import PreparedRecordings, prepare
from drake_cafim.diagnosis.search.by_simulation import judge_found
from drake_cafim.diagnosis.search.conclusion import record_conclusion, record_data_mistake
from drake_cafim.diagnosis.search.given_effects import fit_given
from drake_cafim.diagnosis.search.judgement import Judgement, fit_again, judge, judge_again, narrowed
from drake_cafim.diagnosis.search.pushes import withhold_refuted_pushes
from drake_cafim.diagnosis.search.search import Outcome
from drake_cafim.diagnosis.search.search_under_unknown_force import UNKNOWN_FORCES
from drake_cafim.diagnosis.search.shared_evidence import withhold_refuted, withhold_shared
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.thresholds import EFFORT_NOISE_ROUNDS, UNKNOWN_FAR_IN_PRIOR_STDS
from drake_cafim.diagnosis.trace import Record, Trace
from drake_cafim.diagnosis.verdict import (
    ChannelNoise,
    Comparison,
    NominalParameter,
    Verdict,
    far_sentence,
    mistakes_sentence,
)
from drake_cafim.effects.effect import Effect
from drake_cafim.errors import check_type
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.arguments import check_arguments
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

NO_ESTIMATES = "What follows is fitted to the recordings as they are, and no estimate:"
"""The line above fitted parameters where the recordings have mistakes."""

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
    """The verdict on which physics is missing in the scene's model, given recordings of the robot.

    `held_out` recordings are used for no choice and no fit, only for figures of fit. `effects` are further effect
    classes to test beside the catalogue's. `settings` are the options of the search. `progress` is called with a few
    words at each stage.

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
    """The verdict of `diagnose`, and the outcome of the search that led to it, from which a report draws."""
    check_arguments(scene, recordings, held_out)
    settings = settings or Settings()
    check_type("settings", settings, Settings, "Settings")
    progress("estimating the noise and setting up the equations")
    prepared = prepare(scene.with_effect_classes(effects), recordings, held_out)
    prepared, judgement, trace = judge_prepared(*with_overstated_unknown(prepared), settings, progress)
    selection, unselected = select_findings(prepared, judgement, progress, settings.jobs)
    judgement = replace(judgement, notes=(*judgement.notes, *unselected))
    verdict = verdict_of(prepared, judgement, selection, progress, settings.jobs)
    trace.of_search(judgement.search).add(*selection.records, *record_conclusion(verdict, judgement))
    return replace(verdict, trace=trace.records), judgement.outcome


def with_overstated_unknown(
    prepared: PreparedRecordings,
) -> tuple[PreparedRecordings, SearchProblem | None]:
    """The recordings, friction and rotors unknown of which the model file states far too much; and their problem.

    The problem is None where none was set up.
    """
    scene = prepared.scene
    resisting = np.any(scene.physics.dampings) or np.any(scene.physics.rotor_inertias) or scene.of_model
    if prepared.mistakes or not prepared.moves or not resisting:
        return prepared, None
    problem = prepared.problem()
    overstated = compute(lambda: find_overstated(problem))
    if not isinstance(overstated, Overstated):
        return prepared, problem
    uncertain = compute(lambda: prepared.with_overstated_unknown(overstated))
    return (prepared, problem) if isinstance(uncertain, NotComputable) else (uncertain, None)


def judge_prepared(
    prepared: PreparedRecordings, problem: SearchProblem | None, settings: Settings, progress: Progress
) -> tuple[PreparedRecordings, Judgement, Trace]:
    """The judgement on recordings, the noise of efforts under which it was made, and its decisions.

    `problem` is that of the recordings, None if it was not set up before.
    """
    trace = Trace()
    if prepared.mistakes or not prepared.moves:
        # an effect that compensates for wrong data is no physics, and without motion none can be told apart
        settings = replace(settings, most_effects=0)
        trace.add(*map(record_data_mistake, prepared.mistakes))
    notes: tuple[str, ...] = ()
    found = compute(
        lambda: prepared.search_by_simulation(
            settings.most_effects, progress, trace.of_search(SIMULATED), settings.jobs
        )
    )
    if isinstance(found, NotComputable):
        notes = (f"a fit of the servos' unknowns to simulations cannot be computed: {found.reason}",)
    elif found is not None and settings.most_effects and found.fitted.model.effects:
        own = trace.of_search(SIMULATED)
        judged = compute(lambda: judge_found(prepared.problem(), found, settings, own))
        if isinstance(judged, Judgement):
            return prepared, judged, trace
        notes = (f"what simulations from commands show cannot be judged: {judged.reason}",)
        prepared, problem = prepared.with_servos_settled(found), None
    elif found is not None:
        prepared, problem = prepared.with_servos_settled(found), None
        trace.add(record_servos(found.error(found.fitted), found.error(found.alone)))
    if prepared.overstated is not None:
        trace.add(*prepared.overstated.records)
        if settings.most_effects:
            prepared, problem = prepared.without_overstated(), None
    judgement = judge(problem or prepared.problem(), settings, progress, trace)
    for _ in range(EFFORT_NOISE_ROUNDS):
        again = compute(partial(_with_less_noise, prepared, judgement, settings, progress, trace))
        if isinstance(again, NotComputable):
            note = f"a search with less noise of the efforts cannot be computed: {again.reason}"
            judgement = replace(judgement, notes=(*judgement.notes, note))
        if again is None or isinstance(again, NotComputable):
            break
        prepared, judgement, trace = again
    for withhold in (
        partial(withhold_shared, trace=trace),
        partial(withhold_refuted, settings=settings, trace=trace),
        partial(withhold_refuted_pushes, settings=settings, trace=trace),
        partial(
            withhold_unconfirmed_by_simulation,
            predictions=lambda it: _Predictions(prepared, it.best, settings.jobs),
            given=_given(prepared),
            trace=trace,
        ),
    ):
        judgement = narrowed(judgement, withhold)
    if prepared.overstated is not None and judgement.kind != "unexplained":
        # the model as given differs from the recordings by what no effect says
        judgement = replace(judgement, kind="unexplained", adequate=True)
    return prepared, replace(judgement, notes=(*notes, *judgement.notes)), trace


def select_findings(
    prepared: PreparedRecordings, judgement: Judgement, progress: Progress, jobs: int = 1
) -> tuple[Selection, tuple[str, ...]]:
    """What goes into the corrected scene, predicted by `jobs` processes, and a note where that cannot be computed."""
    best = judgement.best
    if judgement.kind == "none" or judgement.corrected is not None:
        return everything(judgement.corrected or best), ()

    progress("predicting left-out parts of the recordings")
    problem, unexplained = judgement.outcome.problem, judgement.kind == "unexplained"
    predictions = _Predictions(prepared, best, jobs)
    given = _given(prepared)
    selection = compute(lambda: select(problem, best, predictions if unexplained else None, given))
    if isinstance(selection, NotComputable):
        return everything(best), (f"which effects predict left-out parts better is not known: {selection.reason}",)
    if not unexplained or judgement.adequate or prepared.mistakes:
        return selection, ()
    progress("learning what remains")
    model = selection.fitted.model
    learned = compute(lambda: learn(problem, model, predictions))
    if isinstance(learned, NotComputable):
        return selection, (f"laws without a name cannot be learned: {learned.reason}",)
    laws, records = learned
    return replace(selection, learned=laws, records=(*selection.records, *records)), ()


def _given(prepared: PreparedRecordings) -> Array | None:
    """(n,) the unknowns of the scene as given, where a search has others; else None."""
    return None if prepared.overstated is None else prepared.scene.priors.mean


@dataclass(frozen=True)
class _Predictions:
    """Predictions of parts of the recordings that `fitted` is of."""

    prepared: PreparedRecordings
    fitted: Fit
    jobs: int

    def simulate(self, model: Model, part: Part, horizon: float) -> list[Forecast]:
        return self.prepared.simulated(model, part.recordings, (part.begin, part.end), horizon)

    def surprisal(self, model: Model, part: Part) -> float:
        priors, n = self.prepared.scene.priors, len(model.unknown)
        given = np.array_equal(model.unknown, priors.mean)
        covariance = np.diag(priors.std**2) if given else self.fitted.covariance[:n, :n]
        return self.prepared.surprisal(model, covariance, part.recordings, (part.begin, part.end))


def _with_less_noise(
    prepared: PreparedRecordings, judgement: Judgement, settings: Settings, progress: Progress, before: Trace
) -> tuple[PreparedRecordings, Judgement, Trace] | None:
    """The recordings with the noise of efforts that the judgement leaves, judged again; None where it hardly changed.

    Many effects are not looked for again: None also where none of them stands out any more, and the trace goes on from
    the one `before`. Else it is a new one, since decisions under the former noise did not shape the verdict.
    """
    finer = prepared.with_noise_beside(judgement.best.model)
    if finer is None:
        return None
    found = judgement.best.model.effects if judgement.search == UNKNOWN_FORCES else ()
    lasting = before.records if len(found) > settings.most_effects else _before_search(before)
    trace = Trace(records=list(lasting))
    trace.add(*map(record_data_mistake, finer.mistakes))
    if len(found) > settings.most_effects:
        progress("fitting again with less noise of the efforts")
        # to compare them with others takes long, and is done once, under the noise that no longer falls
        for _ in range(EFFORT_NOISE_ROUNDS - 1):
            finer = finer.with_noise_beside(fit_again(finer.problem(), judgement)) or finer
        again = judge_again(finer.problem(), judgement, settings, progress, trace)
        return None if again is None else (finer, again, trace)
    progress("searching again with less noise of the efforts")
    return finer, judge(finer.problem(), settings, progress, trace, found), trace


def _before_search(trace: Trace) -> list[Record]:
    """The decisions on servos' unknowns and on what the model overstates, which are made before any search."""
    return [record for record in trace.records if record.step in ("servos", STEP)]


@dataclass(frozen=True)
class Estimate:
    """The fitted unknown parameters, whether the model fits with them, and the notes on the recordings.

    `goodness_of_fit` compares the residual with the noise. If it is not `accepted`, the parameters' `std` are wider
    than noise alone implies: by the root of the reduced χ², or as blocks of the residual imply; none is wider than its
    prior's. `train` compares the model as given with the fitted one. `data_mistakes`, `noise_remarks`, `notes` and
    `noise` are those of a `Verdict`. If the recordings have mistakes, the values are fitted to them as they are, and no
    estimates.
    """

    parameters: tuple[NominalParameter, ...]
    train: Comparison
    goodness_of_fit: GoodnessOfFit
    data_mistakes: tuple[str, ...] = ()
    noise_remarks: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    noise: Mapping[str, ChannelNoise] = field(default_factory=dict)

    @property
    def far(self) -> tuple[NominalParameter, ...]:
        """The parameters so far from their priors that they are a mismatch at their places."""
        return tuple(parameter for parameter in self.parameters if parameter.distance > UNKNOWN_FAR_IN_PRIOR_STDS)

    def __str__(self) -> str:
        """Mistakes of the data and the goodness of fit first, then a line for each parameter, remark and note."""
        lines = [mistakes_sentence(self.data_mistakes)] if self.data_mistakes else []
        lines += [str(self.goodness_of_fit), *(f"WARNING: {far_sentence(parameter)}" for parameter in self.far)]
        lines += [NO_ESTIMATES] if self.data_mistakes else []
        lines += [
            f"{_name(p)} of {p.at}: {p.value:.6g} ± {p.std:.2g} {p.unit}".removesuffix(" 1") for p in self.parameters
        ]
        lines += [f"{remark[0].upper()}{remark[1:]}." for remark in self.noise_remarks]
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])


def _name(parameter: NominalParameter) -> str:
    return f"{parameter.effect} {parameter.parameter}" if parameter.effect else parameter.parameter


def estimate(scene: Scene, recordings: Sequence[Recording], *, progress: Progress = lambda text: None) -> Estimate:
    """Estimates the scenario's `unknown` parameters from recordings, without looking for missing physics.

        found = drake_cafim.estimate(scene, [drake_cafim.read("run_1.parquet")])
        found.goodness_of_fit.accepted     # whether the residual is as the noise predicts
        for parameter in found.parameters:
            print(parameter.parameter, parameter.at, parameter.value, parameter.std, parameter.unit)

    `found.train` compares the model as given with the fitted one. `progress` is called with a few words at each stage.
    Raises `InputError` for recordings that lack what the scene needs.
    """
    check_arguments(scene, recordings)
    prepared = prepare(scene, recordings)
    scene = prepared.scene
    progress("fitting the unknown parameters")
    problem, fitted = fit_given(prepared.problem(), Model(scene.priors.mean))
    again = compute(lambda: _fitted_with_less_noise(prepared, fitted))
    unknown_noise: tuple[str, ...] = ()
    if isinstance(again, NotComputable):
        unknown_noise = (f"a fit with less noise of the efforts cannot be computed: {again.reason}",)
    elif again is not None:
        prepared, problem, fitted = again
    goodness, notes = goodness_of_fit(problem, fitted)
    std = fitted.std if goodness.accepted else _widened(problem, fitted)
    if goodness.accepted:
        progress("maximising the likelihood of whole recordings")
        whole = prepared.finished(fitted)
        if isinstance(whole, Fit):
            fitted, std = whole, np.sqrt(np.diag(whole.covariance))
    bound, unbounded = bounds_of(prepared, fitted.model)
    progress("simulating")
    train = comparisons_of(prepared, [fitted, fitted])[0]
    return Estimate(
        parameters_of(scene, fitted, std, bound),
        train,
        goodness,
        prepared.mistakes,
        prepared.noise_remarks,
        (*prepared.notes, *unknown_noise, *notes, *unbounded, *train.missing("train")),
        prepared.channel_noise,
    )


def _fitted_with_less_noise(
    prepared: PreparedRecordings, fitted: Fit
) -> tuple[PreparedRecordings, SearchProblem, Fit] | None:
    """The recordings with the noise of efforts that the fit leaves, fitted again; None where it hardly changed."""
    finer = prepared.with_noise_beside(fitted.model)
    return None if finer is None else (finer, *fit_given(finer.problem(), fitted.model))


def _widened(problem: SearchProblem, fitted: Fit) -> Array:
    """(n,) standard deviations of the unknowns where more than noise is left."""
    std = compute(lambda: standard_deviations(problem, fitted, scale_of(fitted)))
    return fitted.std if isinstance(std, NotComputable) else np.where(np.isfinite(std), std, fitted.std)
