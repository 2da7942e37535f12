"""Pushes of an explanation: where they act, and whether they are named.

Each is located at its body, over its fitted interval. Blocks of time whose residual exceeds noise are shorter than a
weak push, whose ends vanish in the noise, and longer than a strong one, since they have a fixed width; the fitted
interval has neither error.

A push of free start, length and direction takes much of whatever happens once. As a name it says more: that a pulse of
force acted then, and nothing else. Where more than noise is left while it acts, that is refuted, and only the place and
the time are told.
"""

from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.fit.fitting import Fit, unbiased_fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.search import decisions_by_place as decisions
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.search.search_under_unknown_force import mean_square
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.thresholds import NOISE_STD_TOLERANCE
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.diagnosis.verdict import Location
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array


def locate_named(problem: SearchProblem, best: Model, lacking: Model) -> tuple[Location, ...]:
    """Where recordings differ from the model `lacking`, strongest first; each push of `best` is a location of its own.

    The share of a push is its part of the decrease of χ² by `best`, and 0 where `lacking` contains the push.
    """
    pushes = tuple(effect for effect in best.effects if effect.episode is not None)
    if not pushes:
        return problem.locate(lacking)
    shares = np.zeros(len(pushes))
    if not any(push in lacking.effects for push in pushes):
        shares = _shares(problem, best, lacking, pushes)
        lacking = lacking.with_effects(pushes)
    rest = [
        replace(location, share=location.share * (1.0 - float(np.sum(shares)))) for location in problem.locate(lacking)
    ]
    named = [_location(push, float(share)) for push, share in zip(pushes, shares, strict=True)]
    return tuple(sorted([*named, *rest], key=lambda location: -location.share))


def withhold_refuted_pushes(judgement: Judgement, settings: Settings, trace: Trace) -> Judgement:
    """The judgement without pushes during which more than noise is left; each test is added to `trace`.

    It is asked where more than noise is left somewhere, of all rows during a push together, at the adequacy's level.
    The noise is that of the channels alone: of unknown forces, too, a push takes its part. The other effects are fitted
    again without it.
    """
    if judgement.kind != "unexplained" or judgement.adequate:
        return judgement
    outcome, best, own = judgement.outcome, judgement.best, trace.of_search(judgement.search)
    pushes = [effect for effect in best.model.effects if effect.episode is not None]
    refuted = []
    problem = outcome.nominal_problem.rewhitened(best.model) if pushes else outcome.nominal_problem
    for push in pushes:
        left, count = _left_during(problem, best, push)
        level = settings.adequacy_level / len(pushes)
        most = float(chi2.isf(level, count)) * (1.0 + NOISE_STD_TOLERANCE) ** 2 if count else 0.0
        own.add(decisions.record_push(best.model, push, left / max(count, 1), most / max(count, 1)))
        refuted += [push] if left > most else []
    if not refuted:
        return judgement
    kept = tuple(effect for effect in best.model.effects if effect not in refuted)
    rest = unbiased_fit(outcome.problem, replace(best.model, effects=kept)) if kept else outcome.nominal
    # the rows of the search are whitened under the pushes that are left out
    return replace(judgement, best=rest, left=mean_square(outcome.nominal_problem, rest))


def _left_during(problem: Problem, best: Fit, push: Effect) -> tuple[float, int]:
    """χ² of the rows whose windows are centred in a push's interval, and their number."""
    episode = push.episode
    assert episode is not None
    left, count = 0.0, 0
    for index, z in by_run(problem, problem.rows_of(best.model)):
        run = problem.runs[index]
        if episode.recording in (None, run.name):
            inside = z[(run.time >= episode.start) & (run.time <= episode.stop)]
            left, count = left + float(np.sum(inside**2)), count + inside.size
    return left, count


def _shares(problem: Problem, best: Model, lacking: Model, pushes: tuple[Effect, ...]) -> Array:
    """(p,) share of each push in the decrease of χ² by `best`; they sum to the share of all pushes together."""
    before = _chi_square(problem, lacking)
    explained = before - _chi_square(problem, best)
    together = before - _chi_square(problem, lacking.with_effects(pushes))
    gains = np.array([max(before - _chi_square(problem, lacking.with_effects([push])), 0.0) for push in pushes])
    if not (explained > 0.0 and np.any(gains > 0.0)):
        return np.zeros(len(pushes))
    return np.asarray(np.clip(together / explained, 0.0, 1.0) * gains / np.sum(gains))


def _chi_square(problem: Problem, model: Model) -> float:
    rows = problem.rows_of(model)
    return float(rows @ rows)


def _location(push: Effect, share: float) -> Location:
    episode = push.episode
    assert episode is not None
    return Location(push.place.value, push.at, share, ((episode.start, episode.stop),), episode.recording)
