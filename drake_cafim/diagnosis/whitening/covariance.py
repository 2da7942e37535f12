"""The covariance of the weak form's rows, and the whitening: rows times the inverse of its Cholesky factor."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.contact_at_rest import contact_at_rest_covariance
from drake_cafim.diagnosis.whitening.contact_step import contact_step_covariance
from drake_cafim.diagnosis.whitening.friction_at_rest import friction_at_rest_covariance
from drake_cafim.diagnosis.whitening.impact_noise import impact_covariance
from drake_cafim.diagnosis.whitening.kinked_law_noise import kinked_law_covariance
from drake_cafim.diagnosis.whitening.mobility_noise import mobility_covariance
from drake_cafim.diagnosis.whitening.sampled_noise import KeptJacobian, sampled_noise
from drake_cafim.numerics.banded import LowerBand
from drake_cafim.numerics.row_products import SymmetricBand, lower_entries
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

NONE = np.zeros(0)
ROUNDING = 1e-10
"""Share of a covariance's diagonal that is added to it, so that rows that are nearly dependent have a factor."""


@dataclass(frozen=True)
class Whitening:
    """The rows' `covariance` C (R, R) and its Cholesky `factor` L, C = L Lᵀ."""

    factor: LowerBand
    covariance: SymmetricBand
    samples_log_determinant: float = 0.0
    """ln det of the part of C that the noise of the samples makes, of motion and of efforts; see `log_determinant`."""

    @classmethod
    def of(cls, covariance: SymmetricBand, samples_log_determinant: float = 0.0) -> "Whitening":
        """The whitening by a `covariance`.

        Raises `numpy.linalg.LinAlgError` where it is not positive definite, or not finite.
        """
        # so that rounding does not make the factorisation fail where rows are nearly dependent
        return cls(covariance.factor(ROUNDING * covariance.diagonal), covariance, samples_log_determinant)

    def __call__(self, rows: Array) -> Array:
        """L⁻¹ `rows`, for (R,) or (R, k)."""
        return self.factor.solve(rows)

    def unwhiten(self, rows: Array) -> Array:
        """L `rows`, for (R,) or (R, k): what `__call__` whitens to `rows`."""
        return self.factor.times(rows)

    def transposed(self, rows: Array) -> Array:
        """L⁻ᵀ `rows`, for (R,) or (R, k): of whitened rows L⁻¹ r it makes C⁻¹ r."""
        return self.factor.solve_transposed(rows)

    @cached_property
    def std(self) -> Array:
        """(R,) the rows' standard deviations."""
        return np.asarray(np.sqrt(self.covariance.diagonal), dtype=float)

    @property
    def log_determinant(self) -> float:
        """ln det C − ln det C_s, C_s the part of C that the noise of the samples makes, of motion and measured efforts.

        With rows r(z) of the samples z and process noise w, r(z) = w, the density of the samples is that of the rows
        times the volume that r makes of a unit of samples, √det(C_s) but for a constant (the coarea formula). Stiff
        laws, as dry friction near rest, and large inertias make large rows of small motions: by det C alone they would
        seem to predict badly. Efforts without noise are no samples: what nobody knows acts on the motion then. Where
        they are measured, it may as well be in them, and the noise of the motion alone would favour large inertias.
        """
        return _log_determinant(self.factor.diagonal) - self.samples_log_determinant


def whitening(weak: WeakForm, physics: Physics, unknown_force: Array = NONE) -> tuple[Whitening, KeptJacobian]:
    """The whitening of one recording's rows under `physics`, and the noise Jacobian.

    `unknown_force` (n,) is the spectral density of unmodelled white forces at the joints, (N m)² s or N² s.
    """
    of_samples, total, jacobian = _covariances(weak, physics)
    for density, part in zip(unknown_force, unknown_force_factors(weak, physics), strict=False):
        if density:
            total.add_entries(density, lower_entries(part @ part.T))
    return Whitening.of(total, _volume(of_samples)), jacobian


def row_covariance(weak: WeakForm, physics: Physics) -> SymmetricBand:
    """(R, R) the covariance of one recording's rows under `physics`; no Jacobian is kept."""
    return _covariances(weak, physics, keep=False)[1]


def _covariances(
    weak: WeakForm, physics: Physics, keep: bool = True
) -> tuple[SymmetricBand, SymmetricBand, KeptJacobian]:
    """The covariances (R, R) by the samples and by all there is, and the noise Jacobian if that is to `keep`.

    What the first-order Jacobian leaves out, kinks and jumps within the noise, is no part of the first, the volume that
    the rows make of the samples: else a law would gain by leaving much to chance near rest.
    """
    of_samples, of_efforts, jacobian = sampled_noise(weak, physics, keep)
    of_samples.add_entries(1.0, lower_entries(of_efforts.full()))
    total = of_samples.copy()
    for part in (
        kinked_law_covariance(weak, physics),
        friction_at_rest_covariance(weak, physics),
        impact_covariance(weak, physics),
        contact_at_rest_covariance(weak, physics),
        contact_step_covariance(weak, physics),
        mobility_covariance(weak, physics),
    ):
        total.add_entries(1.0, lower_entries(part))
    return of_samples, total, jacobian


def _volume(of_samples: SymmetricBand) -> float:
    """ln det of the covariance that the noise of the samples makes; rows of exact samples count as 1.

    What is added for the factorisation is a share of this noise itself: as a share of all noise it would be the larger
    part where efforts or unknown forces have far more noise than positions, and the volume would follow these.
    """
    noise = of_samples.diagonal
    return _log_determinant(of_samples.factor(np.where(noise > 0.0, ROUNDING * noise, 1.0)).diagonal)


def _log_determinant(diagonal: Array) -> float:
    """ln det L Lᵀ of a Cholesky factor with this `diagonal` (R,)."""
    return float(2.0 * np.sum(np.log(diagonal)))


def unknown_force_factors(weak: WeakForm, physics: Physics) -> list[sp.csr_matrix]:
    """For each joint a factor F (R, M), F Fᵀ the rows' covariance by a white force of unit spectral density."""
    windows, r = weak.samples.windows, weak.rows_per_window
    weighed = windows.value @ sp.diags_array(1.0 / np.sqrt(np.gradient(weak.samples.time)))
    factor = SymmetricBand.of(weighed @ weighed.T).factor().full().tocoo()
    factors = []
    for row, gain in zip(range(weak.dynamic.start, weak.dynamic.stop), physics.effort_gains, strict=True):
        at = (r * factor.row + row, factor.col)
        factors.append(sp.csr_matrix((factor.data / gain, at), shape=(r * len(windows), len(windows))))
    return factors
