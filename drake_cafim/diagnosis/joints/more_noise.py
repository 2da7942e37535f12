"""Recordings with further noise added, by which the noise shared by Jacobian and residual is estimated."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.noise.feedback import Feedback
from drake_cafim.diagnosis.rows.samples import add_noise
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.typing import Array

MOST_DRAWS, CHANCE_SHARE = 8, 0.25
"""Largest number of draws of noise, and the variance of their mean, over the information, that is small enough."""


def has_feedback(runs: Sequence[Run]) -> bool:
    """Whether in any recording a controller feeds measurement noise back into the efforts."""
    every = (run.weak.samples for run in runs)
    return any(np.any(Feedback.of(samples.q, samples.v, samples.u).gains) for samples in every)


def with_more_noise(runs: Sequence[Run], fed_back: bool, draw: int = 0) -> tuple[Run, ...]:
    """The runs with noise added once more; where `fed_back`, with the efforts by which the controller answers it."""
    louder = []
    for index, run in enumerate(runs):
        samples = add_noise(run.weak.samples, np.random.default_rng(index + draw * len(runs)), fed_back)
        louder.append(replace(run, weak=WeakForm(samples, run.weak.sensors)))
    return tuple(louder)


def draws(shared: Array, jacobian: Array) -> int:
    """Number of draws of noise to average ΔJᵀΔz over, where one draw changes the `jacobian` (R, n) by ΔJ = `shared`.

    A joint oscillates with fed-back noise long after that noise entered the rows, so that ΔJᵀΔz is mostly chance, of
    variance ΔJᵀΔJ: a single draw may move a fit by as much as all noise of the rows.
    """
    chance, known = (np.einsum("ij,ij->j", slopes, slopes) for slopes in (shared, jacobian))
    needed = np.max(chance / np.maximum(CHANCE_SHARE * known, 1e-300), initial=1.0)
    # a hidden state that diverges under added noise has no finite derivative
    return int(np.ceil(min(needed, MOST_DRAWS))) if np.isfinite(needed) else 1


def noisy_parameters(model: Model) -> Array:
    """(n + k,) 1 for each parameter whose derivative contains measurement noise, 0 for those of effects that impact.

    The twist in a gap is integrated, which leaves nearly no noise; but added noise shifts each impact in time, which is
    no small change.
    """
    numbers = [float(not effect.impacts) for effect in model.effects for _ in effect.strengths]
    return np.array([1.0] * len(model.unknown) + numbers)
