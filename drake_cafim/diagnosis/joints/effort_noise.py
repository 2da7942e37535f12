"""Estimates the noise of measured efforts without a stated std, from the residual of the equations of motion.

Differences of an effort's samples would also show the sensor noise that a controller feeds back, which are efforts that
really acted. The equations tell them apart: an effort that acted leaves no residual, an error of its measurement does.
Missing physics leaves a residual too, but one that changes slowly from window to window, where white noise does not:
over a few successive windows it is modelled as a parabola in time, and a step where the joint reverses. The whole
residual, slow part included, refines the estimate within the uncertainty of the estimate without the slow part.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.optimize import brentq
from scipy.stats import chi2

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import (
    EFFORT_NOISE_LARGEST,
    EFFORT_NOISE_STDS,
    EFFORT_NOISE_STRETCH,
    EFFORT_NOISE_TREND,
    EFFORT_NOISE_TRUSTED_QUANTILE,
)
from drake_cafim.diagnosis.whitening.covariance import row_covariance
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Stretch:
    """A joint's `rows` (ν,) over a few windows, of variance 1 + σ² `gains` (ν,) where the effort's noise has the std σ.

    They are combinations of windows in which the channels' noise and the effort's noise are both independent.
    """

    rows: Array
    gains: Array

    def chi_square(self, variance: float) -> float:
        """Σ rows²/(1 + σ² gains) for the `variance` σ² of the effort's noise."""
        return float(np.sum(self.rows**2 / (1.0 + variance * self.gains)))

    @property
    def bound_and_moments(self) -> tuple[float, float, float]:
        """The bound c on the χ² of this stretch, and the mean and the variance of min(χ²_ν, c)."""
        degrees = len(self.rows)
        most = float(chi2.ppf(EFFORT_NOISE_TRUSTED_QUANTILE, degrees))
        beyond = float(chi2.sf(most, degrees))
        mean = degrees * chi2.cdf(most, degrees + 2) + most * beyond
        square = degrees * (degrees + 2) * chi2.cdf(most, degrees + 4) + most**2 * beyond
        return most, float(mean), float(square - mean**2)


def effort_noise(scene: Scene, forms: Sequence[WeakForm], model: Model, joints: Sequence[int]) -> dict[str, float]:
    """Standard deviation σ of one sample of the efforts of `joints` (indices), by column, N m or N; 0 if undetectable.

    Huber's proposal 2 (Robust Estimation of a Location Parameter, Ann. Math. Statistics 35(1), 1964) over stretches of
    windows without their slow part, Σ min(χ²(σ), c) = Σ E min(χ²_ν, c). Within `EFFORT_NOISE_STDS` of this estimate the
    whole stretches decide, Σ χ²(σ) = Σ ν. `forms` must hold the efforts of `joints` as exact.
    """
    physics = model.physics(scene)
    stretches: dict[int, list[Stretch]] = {j: [] for j in joints}
    whole: dict[int, list[Stretch]] = {j: [] for j in joints}
    for form in forms:
        covariance = row_covariance(form, physics).full()
        residual = form.residual(physics)
        for j in joints:
            row = form.dynamic.start + j
            own = slice(row, None, form.rows_per_window)
            noise = covariance[own, own]
            for fast, every in _stretches(form, physics, j, residual[:, row], noise):
                stretches[j].append(fast)
                whole[j].append(every)
    names = scene.tree.joint_names
    return {f"u.{names[j]}": float(np.sqrt(_variance(stretches[j], whole[j]))) for j in joints}


def with_std(form: WeakForm, std: Mapping[str, float]) -> WeakForm:
    """The recording with the standard deviations `std` of the noise of some columns, by name."""
    return WeakForm(replace(form.samples, std=form.samples.std | dict(std)), form.sensors)


def effort_notes(scene: Scene, noise: Mapping[str, float]) -> tuple[str, ...]:
    """A note for each estimated standard deviation of `noise`, by column."""
    notes = []
    for column, std in noise.items():
        joint = scene.tree.joints[scene.tree.joint_index(column.removeprefix("u."))]
        unit = "N" if joint.prismatic else "N m"
        notes.append(f"Noise of {column}: " + (f"estimated {std:.2g} {unit}" if std > 0.0 else "none is detectable"))
    return tuple(notes)


def _stretches(
    form: WeakForm, physics: Physics, joint: int, residual: Array, noise: sp.csr_matrix
) -> Iterator[tuple[Stretch, Stretch]]:
    """The stretches of one recording, each without its slow part and with it.

    `residual` (M,) is of the joint's rows, `noise` (M, M) the covariance of their noise without the effort's.
    """
    windows = form.samples.windows
    gain = float(physics.effort_gains[joint])
    held = windows.held(windows.time, form.samples.ramped[joint]) / gain
    by_effort = sp.csr_matrix(held @ held.T)
    turning = windows.value @ np.sign(form.measurement(physics).v_hat[:, joint])
    together = np.flatnonzero(np.diff(windows.starts) > 0.75 * windows.width)
    edges = [0, *(together + 1).tolist(), len(windows)]
    for begin, end in pairwise(edges):
        for first in range(begin, end - EFFORT_NOISE_STRETCH + 1, EFFORT_NOISE_STRETCH):
            part = slice(first, first + EFFORT_NOISE_STRETCH)
            slow = _slow(windows.starts[part], turning[part])
            fast = scipy.linalg.null_space(slow.T)
            matrices = residual[part], noise[part, part].toarray(), by_effort[part, part].toarray()
            yield _stretch(fast, *matrices), _stretch(np.eye(EFFORT_NOISE_STRETCH), *matrices)


def _slow(time: Array, turning: Array) -> Array:
    """(K, p) orthonormal basis of the slow part: powers of time, and a step where the joint reverses."""
    powers = np.vander((time - time.mean()) / np.ptp(time), EFFORT_NOISE_TREND)
    basis, _ = np.linalg.qr(powers)
    step = turning - basis @ (basis.T @ turning)
    if np.linalg.norm(step) > 1e-3 * np.linalg.norm(turning):
        basis = np.column_stack([basis, step / np.linalg.norm(step)])
    return np.asarray(basis)


def _stretch(basis: Array, residual: Array, noise: Array, by_effort: Array) -> Stretch:
    """The residual projected on `basis` (K, ν), in the axes that diagonalise both covariances."""
    gains, axes = scipy.linalg.eigh(basis.T @ by_effort @ basis, basis.T @ noise @ basis)
    return Stretch(np.asarray(axes.T @ (basis.T @ residual)), np.maximum(gains, 0.0))


def _variance(stretches: Sequence[Stretch], whole: Sequence[Stretch]) -> float:
    """σ² at which χ² of the stretches has its expectation; 0 where χ² is no larger without such noise."""
    if not stretches:
        return 0.0
    counted = [stretch.bound_and_moments for stretch in stretches]
    expected = sum(mean for _, mean, _ in counted)
    reach = EFFORT_NOISE_STDS * float(np.sqrt(sum(variance for _, _, variance in counted)))
    highest = EFFORT_NOISE_LARGEST / float(np.median([stretch.gains.max() for stretch in stretches]))

    def robust(variance: float) -> float:
        return sum(
            min(stretch.chi_square(variance), most) for stretch, (most, _, _) in zip(stretches, counted, strict=True)
        )

    least = _root(lambda variance: robust(variance) - expected - reach, highest)
    most = _root(lambda variance: robust(variance) - expected + reach, highest)
    rows = sum(len(stretch.rows) for stretch in whole)
    return float(np.clip(_root(lambda v: sum(stretch.chi_square(v) for stretch in whole) - rows, highest), least, most))


def _root(falling: Callable[[float], float], highest: float) -> float:
    """The zero of a decreasing function between 0 and `highest`, or the end nearest to it."""
    if falling(0.0) <= 0.0:
        return 0.0
    return float(brentq(falling, 0.0, highest)) if falling(highest) < 0.0 else highest
