"""A search under forces that nobody knows, where one that reckons with none ends without an explanation.

What a model leaves is taken for noise at first, so that a few stretches of time do not outweigh all others; each round
knows of less of it, as far as the effects that were found explain it.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from drake_cafim.diagnosis.evidence import FAIR_PART, leaves_noise
from drake_cafim.diagnosis.fitting import Fit, unbiased_fit
from drake_cafim.diagnosis.search import Outcome, Settings, key_of, search
from drake_cafim.diagnosis.unknown_force import likeliest
from drake_cafim.diagnosis.weak_problem import WeakProblem

ROUNDS = 3


def search_again(
    outcome: Outcome, settings: Settings, progress: Callable[[str], None] = lambda text: None
) -> Outcome | None:
    """What explains the recordings but for forces that are white noise and little beside it; None where nothing does.

    `outcome` is of a search that ended without an explanation.
    """
    nominal_problem, problem, best = outcome.nominal_problem, outcome.problem, outcome.best
    if not isinstance(nominal_problem, WeakProblem) or not isinstance(problem, WeakProblem):
        return None
    progress("reckoning with forces that nobody knows")
    force = likeliest(problem, best.model)
    shaken = problem.shaken(best.model, force)
    if best.model.effects and not leaves_noise(shaken, unbiased_fit(shaken, best.model), settings.false_alarm_rate):
        return None
    begun = best.model.effects
    for _ in range(ROUNDS):
        found = search(nominal_problem.shaken(nominal_problem.under, force), settings, progress, begun)
        settled = {effect.key for effect in begun} == key_of(found.best)
        begun = found.best.model.effects
        if settled or not begun:
            break
        assert isinstance(found.problem, WeakProblem)
        force = likeliest(found.problem, found.best.model)
    if not begun or not leaves_noise(found.problem, found.best, settings.false_alarm_rate):
        return None
    if _excess(nominal_problem, found.best) > FAIR_PART * _excess(nominal_problem, outcome.nominal):
        return None
    return replace(
        found,
        nominal_problem=nominal_problem,
        nominal=outcome.nominal,
        detection_p_value=outcome.detection_p_value,
    )


def _excess(problem: WeakProblem, one: Fit) -> float:
    """What a model leaves beyond the noise that the channels have."""
    rows = problem.rewhitened(one.model).rows_of(one.model)
    return max(float(np.mean(rows**2)) - 1.0, 0.0)
