"""The benchmark of planning steps measures each of them."""

import numpy as np

from tests.benchmarks.planning import planning_milliseconds


def test_each_planning_step_is_measured() -> None:
    period, times = planning_milliseconds("pinching", 1, periods=3)
    assert period == 20.0 and times.shape == (3,) and np.all(times > 0.0)
