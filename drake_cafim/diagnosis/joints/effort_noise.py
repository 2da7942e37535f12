"""The noise of measured efforts whose std nobody states, from what the equations of motion leave.

Differences of an effort's own samples would show what a controller makes of the sensors' noise, which is real and no
noise of the effort. The equations know: efforts that acted leave nothing, an error of their measurement does. What
physics is missing leaves something too, but it goes on from window to window, where white noise does not: over a few
windows in a row, what missing physics leaves is taken for a parabola in time, and a step where the joint turns round.
All that is left may refine the estimate as far as those few windows leave it open, and no further.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy.linalg
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
from drake_cafim.diagnosis.whitening.covariance import whitening
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Stretch:
    """What a few windows hold of one joint's equation without its slow part, white but for the effort's noise.

    `rows` (ν,), with variance 1 + σ² `gains` (ν,) where the effort's noise has the std σ.
    """

    rows: Array
    gains: Array

    def chi_square(self, variance: float) -> float:
        return float(np.sum(self.rows**2 / (1.0 + variance * self.gains)))

    @property
    def counted(self) -> tuple[float, float, float]:
        """The most c that its χ² counts for, and the mean and the variance of min(χ²_ν, c)."""
        degrees = len(self.rows)
        most = float(chi2.ppf(EFFORT_NOISE_TRUSTED_QUANTILE, degrees))
        beyond = float(chi2.sf(most, degrees))
        mean = degrees * chi2.cdf(most, degrees + 2) + most * beyond
        square = degrees * (degrees + 2) * chi2.cdf(most, degrees + 4) + most**2 * beyond
        return most, float(mean), float(square - mean**2)


def effort_noise(scene: Scene, forms: Sequence[WeakForm], model: Model, joints: Sequence[int]) -> dict[str, float]:
    """Standard deviation of one sample by column of the `joints` by index, N m or N; 0 where none is seen.

    Huber's proposal 2 (Robust Estimation of a Location Parameter, Ann. Math. Statistics 35(1), 1964) over stretches of
    windows without their slow part: Σ min(χ²(σ), c) = Σ E min(χ²_ν, c), within `EFFORT_NOISE_STDS` of which the whole
    stretches have the last word, Σ χ²(σ) = Σ ν. `forms` take the efforts of `joints` as exact.
    """
    physics = model.physics(scene)
    stretches: dict[int, list[Stretch]] = {j: [] for j in joints}
    whole: dict[int, list[Stretch]] = {j: [] for j in joints}
    for form in forms:
        covariance = whitening(form, physics)[0].covariance.tocsr()
        residual = form.residual(physics)
        for j in joints:
            row = form.dynamic.start + j
            own = slice(row, None, form.rows_per_window)
            noise = covariance[own, own].toarray()
            for fast, every in _stretches(form, physics, j, residual[:, row], noise):
                stretches[j].append(fast)
                whole[j].append(every)
    names = scene.tree.joint_names
    return {f"u.{names[j]}": float(np.sqrt(_variance(stretches[j], whole[j]))) for j in joints}


def with_std(form: WeakForm, std: Mapping[str, float]) -> WeakForm:
    """The recording with another noise of some columns, by name."""
    return WeakForm(replace(form.samples, std=form.samples.std | dict(std)), form.sensors)


def effort_notes(scene: Scene, noise: Mapping[str, float]) -> tuple[str, ...]:
    """What was estimated, in words."""
    notes = []
    for column, std in noise.items():
        joint = scene.tree.joints[scene.tree.joint_index(column.removeprefix("u."))]
        unit = "N" if joint.prismatic else "N m"
        notes.append(f"Noise of {column}: " + (f"estimated {std:.2g} {unit}" if std > 0.0 else "none is seen"))
    return tuple(notes)


def _stretches(
    form: WeakForm, physics: Physics, joint: int, residual: Array, noise: Array
) -> Iterator[tuple[Stretch, Stretch]]:
    """Without the slow part and with it, of one recording.

    `residual` (M,) is a joint's, and `noise` (M, M) the covariance of its noise but the effort's.
    """
    windows = form.samples.windows
    gain = float(physics.effort_gains[joint])
    held = windows.held(windows.time, form.samples.ramped[joint]) / gain
    by_effort = (held @ held.T).toarray()
    turning = windows.value @ np.sign(form.measurement(physics).v_hat[:, joint])
    together = np.flatnonzero(np.diff(windows.starts) > 0.75 * windows.width)
    edges = [0, *(together + 1).tolist(), len(windows)]
    for begin, end in pairwise(edges):
        for first in range(begin, end - EFFORT_NOISE_STRETCH + 1, EFFORT_NOISE_STRETCH):
            part = slice(first, first + EFFORT_NOISE_STRETCH)
            slow = _slow(windows.starts[part], turning[part])
            fast = scipy.linalg.null_space(slow.T)
            matrices = residual[part], noise[part, part], by_effort[part, part]
            yield _stretch(fast, *matrices), _stretch(np.eye(EFFORT_NOISE_STRETCH), *matrices)


def _slow(time: Array, turning: Array) -> Array:
    """(K, p) orthonormal: the powers of time, and a step where the joint turns round."""
    powers = np.vander((time - time.mean()) / np.ptp(time), EFFORT_NOISE_TREND)
    basis, _ = np.linalg.qr(powers)
    step = turning - basis @ (basis.T @ turning)
    if np.linalg.norm(step) > 1e-3 * np.linalg.norm(turning):
        basis = np.column_stack([basis, step / np.linalg.norm(step)])
    return np.asarray(basis)


def _stretch(basis: Array, residual: Array, noise: Array, by_effort: Array) -> Stretch:
    """What lies in `basis` (K, ν), in the axes in which noise and the effort's noise are independent."""
    gains, axes = scipy.linalg.eigh(basis.T @ by_effort @ basis, basis.T @ noise @ basis)
    return Stretch(np.asarray(axes.T @ (basis.T @ residual)), np.maximum(gains, 0.0))


def _variance(stretches: Sequence[Stretch], whole: Sequence[Stretch]) -> float:
    """σ² under which the stretches are as spread as χ² says; 0 where they are no more than that without it."""
    if not stretches:
        return 0.0
    counted = [one.counted for one in stretches]
    expected = sum(mean for _, mean, _ in counted)
    reach = EFFORT_NOISE_STDS * float(np.sqrt(sum(variance for _, _, variance in counted)))
    highest = EFFORT_NOISE_LARGEST / float(np.median([one.gains.max() for one in stretches]))

    def robust(variance: float) -> float:
        return sum(min(one.chi_square(variance), most) for one, (most, _, _) in zip(stretches, counted, strict=True))

    least = _root(lambda variance: robust(variance) - expected - reach, highest)
    most = _root(lambda variance: robust(variance) - expected + reach, highest)
    rows = sum(len(one.rows) for one in whole)
    return float(np.clip(_root(lambda v: sum(one.chi_square(v) for one in whole) - rows, highest), least, most))


def _root(falling: Callable[[float], float], highest: float) -> float:
    """Where a function that falls crosses zero between 0 and `highest`, or the end that is nearest to it."""
    if falling(0.0) <= 0.0:
        return 0.0
    return float(brentq(falling, 0.0, highest)) if falling(highest) < 0.0 else highest
