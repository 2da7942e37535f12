"""The search's decisions as records of a trace: what was compared with what, and in words."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.fit.adequacy import Misfit, adequacy, misfits
from drake_cafim.diagnosis.fit.evidence import Check, least_gain, scale_of
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.search.far_unknowns import distances
from drake_cafim.diagnosis.search.screening import Candidate
from drake_cafim.diagnosis.thresholds import NOISE_STD_TOLERANCE, UNKNOWN_FAR_IN_PRIOR_STDS, WINDOWS_PER_BLOCK
from drake_cafim.diagnosis.trace import NOMINAL, OTHERS, Record, name_of, names_of, spoken
from drake_cafim.effects.effect import Effect
from drake_cafim.numerics.rounding import short
from drake_cafim.scenario.unknown import UnknownParameter
from drake_cafim.scene.scene import Scene

REFUSED = 4
"""First looks, and explanations that lost, that are told one by one; the rest together."""
FIRST_LOOK = "gain of a first look"
NOISE_ALLOWED = (1.0 + NOISE_STD_TOLERANCE) ** 2
"""What first looks do not allow for, and admissions do: that the stated noise is a little off."""
TESTS = {
    "share of misfit": "takes a share of {s} of χ² away; of what leaves far more than noise, at least {t} is asked",
    "share of recordings": "fits better in a share of {s} of the recordings; at least {t} is asked",
    "gain": "takes {s} off χ²; the luckiest look at nothing but noise would take less than {t}",
    "gain for its numbers": "takes {s} off χ²; as many numbers fitted to as many rows have to take {t}",
    "distance from absent": "is {s} in χ² away from being absent; at least {t} is asked of the luckiest of all looks",
    "gain under its own noise": "takes {s} off χ² under the noise that it would let through, each channel over what is "
    "left there; at least {t} is asked",
}
"""What each test of an admission says, by its name."""
MISFITS = {
    "stretch": "its mean square over {n} windows, {when}, is {s} times that of noise; below {t} it would pass",
    "neighbours": "its neighbouring windows agree by {s} standard deviations of chance; below {t} they would pass",
    "row": "its mean square over all recordings is {s} times that of noise; below {t} it would pass",
}


def name(model: Model) -> str:
    """The effects of a model as a trace names them."""
    return names_of(model.keys)


def whitened(
    problem: Problem, before: Model, after: Model, threshold: float, test: str = "move of an unknown"
) -> Record:
    """The noise was whitened under `before`, after which the numbers are those of `after`."""
    std = problem.scene.priors.std
    moved = float(np.max(np.abs(after.unknown - before.unknown) / std, initial=0.0))
    words = f"the noise whitened anew: unknowns moved by up to {short(moved, 2)} prior standard deviations"
    values = [
        f"{strength.name.replace('_', ' ')} of {spoken(name_of(old.key))} from {short(a)} to {short(b)}"
        for old, new in zip(before.effects, after.effects, strict=False)
        if old.key == new.key
        for strength, a, b in zip(old.strengths, old.vector, new.vector, strict=True)
    ]
    words += "".join(f"; {value}" for value in values)
    return Record("whiten", name(after), moved, threshold, moved <= threshold, words, test)


def echo(model: Model) -> Record:
    """An explanation that is an echo of noise under its own whitening."""
    words = f"{spoken(name(model))}: an echo of noise, once the noise is reckoned as it lets it through"
    return Record("admit", name(model), None, None, False, words, "echo of noise")


def detected(p_value: float, rate: float, looks: int) -> Record:
    """Whether anything differs from the nominal model."""
    found = p_value <= rate
    words = (
        f"probability that noise alone makes so large a misfit, or so good a first look among {looks}: "
        f"{_probability(p_value)}; {'at most' if found else 'more than'} {short(rate, 2)}, so "
        f"{'something is missing' if found else 'nothing is'}"
    )
    return Record("detect", NOMINAL, p_value, rate, found, words, "p-value")


@dataclass(frozen=True)
class GoOn:
    """Which first looks are followed by a fit: the `most` best, where they gain more than a `share` of the best."""

    most: int
    share: float


def screened(
    at: Fit, candidates: Sequence[Candidate], effects: Sequence[Effect], trials: int, rate: float, go_on: GoOn | None
) -> list[Record]:
    """First looks beside `at`: those that are fitted exactly, the first ones left aside, the rest together.

    `go_on` is None where none is fitted. Of the `effects` that were looked for, some are laws of what the model has
    already, and some show in no row or only with strengths that are no physics.
    """
    beside = name(at.model) if at.model.effects else ""
    fitted = [] if go_on is None else [c for c in candidates[: go_on.most] if c.gain > go_on.share * candidates[0].gain]
    records = []
    for place, entry in enumerate(candidates[: len(fitted) + REFUSED]):
        words = f"a first look, to first order, takes {short(entry.gain)} off χ² by {_numbers(entry.strengths)}"
        if go_on is None:
            level = least_gain(entry.strengths, trials, rate) * scale_of(at)
            lucky = entry.gain < level
            words += f"; the luckiest of {trials} looks at noise takes less than {short(level)}"
            words += "" if lucky else ", but fitted without the noise that it shares with what is left it takes less"
        else:
            level = max(go_on.share * candidates[0].gain, fitted[-1].gain)
            words += (
                ", and it is fitted exactly" if place < len(fitted) else f"; {short(level)} was asked for to fit it"
            )
        asked = name_of(entry.effect.key)
        records.append(Record("screen", asked, entry.gain, level, place < len(fitted), words, FIRST_LOOK, beside))
    rest = candidates[len(fitted) + REFUSED :]
    present = {effect.key for effect in at.model.effects}
    excluded = {name_of(e.key) for e in effects if any(e.excludes(other) for other in at.model.effects)}
    seen = {name_of(entry.effect.key) for entry in candidates}
    hidden = {name_of(effect.key) for effect in effects} - excluded - seen
    excluded -= {name_of(key) for key in present}
    if rest:
        words = f"first looks at {len(rest)} more take no more than {short(rest[0].gain)} off χ² each"
        records.append(
            _together([name_of(c.effect.key) for c in rest], rest[0].gain, records[-1].threshold, words, beside)
        )
    if hidden:
        words = f"{len(hidden)} more show nowhere in these recordings, or with no strength that could be physics"
        records.append(_together(hidden, None, None, words, beside))
    if excluded:
        words = (
            f"not looked for beside {spoken(name(at.model))}: other laws of the same thing, that take its place or not"
        )
        records.append(_together(excluded, None, None, words, beside))
    return records


def _together(names: Iterable[str], most: float | None, level: float | None, words: str, beside: str) -> Record:
    """One record for all effects that fared alike."""
    return Record("screen", OTHERS, most, level, False, words, FIRST_LOOK, beside, others=tuple(sorted(set(names))))


def another(best: Fit, candidates: Sequence[Candidate], trials: int, rate: float, worth: bool) -> list[Record]:
    """Whether what `best` leaves is `worth` one more effect: by the first look that is farthest beyond luck."""
    scale = scale_of(best)
    levels = [least_gain(c.strengths, trials, rate) / NOISE_ALLOWED for c in candidates]
    if not candidates:
        return []
    index = int(np.argmax([c.gain / level for c, level in zip(candidates, levels, strict=True)]))
    gain, level, found = candidates[index].gain / scale, levels[index], spoken(name_of(candidates[index].effect.key))
    words = (
        f"of all that could be added, {found} promises most: {short(gain)} off χ², in units of what is left; the "
        f"luckiest of {trials} looks at noise promises less than {short(level)}, so the search "
        f"{'goes on' if worth else 'ends'}"
    )
    beside = name(best.model) if best.model.effects else ""
    return [Record("another", _number(best), gain, level, worth, words, FIRST_LOOK, beside)]


def none_admitted(best: Fit) -> Record:
    """No explanation with one effect more passed the tests of an admission."""
    words = "of the explanations with one effect more, fitted exactly, none passed the tests of an admission"
    return Record(
        "another", _number(best), None, None, False, words, "", name(best.model) if best.model.effects else ""
    )


def enough(best: Fit, most: int) -> list[Record]:
    """No further effect is looked for where an explanation has the `most` that it may have."""
    size = len(best.model.effects)
    if not most or size < most:
        return []
    words = f"{most} effects are the most that are looked for: no further one was"
    return [
        Record("another", _number(best), float(size), float(most), False, words, "number of effects", name(best.model))
    ]


def _number(best: Fit) -> str:
    return f"effect number {len(best.model.effects) + 1}"


def fitted(ranked: Sequence[Fit], beam: int, cost: Callable[[Fit], float]) -> list[Record]:
    """Explanations of one size that were fitted exactly, best first; the `beam` best go on."""
    records = []
    for place, entry in enumerate(ranked):
        lead = cost(ranked[min(beam, len(ranked)) - 1]) - cost(entry)
        words = f"fitted exactly, χ² is {short(entry.chi_square, 5)} with {_numbers(entry.strengths)}: "
        words += f"number {place + 1} of {len(ranked)} alike"
        words += "" if place < beam else f"; the best {beam} go on"
        records.append(Record("fit", name(entry.model), lead, 0.0, place < beam, words, "criterion"))
    return records


def admitted(before: Fit, after: Fit, checks: Sequence[Check]) -> list[Record]:
    """The tests of an admission, in order, and its outcome."""
    known = {effect.key for effect in before.model.effects}
    asked = names_of(effect.key for effect in after.model.effects if effect.key not in known)
    beside = name(before.model) if known else ""
    records = []
    for check in checks:
        words = TESTS[check.name].format(s=short(check.statistic), t=short(check.threshold))
        records.append(Record("test", asked, check.statistic, check.threshold, check.passed, words, check.name, beside))
    passed = all(check.passed for check in checks)
    told = [entry for entry in records if entry.test != "share of recordings"]
    closest = min(told, key=lambda entry: _ratio(entry.statistic, entry.threshold)) if passed else records[-1]
    outcome = f"admitted by all of {len(records)} tests, of which the closest" if passed else "not admitted"
    return [*records, replace(closest, step="admit", passed=passed, words=f"{outcome}: it {closest.words}")]


def compared(pool: Iterable[Fit], best: Fit, cost: Callable[[Fit], float]) -> list[Record]:
    """The chosen explanation, and the first of those that it was chosen over, by what `cost` says."""
    # what has not passed the tests of an admission, which say why, is not among them
    others = [entry for entry in pool if name(entry.model) != name(best.model)]
    ranked = sorted(others, key=lambda entry: (cost(entry), name(entry.model)))
    if not best.model.named:
        return []
    records = []
    if ranked:
        lead = cost(ranked[0]) - cost(best)
        words = (
            f"chosen: χ² {short(best.chi_square, 5)} with {_numbers(best.strengths)}; the next best is "
            f"{spoken(name(ranked[0].model))}, {_beyond(lead)}"
        )
        records.append(Record("choose", name(best.model), lead, 0.0, True, words, "criterion", name(ranked[0].model)))
    for entry in ranked[: 2 * REFUSED]:
        lead = cost(best) - cost(entry)
        words = (
            f"χ² {short(entry.chi_square, 5)} with {_numbers(entry.strengths)}, where {spoken(name(best.model))} has "
            f"{short(best.chi_square, 5)} with {_numbers(best.strengths)}: {_beyond(-lead)}"
        )
        records.append(Record("choose", name(entry.model), lead, 0.0, False, words, "criterion", name(best.model)))
    return records


def pruned(best: Fit, part: Key, lead: float) -> Record:
    """Whether `part` stays in an explanation: by how much the criterion is worse without it."""
    rest = names_of(best.model.keys - {part})
    stays = not lead < 0.0
    words = f"without it the criterion is {short(abs(lead))} {'worse, so it stays' if stays else 'better, so it goes'}"
    return Record("prune", name_of(part), lead, 0.0, stays, words, "criterion", rest)


def remaining(problem: SearchProblem, entry: Fit, rate: float) -> list[Record]:
    """Whether what the fit leaves is as the noise predicts, and what of it is farthest from that."""
    p_value = adequacy(problem, entry.residual, entry.strengths).p_value
    passed = p_value > rate
    words = (
        f"probability that noise alone leaves as much as {spoken(name(entry.model))} does: {_probability(p_value)}; "
        f"{'more than' if passed else 'at most'} {short(rate, 2)}, so "
        f"{'what remains is noise' if passed else 'something remains'}"
    )
    total = Record("adequacy", name(entry.model), p_value, rate, passed, words, "p-value")
    return [total, *(_farthest(problem, part) for part in misfits(problem, entry.residual, entry.strengths, rate))]


def worse_than_none(best: Fit, nominal: Fit) -> Record:
    """An explanation under whose noise more is left than without it."""
    left, had = best.reduced_chi_square, nominal.reduced_chi_square
    words = f"it leaves {short(left)} times the noise variance, and without it there is {short(had)}: not named"
    return Record("support", name(best.model), left, had, False, words, "misfit")


def far(scene: Scene, unknown: UnknownParameter, model: Model) -> Record:
    """An unknown that is too far from its prior to be what the scenario says."""
    i = scene.unknown.index(unknown)
    distance = float(distances(scene, model)[i])
    words = (
        f"fitted as {short(float(model.unknown[i]), 4)} {unknown.prior.unit}, {short(distance)} prior standard "
        f"deviations from {short(float(scene.priors.mean[i]), 4)}; beyond {short(UNKNOWN_FAR_IN_PRIOR_STDS)} the "
        "parameter itself is a mismatch, so the verdict is unexplained"
    )
    asked = name_of((unknown.parameter, unknown.at))
    return Record("far_unknown", asked, distance, UNKNOWN_FAR_IN_PRIOR_STDS, True, words, "prior standard deviations")


def supported(best: Fit, row: str, share: float, least: float) -> Record:
    """Whether an explanation that leaves more than noise takes away a good part of what it explains most of."""
    passed = share >= least
    words = (
        f"where it explains most, in {row}, it takes {short(share)} of what is beyond noise away; at least "
        f"{short(least)} is asked of what leaves more than noise, so it is {'named' if passed else 'not named'}"
    )
    return Record("support", name(best.model), share, least, passed, words, "share of the excess")


def over_wider_windows(best: Fit, width: float) -> Record:
    """What was found where what shakes fast is averaged out."""
    named = bool(best.model.effects)
    found = f"{spoken(name(best.model))} is named" if named else "nothing is named"
    words = f"what shakes fast averaged out, over windows of {short(width, 2)} s: {found}"
    return Record("wider_windows", name(best.model), None, None, named, words)


def beside_forces(problem: SearchProblem, entry: Fit, rate: float) -> list[Record]:
    """Whether a search under unknown forces is worth it: with them, an explanation has to leave noise."""
    total, *_ = remaining(problem, entry, rate)
    words = "a search with white forces at the joints that nobody knows"
    words += " goes on" if total.passed else " is not begun: what was found leaves more than those would make"
    return [replace(total, step="unknown_forces", words=f"{words}; {total.words}")]


def refused_beside_forces(best: Fit) -> Record:
    """A search under unknown forces that explains nothing."""
    words = "with forces that nobody knows, "
    words += "what is found leaves more than noise" if best.model.effects else "no effect is found"
    return Record("unknown_forces", name(best.model), None, None, False, f"{words}: refused")


def little_beside_forces(best: Fit, left: float, had: float, most: float) -> Record:
    """Whether unknown forces are little beside what an explanation takes away, in mean squares beyond noise."""
    share = left / had if had > 0.0 else 0.0
    passed = not left > most * had
    words = (
        f"without them, {spoken(name(best.model))} leaves {short(share)} of what was beyond noise; forces that nobody "
        f"knows may be {short(most)} of it, so it is {'accepted beside them' if passed else 'refused'}"
    )
    return Record("unknown_forces", name(best.model), share, most, passed, words, "share of the excess")


def _farthest(problem: SearchProblem, part: Misfit) -> Record:
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
    words += f"; {part.failing} of {part.of} such are beyond it" if part.failing else f"; none of {part.of} such is"
    return Record("remains", row, part.statistic, part.threshold, not part.failing, words, part.kind)


def _ratio(statistic: float | None, threshold: float | None) -> float:
    return np.inf if not statistic or not threshold else statistic / threshold


def _probability(p: float) -> str:
    return short(p, 2) if p > 1e-300 else "below 10⁻³⁰⁰"


def _numbers(count: int) -> str:
    return f"{count} number{'s' * (count != 1)}"


def _beyond(lead: float) -> str:
    """By how much the information criterion of another explanation is larger."""
    return f"{short(abs(lead))} {'worse' if lead >= 0.0 else 'better'} by the criterion (χ², and what its numbers cost)"
