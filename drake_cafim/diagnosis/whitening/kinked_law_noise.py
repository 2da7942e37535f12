"""The rows' noise by force laws with a kink within the velocity's noise, beyond what their slopes propagate.

Friction near rest jumps from one sign to the other. Its mean over the noise is the prediction, and its mean slope
propagates the noise to the rows; the scatter beyond that is an additional noise (statistical linearisation; Roberts,
Spanos, Random Vibration and Statistical Linearization, 1990, ch. 5). It is uncorrelated with the velocity's noise, and
its correlation in time is, to leading order, the square of that noise's correlation.
"""

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.noise.coloured import covariance
from drake_cafim.diagnosis.rows.measurement import joint_samples_of
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.numerics.row_products import SymmetricBand
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Indices

NODES = np.linspace(-5.0, 5.0, 51)
SHARES = np.exp(-0.5 * NODES**2) / np.sum(np.exp(-0.5 * NODES**2))
"""Nodes of the mean over normal errors, in standard deviations, and their weights; wide, as rare jumps are large."""
LEAST_SHARE = 1e-3
"""Fraction of the variance propagated by slopes below which the scatter counts as zero."""


def kinked_law_covariance(weak: WeakForm, physics: Physics) -> sp.csr_matrix:
    """(R, R) the rows' covariance by the scatter of kinked force laws, beyond the Jacobian's first order."""
    scattered, windows = scatter(weak, physics), sp.csc_matrix(weak.samples.windows.value)
    rows = len(weak.samples.windows) * weak.rows_per_window
    total = sp.csr_matrix((rows, rows))
    for j in np.flatnonzero(np.any(scattered > 0.0, axis=0)):
        kinked = np.flatnonzero(scattered[:, j])
        weighed = windows[:, kinked] @ sp.diags_array(scattered[kinked, j] / physics.effort_gains[j])
        of_joint = sp.coo_matrix(weighed @ _correlation(weak, int(j), kinked).power(2) @ weighed.T)
        row, column = (weak.rows_per_window * index + weak.dynamic.start + j for index in (of_joint.row, of_joint.col))
        total = total + sp.csr_matrix((of_joint.data, (row, column)), shape=(rows, rows))
    return sp.csr_matrix(total)


def scatter(weak: WeakForm, physics: Physics) -> Array:
    """Standard deviations (N, n) of the joints' force laws by the velocities' noise, less the part linear in it."""
    std, measured = weak.samples.v_std, weak.measurement(physics)
    if not np.any(physics.applied_at_joints(weak.joint_samples(physics))[2]):
        return np.zeros_like(std)
    exact = joint_samples_of(weak.samples, measured, np.zeros_like(weak.samples.v_std))

    def force(error: Array) -> Array:
        return physics.applied_at_joints([joint.with_velocity_change(error[:, j]) for j, joint in enumerate(exact)])[0]

    return beyond_slope(force, std)


def beyond_slope(force: Callable[[Array], Array], std: Array) -> Array:
    """Standard deviation (...,) of `force`(e) for normal errors e of `std` (...,), less the part linear in e."""
    forces = np.stack([force(node * std) for node in NODES])
    mean, linear = np.tensordot(SHARES, forces, 1), np.tensordot(SHARES * NODES, forces, 1)
    beyond = np.tensordot(SHARES, forces**2, 1) - mean**2 - linear**2
    return np.sqrt(np.where(beyond > LEAST_SHARE * linear**2, np.maximum(beyond, 0.0), 0.0))


def _correlation(weak: WeakForm, joint: int, at: Indices) -> sp.csr_matrix:
    """Correlation matrix (K, K) of the noise of the velocity at which a joint's force law is evaluated.

    Of the samples `at` (K,).
    """
    s = weak.samples
    name = [column.removeprefix("q.") for column in s.std if column.startswith("q.")][joint]
    products = SymmetricBand.zeros(len(at))
    for column, whole in ((f"v.{name}", s.kinked_v[joint].from_v), (f"q.{name}", s.kinked_v[joint].from_q)):
        if whole.nnz and column in s.std:
            smooth, memory = whole[at], s.memories.get(column)
            correlated = smooth if memory is None else smooth @ covariance(s.time, memory)
            products.add(s.std[column] ** 2, correlated, smooth)
    total = products.full()
    scale = sp.diags_array(1.0 / np.sqrt(np.maximum(total.diagonal(), 1e-300)))
    return sp.csr_matrix(scale @ total @ scale)
