"""Withholds names that the recordings do not support, since other laws explain as much.

An explanation may leave nothing but noise and yet share that with other laws. Then none has earned its name: the place
is told, and the laws that may act there stand as rivals.
"""

from collections.abc import Iterator
from dataclasses import replace

from drake_cafim.diagnosis.fit.fitting import unbiased_fit
from drake_cafim.diagnosis.search import decisions_by_place as decisions
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.search.search_under_unknown_force import mean_square
from drake_cafim.diagnosis.thresholds import LEAST_PROBABILITY
from drake_cafim.diagnosis.trace import Record, Trace
from drake_cafim.effects.effect import Effect


def withhold_shared(judgement: Judgement, trace: Trace) -> Judgement:
    """The judgement without the names that fail `failures`, which are its `withheld`; each failure is added to `trace`.

    Its kind is then `unexplained`, since what these effects explained has no name.
    """
    own = trace.of_search(judgement.search)
    while failed := list(failures(judgement)):
        best, outcome = judgement.best, judgement.outcome
        own.add(*(record for _, record in failed))
        dropped = {effect.key for effect, _ in failed}
        kept = tuple(effect for effect in best.model.effects if effect.key not in dropped)
        rest = unbiased_fit(outcome.problem, replace(best.model, effects=kept)) if kept else outcome.nominal
        # the rows of the search are whitened under the effects that are now withheld
        left = mean_square(outcome.nominal_problem, rest)
        judgement = replace(
            judgement,
            best=rest,
            kind="unexplained",
            left=left,
            adequate=False,
            withheld=(*judgement.withheld, *(effect for effect, _ in failed)),
        )
    return judgement


def failures(judgement: Judgement) -> Iterator[tuple[Effect, Record]]:
    """The named effects that have less than half of the probability that they share with other laws, and the record."""
    for effect in judgement.best.model.effects:
        probability = judgement.outcome.probability.get(effect.key, 1.0)
        if probability < LEAST_PROBABILITY:
            yield effect, decisions.record_shared(judgement.best.model, effect, probability, LEAST_PROBABILITY)
