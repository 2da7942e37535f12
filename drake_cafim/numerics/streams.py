"""Independent random number streams from one seed, one for each purpose."""

from typing import Literal, TypeAlias, get_args

import numpy as np

Purpose: TypeAlias = Literal["force noise", "joint noise", "trial noise", "wrench and pose noise"]


def stream(purpose: Purpose, *where: int) -> np.random.Generator:
    """A generator for `purpose` at `where`: the seed, then counters.

    Its numbers are independent of those of other purposes and of `numpy.random.default_rng(where)`, which planners use;
    a shorter `where` is equivalent to one padded with zeros.
    """
    key = (get_args(Purpose).index(purpose),)
    return np.random.default_rng(np.random.SeedSequence(where, spawn_key=key))
