"""Writes the search's decisions as records of a trace: the compared numbers, and a sentence for the report."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from drake_cafim.diagnosis.fit.adequacy import Misfit, adequacy, misfits
from drake_cafim.diagnosis.fit.evidence import (
    FINITE_NOISE,
    UNDER_ITS_OWN_NOISE,
    Check,
    law_inaccuracy,
    leaves_inaccuracy,
)
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.search.determined import Descent
from drake_cafim.diagnosis.search.far_unknowns import distances
from drake_cafim.diagnosis.thresholds import (
    LAW_ACCURACY,
    UNKNOWN_FAR_IN_PRIOR_STDS,
    WINDOWS_PER_BLOCK,
)
from drake_cafim.diagnosis.trace import NOMINAL, Record, name_of, names_of, spoken
from drake_cafim.effects.effect import Effect
from drake_cafim.numerics.rounding import short
from drake_cafim.scenario.inertials import INERTIALS
from drake_cafim.scenario.unknown import UnknownParameter
from drake_cafim.scene.scene import Scene

REFUSED = 4
"""Refused candidates, and explanations that lost, with a record each; the others share one."""
TESTS = {
    FINITE_NOISE: "implies noise of the equations that cannot be computed",
    "share of misfit": "removes a share of {s} of χ²; because far more than noise remains, at least {t} is required",
    "share of recordings": "improves the fit in a share of {s} of the recordings; at least {t} is required",
    "gain": "lowers χ² by {s}; on noise alone, the best of all candidates would lower it by less than {t}",
    "gain over inaccuracy": "lowers χ² by {s}; as much as {t} may come from laws that are right to one part in a "
    "thousand",
    "gain for its parameters": "lowers χ² by {s}; the Bayesian information criterion requires {t} for its parameters",
    "Wald statistic": "has a Wald statistic of {s} (χ² of its difference from no effect); on noise alone, the best of "
    "all candidates would have less than {t}",
    UNDER_ITS_OWN_NOISE: "lowers χ² by {s} under the noise covariance that it implies, each channel in units of "
    "the noise that remains there; at least {t} is required",
}
"""The sentence of each test that an effect must pass, by the test's name."""
MISFITS = {
    "stretch": "its mean square over {n} windows, {when}, is {s} times that of noise; below {t} it would pass",
    "neighbours": "the correlation of its neighbouring windows is {s} standard deviations from that of white noise; "
    "below {t} it would pass",
    "row": "its mean square over all recordings is {s} times that of noise; below {t} it would pass",
}
"""The sentence of each kind of `Misfit`."""


def model_name(model: Model) -> str:
    """The effects of a model as a trace writes them, `effect@place` joined by " + "."""
    return names_of(model.keys)


def record_whitening(
    problem: Problem, before: Model, after: Model, threshold: float, test: str = "change of an unknown"
) -> Record:
    """The rows were whitened under `before`, and a fit to them gave `after`; passed where unknowns hardly changed."""
    std = problem.scene.priors.std
    moved = float(np.max(np.abs(after.unknown - before.unknown) / std, initial=0.0))
    words = "noise covariance computed again"
    words += f"; unknowns changed by up to {short(moved, 2)} prior standard deviations" if len(std) else ""
    values = [
        f"{strength.name.replace('_', ' ')} of {spoken(name_of(old.key))} from {short(a)} to {short(b)}"
        for old, new in zip(before.effects, after.effects, strict=False)
        if old.key == new.key
        for strength, a, b in zip(old.strengths, old.vector, new.vector, strict=True)
    ]
    words += "".join(f"; {value}" for value in values)
    return Record("whiten", model_name(after), moved, threshold, moved <= threshold, words, test)


def record_echo(model: Model) -> Record:
    """An explanation whose gain is an artefact of noise in its regressors (`Fit.echo`) under its own whitening."""
    asked = model_name(model)
    words = (
        f"with the noise covariance computed for {spoken(asked)}, its gain is an artefact of noise in the regressors"
    )
    return Record("admit", asked, None, None, False, words, "artefact of noise")


def record_detection(p_value: float, rate: float, trials: int) -> Record:
    """Whether the recordings differ from the nominal model by more than noise, at a false-alarm `rate`."""
    found = p_value <= rate
    words = (
        f"probability that noise alone gives so large a misfit, or so large a gain in the best of {trials} first-order "
        f"tests: {_probability(p_value)}; {'at most' if found else 'more than'} {short(rate, 2)}, so "
        f"{'something' if found else 'nothing'} is missing"
    )
    return Record("detect", NOMINAL, p_value, rate, found, words, "p-value")


def record_fits(ranked: Sequence[Fit], beam: int, cost: Callable[[Fit], float]) -> list[Record]:
    """Explanations of equal size that were fitted exactly, sorted by `cost`; the `beam` best are continued."""
    records = []
    for place, entry in enumerate(ranked):
        lead = cost(ranked[min(beam, len(ranked)) - 1]) - cost(entry)
        words = f"fitted exactly, χ² is {short(entry.chi_square, 5)} with {parameters_in_words(entry.strengths)}: "
        words += f"rank {place + 1} of {len(ranked)} explanations of this size"
        words += "" if place < beam else f"; the best {beam} are continued"
        records.append(Record("fit", model_name(entry.model), lead, 0.0, place < beam, words, "criterion"))
    return records


def record_admission(before: Fit, after: Fit, checks: Sequence[Check]) -> list[Record]:
    """The tests that the effects of `after` beyond `before` must pass, in order, and their outcome."""
    known = {effect.key for effect in before.model.effects}
    asked = names_of(effect.key for effect in after.model.effects if effect.key not in known)
    beside = model_name(before.model) if known else ""
    records = []
    for check in checks:
        words = TESTS[check.name].format(s=short(check.statistic), t=short(check.threshold))
        records.append(Record("test", asked, check.statistic, check.threshold, check.passed, words, check.name, beside))
    passed = all(check.passed for check in checks)
    # a share is at most 1, so it would always seem the closest to its threshold
    comparable = [entry for entry in records if entry.test != "share of recordings"]
    closest = min(comparable, key=lambda entry: _ratio(entry.statistic, entry.threshold)) if passed else records[-1]
    outcome = f"it passed all {len(records)} tests, in the closest of which it" if passed else "it failed a test: it"
    return [*records, replace(closest, step="admit", passed=passed, words=f"{outcome} {closest.words}")]


def record_own_noise(model: Model, effect: Effect, law: Effect, lead: float, least: float) -> Record:
    """A law that acts alike in the place of an effect; `lead` is its criterion beyond that one's, each whitened."""
    compared = f"{short(abs(lead))} {'higher' if lead > 0.0 else 'lower'}"
    words = (
        f"in the place of {spoken(name_of(effect.key))}, each under the noise that it implies, −2 ln likelihood plus a "
        f"cost for each parameter is {compared}; it is preferred where it is lower by more than {short(least)}"
    )
    beside = model_name(model.without(effect))
    return Record("choose", name_of(law.key), -lead, least, -lead > least, words, "criterion", beside)


def record_choice(pool: Iterable[Fit], best: Fit, cost: Callable[[Fit], float]) -> list[Record]:
    """The chosen explanation, and those of the least `cost` that it was preferred to."""
    # larger explanations that failed a test are not in the pool: the records of their tests say why
    chosen = model_name(best.model)
    others = [entry for entry in pool if model_name(entry.model) != chosen]
    ranked = sorted(others, key=lambda entry: (cost(entry), model_name(entry.model)))
    if not best.model.named:
        return []
    records = []
    if ranked:
        lead = cost(ranked[0]) - cost(best)
        words = (
            f"chosen: χ² is {short(best.chi_square, 5)} with {parameters_in_words(best.strengths)}; the next best is "
            f"{spoken(model_name(ranked[0].model))}: {_compare(lead)}"
        )
        second = model_name(ranked[0].model)
        records.append(Record("choose", chosen, lead, 0.0, True, words, "criterion", second))
    for entry in ranked[: 2 * REFUSED]:
        lead = cost(best) - cost(entry)
        words = (
            f"χ² is {short(entry.chi_square, 5)} with {parameters_in_words(entry.strengths)}, and with "
            f"{spoken(chosen)} {short(best.chi_square, 5)} with {parameters_in_words(best.strengths)}: "
            f"{_compare(-lead)}"
        )
        records.append(Record("choose", model_name(entry.model), lead, 0.0, False, words, "criterion", chosen))
    return records


def record_pruning(best: Fit, part: Key, lead: float) -> Record:
    """Whether `part` stays in an explanation: by how much the criterion is worse without it."""
    rest = names_of(best.model.keys - {part})
    stays = not lead < 0.0
    change = "higher, so it stays" if stays else "lower, so it is removed"
    words = f"without it the information criterion is {short(abs(lead))} {change}"
    return Record("prune", name_of(part), lead, 0.0, stays, words, "criterion", rest)


def record_descent(model: Model, descent: Descent) -> Record:
    """Why a law is not named, and the simpler one, if any, that is named in its place."""
    instead = f"{spoken(name_of(descent.law.key))} is named instead" if descent.law else "it is not named"
    rest, name = names_of(model.keys - {descent.effect.key}), name_of(descent.effect.key)
    if descent.gain is None or descent.luck is None:
        words = f"{descent.reason}: nothing is known of its size, so {instead}"
        return Record("admit", name, None, None, False, words, "undetermined", rest)
    words = (
        f"with it −2 ln likelihood is lower by {short(descent.gain)}, in units of what is left; on noise alone, it "
        f"would be by less than {short(descent.luck)}, so {instead}"
    )
    return Record("admit", name, descent.gain, descent.luck, False, words, "decrease of −2 ln likelihood", rest)


def record_residual(problem: SearchProblem, entry: Fit, rate: float) -> list[Record]:
    """Whether the residual of a fit is as the noise predicts, and its worst row of each kind of statistic."""
    p_value = adequacy(problem, entry.residual, entry.strengths).p_value
    passed = p_value > rate
    words = (
        f"probability that noise alone leaves a residual like that of {spoken(model_name(entry.model))}: "
        f"{_probability(p_value)}; {'more than' if passed else 'at most'} {short(rate, 2)}, so "
        f"{'what remains is noise' if passed else 'more than noise remains'}"
    )
    total = Record("adequacy", model_name(entry.model), p_value, rate, passed, words, "p-value")
    return [total, *(_record_worst(problem, part) for part in misfits(problem, entry.residual, entry.strengths, rate))]


def record_inaccuracy(problem: SearchProblem, best: Fit) -> list[Record]:
    """What remains is within the accuracy to which the named laws are taken to be right; nothing where it is not."""
    excess, most = best.chi_square - best.degrees_of_freedom, law_inaccuracy(problem, best)
    if not leaves_inaccuracy(problem, best):
        return []
    words = (
        f"χ² exceeds that of noise by {short(excess)}; as much as {short(most)} may come from laws that are right to "
        f"one part in {round(1.0 / LAW_ACCURACY)}, so what remains is no evidence of more physics"
    )
    return [Record("adequacy", model_name(best.model), excess, most, True, words, "excess over noise")]


def record_worse_than_none(best: Fit, left: float, had: float) -> Record:
    """An explanation that leaves more, `left` times the noise, than the nominal model, `had`."""
    words = f"with it the residual is {short(left)} times the noise variance, without it {short(had)}: it is not named"
    return Record("support", model_name(best.model), left, had, False, words, "misfit")


def record_leaves_less(few: Fit, many: Fit, by_few: float, by_many: float) -> Record:
    """A search under unknown forces whose effects leave more, `by_many` times the noise, than a `few` of the first."""
    words = (
        f"the geometric mean over all kinds of rows of what is left is {short(by_many)} times the noise variance, and "
        f"{short(by_few)} with {model_name(few.model)}: these are named instead"
    )
    return Record("unknown_forces", model_name(many.model), by_many, by_few, False, words, "misfit")


def record_cost_of_others(many: Fit, growth: float, most: float) -> Record:
    """A search under unknown forces whose effects leave some kind of row `growth` times as large as it was."""
    words = (
        f"the misfit of one kind of row is {short(growth)} times as large as without any effect; at most {short(most)} "
        "is allowed, to which the effects of the search for few of them keep: these are named instead"
    )
    return Record("unknown_forces", model_name(many.model), growth, most, False, words, "times the misfit")


def record_far_unknown(scene: Scene, unknown: UnknownParameter, model: Model) -> Record:
    """An unknown parameter whose value in `model` is too far from its prior mean."""
    i = scene.unknown.index(unknown)
    distance = float(distances(scene, model)[i])
    if unknown.kind == INERTIALS:
        words = (
            f"its ten inertial parameters together are {short(distance)} prior standard deviations from the model's; "
            f"beyond {short(UNKNOWN_FAR_IN_PRIOR_STDS)} they are a mismatch, so the verdict is unexplained"
        )
        asked = name_of((INERTIALS, unknown.at))
        limit = UNKNOWN_FAR_IN_PRIOR_STDS
        return Record("far_unknown", asked, distance, limit, True, words, "prior standard deviations")
    unit = "" if unknown.prior.unit == "1" else f" {unknown.prior.unit}"
    words = (
        f"its fitted value {short(float(model.unknown[i]), 4)}{unit} is {short(distance)} prior standard "
        f"deviations from its prior mean {short(float(scene.priors.mean[i]), 4)}; beyond "
        f"{short(UNKNOWN_FAR_IN_PRIOR_STDS)} the parameter itself is a mismatch, so the verdict is unexplained"
    )
    asked = name_of((unknown.parameter, unknown.at))
    return Record("far_unknown", asked, distance, UNKNOWN_FAR_IN_PRIOR_STDS, True, words, "prior standard deviations")


def record_support(best: Fit, row: str, share: float, least: float) -> Record:
    """Whether an explanation that leaves more than noise removes enough of the excess in its best row."""
    passed = share >= least
    words = (
        f"of the excess over noise in the row that it explains best, {row}, it removes a share of {short(share)}; as "
        f"more than noise remains, at least {short(least)} is required, so it is {'named' if passed else 'not named'}"
    )
    return Record("support", model_name(best.model), share, least, passed, words, "share of the excess")


def record_wider_windows(best: Fit, width: float) -> Record:
    """The result of a search over wider windows, in which fast vibration averages out."""
    named = bool(best.model.effects)
    found = f"{spoken(model_name(best.model))} is named" if named else "nothing is named"
    words = f"with fast vibration averaged out over windows of {short(width, 2)} s, {found}"
    return Record("wider_windows", model_name(best.model), None, None, named, words)


def record_unknown_forces_failure(best: Fit) -> Record:
    """A search under unknown forces that finds no effect."""
    words = "with unknown forces counted as noise, no effect is found, so this search is dropped"
    return Record("unknown_forces", model_name(best.model), None, None, False, words)


def record_unknown_forces_share(best: Fit, left: float, had: float, most: float) -> Record:
    """Whether unknown forces are small enough; `left` and `had` are excess mean squares with and without `best`."""
    share = left / had if had > 0.0 else 0.0
    passed = not left > most * had
    words = (
        f"apart from unknown forces, {spoken(model_name(best.model))} leaves a share of {short(share)} of the excess "
        f"over noise; at most {short(most)} may be put down to unknown forces, so it is "
        f"{'accepted' if passed else 'rejected'}"
    )
    return Record("unknown_forces", model_name(best.model), share, most, passed, words, "share of the excess")


def _record_worst(problem: SearchProblem, part: Misfit) -> Record:
    row = problem.pictures.row_labels[part.row]
    when = ""
    if part.run is not None and part.windows is not None:
        run = problem.runs[part.run]
        first, last = (short(float(run.time[index]), 3) for index in part.windows)
        when = f"at {first} to {last} s of {run.name}"
    elif part.run is not None:
        when = f"of {problem.runs[part.run].name}"
    words = f"{row} {when}: ".replace(" :", ":") if part.kind == "neighbours" else f"{row}: "
    words += MISFITS[part.kind].format(n=WINDOWS_PER_BLOCK, when=when, s=short(part.statistic), t=short(part.threshold))
    words += (
        f"; {part.failing} of {part.of} such values exceed it"
        if part.failing
        else f"; none of {part.of} such values does"
    )
    return Record("remains", row, part.statistic, part.threshold, not part.failing, words, part.kind)


def _ratio(statistic: float | None, threshold: float | None) -> float:
    return np.inf if not statistic or not threshold else statistic / threshold


def _probability(p: float) -> str:
    return short(p, 2) if p > 1e-300 else "below 10⁻³⁰⁰"


def parameters_in_words(count: int) -> str:
    """Such as "1 parameter", "2 parameters"."""
    return f"{count} parameter{'s' * (count != 1)}"


def _compare(lead: float) -> str:
    """By how much the information criterion of another explanation is larger, in words."""
    side = "higher" if lead >= 0.0 else "lower"
    return f"its information criterion (χ² plus a cost for each parameter) is {short(abs(lead))} {side}"
