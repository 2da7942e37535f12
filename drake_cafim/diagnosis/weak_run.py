"""One recording's rows, whitened."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.beginning import Begun, doubtful, start_rows
from drake_cafim.diagnosis.kept import make_room
from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.diagnosis.whitening import Whitening
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

IMPOSSIBLE = 1e9
"""Standard deviations of noise beyond which a row is of no motion that there could be."""
DOUBTS_KEPT = 6
"""Of what the beginning leaves in doubt, whitened."""


@dataclass(frozen=True)
class Run:
    """One recording's weak form, whitened under one model's covariance."""

    weak: WeakForm
    whiten: Whitening
    jacobian: sp.csr_matrix
    labels: tuple[tuple[str, slice], ...]
    _doubts: dict[bytes, Array] = field(default_factory=dict, repr=False, compare=False)

    @property
    def name(self) -> str:
        """Of the recording."""
        return self.weak.samples.recording.name

    @property
    def shape(self) -> tuple[int, int]:
        """Windows, and rows of each."""
        return (len(self.weak.samples.windows), self.weak.rows_per_window)

    @property
    def rows(self) -> int:
        return len(self.weak.samples.windows) * self.weak.rows_per_window

    def whitened(self, rows: Array) -> Array:
        """Rows (M, r) or (M, r, k), flattened window after window and whitened."""
        return self.whiten(rows.reshape(self.rows, *rows.shape[2:]))

    def residual(self, physics: Physics) -> Array:
        """Whitened rows (R,), less what an unknown start is to blame for."""
        return self.begun(physics).rows

    def begun(self, physics: Physics, widths: Array | None = None) -> Begun:
        """How the recording began, under `physics`, with doubts as wide as is likeliest unless `widths` say."""
        if not doubtful(physics):
            return Begun(self.whitened(self.weak.residual(physics)))
        # a link that is lighter than its rotor runs away
        with np.errstate(over="ignore", invalid="ignore"):
            rows, U = self.whitened(self.weak.residual(physics)), self._doubted(start_rows(self.weak, physics))
            if not np.all(np.abs(rows) < IMPOSSIBLE) or not np.all(np.abs(U) < IMPOSSIBLE):
                return Begun(np.full(len(rows), np.inf))
        return Begun.of(rows, U, widths)

    def _doubted(self, rows: Array) -> Array:
        """`whitened` rows of doubts, which most numbers that are tried leave as they are; the last few are kept."""
        key = rows.tobytes()
        if key not in self._doubts:
            make_room(self._doubts, DOUBTS_KEPT)
            self._doubts[key] = self.whitened(rows)
        return self._doubts[key]

    def pushed(self, force: Array, gains: Array) -> Array:
        """Rows (M, r, k) of generalized forces (N, n, k), at joints whose efforts count `gains` (n,) times."""
        windows = self.weak.samples.windows
        rows = np.zeros((len(windows), self.weak.rows_per_window, force.shape[2]))
        weighed = (windows.value @ force.reshape(len(force), -1)).reshape(len(windows), *force.shape[1:])
        rows[:, self.weak.dynamic] = -weighed / gains[:, None]
        return rows

    @cached_property
    def covariance(self) -> Array:
        """(M, r, r): each window's own rows."""
        r = self.weak.rows_per_window
        starts = r * np.arange(len(self.weak.samples.windows))
        return np.stack([self.whiten.covariance[at : at + r, at : at + r].toarray() for at in starts])

    def sensed(self, column: str, change: Array) -> Array:
        """Whitened rows' change (R, k) when the recording's `column` changes by `change` (N, k)."""
        return self.whiten(np.asarray(self._by_column[column] @ change))

    @cached_property
    def _by_column(self) -> dict[str, sp.csr_matrix]:
        columns = sp.csc_matrix(self.jacobian)
        return {name: sp.csr_matrix(columns[:, part]) for name, part in self.labels}
