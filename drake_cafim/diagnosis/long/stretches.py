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
    begins: bool = False
    """Whether another stretch is before it."""
    ends: bool = False
    """Whether another stretch is after it."""

    @property
    def inner(self) -> tuple[Seen, ...]:
        """Those of its parts in which nothing changes: where another stretch meets it, the change may lie in the last
        part before or in the first part after.
        """
        return self.seen[int(self.begins) : len(self.seen) - int(self.ends)]

    @property
    def numbers(self) -> tuple[int, ...]:
        """The numbers of its parts."""
        return tuple(part.number for part in self.seen)


def stretches_of(seen: Sequence[Seen], rate: float) -> tuple[Stretch, ...]:
    """The parts in their order, divided where the excess of a row steps, or steps up and down again.

    The logarithms of the mean squares inside and outside an interval of parts are compared by Student's t, at a
    false-alarm `rate` over all intervals and rows. The larger mean square must be more than twice the smaller, so that
    more begins (or ends) than stays.
    """
    found = [tuple(seen)]
    while len(found) < MOST_STRETCHES:
        steps = [(*step, index) for index, own in enumerate(found) if (step := _step(own, MOST_STRETCHES - len(found)))]
        if not steps or not min(steps)[0] < rate:
            break
        _, begin, end, index = min(steps)
        own = found[index]
        found[index : index + 1] = [part for part in (own[:begin], own[begin:end], own[end:]) if part]
    last = len(found) - 1
    return tuple(Stretch(own, index > 0, index < last) for index, own in enumerate(found))


def _step(seen: Sequence[Seen], cuts: int) -> tuple[float, int, int] | None:
    """p-value, begin and end of the interval that differs most clearly, by at most so many `cuts`; None without one."""
    count = len(seen)
    logs = np.log(np.maximum([part.excess + 1.0 for part in seen], np.finfo(float).tiny))
    sums = np.concatenate([np.zeros((1, logs.shape[1])), np.cumsum(logs, axis=0)])
    mean, scatter = np.mean(logs, axis=0), np.sum((logs - np.mean(logs, axis=0)) ** 2, axis=0)
    least = -np.log(1.0 - NAMED_EXCESS_SHARE)
    best: tuple[float, int, int] | None = None
    tests = 0
    for begin in range(FEWEST_PARTS, count - FEWEST_PARTS + 1):
        ends = np.array([*range(begin + FEWEST_PARTS, count - FEWEST_PARTS + 1), count])
        ends = ends if cuts > 1 else ends[-1:]
        tests += len(ends)
        size = (ends - begin)[:, None]
        inside = (sums[ends] - sums[begin]) / size
        change = (inside - mean) * count / (count - size)
        left = np.maximum(scatter - change**2 * size * (count - size) / count, 1e-12 * (1.0 + scatter))
        statistic = np.abs(change) / np.sqrt(left / (count - 2) * (1.0 / size + 1.0 / (count - size)))
        # by the statistic: of many parts p-values of clear steps are all below what a number can hold
        largest = np.max(np.where(np.abs(change) > least, statistic, -np.inf), axis=1)
        at = int(np.argmax(largest))
        if np.isfinite(largest[at]) and (best is None or largest[at] > best[0]):
            best = float(largest[at]), begin, int(ends[at])
    return None if best is None else (2.0 * student.sf(best[0], count - 2) * tests * logs.shape[1], *best[1:])


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
