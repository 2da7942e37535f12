"""Cuts of the recordings, to see whether what a diagnosis names holds whichever way they are cut.

Each recording is left out in turn (in groups where there are many), the recordings are halved, and blocks of them are
drawn with replacement, as a bootstrap draws samples (Künsch, Ann. Statist. 17(3), 1989). Throws are cut whole: a part
of one has no beginning.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from drake_cafim.diagnosis.thresholds import CUTS_SHARE_SURE
from drake_cafim.diagnosis.verdict import Verdict
from drake_cafim.recordings.recording import Recording

MOST_LEFT_OUT = 8
"""Most cuts in which recordings are left out; more recordings are left out in groups."""
DRAWS = 4
"""Number of draws of blocks."""
BLOCKS = 8
"""Number of blocks of a recording, and of groups of many throws."""
Named = frozenset[tuple[str, str]]
"""(effect, place) of what one diagnosis names."""


@dataclass(frozen=True)
class Cut:
    """Some of the recordings, or parts of them; `words` say which."""

    words: str
    recordings: tuple[Recording, ...]


def cuts_of(recordings: Sequence[Recording], rng: np.random.Generator, whole: bool = False) -> tuple[Cut, ...]:
    """The cuts of `recordings`; `rng` draws the blocks.

    With `whole` no recording is cut in parts: halves and blocks are then of whole recordings, and a single one has no
    cuts.
    """
    found = list(_left_out(recordings))
    if not whole:
        found += [Cut(f"{words} halves", tuple(_half(item, late) for item in recordings)) for words, late in _HALVES]
        blocks = [block for recording in recordings for block in _blocks(recording)]
    elif len(recordings) > 1:
        found += [Cut(f"{words} half", tuple(recordings[late::2])) for words, late in _HALVES]
        blocks = list(recordings)
    else:
        return ()
    for draw in range(DRAWS):
        drawn = rng.integers(len(blocks), size=len(blocks))
        named = (replace(blocks[k], name=f"{blocks[k].name} ({number})") for number, k in enumerate(drawn, start=1))
        found.append(Cut(f"blocks, draw {draw + 1}", tuple(named)))
    return tuple(found)


_HALVES = (("first", 0), ("second", 1))


def _left_out(recordings: Sequence[Recording]) -> Iterator[Cut]:
    groups = np.array_split(np.arange(len(recordings)), min(MOST_LEFT_OUT, len(recordings)))
    for group in groups if len(recordings) > 1 else ():
        names = ", ".join(recordings[k].name for k in group)
        yield Cut(f"without {names}", tuple(item for k, item in enumerate(recordings) if k not in group))


def _half(recording: Recording, late: int) -> Recording:
    middle = 0.5 * (recording.time[0] + recording.time[-1])
    return recording.window(middle, np.inf) if late else recording.window(-np.inf, middle)


def _blocks(recording: Recording) -> list[Recording]:
    edges = np.linspace(recording.time[0], recording.time[-1], BLOCKS + 1)
    return [recording.window(start, stop) for start, stop in pairwise(edges)]


def named_in(verdict: Verdict) -> Named:
    """What a verdict names."""
    return frozenset(accepted.effect.key for accepted in verdict.explanation)


def with_cuts(verdict: Verdict, named: Sequence[Named], unusable: Sequence[str] = ()) -> Verdict:
    """The verdict with the share of the cuts that names each of its effects, from what each cut `named`.

    An effect that fewer than `CUTS_SHARE_SURE` of them name is told as unsure. `unusable` are sentences on cuts that
    could not be diagnosed, which do not count.
    """
    notes = tuple(f"a cut is left out of the count: {reason}" for reason in unusable)
    if not named:
        return replace(verdict, notes=(*verdict.notes, *notes, "the recordings have no cuts that can be diagnosed"))
    explanation = []
    for accepted in verdict.explanation:
        times = sum(accepted.effect.key in names for names in named)
        share, sentence = times / len(named), accepted.sentence
        if share < CUTS_SHARE_SURE:
            sentence += f", unsure: named in {times} of {len(named)} cuts of the recordings"
        explanation.append(replace(accepted, cuts=share, sentence=sentence))
    present = named_in(verdict)
    others = sorted({key for names in named for key in names} - present)
    elsewhere = [(key, sum(key in names for names in named)) for key in others]
    notes += tuple(
        f"{name} at {at} is named in {times} of {len(named)} cuts, and not by all recordings together"
        for (name, at), times in elsewhere
        if times / len(named) >= CUTS_SHARE_SURE
    )
    return replace(verdict, explanation=tuple(explanation), notes=(*verdict.notes, *notes))
