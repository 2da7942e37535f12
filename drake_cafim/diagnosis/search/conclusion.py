"""How a diagnosis ends, as records of its trace: mistakes of the data, rivals, and the kind of the verdict."""

from drake_cafim.diagnosis.search.decisions import name
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.thresholds import RIVAL_EXCESS_CHI_SQUARE
from drake_cafim.diagnosis.trace import NOMINAL, Record, name_of, names_of, spoken
from drake_cafim.diagnosis.verdict import Verdict
from drake_cafim.numerics.rounding import short

KINDS = {
    "none": "the recordings are as the model and its noise predict",
    "explained": "what the named effects leave is as the noise predicts",
    "unexplained": "what is left is more than noise",
}


def data_mistake(sentence: str) -> Record:
    """A mistake of the data, because of which no effect is named."""
    words = f"{sentence}; physics that would make up for it is none, so nothing is named"
    return Record("data_mistake", NOMINAL, None, None, False, words)


def concluded(verdict: Verdict, judgement: Judgement) -> list[Record]:
    """The rivals, and the kind of the verdict."""
    best, outcome, records = judgement.best, judgement.outcome, []
    for rival in verdict.rivals:
        fits = [fit.chi_square for fit in outcome.competing if rival.key in fit.model.keys]
        worse, most = min(fits) - best.chi_square, RIVAL_EXCESS_CHI_SQUARE * outcome.scale
        side = "worse" if worse > 0.0 else "better"
        words = (
            f"the closest explanation with it fits {side} by {short(abs(worse))} in χ²; what fits worse by no more "
            f"than {short(most)} cannot be told apart by χ² alone. "
            f"Its probability is {short(rival.probability, 2)}: {rival.why_alike}"
        )
        asked = name_of(rival.key)
        records.append(Record("rival", asked, worse, most, True, words, "difference in χ²", name(best.model)))
    effects = names_of(effect.key for effect in best.model.effects)
    named = spoken(effects) if best.model.effects else "no effect"
    words = f"{verdict.kind}: {KINDS[verdict.kind]}; named: {named}"
    return [*records, Record("verdict", verdict.kind, None, None, verdict.kind == "explained", words)]
