"""Forces within a model's accuracy as noise of the rows: as much of them as the rows themselves show.

The smoother of each joint takes for a force also what the noise of the other joints does to its acceleration, and the
noise of measured efforts. Only the rows of all joints, whitened together, know all of this.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.initial_uncertainty import has_unknown_start
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.covariance import Whitening
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.numerics.row_products import LowerEntries, lower_entries
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

DRAWS = 64
"""Draws of noise from which mean and variance of a quadratic form are taken, to 18 % of the variance."""
MOST_STEPS, TOLERANCE = 4, 0.1
"""Largest number of scoring steps, and the relative change of the densities at which they end."""


def with_unmodelled_force(run: Run, physics: Physics) -> Run:
    """`run` with white forces at the joints as noise: of the density that its rows ask for, and no more than is stated.

    Stated is `EstimatedMotion.unmodelled_force`. Where the rows have an unknown start, that is the density.
    """
    if run.weak.samples.estimated is None:
        return run
    most = run.weak.samples.estimated.unmodelled_force
    if not np.any(most):
        return run
    weighed = _weighed(run.weak, physics)
    shares = [lower_entries(part @ part.T) for part in weighed]
    if has_unknown_start(physics):
        return _with_noise(run, shares, most)
    density = _asked(run, run.noisy_rows(physics), weighed, shares, most)
    return _with_noise(run, shares, density) if np.any(density) else run


def _asked(run: Run, rows: Array, weighed: list[sp.csr_matrix], shares: Sequence[LowerEntries], most: Array) -> Array:
    """(n,) densities of the forces, each `weighed`, that make the `rows` (M, r) likeliest, none of them above `most`.

    `shares` are those of the rows' covariance.

    Variance components by Fisher scoring (Harville, J. American Statistical Association 72(358), 1977, §4), each joint
    by itself. With z = L⁻¹ rows white and U the covariance by a unit force, zᵀAz, A = L⁻¹UL⁻ᵀ, has the mean tr A and
    the variance 2 tr A², and a density that is more by d adds d tr A² to it. Mean and variance are taken from draws of
    z, the same ones always.
    """
    rows = rows.reshape(run.rows, 1)
    drawn = np.random.default_rng(0).standard_normal((run.rows, DRAWS))
    density = most
    for _ in range(MOST_STEPS):
        whiten = _with_noise(run, shares, density).whiten
        seen = whiten.transposed(np.hstack([whiten(rows), drawn]))
        before, found = density, []
        for own, d in zip(weighed, density, strict=True):
            form, *by_noise = np.sum((own.T @ seen) ** 2, axis=0)
            found.append(d + (form - np.mean(by_noise)) / (0.5 * np.var(by_noise, ddof=1)))
        density = np.clip(found, 0.0, most)
        if np.all(np.abs(density - before) <= TOLERANCE * before):
            break
    return density


def _with_noise(run: Run, shares: Sequence[LowerEntries], density: Array) -> Run:
    """`run` with forces of that `density` (n,) as noise, each with its share of the covariance."""
    covariance = run.whiten.covariance.copy()
    for own, share in zip(density, shares, strict=True):
        covariance.add_entries(own, share)
    return replace(run, whiten=Whitening.of(covariance, run.whiten.samples_log_determinant))


def _weighed(weak: WeakForm, physics: Physics) -> list[sp.csr_matrix]:
    """W (R, N) of each joint: W Wᵀ is the rows' covariance by a white force of unit spectral density."""
    windows, r = weak.samples.windows, weak.rows_per_window
    weighed = sp.coo_matrix(windows.value @ sp.diags_array(1.0 / np.sqrt(np.gradient(weak.samples.time))))
    shape = (r * len(windows), weighed.shape[1])
    return [
        sp.csr_matrix((weighed.data / gain, (r * weighed.row + row, weighed.col)), shape=shape)
        for row, gain in zip(range(weak.dynamic.start, weak.dynamic.stop), physics.effort_gains, strict=True)
    ]
