"""Withholds late efforts and soft joints that simulations of left-out parts do not confirm.

A controller answers forces that nobody knows, so that these go together with changes of its efforts. Over windows that
last longer than a delay, the equations of motion do not tell which of the two comes first (closed-loop identification;
Ljung, System Identification, 1999, §13.4): what depends on changes of an effort explains a part of what the forces do.
Simulations over 0.1 s, in which a controller of some rad/s hardly answers, are not better with it. One that answers
faster may deceive them, too.
"""

from collections.abc import Callable

import numpy as np

from drake_cafim.diagnosis.left_out import decisions
from drake_cafim.diagnosis.left_out.parts import parts_of
from drake_cafim.diagnosis.left_out.refits import Items, Refits
from drake_cafim.diagnosis.left_out.simulations import (
    ByColumn,
    Predictions,
    errors_over,
    mean_differences,
    mean_with_error,
)
from drake_cafim.diagnosis.predict.forecast import SHORT_HORIZON
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.search.shared_evidence import withhold
from drake_cafim.diagnosis.trace import Record, Trace, name_of
from drake_cafim.effects.effect import Effect, Place
from drake_cafim.typing import Array


def withhold_unconfirmed_by_simulation(
    judgement: Judgement, predictions: Callable[[Judgement], Predictions], given: Array | None, trace: Trace
) -> Judgement:
    """The judgement without the laws of changes of efforts that simulations do not confirm; each test is in `trace`.

    Where unknown forces are a part of what remains. The unknowns as `given` (n,) are as for `Refits.of`.
    """
    if judgement.kind != "unexplained" or judgement.adequate or not judgement.outcome.problem.forced_joints:
        return judgement
    own = trace.of_search(judgement.search)
    while any(map(_acts_by_changes_of_efforts, judgement.best.model.effects)):
        found = _least_confirmed(judgement, predictions(judgement), given)
        if found is None:
            break
        effect, record = found
        own.add(record)
        if record.passed:
            break
        judgement = withhold(judgement, [effect])
    return judgement


def _acts_by_changes_of_efforts(effect: Effect) -> bool:
    return effect.needs_motion and effect.place is not Place.CHANNEL


def _least_confirmed(
    judgement: Judgement, predictions: Predictions, given: Array | None
) -> tuple[Effect, Record] | None:
    """The law of changes of efforts of which simulations of left-out parts confirm the least, and the test.

    None where no part can judge one.
    """
    problem, best = judgement.outcome.problem, judgement.best
    parts = parts_of(problem.runs)
    refits = Refits.of(problem, best, parts, given)
    kept = frozenset(refits.items)

    def errors(items: Items) -> list[ByColumn]:
        return errors_over(predictions, refits.models(items), parts, SHORT_HORIZON)[0]

    beside, tested = errors(kept), []
    for item, effect in enumerate(best.model.effects):
        if not _acts_by_changes_of_efforts(effect):
            continue
        worse = np.where(refits.shown(item), mean_differences(beside, errors(kept - {item})), np.nan)
        if np.any(np.isfinite(worse)):
            mean, error = mean_with_error(worse)
            tested.append((mean + error, effect, decisions.confirmed(name_of(effect.key), mean, error)))
    return max(tested, key=lambda entry: entry[0])[1:] if tested else None
