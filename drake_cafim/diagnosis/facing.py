"""Positions and velocities that face each other in the kinematic rows, where a sensor of one of them lags."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.coloured_noise import Lasting, covariance
from drake_cafim.diagnosis.kept import make_room
from drake_cafim.diagnosis.samples import Samples
from drake_cafim.effects.timing import SensorLag
from drake_cafim.typing import Array


def lags_of(effects: Iterable[object]) -> tuple[SensorLag, ...]:
    """The lags of measured positions and velocities among the effects."""
    lags = (effect for effect in effects if isinstance(effect, SensorLag))
    return tuple(effect for effect in lags if effect.at.startswith(("q.", "v.")))


@dataclass(frozen=True)
class Facing:
    """The kinematic rows of one recording's `samples`."""

    samples: Samples
    _alike: dict[Lasting, sp.csr_matrix] = field(default_factory=dict, repr=False, compare=False)

    def compared(
        self, lags: Sequence[SensorLag], joints: Sequence[str], q: Array, v: Array
    ) -> tuple[Array, Array, Array]:
        """Positions and velocities, (N, n) each, of which the first's rate is the second; and a factor (M, n).

        `q` and `v` (N, n) of the `joints` are corrected for all sensor effects but the `lags`. Undoing a lag raises the
        noise; where q and v only face each other, the other one is made to lag as well, and both are then read a time
        constant later: rows of a lag and of a delay see the same noise, or one of them would win by luck. To lag
        smooths noise, by which no model may gain: the factor makes rows as noisy as without it.
        """
        windows, time = self.samples.windows, self.samples.time
        louder = np.ones((len(windows), q.shape[1]))
        channels = {"q": q.copy(), "v": v.copy()} if lags else {"q": q, "v": v}
        slopes = {"q": windows.rate, "v": windows.value}
        for lag in lags:
            kind, joint = lag.at.split(".", 1)
            other, j = "v" if kind == "q" else "q", joints.index(joint)
            ahead = lag.facing(time)
            channels[other][:, j] = lag.measured(time, channels[other][:, j : j + 1])[:, 0]
            as_noisy, noisy = np.zeros(len(windows)), np.zeros(len(windows))
            for name, read in ((kind, ahead), (other, sp.csr_matrix(ahead @ lag.writing(time)))):
                channels[name][:, j] = ahead @ channels[name][:, j]
                as_noisy += self._variance(f"{name}.{joint}", slopes[name])
                noisy += self._variance(f"{name}.{joint}", sp.csr_matrix(slopes[name] @ read))
            louder[:, j] *= np.sqrt(as_noisy / noisy)
        return channels["q"], channels["v"], louder

    def _variance(self, column: str, rows: sp.csr_matrix) -> Array:
        """(M,) of rows (M, N) of a column's noise."""
        memory = self.samples.memories.get(column)
        if memory is not None and memory not in self._alike:
            # of two columns that face each other
            make_room(self._alike, 2)
            self._alike[memory] = covariance(self.samples.time, memory)
        alike = rows if memory is None else rows @ self._alike[memory]
        return self.samples.std[column] ** 2 * np.asarray(rows.multiply(alike).sum(axis=1), dtype=float).ravel()
