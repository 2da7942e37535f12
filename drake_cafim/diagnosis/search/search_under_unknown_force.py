"""A search under forces that nobody knows, where one that reckons with none ends without an explanation.

What a model leaves is taken for noise at first, so that a few stretches of time do not outweigh all others; each round
knows of less of it, as far as the effects that were found explain it.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from drake_cafim.diagnosis.fit.evidence import leaves_noise
from drake_cafim.diagnosis.fit.fitting import Fit, unbiased_fit
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.search import decisions
from drake_cafim.diagnosis.search.search import Outcome, search
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.thresholds import MISFIT_SHARE_TO_EXPLAIN
from drake_cafim.diagnosis.trace import Trace

ROUNDS = 3
UNKNOWN_FORCES = "forces that nobody knows"
"""What a trace calls this search."""


def search_again(
    outcome: Outcome,
    settings: Settings,
    progress: Callable[[str], None] = lambda text: None,
    trace: Trace | None = None,
) -> Outcome | None:
    """What explains the recordings but for forces that are white noise and little beside it; None where nothing does.

    `outcome` is of a search that ended without an explanation. Each decision is added to `trace`.
    """
    trace = Trace(UNKNOWN_FORCES) if trace is None else trace
    nominal_problem, problem, best = outcome.nominal_problem, outcome.problem, outcome.best
    force = problem.likeliest_force(best.model)
    if force is None:
        return None
    progress("reckoning with forces that nobody knows")
    shaken = problem.shaken(force, best.model)
    if best.model.effects:
        beside = unbiased_fit(shaken, best.model)
        trace.add(*decisions.beside_forces(shaken, beside, settings.false_alarm_rate))
        if not leaves_noise(shaken, beside, settings.false_alarm_rate):
            return None
    begun = best.model.effects
    for _ in range(ROUNDS):
        found = search(nominal_problem.shaken(force), settings, progress, begun, trace)
        settled = {effect.key for effect in begun} == {effect.key for effect in found.best.model.effects}
        begun = found.best.model.effects
        if settled or not begun:
            break
        force = found.problem.likeliest_force(found.best.model)
        assert force is not None
    trace.add(*decisions.remaining(found.problem, found.best, settings.false_alarm_rate))
    if not begun or not leaves_noise(found.problem, found.best, settings.false_alarm_rate):
        trace.add(decisions.refused_beside_forces(found.best))
        return None
    left, had = _excess(nominal_problem, found.best), _excess(nominal_problem, outcome.nominal)
    trace.add(decisions.little_beside_forces(found.best, left, had, MISFIT_SHARE_TO_EXPLAIN))
    if left > MISFIT_SHARE_TO_EXPLAIN * had:
        return None
    return replace(
        found,
        nominal_problem=nominal_problem,
        nominal=outcome.nominal,
        detection_p_value=outcome.detection_p_value,
    )


def _excess(problem: Problem, one: Fit) -> float:
    """What a model leaves beyond the noise that the channels have."""
    rows = problem.rewhitened(one.model).rows_of(one.model)
    return max(float(np.mean(rows**2)) - 1.0, 0.0)
