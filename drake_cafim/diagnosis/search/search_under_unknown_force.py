"""A search with unknown forces at the joints as additional noise, after a search without them ended unexplained.

At first all that the model leaves counts as noise, so that a few stretches of time do not outweigh all others; in each
round the effects found so far explain a part, and the density of the unknown forces is estimated again from the rest.
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
UNKNOWN_FORCES = "unknown forces"
"""Name of this search in a trace."""


def search_again(
    outcome: Outcome,
    settings: Settings,
    progress: Callable[[str], None] = lambda text: None,
    trace: Trace | None = None,
) -> Outcome | None:
    """The search with unknown white forces as noise; None unless its effects leave only noise and small such forces.

    `outcome` is of a search that ended unexplained. Each decision is added to `trace`.
    """
    trace = Trace(UNKNOWN_FORCES) if trace is None else trace
    nominal_problem, problem, best = outcome.nominal_problem, outcome.problem, outcome.best
    force = problem.likeliest_force(best.model)
    if force is None:
        return None
    progress("searching with unknown forces counted as noise")
    noisier = problem.with_unknown_force(force, best.model)
    if best.model.effects:
        beside = unbiased_fit(noisier, best.model)
        trace.add(*decisions.record_unknown_forces_start(noisier, beside, settings.adequacy_level))
        if not leaves_noise(noisier, beside, settings.adequacy_level):
            return None
    initial = best.model.effects
    for _ in range(ROUNDS):
        found = search(nominal_problem.with_unknown_force(force), settings, progress, initial, trace)
        unchanged = {effect.key for effect in initial} == {effect.key for effect in found.best.model.effects}
        initial = found.best.model.effects
        if unchanged or not initial:
            break
        force = found.problem.likeliest_force(found.best.model)
        assert force is not None
    trace.add(*decisions.record_residual(found.problem, found.best, settings.adequacy_level))
    if not initial or not leaves_noise(found.problem, found.best, settings.adequacy_level):
        trace.add(decisions.record_unknown_forces_failure(found.best))
        return None
    # noise of any size would explain everything: under the stated noise, the effects must explain nearly all
    left, had = _excess(nominal_problem, found.best), _excess(nominal_problem, outcome.nominal)
    trace.add(decisions.record_unknown_forces_share(found.best, left, had, MISFIT_SHARE_TO_EXPLAIN))
    if left > MISFIT_SHARE_TO_EXPLAIN * had:
        return None
    return replace(
        found,
        nominal_problem=nominal_problem,
        nominal=outcome.nominal,
        detection_p_value=outcome.detection_p_value,
    )


def _excess(problem: Problem, fit: Fit) -> float:
    """Mean square of the rows − 1, at least 0, whitened with the noise of the channels alone."""
    rows = problem.rewhitened(fit.model).rows_of(fit.model)
    return max(float(np.mean(rows**2)) - 1.0, 0.0)
