"""Recordings with their noise once more on top, and how many doses of it tell what slopes share with the residual."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.noise.feedback import Feedback
from drake_cafim.diagnosis.rows.samples import noisier
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.typing import Array

DOSES, DRAWN = 8, 0.25
"""Of noise, at most; and what is left of chance in the mean of them, of the information."""


def closed(runs: Sequence[Run]) -> bool:
    """Whether any recording's efforts are a controller's that hands noise on."""
    every = (run.weak.samples for run in runs)
    return any(np.any(Feedback.of(samples.q, samples.v, samples.u).gains) for samples in every)


def with_more_noise(runs: Sequence[Run], fed_back: bool, dose: int = 0) -> tuple[Run, ...]:
    """The runs with more noise, and where `fed_back` with the efforts that the controller would have made of it."""
    louder = []
    for index, run in enumerate(runs):
        samples = noisier(run.weak.samples, np.random.default_rng(index + dose * len(runs)), fed_back)
        louder.append(replace(run, weak=WeakForm(samples, run.weak.sensors)))
    return tuple(louder)


def doses(shared: Array, jacobian: Array) -> int:
    """How many doses of noise it takes, where slopes (R, n) change by `shared` with one of them.

    A joint rings with what a controller made of noise long after rows had their share of it: the product of the two
    then is mostly chance, of variance ΔJᵀΔJ, and a single one may throw a fit as far off as all of the rows' noise.
    """
    chance, known = (np.einsum("ij,ij->j", slopes, slopes) for slopes in (shared, jacobian))
    needed = np.max(chance / np.maximum(DRAWN * known, 1e-300), initial=1.0)
    return int(np.ceil(min(needed, DOSES)))


def noisy_numbers(model: Model) -> Array:
    """(n + k,) 1 for each number whose slopes hold noise of the measurement, 0 for those of gaps.

    The twist in one is integrated, and holds next to none; but with more of it each impact comes at another time,
    which is no small change.
    """
    numbers = [float(not effect.impacts) for effect in model.effects for _ in effect.strengths]
    return np.array([1.0] * len(model.unknown) + numbers)
