"""Withholds names that the recordings do not support: not determined, or no more probable than others.

An explanation may leave nothing but noise and yet share that with another law, or hold a strength that may be
anything. Then no law has earned its name: the place is told, and the laws that may act there stand as rivals.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from drake_cafim.diagnosis.fit.fitting import unbiased_fit
from drake_cafim.diagnosis.fit.intervals import standard_deviations
from drake_cafim.diagnosis.search import decisions_by_place as decisions
from drake_cafim.diagnosis.search.determined import undetermined
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.search.search_under_unknown_force import mean_square
from drake_cafim.diagnosis.thresholds import LEAST_PROBABILITY
from drake_cafim.diagnosis.trace import Record, Trace
from drake_cafim.effects.effect import Effect
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.typing import Array


def withhold_unsupported(judgement: Judgement, trace: Trace) -> Judgement:
    """The judgement without the names that fail `failures`, which are its `withheld`; each failure is added to `trace`.

    Its kind is then `unexplained`, since what these effects explained has no name.
    """
    own = trace.of_search(judgement.search)
    while judgement.best.model.effects:
        problem, best = judgement.outcome.problem, judgement.best
        std = compute(partial(standard_deviations, problem, best, judgement.outcome.scale))
        if isinstance(std, NotComputable):
            return judgement
        failed = list(failures(judgement, std))
        if not failed:
            return replace(judgement, std=std)
        own.add(*(record for _, record in failed))
        dropped = {effect.key for effect, _ in failed}
        kept = tuple(effect for effect in best.model.effects if effect.key not in dropped)
        nominally, nominal = judgement.outcome.nominal_problem, judgement.outcome.nominal
        rest = unbiased_fit(problem, replace(best.model, effects=kept)) if kept else nominal
        # the rows of the search are whitened under the effects that are now withheld
        left = mean_square(nominally, rest)
        judgement = replace(
            judgement,
            best=rest,
            kind="unexplained",
            left=left,
            adequate=False,
            withheld=(*judgement.withheld, *(effect for effect, _ in failed)),
        )
    return judgement


def failures(judgement: Judgement, std: Array) -> Iterator[tuple[Effect, Record]]:
    """The named effects that lack support, with the record of the first test that each fails.

    `std` (n + k,) are the standard deviations of unknowns and strengths. A name needs an amplitude that is determined,
    and half of the probability that it shares with other laws. What else a law has, such as the damping of a contact
    or the range of an adhesion, may be known by its bounds alone.
    """
    best, position = judgement.best, len(judgement.best.model.unknown)
    for effect in best.model.effects:
        own = slice(position, position + len(effect.strengths))
        position = own.stop
        record = _failure(judgement, effect, std[own], best.std[own])
        if record is not None:
            yield effect, record


def _failure(judgement: Judgement, effect: Effect, std: Array, linear_std: Array) -> Record | None:
    model = judgement.best.model
    amplitudes = [s for s in effect.strengths if s.amplitude and not s.through and not s.inverse]
    wide = [undetermined(effect, std, linear_std, [strength]) for strength in amplitudes]
    if wide and wide[0] is not None and all(found is not None for found in wide):
        return decisions.record_undetermined(model, effect, *wide[0])
    probability = judgement.outcome.probability.get(effect.key, 1.0)
    if probability < LEAST_PROBABILITY:
        return decisions.record_shared(model, effect, probability, LEAST_PROBABILITY)
    return None
