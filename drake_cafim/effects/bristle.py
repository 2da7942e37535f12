"""The state of friction that builds up with the displacement after a motion turns round, as of a bristle that bends.

ż = (v − |v| z)/s depends on the path alone, not on how fast it is gone along: over a displacement d in one direction,
with g = sign d, z becomes g + (z − g) exp(−|d|/s) (Dahl, A solid friction model, Aerospace Corporation TOR-0158, 1968).
"""

from itertools import pairwise

import numpy as np

from drake_cafim.typing import Array


def bristle_after(state: Array, displacement: Array, slip: float) -> Array:
    """The state z after a `displacement` d in one direction, rad or m, from `state`; `slip` is s. Of any one shape."""
    side = np.sign(displacement)
    return np.asarray(side + (state - side) * np.exp(-np.abs(displacement) / slip))


def bristle_along(q: Array, slip: float) -> Array:
    """(N,) the state z along the positions `q` (N,) of one recording, in order, at rest and not bent at the first."""
    step = np.diff(q)
    moved = np.flatnonzero(step)
    z = np.zeros(len(q))
    if len(moved) == 0:
        return z
    side = np.sign(step)[moved]
    # over each stretch in one direction it is an exponential of the way
    turns = [0, *(np.flatnonzero(np.diff(side)) + 1), len(side)]
    way = np.concatenate([[0.0], np.cumsum(np.abs(step))])
    now = 0.0
    for first, stop in pairwise(turns):
        begin = moved[first]
        end = moved[stop] if stop < len(moved) else len(step)
        own = slice(begin + 1, end + 1)
        z[own] = side[first] + (now - side[first]) * np.exp(-(way[own] - way[begin]) / slip)
        now = z[end]
    return z
