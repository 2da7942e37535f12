"""The search for the effects that explain a misfit: detect, grow an explanation, compare it with its rivals."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.fit.detection import detection_p_value
from drake_cafim.diagnosis.fit.evidence import inclusion_probabilities, leaves_inaccuracy, scale_of
from drake_cafim.diagnosis.fit.fitting import Fit, fit_at_first_order, unbiased_fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.places import place_of
from drake_cafim.diagnosis.fit.rivals import Rivals
from drake_cafim.diagnosis.fit.screening import Candidate, by_row, screen
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.search import candidate_decisions, decisions
from drake_cafim.diagnosis.search.competition import compete, more_likely_alike
from drake_cafim.diagnosis.search.growth import grow
from drake_cafim.diagnosis.search.state import ROUNDS, Settings, State, has_moved
from drake_cafim.diagnosis.thresholds import (
    MISFIT_REDUCED_CHI_SQUARE,
    NAMED_EXCESS_SHARE,
    UNKNOWN_MOVE_IN_PRIOR_STDS,
)
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Outcome:
    """The result of a search: the best fit, the explanations it competed with, and the tests of the nominal model."""

    problem: SearchProblem
    nominal_problem: SearchProblem
    nominal: Fit
    best: Fit
    competing: tuple[Fit, ...]
    """The explanations that were compared with the best one, which is among them.

    An explanation that the criterion prefers to the best one is not: it has more effects, and these failed a test.
    """
    hypotheses: int
    screened: tuple[Candidate, ...]
    detection_p_value: float
    probability: Mapping[Key, float]
    """Posterior probability of each effect, and of each unknown without its prior, by (name, place)."""
    compare: "Callable[[], Outcome] | None" = None
    """Compares the best fit with its rivals, where that was put off; None where it is done."""
    unsupported: tuple[Effect, ...] = ()
    """Effects that stood out of unknown forces and explain less than is left at their places."""
    rivals: Rivals | None = None
    """The laws that effects under unknown forces were compared with."""

    def compared(self) -> "Outcome":
        """The outcome with its best fit compared with rivals."""
        return self if self.compare is None else self.compare()

    @property
    def scale(self) -> float:
        """χ² of the best fit per degree of freedom, at least 1."""
        return scale_of(self.best)


def search(
    problem: SearchProblem,
    settings: Settings,
    progress: Callable[[str], None] = lambda text: None,
    initial: Sequence[Effect] = (),
    trace: Trace | None = None,
    put_off: bool = False,
    many: bool = False,
) -> Outcome:
    """The effects that explain the recordings beyond the scene's nominal physics, starting from the `initial` effects.

    `progress` is called with a few words on each stage; each decision is added to `trace`. With `put_off`, the best
    explanation is returned as soon as no few effects can explain the recordings, at once where `many` are known;
    `Outcome.compared` then goes on.
    """
    trace = Trace() if trace is None else trace
    progress("fitting the nominal model")
    problem, nominal = fit_nominal(problem, trace)
    effects = problem.hypotheses()
    progress(f"screening {len(effects)} hypotheses")
    screened = screen(problem, nominal, effects, jobs=settings.jobs)
    trials = sum(candidate.trials for candidate in screened)
    detection = detection_p_value(problem, nominal, screened, trials)
    trace.add(decisions.record_detection(detection, settings.false_alarm_rate, trials))
    state = State(problem, settings, effects, trials, progress, trace)
    state.pool.add(nominal)
    state.screens[nominal.model.keys] = screened
    best = nominal
    begun = Outcome(problem, problem, nominal, nominal, (), trials, tuple(screened), detection, {})
    if detection <= settings.false_alarm_rate and settings.most_effects:
        best = _fit_initial(state, nominal, initial)
        if put_off and (many or lacks_more_effects(state, best)):
            return _put_off(state, begun, best, grown=False)
        best = grow(state, best, lacks_more_effects if put_off else None)
        if put_off and lacks_more_effects(state, best):
            return _put_off(state, begun, best, grown=not state.halted)
        best = _explain(state, best)
    else:
        trace.add(
            *candidate_decisions.record_screening(nominal, screened, effects, trials, settings.false_alarm_rate, None)
        )
    return _concluded(state, begun, best)


def fit_nominal(problem: SearchProblem, trace: Trace) -> tuple[SearchProblem, Fit]:
    """The problem, whitened under the unknowns of the nominal model as fitted, and that fit."""
    under, nominal = Model(problem.scene.priors.mean), unbiased_fit(problem, problem.nominal())
    for number in range(ROUNDS):
        moved = np.abs(nominal.model.unknown - under.unknown) > nominal.std[: len(under.unknown)]
        if not has_moved(problem, under, nominal.model) and (number or not np.any(moved)):
            break
        # the noise covariance depends on the masses, and the arcs of a throw are fitted under them; the motion is
        # estimated under them too, where they act as forces that the model lacks
        problem.forget()
        under, problem = nominal.model, problem.rewhitened(nominal.model)
        nominal = unbiased_fit(problem, under)
        trace.add(decisions.record_whitening(problem, under, nominal.model, UNKNOWN_MOVE_IN_PRIOR_STDS))
    return problem, nominal


def _put_off(state: State, begun: Outcome, best: Fit, grown: bool) -> Outcome:
    """The outcome `begun` with `best`, from which the search goes on where none for more effects finds any."""
    state.trace.add(candidate_decisions.record_put_off(best, state.settings.most_effects))
    compare = partial(_compared, state, begun, best, grown)
    return replace(begun, problem=state.problem, best=best, compare=compare)


def _compared(state: State, begun: Outcome, best: Fit, grown: bool) -> Outcome:
    """The outcome `begun` with the most probable explanation beside `best`, or grown from it."""
    return _concluded(state, begun, _explain(state, best if grown else grow(state, best)))


def _concluded(state: State, begun: Outcome, best: Fit) -> Outcome:
    """The outcome `begun` with the explanation `best` and the others of the state, by their probabilities."""
    cost = state.cost(scale_of(best))
    # larger explanations that failed a test may have a smaller criterion: they do not compete
    competing = tuple(found for found in state.pool.fits.values() if found is best or cost(found) > cost(best))
    state.trace.add(*decisions.record_choice(competing, best, cost))
    probability = dict(inclusion_probabilities(competing, cost))
    for effect in best.model.effects:
        # what speaks for a law speaks for a simpler one at its place that it contains
        larger = [law.key for law in state.effects if law.at == effect.at and effect.name in law.narrows]
        together = sum(probability.get(key, 0.0) for key in (effect.key, *larger))
        probability[effect.key] = min(together, 1.0)
    return replace(begun, problem=state.problem, best=best, competing=competing, probability=probability)


def lacks_more_effects(state: State, best: Fit) -> bool:
    """Whether as few effects as are allowed will not explain the recordings, by what `best` leaves.

    More rows of a window are left far from noise than there may be effects. And to first order those that may be added,
    the best at each place, together explain less than half of the misfit, or halve it in fewer than half of these rows:
    effects at several places may explain the same, and a joint is not explained by others that are further from noise.
    Once one was fitted, each of these rows has to be halved: the first one may disturb the rows of other joints.
    """
    problem, most = state.problem, state.settings.most_effects
    windows = sum(len(z) for _, z in by_run(problem, best.residual[: problem.rows]))
    had = by_row(problem, best.residual)
    far = had > MISFIT_REDUCED_CHI_SQUARE * windows
    if np.count_nonzero(far) <= most or leaves_inaccuracy(problem, best):
        return False
    by_place: dict[str, Candidate] = {}
    for candidate in state.screen(best) if most > len(best.model.effects) else ():
        by_place.setdefault(place_of(candidate.effect), candidate)
    added = list(by_place.values())[: most - len(best.model.effects)]
    explained = np.max(
        [_explained(problem, best, added), *(candidate.gains for candidate in added)], axis=0, initial=0.0
    )
    halved = explained >= NAMED_EXCESS_SHARE * (had - windows)
    hardly = np.sum(explained) < NAMED_EXCESS_SHARE * np.sum(had - windows)
    return bool(hardly or np.mean(halved[far]) < (1.0 if best.model.effects else NAMED_EXCESS_SHARE))


def _explained(problem: SearchProblem, best: Fit, added: Sequence[Candidate]) -> Array:
    """(r,) decrease of χ² in each row of a window by effects that are `added` together, to first order."""
    model = best.model.with_effects([candidate.effect for candidate in added])
    columns = problem.jacobian(model)[:, len(best.model.vector) :]
    together = fit_at_first_order(problem, best, model, [columns])
    return by_row(problem, best.residual) - by_row(problem, together.residual)


def _explain(state: State, best: Fit) -> Fit:
    """The most probable explanation beside the grown one `best`.

    It is grown again where an unknown turns out to be far from its prior, or where another explanation takes its place
    under which the noise of the rows is another: what stood out of the former noise says nothing of this one.
    """
    for number in range(ROUNDS):
        free = best.model.free
        best = compete(state, grow(state, best) if number else best)
        alike = None if number else more_likely_alike(state, best)
        if alike is None and best.model.free == free and not state.problem.has_other_noise(best.model):
            break
        state.frontier = list(state.pool.fits.values())
        best = state.rewhiten(alike or best) or best
    return best


def _fit_initial(state: State, nominal: Fit, effects: Sequence[Effect]) -> Fit:
    """The fit with `effects`; the nominal one where there are none, or where their gain is an artefact of noise."""
    if not effects:
        return nominal
    found = unbiased_fit(state.problem, nominal.model.with_effects(effects))
    state.pool.add(found)
    return nominal if found.echo else state.rewhiten(found) or nominal
