"""Derivatives of recorded columns with respect to the strengths of a sensor effect, cached."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.samples import Samples
from drake_cafim.diagnosis.thresholds import CHANNEL_SMOOTHING_REACH
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.numerics.local_polynomial import local_polynomial
from drake_cafim.typing import Array


@dataclass(frozen=True)
class SensorSlopes:
    """∂(recorded columns)/∂(strengths) of sensor effects, on one recording."""

    samples: Samples
    _slopes: dict[tuple[str, str], Array] = field(default_factory=dict, repr=False, compare=False)

    def of(self, effect: SensorEffect, columns: tuple[str, ...]) -> Array:
        """Derivatives (N, c, k) of the c `columns` that `effect` acts on with respect to its k strengths.

        The columns are smoothed over more than a window first: regressors that contain the rows' own noise would bias
        the fitted strengths (errors in variables).
        """
        if effect.key not in self._slopes:
            recording = self.samples.recording
            written = np.nan_to_num(np.stack([recording[name] for name in columns], axis=1))
            self._slopes[effect.key] = effect.columns(self.samples.time, self._smooth @ written)
        return self._slopes[effect.key]

    @cached_property
    def _smooth(self) -> sp.csr_matrix:
        return local_polynomial(self.samples.time, CHANNEL_SMOOTHING_REACH, 3, 0, at_least=4)
