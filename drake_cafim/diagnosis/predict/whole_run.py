"""Simulation of whole recordings, each from its first sample to its last, as one course."""

from collections.abc import Sequence

import numpy as np

from drake_cafim.diagnosis.predict.forecast import Forecast, simulated_courses
from drake_cafim.diagnosis.predict.initial_state import LOOK_BACK
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

DEGREE = 2
"""Degree of the polynomial in time that the first positions are fitted by."""


def whole_runs(forms: Sequence[WeakForm], physics: Physics) -> list[Forecast]:
    """Each recording simulated from its first sample on; the first `LOOK_BACK` s of positions give the state there."""
    return simulated_courses(forms, physics, lambda weak: ([0], np.inf), first_state)


def first_state(weak: WeakForm, physics: Physics, start: int) -> tuple[Array, Array]:
    """q and v (n,) at the sample `start`, from a parabola through the `LOOK_BACK` s of positions from there on."""
    time, q = weak.samples.time, weak.measurement(physics).q
    stop = max(int(np.searchsorted(time, time[start] + LOOK_BACK)), start + DEGREE + 1)
    powers = (time[start:stop, None] - time[start]) ** np.arange(DEGREE + 1)
    coefficients = np.linalg.lstsq(powers, q[start:stop], rcond=None)[0]
    return coefficients[0], coefficients[1]
