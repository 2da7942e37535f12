"""Coupled velocities that relax under viscous forces over an interval, exactly: v̇ = a − M⁻¹ A v, A diagonal.

With x = M⁻¹ A h and an acceleration a that changes linearly by Δa over the interval h, velocities and ways are

    v₁ = e^{−x} v₀ + h φ₁(x) a₀ + h φ₂(x) Δa,    q₁ − q₀ = h φ₁(x) v₀ + h² φ₂(x) a₀ + h² φ₃(x) Δa,
    φ₁ = (1 − e^{−x})/x,    φ₂ = (1 − φ₁)/x,    φ₃ = (1/2 − φ₂)/x

(Hochbruck, Ostermann, Acta Numerica 19, 2010, §2.1). A function φ of a product B C with φ(z) = φ(0) + z γ(z) is
φ(0) + B γ(C B) C; with B = M⁻¹ A^{1/2} and C = A^{1/2}, C B is symmetric, and nothing is inverted.
"""

from dataclasses import dataclass

import numpy as np

from drake_cafim.typing import Array

SMALL = 0.05
"""x below which series replace differences of nearly equal numbers."""


@dataclass(frozen=True)
class Relaxation:
    """e^{−x}, φ₁, φ₂ and φ₃ of x = M⁻¹ A h, (K, n, n) each, over K intervals."""

    left: Array
    first: Array
    second: Array
    third: Array

    @classmethod
    def of(cls, mobility: Array, damping: Array, h: Array) -> "Relaxation":
        """For M⁻¹ = `mobility` (K, n, n), A = `damping` (K, n), not negative, and `h` (K,) s."""
        root = np.sqrt(np.maximum(damping, 0.0) * h[:, None])
        rates, modes = np.linalg.eigh(root[:, :, None] * mobility * root[:, None, :])
        # of a mass matrix that is none, as a fit may try, nothing grows
        gammas = _functions(np.maximum(rates, 0.0))
        ahead, behind = mobility @ (root[:, :, None] * modes), np.swapaxes(modes, 1, 2) * root[:, None, :]
        unit = np.eye(damping.shape[1])
        return cls(
            *(
                begin * unit - (ahead * gamma[:, None, :]) @ behind
                for begin, gamma in zip((1.0, 1.0, 0.5, 1.0 / 6.0), gammas, strict=True)
            )
        )


def _functions(x: Array) -> tuple[Array, Array, Array, Array]:
    """φ₁, φ₂, φ₃ and φ₄ = (1/6 − φ₃)/x of `x`, of any shape, not negative."""
    near, far = np.minimum(x, SMALL), np.maximum(x, SMALL)
    # φ₄ = 1/4! − x/5! + x²/6! − …
    fourth = 1.0 / 24.0 * (1.0 - near / 5.0 * (1.0 - near / 6.0 * (1.0 - near / 7.0 * (1.0 - near / 8.0))))
    third = 1.0 / 6.0 - near * fourth
    second = 0.5 - near * third
    first = 1.0 - near * second
    decayed = -np.expm1(-far) / far
    after = (1.0 - decayed) / far
    later = (0.5 - after) / far
    last = (1.0 / 6.0 - later) / far
    small = x < SMALL
    return tuple(np.where(small, *pair) for pair in ((first, decayed), (second, after), (third, later), (fourth, last)))  # type: ignore[return-value]
