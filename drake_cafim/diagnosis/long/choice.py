"""Chooses the parts of long recordings that are searched: those that tell most, not the first ones."""

from collections.abc import Sequence

import numpy as np

from drake_cafim.diagnosis.long.scan import Seen
from drake_cafim.typing import Array


def choose(seen: Sequence[Seen], most: int) -> list[int]:
    """The numbers of at most `most` parts, in order.

    Half of them are those of largest excess over noise: of each row of a window in turn, so that what is missing at
    one joint does not hide what is missing at another. The others add most information, the sum over the hypotheses h
    of ln(I_h + ΔI_h) − ln I_h (greedy D-optimal choice of independent parts; Fedorov, Theory of Optimal Experiments,
    1972).
    """
    if len(seen) <= most:
        return [part.number for part in seen]
    chosen: list[int] = []
    excess = np.stack([part.excess for part in seen])
    for row in np.argsort(-np.max(excess, axis=0)):
        if len(chosen) >= most // 2:
            break
        worst = int(np.argmax(excess[:, row]))
        if excess[worst, row] > 0.0 and worst not in chosen:
            chosen.append(worst)
    information = _informations(seen)
    while len(chosen) < most:
        have = np.sum(information[chosen], axis=0)
        # nothing is known of a hypothesis before the first part: a little is, so that the logarithm is finite
        have = have + 1e-3 * np.max(information, axis=0) + np.finfo(float).tiny
        gain = np.sum(np.log1p(information / have), axis=1)
        gain[chosen] = -np.inf
        chosen.append(int(np.argmax(gain)))
    return sorted(seen[k].number for k in chosen)


def _informations(seen: Sequence[Seen]) -> Array:
    """(parts, hypotheses) information; 0 where a part says nothing of a hypothesis."""
    keys = sorted({key for part in seen for key in part.information})
    found = [[part.information.get(key, 0.0) for key in keys] for part in seen]
    return np.array(found, dtype=float).reshape(len(seen), len(keys))
