"""Random numbers of one seed for several purposes, none of which sees those of another."""

from typing import Literal, TypeAlias, get_args

import numpy as np

Purpose: TypeAlias = Literal["force noise", "joint noise", "trial noise"]


def stream(purpose: Purpose, *where: int) -> np.random.Generator:
    """Random numbers for `purpose` at `where`: the seed, then counters.

    Independent of those of other purposes and of `numpy.random.default_rng(where)`, which plans draw from; a shorter
    `where` is one with zeros behind it.
    """
    key = (get_args(Purpose).index(purpose),)
    return np.random.default_rng(np.random.SeedSequence(where, spawn_key=key))
