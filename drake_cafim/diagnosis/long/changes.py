"""Says in a verdict since when, or until when, an effect is there that is not there throughout."""

from collections.abc import Sequence
from dataclasses import replace

from drake_cafim.diagnosis.fit.model import Key
from drake_cafim.diagnosis.long.stretches import Change
from drake_cafim.diagnosis.verdict import Explanation, Location, Verdict


def with_changes(verdict: Verdict, named: Sequence[frozenset[Key]], changes: Sequence[Change]) -> Verdict:
    """The verdict with a location of share 0, and words, for each effect that only some of the stretches name.

    `named` are the effects of each stretch; between two of them is one of the `changes`.
    """
    explanation, locations = [], []
    for accepted in verdict.explanation:
        own = [accepted.effect.key in effects for effects in named]
        if all(own):
            explanation.append(accepted)
            continue
        words, intervals = _when(own, changes)
        explanation.append(replace(accepted, sentence=f"{accepted.sentence}, {words}"))
        locations += [_location(accepted, *interval) for interval in intervals]
    mismatch = replace(verdict.mismatch, locations=(*verdict.mismatch.locations, *locations))
    return replace(verdict, explanation=tuple(explanation), mismatch=mismatch)


def _when(own: Sequence[bool], changes: Sequence[Change]) -> tuple[str, list[tuple[Change | None, Change | None]]]:
    """In words when the effect is there, and the changes between which that is; None at the ends of the recordings."""
    bounds = [None, *changes, None]
    intervals: list[tuple[Change | None, Change | None]] = []
    for index, there in enumerate(own):
        if not there:
            continue
        if intervals and index and own[index - 1]:
            intervals[-1] = (intervals[-1][0], bounds[index + 1])
        else:
            intervals.append((bounds[index], bounds[index + 1]))
    words = []
    for begin, end in intervals:
        since = f"from {begin.time:.6g} s of {begin.recording} on" if begin else ""
        until = f"until {end.time:.6g} s of {end.recording}" if end else ""
        words.append(" ".join(part for part in (since.removesuffix(" on") if end else since, until) if part))
    return " and ".join(words), intervals


def _location(accepted: Explanation, begin: Change | None, end: Change | None) -> Location:
    at = begin or end
    assert at is not None
    start = begin.time if begin else at.begin
    stop = end.time if end and end.recording == at.recording else at.end
    return Location(accepted.effect.place.value, accepted.effect.at, 0.0, ((start, stop),), at.recording)
