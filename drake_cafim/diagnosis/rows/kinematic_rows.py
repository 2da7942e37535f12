"""The measured positions and velocities that the kinematic rows compare, where a sensor of one of them lags."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import cast

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.noise.coloured import CorrelatedNoise, covariance
from drake_cafim.diagnosis.rows.samples import Samples
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.numerics.cache import make_room
from drake_cafim.typing import Array

CACHED_LAGS = 16
"""Most lags, by sensor and time constant, whose filters are kept."""


def lags_of(sensors: Iterable[SensorEffect]) -> tuple[SensorEffect, ...]:
    """The sensor effects that are lags (have a settling time) of measured positions or velocities."""
    return tuple(effect for effect in sensors if effect.settling is not None and effect.at.startswith(("q.", "v.")))


@dataclass(frozen=True)
class KinematicRows:
    """The kinematic rows ∫ ẇ q dt + ∫ w v dt of one recording's `samples`."""

    samples: Samples
    _alike: dict[CorrelatedNoise, sp.csr_matrix] = field(default_factory=dict, repr=False, compare=False)
    _of_lags: dict[tuple[object, ...], tuple[sp.csr_matrix, Array | None]] = field(
        default_factory=dict, repr=False, compare=False
    )

    def compared(
        self, lags: Sequence[SensorEffect], joints: Sequence[str], q: Array, v: Array
    ) -> tuple[Array, Array, Array]:
        """Positions q and velocities v, (N, n) each, with q̇ = v but for noise; and a noise factor (M, n) for the rows.

        `q` and `v` (N, n) of the `joints` are corrected for all sensor effects but the `lags`. To invert a lag would
        amplify the noise; as these rows only compare q with v, the partner channel is filtered by the same lag instead,
        and both are then read a time constant later. Rows under a lag and under a delay so contain the same noise,
        without which one of the two could win by chance. The filter smooths the noise, from which no hypothesis may
        gain: the factor scales the rows to the standard deviation that they have without it.
        """
        windows, time = self.samples.windows, self.samples.time
        factor = np.ones((len(windows), q.shape[1]))
        channels = {"q": q.copy(), "v": v.copy()} if lags else {"q": q, "v": v}
        for lag in lags:
            kind, joint = lag.at.split(".", 1)
            partner, j = "v" if kind == "q" else "q", joints.index(joint)
            ahead, quieter = self._filtered(lag, kind, partner, joint)
            channels[partner][:, j] = lag.measured(time, channels[partner][:, j : j + 1])[:, 0]
            for name in (kind, partner):
                channels[name][:, j] = ahead @ channels[name][:, j]
            if quieter is not None:
                factor[:, j] *= quieter
        return channels["q"], channels["v"], factor

    def variance(self, joint: str) -> Array:
        """(M,) variance of a joint's rows by the noise of its position and velocity."""
        windows = self.samples.windows
        return self._variance(f"q.{joint}", windows.rate) + self._variance(f"v.{joint}", windows.velocity)

    def _filtered(self, lag: SensorEffect, kind: str, partner: str, joint: str) -> tuple[sp.csr_matrix, Array | None]:
        """The matrix (N, N) that reads both channels a time constant later, and the noise factor (M,) of a lag.

        None where the motion is estimated: the estimate has no samples' noise to be smoothed. Cached, since most
        changes of a model leave the lags as they are.
        """
        key = (lag.key, *lag.values.values())
        if key not in self._of_lags:
            time, windows = self.samples.time, self.samples.windows
            ahead = cast(sp.csr_matrix, lag.kinematic_correction(time))  # an effect with a settling time has one
            quieter = None
            if self.samples.estimated is None:
                slopes = {"q": windows.rate, "v": windows.velocity}
                as_noisy, noisy = np.zeros(len(windows)), np.zeros(len(windows))
                for name, read in ((kind, ahead), (partner, sp.csr_matrix(ahead @ lag.filter_matrix(time)))):
                    as_noisy += self._variance(f"{name}.{joint}", slopes[name])
                    noisy += self._variance(f"{name}.{joint}", sp.csr_matrix(slopes[name] @ read))
                quieter = np.sqrt(as_noisy / noisy)
            make_room(self._of_lags, CACHED_LAGS)
            self._of_lags[key] = ahead, quieter
        return self._of_lags[key]

    def _variance(self, column: str, rows: sp.csr_matrix) -> Array:
        """(M,) variance of `rows` (M, N) applied to the noise of `column`."""
        memory = self.samples.memories.get(column)
        if memory is not None and memory not in self._alike:
            # of the two columns that are compared
            make_room(self._alike, 2)
            self._alike[memory] = covariance(self.samples.time, memory)
        alike = rows if memory is None else rows @ self._alike[memory]
        return self.samples.std[column] ** 2 * np.asarray(rows.multiply(alike).sum(axis=1), dtype=float).ravel()
