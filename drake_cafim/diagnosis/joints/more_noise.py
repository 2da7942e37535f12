"""Recordings with more noise of measured efforts, by which the noise that Jacobian and residual share is estimated."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.rows.samples import add_effort_noise
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.typing import Array


def with_more_effort_noise(runs: Sequence[Run]) -> tuple[Run, ...]:
    """The runs with the noise of measured efforts added once more."""
    louder = []
    for index, run in enumerate(runs):
        samples = add_effort_noise(run.weak.samples, np.random.default_rng(index))
        louder.append(replace(run, weak=WeakForm(samples, run.weak.sensors)))
    return tuple(louder)


def noisy_parameters(model: Model) -> Array:
    """(n + k,) 1 for each parameter whose derivative contains measurement noise, 0 for those of effects that impact.

    The twist in a gap is integrated, which leaves nearly no noise; but added noise shifts each impact in time, which is
    no small change.
    """
    numbers = [float(not effect.impacts) for effect in model.effects for _ in effect.strengths]
    return np.array([1.0] * len(model.unknown) + numbers)
