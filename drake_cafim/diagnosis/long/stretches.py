"""Stretches of long recordings between which what is missing changes, as where a payload is taken up."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from drake_cafim.diagnosis.long.parts import Part, Parts
from drake_cafim.diagnosis.long.scan import Seen
from drake_cafim.diagnosis.thresholds import NAMED_EXCESS_SHARE
from drake_cafim.typing import Array

MOST_STRETCHES, FEWEST_PARTS = 3, 3
"""Most stretches, and the fewest parts of one: of fewer the scatter is not known."""


@dataclass(frozen=True)
class Stretch:
    """Neighbouring parts, by their looks, over which the same is missing."""

    seen: tuple[Seen, ...]

    @property
    def numbers(self) -> tuple[int, ...]:
        """The numbers of its parts."""
        return tuple(part.number for part in self.seen)


def stretches_of(seen: Sequence[Seen], rate: float) -> tuple[Stretch, ...]:
    """The parts in their order, divided where the excess of a row steps, the clearest steps first.

    A step is tested by Student's t of the logarithms of the mean squares before and after, with the number of rows and
    places tried as the number of tests, at a false-alarm `rate`; the larger mean square must be more than twice the
    smaller, so that more begins (or ends) than stays.
    """
    found = [tuple(seen)]
    while len(found) < MOST_STRETCHES:
        steps = [(*step, index) for index, own in enumerate(found) if (step := _step(own)) is not None]
        steps = [step for step in steps if step[0] < rate]
        if not steps:
            break
        _, at, index = min(steps)
        found[index : index + 1] = [found[index][:at], found[index][at:]]
    return tuple(map(Stretch, found))


def _step(seen: Sequence[Seen]) -> tuple[float, int] | None:
    """p-value and place of the clearest step; None where there is none large enough."""
    if len(seen) < 2 * FEWEST_PARTS:
        return None
    logs = np.log(np.maximum([part.excess + 1.0 for part in seen], np.finfo(float).tiny))
    places = range(FEWEST_PARTS, len(seen) - FEWEST_PARTS + 1)
    best: tuple[float, int] | None = None
    for at in places:
        before, after = logs[:at], logs[at:]
        change = np.mean(after, axis=0) - np.mean(before, axis=0)
        left = np.sum((before - np.mean(before, axis=0)) ** 2, axis=0) + np.sum(
            (after - np.mean(after, axis=0)) ** 2, axis=0
        )
        freedom = len(seen) - 2
        scatter = np.sqrt(np.maximum(left, 1e-12) / freedom * (1.0 / at + 1.0 / (len(seen) - at)))
        p = 2.0 * student.sf(np.abs(change) / scatter, freedom) * len(places) * logs.shape[1]
        p = np.where(np.abs(change) > -np.log(1.0 - NAMED_EXCESS_SHARE), p, np.inf)
        row = int(np.argmin(p))
        if np.isfinite(p[row]) and (best is None or p[row] < best[0]):
            best = float(p[row]), at
    return best


Costs = Callable[[int, int], tuple[Array, Array]]
"""By a part's number and a stretch's: (M,) χ² of each window of the part under what was found in that stretch, and the
middles of the windows, s."""


@dataclass(frozen=True)
class Change:
    """A change between two stretches: at `time` s of a recording that goes from `begin` to `end` s."""

    recording: str
    time: float
    begin: float
    end: float


def cut_at_changes(
    parts: Parts, stretches: Sequence[Sequence[int]], costs: Costs
) -> tuple[Parts, tuple[tuple[int, ...], ...], tuple[Change, ...]]:
    """The parts cut where the numbered `stretches` meet, their new numbers by stretch, and the changes.

    A change is placed between the two windows where the least χ² is left, the windows before it under what was found
    before and those after it under what was found after.
    """
    cuts: dict[int, float] = {}
    changes = []
    for index in range(len(stretches) - 1):
        last, first = stretches[index][-1], stretches[index + 1][0]
        time = parts.items[first].begin
        if parts.items[last].index == parts.items[first].index:
            time = _change_between(last, first, index, costs)
            cuts |= {last: time, first: time}
        spans = parts.recordings[parts.items[first].index].spans
        changes.append(Change(parts.name(first), time, spans[0][0], spans[-1][1]))
    items: list[Part] = []
    numbers: list[list[int]] = [[] for _ in stretches]
    for index, own in enumerate(stretches):
        for number in own:
            part, moment = parts.items[number], cuts.get(number)
            pieces = [(part, index)]
            if moment is not None:
                # the parts on both sides of a change: what is before it belongs to the stretch before
                before = index if number == own[-1] else index - 1
                pieces = [
                    (replace(part, end=min(part.end, moment)), before),
                    (replace(part, begin=max(part.begin, moment)), before + 1),
                ]
            for piece, stretch in pieces:
                if piece.begin < piece.end:
                    numbers[stretch].append(len(items))
                    items.append(piece)
    return Parts(parts.recordings, tuple(items)), tuple(map(tuple, numbers)), tuple(changes)


def _change_between(last: int, first: int, stretch: int, costs: Costs) -> float:
    """s, the time of the change that lies in the part `last` or in the part `first`."""
    before = [costs(number, stretch) for number in (last, first)]
    after = [costs(number, stretch + 1) for number in (last, first)]
    time = np.concatenate([middles for _, middles in before])
    own, other = (np.concatenate([cost for cost, _ in group]) for group in (before, after))
    left = np.concatenate([[0.0], np.cumsum(own)]) + np.concatenate([np.cumsum(other[::-1])[::-1], [0.0]])
    at = int(np.argmin(left))
    edges = np.concatenate([time[:1], 0.5 * (time[1:] + time[:-1]), time[-1:]])
    return float(edges[at])
