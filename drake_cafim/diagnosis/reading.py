"""Channels that are read between their samples: what that smooths of their noise is nobody's gain."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.coloured_noise import covariance
from drake_cafim.diagnosis.kept import make_room
from drake_cafim.diagnosis.noise_jacobian import noise_jacobian
from drake_cafim.diagnosis.samples import Samples
from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.effects.timing import ShiftedSensor
from drake_cafim.scenario.physics import Physics

KEPT = 8
WIDE = 28.0
"""Samples in a window from which on reading between them leaves all of the noise but 3e-5."""


def shifts_of(samples: Samples, physics: Physics) -> tuple[ShiftedSensor, ...]:
    """The sensors of positions and velocities that write the value of another time, where to undo that smooths."""
    if samples.windows.width >= WIDE * float(np.median(np.diff(samples.time))):
        return ()
    shifts = (effect for effect in physics.sensors if isinstance(effect, ShiftedSensor))
    return tuple(effect for effect in shifts if not effect.at.startswith("wrench."))


@dataclass(frozen=True)
class Reading:
    """What rows take from the samples where every channel is read at its own: their `jacobian` (R, columns) there.

    A polynomial between two samples is a weighted mean of those around, least noisy in the middle: windows of a dozen
    samples lose half a percent of a channel's noise to a delay of half a sample, and χ² with it, the more the longer
    one records. `inverse` (R, R) is that of the covariance that rows are whitened with, near its diagonal.
    """

    samples: Samples
    jacobian: sp.csr_matrix
    labels: Sequence[tuple[str, slice]]
    inverse: sp.csr_matrix
    _gained: dict[tuple[object, ...], float] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def of(
        cls,
        weak: WeakForm,
        under: Physics,
        whitened: sp.csr_matrix,
        known: tuple[sp.csr_matrix, Sequence[tuple[str, slice]]],
    ) -> Self:
        """Of rows that are whitened with a covariance (R, R) `under` some physics, with the Jacobian `known` there."""
        if shifts := shifts_of(weak.samples, under):
            others = tuple(effect for effect in under.sensors if effect not in shifts)
            known = noise_jacobian(weak, replace(under, sensors=others))
        return cls(weak.samples, *known, inverse_near_diagonal(whitened))

    def gained(self, physics: Physics) -> float:
        """What noise alone is expected to lose of χ² by what is read between samples; the last few are kept.

        E rᵀ C⁻¹ r of rows whose noise has another covariance D is tr C⁻¹ D.
        """
        shifts = shifts_of(self.samples, physics)
        key = tuple((effect.key, *effect.values.values()) for effect in shifts)
        if key not in self._gained:
            make_room(self._gained, KEPT)
            self._gained[key] = sum(self._gained_in(name, part, shifts) for name, part in self.labels)
        return self._gained[key]

    def _gained_in(self, name: str, part: slice, shifts: Sequence[ShiftedSensor]) -> float:
        time, own = self.samples.time, [effect for effect in shifts if effect.channels((name,))]
        # a slow channel that was bridged is read between its samples either way
        if not own or name in self.samples.bridges or name.startswith("wrench."):
            return 0.0
        rows = self.jacobian[:, part]
        read, held = rows, np.zeros(len(time))
        for effect in reversed(own):
            read, at = read @ effect.correction(time), effect.read(time)
            held += (at < time[0]) | (at > time[-1])
        # what is held beyond the ends of a recording is no reading
        fair = sp.diags_array((abs(rows) @ held == 0.0).astype(float))
        return self._chi_square(name, fair @ rows) - self._chi_square(name, fair @ read)

    def _chi_square(self, name: str, rows: sp.csr_matrix) -> float:
        """What is expected of a channel's noise that reaches the rows by `rows` (R, N)."""
        memory = self.samples.memories.get(name)
        alike = rows if memory is None else rows @ covariance(self.samples.time, memory)
        return self.samples.std[name] ** 2 * float(self.inverse.multiply(alike @ rows.T).sum())


def inverse_near_diagonal(banded: sp.csr_matrix) -> sp.csr_matrix:
    """(R, R) the inverse of a banded covariance where it is not small, piece by piece of some bands' widths.

    What is farther from a piece than three bands hardly correlates with it once what lies between is known.
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
