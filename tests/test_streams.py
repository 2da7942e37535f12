"""Noise and plans of one seed draw from different streams."""

from itertools import combinations
from typing import get_args

import numpy as np
import pytest

from drake_cafim.diagrams.sensing import SensorNoise
from drake_cafim.numerics.streams import Purpose, stream

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


def test_a_sensors_noise_is_not_what_the_planner_draws_at_the_same_step() -> None:
    noise = SensorNoise(std=[1.0, 1.0], period=0.1, seed=3)
    context = noise.CreateDefaultContext()
    context.get_mutable_numeric_parameter(0)[0] = 2.0
    context.SetTime(0.4)
    noise.get_input_port().FixValue(context, [0.0, 0.0])
    read = noise.get_output_port().Eval(context)
    assert not np.isin(read, np.random.default_rng([3, 2, 4]).standard_normal(2)).any()
    np.testing.assert_array_equal(read, noise.get_output_port().Eval(context))
