"""Realisations of a recording's noise in its whitened rows, with rounding errors as its encoders make them."""

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.noise.coloured import drawn
from drake_cafim.diagnosis.noise.quantised import Rounding
from drake_cafim.diagnosis.whitening.sampled_noise import sampled_covariance
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.numerics.row_products import lower_entries
from drake_cafim.typing import Array

LEAST_SHARE = 1e-6
"""Share of a row's variance below which what is not by the samples counts as none."""


def rounds(run: Run) -> bool:
    """Whether errors of rounding that stay correlated are part of the noise of `run`."""
    return any(isinstance(memory, Rounding) for memory in run.weak.samples.memories.values())


def noise_realisations(run: Run, rng: np.random.Generator, count: int) -> Array | None:
    """Whitened rows (R, count) of noise alone; None where the noise of the samples is not propagated by matrices.

    An encoder's readings err as those of the estimated motion do anywhere beside its lattice: in a slow channel they
    jump now and then, which a covariance does not tell. All other noise is drawn from its covariance.
    """
    samples, blocks = run.weak.samples, dict(run.jacobian)
    if not all(sp.issparse(block) for block in blocks.values()):
        return None
    rows = np.zeros((run.rows, count))
    for column, block in blocks.items():
        memory, std = samples.memories.get(column), samples.std[column]
        if isinstance(memory, Rounding):
            rows += block @ memory.of_readings(rng, samples.recording[column], std, count)
        else:
            rows += block @ (std * np.stack([drawn(rng, samples.time, memory) for _ in range(count)], axis=1))
    total, rest = run.whiten.covariance.diagonal, run.whiten.covariance.copy()
    rest.add_entries(-1.0, lower_entries(sampled_covariance(run.weak, blocks.items()).full()))
    if np.any(rest.diagonal > LEAST_SHARE * total):
        # less than nothing is left where the subtraction cancels
        rows += rest.factor(LEAST_SHARE * total).times(rng.standard_normal(rows.shape))
    return run.whiten(rows)
