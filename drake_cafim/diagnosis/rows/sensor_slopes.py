"""Derivatives of recorded columns with respect to the strengths of a sensor effect, cached."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.samples import Samples
from drake_cafim.diagnosis.thresholds import CHANNEL_SMOOTHING_REACH, REGRESSOR_SIGNAL_SHARE
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.numerics.local_polynomial import local_polynomial
from drake_cafim.typing import Array


@dataclass(frozen=True)
class SensorSlopes:
    """∂(recorded columns)/∂(strengths) of sensor effects, on one recording."""

    samples: Samples
    _slopes: dict[tuple[object, ...], Array] = field(default_factory=dict, repr=False, compare=False)

    def of(
        self, effect: SensorEffect, columns: tuple[str, ...], acts: bool = False, fed_back: Array | None = None
    ) -> Array:
        """Derivatives (N, c, k) of the c `columns` that `effect` acts on with respect to its k strengths.

        They are taken where it `acts` already with its strengths, or else where it does not act.
        The columns are smoothed over more than a window first: regressors that contain the rows' own noise would bias
        the fitted strengths (errors in variables). So would motion that a controller makes of that noise: where the
        effect does not act yet, `fed_back` (N, c) of it is taken out, and where hardly anything else moves, nothing is
        known: they are zero.
        """
        key = (effect.key, *(effect.values.values() if acts else ()))
        if key not in self._slopes:
            recording = self.samples.recording
            written = np.nan_to_num(np.stack([recording[name] for name in columns], axis=1))
            true = self._smooth @ written
            if acts and not effect.late:
                true = effect.true(self.samples.time, true)
            slopes = effect.columns(self.samples.time, true)
            if fed_back is not None and not acts:
                signal = effect.columns(self.samples.time, true - self._smooth @ fed_back)
                known = np.sum(signal**2) > REGRESSOR_SIGNAL_SHARE * np.sum(slopes**2)
                slopes = signal if known else np.zeros_like(slopes)
            self._slopes[key] = slopes
        return self._slopes[key]

    @cached_property
    def _smooth(self) -> sp.csr_matrix:
        return local_polynomial(self.samples.time, CHANNEL_SMOOTHING_REACH, 3, 0, at_least=4)
