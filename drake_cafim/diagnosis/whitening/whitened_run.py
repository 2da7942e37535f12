"""The whitened rows of one recording."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from drake_cafim.diagnosis.rows.initial_uncertainty import StartMarginal, has_unknown_start, start_rows
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.covariance import Whitening
from drake_cafim.diagnosis.whitening.sampled_noise import KeptJacobian
from drake_cafim.numerics.cache import make_room
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

IMPOSSIBLE = 1e9
"""Standard deviations of noise beyond which a row counts as diverged."""
CACHED_STARTS = 6
"""Most cached whitened rows of initial values."""


@dataclass(frozen=True)
class Run:
    """One recording's weak form, whitened under one model's covariance."""

    weak: WeakForm
    whiten: Whitening
    jacobian: KeptJacobian
    measured: WeakForm | None = None
    """The recording as measured, where `weak` has its motion as estimated."""
    noise: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    """J (y − ŷ) (R,): the part of the rows by the noise of the samples; empty where `weak` contains it."""
    _start_rows: dict[bytes, Array] = field(default_factory=dict, init=False, repr=False, compare=False)
    _marginal: list[tuple[Physics, StartMarginal]] = field(default_factory=list, init=False, repr=False, compare=False)
    """Cache: the last marginal with the most likely widths, and what physics it is of. No run that is made of this one
    by another whitening, or with more noise, has it."""

    def forget(self) -> None:
        """Frees what was computed of the samples, which is computed again when it is asked for."""
        for weak in (self.weak, *(() if self.measured is None else (self.measured,))):
            weak.forget()
        self.jacobian.forget()

    @property
    def name(self) -> str:
        """The recording's name."""
        return self.weak.samples.recording.name

    @property
    def shape(self) -> tuple[int, int]:
        """The numbers of windows M and of rows in each, r."""
        return (len(self.weak.samples.windows), self.weak.rows_per_window)

    @property
    def rows(self) -> int:
        """The number R = M r of rows."""
        return len(self.weak.samples.windows) * self.weak.rows_per_window

    @property
    def time(self) -> Array:
        """(M,) s, the windows' middles."""
        return self.weak.samples.windows.centers

    def whitened(self, rows: Array) -> Array:
        """`rows` (M, r) or (M, r, k), flattened window after window and whitened: (R,) or (R, k)."""
        return self.whiten(rows.reshape(self.rows, *rows.shape[2:]))

    def noisy_rows(self, physics: Physics) -> Array:
        """Rows (M, r) under `physics`, with the noise of the samples, before whitening."""
        rows = self.weak.residual(physics)
        return rows + self.noise.reshape(rows.shape) if len(self.noise) else rows

    def residual(self, physics: Physics) -> Array:
        """Whitened residual (R,), with the unknown initial state marginalised."""
        return self.marginalise_start(physics).rows

    def marginalise_start(self, physics: Physics, widths: Array | None = None) -> StartMarginal:
        """The residual under `physics` with the initial state marginalised, with the most likely widths unless given.

        Rows are infinite where the simulation of a coupling diverges.
        """
        if not has_unknown_start(physics):
            return StartMarginal(self.whitened(self.noisy_rows(physics)))
        if widths is not None:
            return self._marginalised(physics, widths)
        if not self._marginal or self._marginal[0][0] is not physics:
            self._marginal[:] = [(physics, self._marginalised(physics, None))]
        return self._marginal[0][1]

    def _marginalised(self, physics: Physics, widths: Array | None) -> StartMarginal:
        """`marginalise_start` where the initial state is unknown, computed anew."""
        # the simulated twist diverges where a link is lighter than its rotor
        with np.errstate(over="ignore", invalid="ignore"):
            rows, U = (
                self.whitened(self.noisy_rows(physics)),
                self._doubted(start_rows(self.weak, physics)),
            )
            if not np.all(np.abs(rows) < IMPOSSIBLE) or not np.all(np.abs(U) < IMPOSSIBLE):
                return StartMarginal(np.full(len(rows), np.inf))
        return StartMarginal.of(rows, U, widths)

    def _doubted(self, rows: Array) -> Array:
        """`whitened` rows of initial values; cached, since most parameter values leave them unchanged."""
        key = rows.tobytes()
        if key not in self._start_rows:
            make_room(self._start_rows, CACHED_STARTS)
            self._start_rows[key] = self.whitened(rows)
        return self._start_rows[key]

    def pushed(self, force: Array, gains: Array) -> Array:
        """Rows (M, r, k) of generalised forces `force` (N, n, k), at joints whose efforts have the `gains` (n,)."""
        windows = self.weak.samples.windows
        rows = np.zeros((len(windows), self.weak.rows_per_window, force.shape[2]))
        weighed = (windows.value @ force.reshape(len(force), -1)).reshape(len(windows), *force.shape[1:])
        rows[:, self.weak.dynamic] = -weighed / gains[:, None]
        return rows

    @cached_property
    def covariance(self) -> Array:
        """(M, r, r) covariance of each window's rows."""
        return self.whiten.covariance.blocks(self.weak.rows_per_window)

    def sensed(self, column: str, change: Array) -> Array:
        """Change (R, k) of the whitened rows when the recorded `column` changes by `change` (N, k)."""
        return self.whiten(np.asarray(self.jacobian[column] @ change))


def without_start(runs: Sequence[Run], physics: Physics, columns: Array) -> Array:
    """Derivatives `columns` (R, k) of the whitened rows of all `runs` under `physics`, initial states marginalised.

    The likelihood is maximal in the widths, so that these count as constant.
    """
    if not has_unknown_start(physics):
        return columns
    parts = np.split(columns, np.cumsum([run.rows for run in runs])[:-1])
    return np.concatenate([run.marginalise_start(physics).without(own) for run, own in zip(runs, parts, strict=True)])
