"""All recordings against one scene: whitened residuals and their derivatives by whatever a model may change."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Protocol, Self

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


class Rows(Protocol):
    """One recording's part of the rows."""

    @property
    def name(self) -> str:
        """Of the recording."""
        ...

    @property
    def shape(self) -> tuple[int, int]:
        """Windows, and rows of each."""
        ...

    @property
    def rows(self) -> int:
        """How many."""
        ...

    @property
    def time(self) -> Array:
        """(windows,) s, the middle of each window."""
        ...


class Problem(ABC):
    """Recordings of one scene. Vectors over rows hold all recordings', then one row a prior."""

    scene: Scene
    runs: Sequence[Rows]
    regressors_noisy: ClassVar[bool] = True
    """Whether the slopes by a model's numbers hold noise of the measurement."""
    least_gain: ClassVar[float] = 5e-4
    """Of χ²; where a step promises less, the minimum is reached."""
    slack: ClassVar[float] = 0.0
    """Of what χ² is beyond noise; as `least_gain`, where far too much is left to be exact about."""
    least_damping: ClassVar[float] = 1e-6
    """Of a step after one that failed."""

    @abstractmethod
    def rewhitened(self, model: Model) -> Self:
        """The same recordings under another model's covariance."""

    @abstractmethod
    def plausible(self, model: Model) -> bool:
        """Whether every effect of the model still is what its name says."""

    @abstractmethod
    def rows_of(self, model: Model) -> Array:
        """Whitened rows of all recordings."""

    def shared_noise(self, model: Model, residual: Array, jacobian: Array) -> tuple[Array, Array]:
        """ΔJᵀΔz (n,) and ΔJᵀΔJ (n, n), Δ by one more dose of noise; zero where slopes hold none."""
        n = jacobian.shape[1]
        return np.zeros(n), np.zeros((n, n))

    @abstractmethod
    def jacobian(self, model: Model) -> Array:
        """∂residual/∂(unknowns, strengths)."""

    @property
    def rows(self) -> int:
        """Whitened data rows, priors aside."""
        return sum(run.rows for run in self.runs)

    def nominal(self) -> Model:
        """Unknowns at their prior means, no effects."""
        return Model(self.scene.priors.mean)

    def residual(self, model: Model) -> Array:
        """Whitened rows of all recordings, then (value − mean)/std of each prior."""
        return np.concatenate([self.rows_of(model), self.prior_rows(model)])

    def prior_rows(self, model: Model) -> Array:
        """(value − mean)/std of each prior; next to nothing of those that `model` sets aside."""
        return np.asarray((model.unknown - self.scene.priors.mean) / self.prior_std(model), dtype=float)

    def prior_std(self, model: Model) -> Array:
        """(n,) of the unknowns under `model`."""
        return np.asarray(self.scene.priors.std * model.prior_std_ratios(self.scene), dtype=float)

    def penalty(self, model: Model) -> float:
        """What a model pays in χ² beside its rows.

        That is ln det of what it does not know of how the recordings began, and what it would gain by letting less
        noise through.
        """
        return 0.0
