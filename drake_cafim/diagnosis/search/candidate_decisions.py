"""Writes a search's decisions on candidates as records of a trace: which are fitted exactly, and whether to go on."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.fit.evidence import least_gain, scale_of
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.screening import Candidate
from drake_cafim.diagnosis.search.decisions import REFUSED, model_name, parameters_in_words
from drake_cafim.diagnosis.thresholds import LAW_ACCURACY, NOISE_STD_TOLERANCE
from drake_cafim.diagnosis.trace import OTHERS, Record, name_of, spoken
from drake_cafim.effects.effect import Effect
from drake_cafim.numerics.rounding import short

FIRST_ORDER_GAIN = "first-order gain"
NOISE_ALLOWED = (1.0 + NOISE_STD_TOLERANCE) ** 2
"""Variance ratio by which `least_gain` allows for an error of the stated noise; first-order tests do not."""


@dataclass(frozen=True)
class GoOn:
    """Which candidates are fitted exactly: the `most` best, if they gain more than a `share` of the best one's gain.

    And all that gain as much as the best one, as far as laws are right at all (`LAW_ACCURACY`): those of dry friction
    would else leave no room for what acts like them.
    """

    most: int
    share: float

    def fitted(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Of `candidates`, sorted by gain, those that are fitted exactly."""
        best = candidates[0].gain if candidates else 0.0
        promising = [candidate for candidate in candidates if candidate.gain > self.share * best]
        alike = sum(candidate.gain > (1.0 - LAW_ACCURACY) * best for candidate in promising)
        return promising[: max(self.most, alike)]


def record_screening(
    at: Fit, candidates: Sequence[Candidate], effects: Sequence[Effect], trials: int, rate: float, go_on: GoOn | None
) -> list[Record]:
    """The first-order tests beside the fit `at`: of the candidates that are fitted exactly, and of the refused ones.

    `go_on` is None where none is fitted. `candidates` are sorted by gain. Of all `effects` some are missing there:
    alternative laws for what the model has already, and those that move no row or only with impossible strengths.
    """
    beside = model_name(at.model) if at.model.effects else ""
    fitted = [] if go_on is None else go_on.fitted(candidates)
    records = []
    for place, entry in enumerate(candidates[: len(fitted) + REFUSED]):
        words = f"to first order, lowers χ² by {short(entry.gain)} with {parameters_in_words(entry.strengths)}"
        if go_on is None:
            level = least_gain(entry.strengths, trials, rate) * scale_of(at)
            lucky = entry.gain < level
            words += f"; on noise alone, the best of {trials} such tests would lower it by less than {short(level)}"
            # more than luck to first order, and yet nothing was detected: the exact fit decided
            words += "" if lucky else ", but fitted exactly, free of the noise in its regressors, it lowers χ² by less"
        else:
            level = max(go_on.share * candidates[0].gain, fitted[-1].gain)
            words += (
                ", so it is fitted exactly"
                if place < len(fitted)
                else f"; an exact fit required a gain above {short(level)}"
            )
        asked = name_of(entry.effect.key)
        records.append(Record("screen", asked, entry.gain, level, place < len(fitted), words, FIRST_ORDER_GAIN, beside))
    rest = candidates[len(fitted) + REFUSED :]
    present = {effect.key for effect in at.model.effects}
    excluded = {name_of(e.key) for e in effects if any(e.excludes(other) for other in at.model.effects)}
    seen = {name_of(entry.effect.key) for entry in candidates}
    hidden = {name_of(effect.key) for effect in effects} - excluded - seen
    excluded -= {name_of(key) for key in present}
    if rest:
        words = (
            f"one of {len(rest)} further candidates that lower χ² by at most {short(rest[0].gain)} each, to first order"
        )
        records.append(
            _record_together([name_of(c.effect.key) for c in rest], rest[0].gain, records[-1].threshold, words, beside)
        )
    if hidden:
        words = (
            f"one of {len(hidden)} effects that change nothing in these recordings, or fit only with impossible values"
        )
        records.append(_record_together(hidden, None, None, words, beside))
    if excluded:
        words = (
            f"not tested beside {spoken(beside)}: an alternative law for the same thing, which could only replace it"
        )
        records.append(_record_together(excluded, None, None, words, beside))
    return records


def _record_together(names: Iterable[str], most: float | None, level: float | None, words: str, beside: str) -> Record:
    """A single record for all effects that were refused alike."""
    return Record(
        "screen", OTHERS, most, level, False, words, FIRST_ORDER_GAIN, beside, others=tuple(sorted(set(names)))
    )


def record_next_effect(
    best: Fit, candidates: Sequence[Candidate], trials: int, rate: float, worth: bool
) -> list[Record]:
    """Whether the residual of `best` is `worth` one more effect: the first-order test that exceeds its level most."""
    scale = scale_of(best)
    levels = [least_gain(c.strengths, trials, rate) / NOISE_ALLOWED for c in candidates]
    if not candidates:
        return []
    index = int(np.argmax([c.gain / level for c, level in zip(candidates, levels, strict=True)]))
    gain, level, found = candidates[index].gain / scale, levels[index], spoken(name_of(candidates[index].effect.key))
    words = (
        f"the best further effect, to first order, is {found}: it lowers χ² by {short(gain)} in units of the remaining "
        f"noise; on noise alone, the best of {trials} such tests would lower it by less than {short(level)}, so the "
        f"search {'continues' if worth else 'ends'}"
    )
    beside = model_name(best.model) if best.model.effects else ""
    return [Record("another", _number(best), gain, level, worth, words, FIRST_ORDER_GAIN, beside)]


def record_none_admitted(best: Fit) -> Record:
    """No explanation with one more effect than `best` passed all tests."""
    words = "of the explanations with one more effect, fitted exactly, none passed all tests"
    beside = model_name(best.model) if best.model.effects else ""
    return Record("another", _number(best), None, None, False, words, "", beside)


def record_effect_limit(best: Fit, most: int) -> list[Record]:
    """That no further effect is looked for, where `best` has the `most` that are allowed; else nothing."""
    size = len(best.model.effects)
    if not most or size < most:
        return []
    words = f"the search allows at most {most} effects, so no further one was looked for"
    beside = model_name(best.model)
    return [Record("another", _number(best), float(size), float(most), False, words, "number of effects", beside)]


def record_put_off(best: Fit, most: int) -> Record:
    """That `best` is left as it is until a search for more effects than `most` has found nothing."""
    size = float(len(best.model.effects))
    words = (
        f"more than {most} rows are left far from noise, and to first order as few effects explain less than half of "
        "that; this search goes on only where one for more effects finds none"
    )
    return Record(
        "another", _number(best), size, float(most), False, words, "number of effects", model_name(best.model)
    )


def _number(best: Fit) -> str:
    return f"effect number {len(best.model.effects) + 1}"
