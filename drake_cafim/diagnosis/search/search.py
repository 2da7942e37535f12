"""The search for what explains a misfit: detect, grow an explanation, let it compete with all others."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from drake_cafim.diagnosis.fit.evidence import scale_of
from drake_cafim.diagnosis.fit.fitting import Fit, unbiased_fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.search import decisions
from drake_cafim.diagnosis.search.competition import compete
from drake_cafim.diagnosis.search.detection import detection_p_value
from drake_cafim.diagnosis.search.growth import grow
from drake_cafim.diagnosis.search.posterior import inclusion
from drake_cafim.diagnosis.search.screening import Candidate, screen
from drake_cafim.diagnosis.search.state import ROUNDS, Settings, State, has_moved
from drake_cafim.diagnosis.thresholds import UNKNOWN_MOVE_IN_PRIOR_STDS
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.effect import Effect


@dataclass(frozen=True)
class Outcome:
    """What the search found: the best fit, all that were tried, and the first look at the nominal model."""

    problem: SearchProblem
    nominal_problem: SearchProblem
    nominal: Fit
    best: Fit
    competing: tuple[Fit, ...]
    """The explanations that were compared with the best one, which is among them.

    One that the criterion would prefer has more effects, which did not pass the tests of an admission.
    """
    hypotheses: int
    screened: tuple[Candidate, ...]
    detection_p_value: float
    probability: Mapping[Key, float]
    """Posterior probability of each effect, and of each unknown whose prior is wrong, by (name, place)."""

    @property
    def scale(self) -> float:
        return scale_of(self.best)


def search(
    problem: SearchProblem,
    settings: Settings,
    progress: Callable[[str], None] = lambda text: None,
    begun: Sequence[Effect] = (),
    trace: Trace | None = None,
) -> Outcome:
    """The effects that the recordings ask for, beyond the scene's nominal physics and those `begun` with.

    Each decision is added to `trace`.
    """
    trace = Trace() if trace is None else trace
    progress("fitting the nominal model")
    reckoned, nominal = Model(problem.scene.priors.mean), unbiased_fit(problem, problem.nominal())
    for _ in range(ROUNDS):
        if not has_moved(problem, reckoned, nominal.model):
            break
        # other masses let other amounts of noise through, and a throw settles where they have it
        reckoned, problem = nominal.model, problem.rewhitened(nominal.model)
        nominal = unbiased_fit(problem, reckoned)
        trace.add(decisions.whitened(problem, reckoned, nominal.model, UNKNOWN_MOVE_IN_PRIOR_STDS))
    effects = problem.hypotheses()
    progress(f"screening {len(effects)} hypotheses")
    screened = screen(problem, nominal, effects)
    trials = sum(candidate.trials for candidate in screened)
    detection = detection_p_value(problem, nominal, screened, trials)
    trace.add(decisions.detected(detection, settings.false_alarm_rate, trials))
    state = State(problem, settings, effects, trials, progress, trace)
    state.pool.add(nominal)
    state.screens[nominal.model.keys] = screened
    best = nominal
    if detection <= settings.false_alarm_rate:
        best = _explained(state, _fit_begun(state, nominal, begun))
    else:
        trace.add(*decisions.screened(nominal, screened, effects, trials, settings.false_alarm_rate, None))
    cost = state.cost(scale_of(best))
    competing = tuple(found for found in state.pool.fits.values() if found is best or cost(found) > cost(best))
    trace.add(*decisions.compared(competing, best, cost))
    probability = inclusion(competing, cost)
    looks = tuple(screened)
    return Outcome(state.problem, problem, nominal, best, competing, trials, looks, detection, probability)


def _explained(state: State, best: Fit) -> Fit:
    """The most probable explanation, grown from `best`; and grown on where an unknown turns out far from its prior."""
    for _ in range(ROUNDS):
        free = best.model.free
        best = compete(state, grow(state, best))
        if best.model.free == free:
            break
        state.frontier = list(state.pool.fits.values())
        best = state.rewhiten(best) or best
    return best


def _fit_begun(state: State, nominal: Fit, effects: Sequence[Effect]) -> Fit:
    """The fit with `effects`, the nominal one where there are none, or where they are an echo of noise."""
    if not effects:
        return nominal
    found = unbiased_fit(state.problem, nominal.model.with_effects(effects))
    state.pool.add(found)
    return nominal if found.echo else state.rewhiten(found) or nominal
