"""The state of friction that builds up with the displacement after a motion turns round, as of a bristle that bends.

ż = (v − |v| z)/s depends on the path alone, not on how fast it is gone along: over a displacement d in one direction,
with g = sign d, z becomes g + (z − g) exp(−|d|/s) (Dahl, A solid friction model, Aerospace Corporation TOR-0158, 1968).
"""

import numpy as np

from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array


def bristle_after(state: Array, displacement: Array, slip: float) -> Array:
    """The state z after a `displacement` d in one direction, rad or m, from `state`; `slip` is s. Of any one shape."""
    side = np.sign(displacement)
    return np.asarray(side + (state - side) * np.exp(-np.abs(displacement) / slip))


def bristle_along(q: Array, slip: float) -> Array:
    """(N,) the state z along the positions `q` (N,) of one recording, in order, at rest and not bent at the first."""
    return np.asarray(_along(np.ascontiguousarray(q), float(slip)))


@compiled
def _along(q: Array, slip: float) -> Array:
    z = np.zeros(len(q))
    for k in range(1, len(q)):
        displacement = q[k] - q[k - 1]
        side = np.sign(displacement)
        z[k] = side + (z[k - 1] - side) * np.exp(-abs(displacement) / slip)
    return z
