"""Noise and plans of one seed draw from different streams."""

from itertools import combinations
from typing import get_args

import numpy as np
import pytest

from drake_cafim.streams import Purpose, stream

PLACES = [(0, 0), (1, 0), (1, 2), (1, 0, 0), (1, 0, 1), (2, 3, 1)]


@pytest.mark.parametrize("where", PLACES)
def test_purposes_share_no_numbers(where: tuple[int, ...]) -> None:
    draws = [stream(purpose, *where).standard_normal(4) for purpose in get_args(Purpose)]
    draws.append(np.random.default_rng(where).standard_normal(4))
    for first, second in combinations(draws, 2):
        assert not np.isin(first, second).any()


def test_the_same_place_draws_the_same_numbers_again() -> None:
    first, again, other = (stream("force noise", 3, 1, step).standard_normal(4) for step in (5, 5, 6))
    np.testing.assert_array_equal(first, again)
    assert not np.isin(first, other).any()
