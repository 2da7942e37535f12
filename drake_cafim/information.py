"""Fisher information of a trajectory, scalar design criteria, and identifiable combinations of parameters."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.typing import Array

Criterion: TypeAlias = Literal["trace", "scaled_trace", "logdet", "a_optimal", "min_eigenvalue"]
CRITERIA: tuple[str, ...] = get_args(Criterion)


def fisher_information(sensitivities: Array, noise_std: Array) -> Array:
    """F = Σ_t G_tᵀ Σ_y⁻¹ G_t (..., n, n) of total sensitivities G (..., T, ny, n) = dy_t/dθ.

    `noise_std` (ny,) is the std of one sample, white and independent between components. It is a sum over time, so
    that trajectories add up, without the paper's 1/N and without the prior (paper, Eq. 8 and Theorem 1).
    """
    whitened = sensitivities / np.asarray(noise_std)[:, np.newaxis]
    flat = whitened.reshape(*whitened.shape[:-3], -1, whitened.shape[-1])
    return np.asarray(np.swapaxes(flat, -1, -2) @ flat)


def criterion(name: Criterion, fisher: Array, prior: Array) -> Array:
    """ψ (...,), larger is better, of Fisher information F (..., n, n) given the present information P (n, n).

    trace            tr F: the paper's choice; depends on the units of θ
    scaled_trace     tr(P⁻¹ F): the trace in units of the present uncertainty
    logdet           ½ (log det(P + F) − log det P): information gain in nats (D-optimality)
    a_optimal        n − tr(P (P + F)⁻¹): relative reduction of the present variance, summed (A-optimality)
    min_eigenvalue   of the whitened F: the gain in the least informed direction (E-optimality)

    All but the trace need P positive definite. Raises `InputError` on an unknown name.
    """
    if name == "trace":
        return np.asarray(np.trace(fisher, axis1=-2, axis2=-1))
    if name not in CRITERIA:
        raise InputError(f"criterion {name!r}: expected one of {', '.join(CRITERIA)}")
    eigenvalues = _whitened_eigenvalues(fisher, prior)
    if name == "scaled_trace":
        return np.asarray(eigenvalues.sum(axis=-1))
    if name == "logdet":
        return np.asarray(0.5 * np.log1p(eigenvalues).sum(axis=-1))
    if name == "a_optimal":
        return np.asarray((eigenvalues / (1.0 + eigenvalues)).sum(axis=-1))
    return np.asarray(eigenvalues.min(axis=-1))


def without_nuisance(fisher: Array, prior: Array, sought: Array) -> tuple[Array, Array]:
    """F (..., k, k) and P (k, k) of the `sought` parameters (n,) bool alone, the others projected out.

    From F (..., n, n) and P (n, n). The information about some parameters where the others are unknown is the Schur
    complement S(P) = P_aa − P_ab P_bb⁻¹ P_ba; what the data add to it is S(P + F) − S(P).
    """
    if sought.all():
        return fisher, prior
    before = _schur_complement(prior, sought)
    return _schur_complement(prior + fisher, sought) - before, before


def _schur_complement(matrix: Array, kept: Array) -> Array:
    a, b = np.flatnonzero(kept), np.flatnonzero(np.logical_not(kept))
    across = matrix[..., a[:, np.newaxis], b]
    inner = np.linalg.solve(matrix[..., b[:, np.newaxis], b], np.swapaxes(across, -1, -2))
    return np.asarray(matrix[..., a[:, np.newaxis], a] - across @ inner)


@dataclass(frozen=True)
class Combination:
    """A product of powers Π θ_i^a_i of the parameters, a = `exponents` (n,), normalized to a largest exponent of 1.

    `std` and `prior_std` are relative standard deviations with and without the data; both are equal for a combination
    that is not `identified`, about which the data hold no information.
    """

    exponents: Array
    std: float
    prior_std: float
    identified: bool

    def text(self, names: Sequence[str]) -> str:
        """The product as text, as `friction·stiffness` or `mass·stiffness^-0.5`; exponents below 0.05 are left out."""
        parts = zip(names, self.exponents, strict=True)
        return "·".join(f"{name}^{a:.2g}" if abs(a - 1.0) > 5e-3 else name for name, a in parts if abs(a) >= 0.05)


def identifiable_combinations(
    fisher: Array, prior: Array, theta: Array, *, tolerance: float = 1e-9
) -> tuple[Combination, ...]:
    """All n combinations of the parameters θ (n,) by how well F (n, n) identifies them, given the prior P; best first.

    P (n, n) is the prior's information. The eigenvectors w of LᵀFL, with P⁻¹ = L Lᵀ, are combinations wᵀL⁻¹θ that are
    independent before and after the data: of prior variance 1 and posterior variance 1/(1 + eigenvalue). To first order
    each is the logarithm of a product of powers; where θ_i = 0 its prior std takes its place. The number of identified
    ones is the rank of F: eigenvalues above `tolerance` times the largest.
    """
    covariance = np.linalg.inv(prior)
    L = np.linalg.cholesky(covariance)
    eigenvalues, vectors = np.linalg.eigh(L.T @ fisher @ L)
    scale = np.where(theta == 0.0, np.sqrt(np.diag(covariance)), theta)
    found = []
    for eigenvalue, w in reversed(list(zip(eigenvalues, vectors.T, strict=True))):
        powers = scale * np.linalg.solve(L.T, w)
        greatest = powers[np.argmax(np.abs(powers))]
        identified = bool(eigenvalue > max(tolerance * eigenvalues[-1], 0.0))
        prior_std = 1.0 / float(abs(greatest))
        std = prior_std / float(np.sqrt(1.0 + eigenvalue)) if identified else prior_std
        found.append(Combination(powers / greatest, std, prior_std, identified))
    return tuple(found)


def _whitened_eigenvalues(fisher: Array, prior: Array) -> Array:
    """Eigenvalues (..., n) of L⁻¹ F L⁻ᵀ with P = L Lᵀ; negative ones, which come from rounding, are set to zero."""
    if fisher.shape[-1] == 1:
        return np.asarray(np.maximum(fisher[..., 0] / prior[0, 0], 0.0))
    inverse = np.linalg.inv(np.linalg.cholesky(prior))
    return np.asarray(np.maximum(np.linalg.eigvalsh(inverse @ fisher @ inverse.T), 0.0))
