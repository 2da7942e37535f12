"""What laws that bend within the noise of a velocity make of that noise, beyond what their slopes make of it.

Friction near rest jumps from one side to the other. Its mean over the noise is what is predicted, and its mean slope
hands the noise on to the rows; what it scatters beyond that is a noise of its own (statistical linearisation; Roberts,
Spanos, Random Vibration and Statistical Linearization, 1990, ch. 5). It is uncorrelated with the velocity's, and
forgets sooner: its correlation in time is the square of that one's, to the first order that counts.
"""

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.coloured_noise import covariance
from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

NODES = np.linspace(-5.0, 5.0, 51)
SHARES = np.exp(-0.5 * NODES**2) / np.sum(np.exp(-0.5 * NODES**2))
"""Errors in standard deviations, and how likely they are; what is rare counts, for a jump is large."""
WORTH = 1e-3
"""Of the noise that the slopes hand on, below which nothing bends."""


def bent_covariance(weak: WeakForm, physics: Physics) -> sp.csr_matrix:
    """(R, R) of the rows, beside what their slopes in the samples make of the noise."""
    scattered = scatter(weak, physics)
    rows = len(weak.samples.windows) * weak.rows_per_window
    total = sp.csr_matrix((rows, rows))
    for j in np.flatnonzero(np.any(scattered > 0.0, axis=0)):
        weighed = weak.samples.windows.value @ sp.diags_array(scattered[:, j] / physics.effort_gains[j])
        own = sp.coo_matrix(weighed @ _alike(weak, int(j)).power(2) @ weighed.T)
        row, column = (weak.rows_per_window * index + weak.dynamic.start + j for index in (own.row, own.col))
        total = total + sp.csr_matrix((own.data, (row, column)), shape=(rows, rows))
    return sp.csr_matrix(total)


def scatter(weak: WeakForm, physics: Physics) -> Array:
    """Standard deviations (N, n) of the joints' laws beyond what their mean slopes make of the velocities' noise."""
    std, measured = weak.samples.v_std, weak.measurement(physics)
    if not np.any(physics.applied_at_joints(weak.joint_samples(physics))[2]):
        return np.zeros_like(std)
    known = weak.sampled_joints(measured, np.zeros_like(weak.samples.v_std))

    def force(off: Array) -> Array:
        return physics.applied_at_joints([one.moved(off[:, j]) for j, one in enumerate(known)])[0]

    return beyond_slope(force, std)


def beyond_slope(force: Callable[[Array], Array], std: Array) -> Array:
    """Standard deviation (...,) of `force` of an error with `std` (...,), less what is in proportion to the error."""
    forces = np.stack([force(node * std) for node in NODES])
    mean, linear = np.tensordot(SHARES, forces, 1), np.tensordot(SHARES * NODES, forces, 1)
    beyond = np.tensordot(SHARES, forces**2, 1) - mean**2 - linear**2
    return np.sqrt(np.where(beyond > WORTH * linear**2, np.maximum(beyond, 0.0), 0.0))


def _alike(weak: WeakForm, joint: int) -> sp.csr_matrix:
    """Correlations (N, N) of the noise of the velocity that a joint's law has."""
    s = weak.samples
    name = [one.removeprefix("q.") for one in s.std if one.startswith("q.")][joint]
    total = sp.csr_matrix((len(s.time), len(s.time)))
    for column, smooth in ((f"v.{name}", s.kinked_v[joint].from_v), (f"q.{name}", s.kinked_v[joint].from_q)):
        if smooth.nnz and column in s.std:
            memory = s.memories.get(column)
            own = smooth if memory is None else smooth @ covariance(s.time, memory)
            total = total + s.std[column] ** 2 * (own @ smooth.T)
    scale = sp.diags_array(1.0 / np.sqrt(np.maximum(total.diagonal(), 1e-300)))
    return sp.csr_matrix(scale @ total @ scale)
