"""Writes the decisions of a search under unknown forces, place by place, as records of its trace."""

from collections.abc import Sequence

import numpy as np

from drake_cafim.diagnosis.fit.constancy import Constancy
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.trace import Record, name_of, names_of, spoken
from drake_cafim.effects.effect import Effect
from drake_cafim.numerics.rounding import short
from drake_cafim.scenario.unknown import UnknownParameter
from drake_cafim.typing import Flags


def record_wald(model: Model, effect: Effect, statistic: float, threshold: float) -> Record:
    """Whether an effect stands out of the unknown forces at its place."""
    passed = statistic >= threshold
    words = (
        f"against unknown forces at the joints, as large as the residual makes them, it has a Wald statistic of "
        f"{short(statistic)} (χ² of its difference from no effect); on noise alone, the best of all candidates would "
        f"have less than {short(threshold)}, so it is {'admitted' if passed else 'dropped'}"
    )
    return _record("admit", model, effect, statistic, threshold, passed, words, "Wald statistic")


def record_share(model: Model, effect: Effect, share: float, least: float) -> Record:
    """An effect that removes too little of the misfit at its place to stand out of what nobody knows there."""
    words = (
        f"it removes a share of {short(share)} of χ² from the rows that it explains best; because more than noise and "
        f"white forces remain, at least {short(least)} is required, so it is dropped"
    )
    return _record("admit", model, effect, share, least, False, words, "share of misfit")


def record_improved(model: Model, effect: Effect, share: float, least: float) -> Record:
    """An effect that makes up for something else, and so helps in some recordings only."""
    words = (
        f"it improves the fit in a share of {short(share)} of the recordings, or of their quarters; at least "
        f"{short(least)} is required, so it is dropped"
    )
    return _record("admit", model, effect, share, least, False, words, "share of recordings")


def record_likelihood(larger: Model, smaller: Model, lead: float) -> Record:
    """Whether an explanation is accepted; `lead` is its criterion beyond that of the one before."""
    passed = lead < 0.0
    words = (
        f"under the forces that each leaves unknown, the information criterion is {short(abs(lead))} "
        f"{'lower' if passed else 'higher'} than before, so it is {'accepted' if passed else 'rejected'}"
    )
    return Record("fit", names_of(larger.keys), -lead, 0.0, passed, words, "criterion", names_of(smaller.keys))


def record_bound(model: Model, effect: Effect, strength: str) -> Record:
    """A law one of whose strengths ended at a bound."""
    words = (
        f"its {strength.replace('_', ' ')} ends at a bound or beyond it, {short(effect.values[strength])}: a "
        "simpler law says the same, so it is dropped"
    )
    return _record("admit", model, effect, None, None, False, words, "bound")


def record_implausible(model: Model, effect: Effect) -> Record:
    """An effect that would not act as its name says."""
    words = "over these motions it would not act as its name says, so it is dropped"
    return _record("admit", model, effect, None, None, False, words, "plausibility")


def record_undetermined(model: Model, effect: Effect, strength: str, std: float, size: float) -> Record:
    """A law one of whose strengths the recordings do not determine."""
    words = (
        f"the standard deviation of its {strength.replace('_', ' ')} is {short(std)}, and what it may be spans "
        f"{short(size)}: it is not determined, so the law is dropped"
    )
    return _record("admit", model, effect, std, size, False, words, "undetermined")


def record_unknown(model: Model, effect: Effect, reason: str) -> Record:
    """A law whose size is not known; `reason` is a clause."""
    return _record("admit", model, effect, None, None, False, f"{reason}, so it is dropped", "undetermined")


def record_contrast(model: Model, effect: Effect, simpler: str, statistic: float, threshold: float) -> Record:
    """A law of friction that the recordings do not tell from a `simpler` one that it contains."""
    words = (
        f"a Wald statistic of {short(statistic)} tells it from {simpler}; on noise alone, the best of all candidates "
        f"would have less than {short(threshold)}, so it is not chosen"
    )
    return _record("admit", model, effect, statistic, threshold, False, words, "Wald statistic")


def record_friction(model: Model, laws: Sequence[Effect], lead: float, chosen: bool) -> Record:
    """Whether `laws` are the friction of their joint; `lead` is their criterion beyond that of the chosen ones."""
    words = f"of the laws of friction that stand at {laws[0].at}, "
    words += "none simpler explains as much" if chosen else f"the information criterion is {short(lead)} higher"
    words += f", so {'it is' if chosen else 'it is not'} chosen"
    own = frozenset(law.key for law in laws)
    return Record("fit", names_of(own), -lead, 0.0, chosen, words, "criterion", names_of(model.keys - own))


def record_larger_friction(model: Model, laws: Sequence[Effect], gain: float, most: float) -> Record:
    """That `laws` are not the friction of their joint: their `gain` of χ² over simpler ones may be noise."""
    words = (
        f"of the laws of friction that stand at {laws[0].at}, it lowers χ² by {short(gain)} against the simplest; on "
        f"noise alone, the best of all candidates would lower it by less than {short(most)}, so it is not chosen"
    )
    own = frozenset(law.key for law in laws)
    return Record("fit", names_of(own), gain, most, False, words, "decrease of χ²", names_of(model.keys - own))


def record_support(model: Model, effect: Effect, share: float, least: float) -> Record:
    """Whether an effect explains more at its place than is left there."""
    passed = share >= least
    words = (
        f"in the row, or the priors, that it explains best, a share of {short(share)} of the misfit beyond noise is "
        f"removed by it; as more than noise and white forces remain, at least {short(least)} is required, so it is "
        f"{'named' if passed else 'not named'}"
    )
    return _record("test", model, effect, share, least, passed, words, "share of the misfit")


def record_push(model: Model, effect: Effect, left: float, most: float) -> Record:
    """Whether no more than noise is left while a push acts; `left` and `most` are mean squares of whitened rows."""
    passed = not left > most
    words = (
        f"while it acts, the mean square of what is left is {short(left)} times the noise; a pulse of force and "
        f"nothing else would leave at most {short(most)}, so it is {'named' if passed else 'not named'}"
    )
    return _record("test", model, effect, left, most, passed, words, "mean square during the push")


def record_contender(best: Model, effect: Effect, other: Key, lead: float, odds: float) -> Record:
    """An effect that was fitted exactly in the place of an accepted one; `lead` is its criterion beyond that one's.

    It counts the prior `odds` that other joints give.
    """
    by_others = "" if odds == 1.0 else f" with prior odds of {short(odds)} : 1 by what other joints lack"
    words = (
        f"in the place of {spoken(name_of(effect.key))}, all else being equal, the information criterion{by_others} is "
        f"{short(abs(lead))} {'higher, so it is not preferred' if lead > 0.0 else 'lower, so it is preferred'}"
    )
    beside = names_of(best.keys - {effect.key})
    return Record("choose", name_of(other), -lead, 0.0, lead < 0.0, words, "criterion", beside)


def record_shared(model: Model, effect: Effect, probability: float, least: float) -> Record:
    """Whether an effect has most of the evidence that it shares with other laws at its place."""
    passed = probability >= least
    words = (
        f"of the laws that explain the same, it has a probability of {short(probability, 2)}; at least "
        f"{short(least, 2)} is required, so it is {'named' if passed else 'not named'}"
    )
    return _record("prune", model, effect, probability, least, passed, words, "probability")


def record_left_at_place(model: Model, effect: Effect, share: float, most: float, passed: bool) -> Record:
    """Whether the laws at a place explain nearly all there, where other equations hold to the noise."""
    words = (
        f"other equations hold to the noise, so that what is missing is at its place, where a share of {short(share)} "
        f"of the misfit is left; laws that hold would leave at most {short(most)}, so it is "
        f"{'named' if passed else 'not named'}"
    )
    return _record("prune", model, effect, share, most, passed, words, "share left at its place")


def record_helped(model: Model, effect: Effect, share: float, least: float) -> Record:
    """Whether most of the recordings that show an effect are better with it."""
    passed = share >= least
    words = (
        f"a share of {short(share)} of the recordings that show it is predicted better with it, all else being fitted "
        f"again; as more than noise remains, at least {short(least)} is required, so it is "
        f"{'named' if passed else 'not named'}"
    )
    return _record("prune", model, effect, share, least, passed, words, "share of recordings")


def record_replacement(best: Fit, effect: Effect, other: Fit, p_value: float, level: float) -> Record:
    """Whether an effect predicts surely better than a law that was fitted in its place, once others were refuted."""
    passed = p_value <= level
    law, more = spoken(name_of(other.model.effects[-1].key)), other.chi_square - best.chi_square
    words = (
        f"with {law} in its place χ² is {short(abs(more))} {'higher' if more > 0.0 else 'lower'}; if it predicted no "
        f"better than that, blocks of time would differ as much with a probability of {short(p_value, 2)}; at most "
        f"{short(level)} is required, so it is {'named' if passed else 'not named'}"
    )
    return _record("prune", best.model, effect, p_value, level, passed, words, "p-value of no better")


def record_implausible_contact(model: Model, effect: Effect, unknown: UnknownParameter) -> Record:
    """A law of a contact beside which a number of that contact is not as plausible as its prior says."""
    words = (
        f"beside it the {unknown.parameter} of {unknown.at} is farther from its prior than is plausible, and more than "
        "noise remains, so it is not named"
    )
    return _record("prune", model, effect, None, None, False, words, "plausibility of the contact")


def record_read(model: Model, effect: Effect, read: float, beside: float, passed: bool) -> Record:
    """Whether a law stands where a sensor reads the contact's force: excess χ² by the reading without and with it."""
    words = (
        f"with the sensor's reading in the place of the predicted contact force, the equation of {effect.at} exceeds "
        f"noise by {short(read)} (χ²) without a law there, and by {short(beside)} with it"
    )
    if not passed:
        words += ": hardly anything is missing there without it, and more with it, so it is not named"
    return _record("prune", model, effect, beside, read, passed, words, "excess χ² with the sensor's reading")


def record_unconfirmed(step: str, model: Model, effect: Effect, shown: Flags, least: int) -> Record:
    """An effect that too few parts of the recordings show, those `shown` (P,), while more than noise remains."""
    count = int(np.count_nonzero(shown))
    words = (
        f"{count} of {len(shown)} parts of the recordings show{'s' if count == 1 else ''} it; as more than noise "
        f"remains, it may stand for what else is missing there, and at least {least} are required, so it is "
        f"{'dropped' if step == 'admit' else 'not named'}"
    )
    return _record(step, model, effect, float(count), float(least), False, words, "parts that show it")


def record_constancy(model: Model, tested: Constancy, level: float, passed: bool) -> Record:
    """Whether a law's strengths are the same throughout the recordings."""
    outcome = f"it is {'' if passed else 'not '}named"
    if passed and tested.p_value < level:
        outcome = "too little to refute it, so it is named"
    words = (
        f"with strengths of its own in each half of each recording it would lower χ² by {short(tested.varying)} more, "
        f"beside {short(tested.common)} with the same strengths throughout; on noise alone, the probability of as much "
        f"is {short(tested.p_value, 2)}, and below {short(level, 2)} they vary: {outcome}"
    )
    return _record("prune", model, tested.effect, tested.p_value, level, passed, words, "p-value of its constancy")


def _record(
    step: str,
    model: Model,
    effect: Effect,
    statistic: float | None,
    threshold: float | None,
    passed: bool,
    words: str,
    test: str,
) -> Record:
    rest = model.keys - {effect.key}
    beside = names_of(rest) if rest else ""
    return Record(step, name_of(effect.key), statistic, threshold, passed, words, test, beside)
