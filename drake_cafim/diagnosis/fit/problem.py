"""The interface of a fit: whitened residuals of all recordings of a scene, and their derivatives by parameters."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Protocol, Self

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.realised_noise import RealisedNoise
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


class Rows(Protocol):
    """One recording's part of the rows."""

    @property
    def name(self) -> str:
        """The recording's name."""
        ...

    @property
    def shape(self) -> tuple[int, int]:
        """Number of windows, and of rows of each."""
        ...

    @property
    def rows(self) -> int:
        """Number of rows in all."""
        ...

    @property
    def time(self) -> Array:
        """(windows,) s, the middle of each window."""
        ...


class Problem(ABC):
    """Whitened rows (R,) of all recordings of a scene, then a prior row of each of its n unknowns."""

    scene: Scene
    runs: Sequence[Rows]
    whitened_by_model: ClassVar[bool] = True
    """Whether the noise covariance of the rows, and their first order, depend on the model."""
    least_gain: ClassVar[float] = 5e-4
    """Smallest predicted decrease of ½ χ² for which a fit takes another step."""
    slack: ClassVar[float] = 0.0
    """Share of the excess χ² − R that is added to `least_gain`: where much remains, a fit need not be exact."""
    least_damping: ClassVar[float] = 1e-6
    """Least damping of a step after one that failed."""

    @property
    def regressors_noisy(self) -> bool:
        """Whether the Jacobian contains measurement noise."""
        return False

    @property
    def realised_noise(self) -> RealisedNoise | None:
        """What noise alone makes of the rows; None where it is Gaussian, of unit covariance."""
        return None

    @abstractmethod
    def rewhitened(self, model: Model) -> Self:
        """The same recordings, whitened by the noise covariance under `model`."""

    @abstractmethod
    def plausible(self, model: Model) -> bool:
        """Whether every effect of `model` acts as its name says over these recordings."""

    @abstractmethod
    def rows_of(self, model: Model) -> Array:
        """Whitened rows (R,) of all recordings."""

    def shared_noise(self, model: Model, residual: Array, jacobian: Array) -> tuple[Array, Array]:
        """ΔJᵀΔz (n,) and ΔJᵀΔJ (n, n), Δ the change by adding noise once more; zero if the Jacobian contains none."""
        n = jacobian.shape[1]
        return np.zeros(n), np.zeros((n, n))

    @abstractmethod
    def jacobian(self, model: Model) -> Array:
        """∂residual/∂(unknowns, strengths), (R + n, n + k)."""

    def better_start(self, model: Model) -> Model | None:
        """From where another fit comes to a far lower minimum than `model`, a fitted one; None where none is known."""
        return None

    def has_other_noise(self, model: Model) -> bool:
        """Whether the noise of the rows under `model` is so different that tests of it need its own whitening."""
        return False

    @property
    def rows(self) -> int:
        """Number R of whitened rows, without prior rows."""
        return sum(run.rows for run in self.runs)

    def nominal(self) -> Model:
        """Unknowns at their prior means, no effects."""
        return Model(self.scene.priors.mean)

    def residual(self, model: Model) -> Array:
        """Whitened rows of all recordings, then `prior_rows`: (R + n,)."""
        return np.concatenate([self.rows_of(model), self.prior_rows(model)])

    def prior_rows(self, model: Model) -> Array:
        """(n,) (value − mean)/std of each prior; nearly zero where `model` sets the prior aside."""
        return prior_rows(self.scene, model)

    def prior_std(self, model: Model) -> Array:
        """(n,) standard deviations of the priors, those that `model` sets aside widened."""
        return prior_std(self.scene, model)

    @property
    def log_determinant(self) -> float:
        """ln det of the covariance by which the rows are whitened, less that of its part by the noise of motion.

        With χ² it is −2 ln likelihood of the samples but for a constant; 0 where it is the same for every model.
        """
        return 0.0

    def penalty(self, model: Model, own_noise: bool = True) -> float:
        """Addition to a model's χ²: ln det of the covariance of unknown initial states.

        With `own_noise`, also what whitening under the model's own noise changes, where that is another one.
        """
        return 0.0


def prior_std(scene: Scene, model: Model) -> Array:
    """(n,) standard deviations of the priors of a scene's unknowns, those that `model` sets aside widened."""
    return np.asarray(scene.priors.std * model.prior_std_ratios(scene), dtype=float)


def prior_rows(scene: Scene, model: Model) -> Array:
    """(n,) (value − mean)/std of each prior."""
    return np.asarray((model.unknown - scene.priors.mean) / prior_std(scene, model), dtype=float)
