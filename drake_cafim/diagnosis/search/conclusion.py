"""Writes the end of a diagnosis as records of its trace: mistakes of the data, rivals, and the kind of the verdict."""

from drake_cafim.diagnosis.search.decisions import model_name
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.thresholds import RIVAL_EXCESS_CHI_SQUARE
from drake_cafim.diagnosis.trace import NOMINAL, Record, name_of, names_of, spoken
from drake_cafim.diagnosis.verdict import Verdict
from drake_cafim.numerics.rounding import short

KINDS = {
    "none": "the recordings are as the model and its noise predict",
    "explained": "with the named effects, what remains is as the noise predicts",
    "unexplained": "more than noise remains",
}
"""Each kind of verdict in words."""
FAR_UNKNOWN = "what remains is as the noise predicts, but a parameter is too far from its prior"
"""An unexplained verdict with nothing but a `far_unknown`, in words."""


def record_data_mistake(sentence: str) -> Record:
    """A mistake of the data, described by `sentence`, because of which no effect is named."""
    words = f"{sentence}; an effect that compensates for wrong data is no physics, so none is named"
    return Record("data_mistake", NOMINAL, None, None, False, words)


def record_conclusion(verdict: Verdict, judgement: Judgement) -> list[Record]:
    """The rivals of the verdict, and its kind."""
    best, outcome, records = judgement.best, judgement.outcome, []
    # a name that is withheld stands among its rivals
    whole = outcome.best if judgement.withheld else best
    for rival in verdict.rivals:
        fits = [fit.chi_square for fit in outcome.competing if rival.key in fit.model.keys]
        if not fits or rival.key in judgement.rivals:
            # compared otherwise, and recorded there
            continue
        worse, most = min(fits) - whole.chi_square, RIVAL_EXCESS_CHI_SQUARE * outcome.scale
        side = "larger" if worse > 0.0 else "smaller"
        words = (
            f"χ² of the best explanation with it is {side} by {short(abs(worse))}; one whose χ² is larger by "
            f"at most {short(most)} cannot be distinguished by its fit. "
            f"Its probability is {short(rival.probability, 2)}: {rival.why_alike}"
        )
        asked = name_of(rival.key)
        records.append(Record("rival", asked, worse, most, True, words, "difference in χ²", model_name(whole.model)))
    effects = names_of(effect.key for effect in best.model.effects)
    named = spoken(effects) if best.model.effects else "no effect"
    reason = FAR_UNKNOWN if verdict.kind == "unexplained" and verdict.adequate else KINDS[verdict.kind]
    words = f"{verdict.kind}: {reason}; named: {named}"
    return [*records, Record("verdict", verdict.kind, None, None, verdict.kind == "explained", words)]
