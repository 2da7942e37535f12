"""The decrease of χ² when channels are interpolated between samples, which smooths noise and is no evidence."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.noise.coloured import covariance
from drake_cafim.diagnosis.rows.samples import Samples
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.noise_jacobian import noise_jacobian
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.numerics.cache import make_room
from drake_cafim.scenario.physics import Physics

CACHED_VALUES = 8
"""Most cached values."""
WIDE_WINDOW = 28.0
"""Samples in a window from which on interpolation removes less than a fraction 3e-5 of the noise's variance."""


def shifts_of(samples: Samples, physics: Physics) -> tuple[SensorEffect, ...]:
    """The effects on position and velocity sensors that shift time; none where a window has `WIDE_WINDOW` or more."""
    if samples.windows.width >= WIDE_WINDOW * float(np.median(np.diff(samples.time))):
        return ()
    shifts = (effect for effect in physics.sensors if effect.shifts)
    return tuple(effect for effect in shifts if not effect.at.startswith("wrench."))


@dataclass(frozen=True)
class Reading:
    """The noise of rows when every channel is evaluated at its own samples: their `jacobian` (R, columns) there.

    Interpolation between two samples is a weighted mean of those around, least noisy in the middle: in windows of a
    dozen samples a delay of half a sample removes half a percent of a channel's noise variance, and with it a part of
    χ² that grows with the recording's length. `inverse` (R, R) is that of the covariance by which rows are whitened,
    near its diagonal; `labels` give each column's slice of the Jacobian.
    """

    samples: Samples
    jacobian: sp.csr_matrix
    labels: Sequence[tuple[str, slice]]
    inverse: sp.csr_matrix
    _decreases: dict[tuple[object, ...], float] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def of(
        cls,
        weak: WeakForm,
        under: Physics,
        whitened: sp.csr_matrix,
        known: tuple[sp.csr_matrix, Sequence[tuple[str, slice]]],
    ) -> Self:
        """For rows with the covariance `whitened` (R, R) and the noise Jacobian `known` under the physics `under`."""
        if shifts := shifts_of(weak.samples, under):
            others = tuple(effect for effect in under.sensors if effect not in shifts)
            known = noise_jacobian(weak, replace(under, sensors=others))
        return cls(weak.samples, *known, inverse_near_diagonal(whitened))

    def decrease(self, physics: Physics) -> float:
        """Expected decrease of χ² by the interpolation of noise under the time shifts of `physics`; cached.

        For rows r whose noise has the covariance D, and C by which they are whitened, E rᵀ C⁻¹ r = tr C⁻¹ D.
        """
        shifts = shifts_of(self.samples, physics)
        key = tuple((effect.key, *effect.values.values()) for effect in shifts)
        if key not in self._decreases:
            make_room(self._decreases, CACHED_VALUES)
            self._decreases[key] = sum(self._decrease_in(name, part, shifts) for name, part in self.labels)
        return self._decreases[key]

    def _decrease_in(self, name: str, part: slice, shifts: Sequence[SensorEffect]) -> float:
        """`decrease` by the channel `name`, whose slice of the Jacobian is `part`."""
        time, on_channel = self.samples.time, [effect for effect in shifts if effect.channels((name,))]
        # a slow channel is interpolated between its samples either way
        if not on_channel or name in self.samples.bridges or name.startswith("wrench."):
            return 0.0
        rows = self.jacobian[:, part]
        read, held = rows, np.zeros(len(time))
        for effect in reversed(on_channel):
            read, at = read @ effect.correction(time), effect.read(time)
            held += (at < time[0]) | (at > time[-1])
        # rows that use values held beyond the ends of the recording do not count
        fair = sp.diags_array((abs(rows) @ held == 0.0).astype(float))
        return self._chi_square(name, fair @ rows) - self._chi_square(name, fair @ read)

    def _chi_square(self, name: str, rows: sp.csr_matrix) -> float:
        """Expected χ² of the noise of channel `name`, which enters through `rows` (R, N)."""
        memory = self.samples.memories.get(name)
        alike = rows if memory is None else rows @ covariance(self.samples.time, memory)
        return self.samples.std[name] ** 2 * float(self.inverse.multiply(alike @ rows.T).sum())


def inverse_near_diagonal(banded: sp.csr_matrix) -> sp.csr_matrix:
    """(R, R) approximate inverse of a `banded` covariance near its diagonal, by blocks of four band widths.

    Each block is inverted with three band widths on either side: rows farther away are nearly uncorrelated with the
    block, given those in between.
    """
    entries, size = sp.coo_matrix(banded), banded.shape[0]
    band = max(int(np.abs(entries.row - entries.col).max()), 1)
    pieces = []
    for first in range(0, size, 4 * band):
        stop = min(first + 4 * band, size)
        low, high = max(first - 3 * band, 0), min(stop + 3 * band, size)
        local = np.linalg.inv(banded[low:high, low:high].toarray())[first - low : stop - low]
        pieces.append(sp.hstack([sp.csr_matrix((len(local), low)), local, sp.csr_matrix((len(local), size - high))]))
    return sp.csr_matrix(sp.vstack(pieces))
