"""A Kalman smoother that carries the sensitivities to parameters along (compiled).

The model is linear about a trajectory: with deviations x of the state and θ of the parameters,

    x₊ = A x + B θ + c + E w,   r = C x + D θ + e,   w ~ N(0, 1), e ~ N(0, R),

and x of the first sample of variances that say nothing. Each innovation is ν = ν₀ − V θ with V its derivative, so that
−2 ln p(r | θ) is Σ νᵀ S⁻¹ ν + Σ ln det S (Schweppe, IEEE Trans. Inf. Theory 11(1), 1965), a parabola in θ whose
curvature Σ Vᵀ S⁻¹ V is the Fisher information of θ with the initial state projected out. Costs grow linearly with the
samples.
"""

import numpy as np

from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array, Flags


@compiled
def filter_forward(
    A: Array, B: Array, c: Array, E: Array, C: Array, D: Array, r: Array, R: Array, seen: Flags, start: Array
) -> tuple[Array, Array, Array, float, float, Array, Array, Array]:
    """One pass over N samples of m readings, with s states, p parameters and w noises.

    A (N−1, s, s), B (N−1, s, p), c (N−1, s), E (N−1, s, w); C (N, m, s), D (N, m, p), r (N, m), R (m,) variances,
    `seen` (N, m); `start` (s,) variances of the first state. Returns the information (p, p), the gradient
    Σ Vᵀ S⁻¹ ν₀ (p,), the scores Vᵀ S⁻¹ ν₀ of each sample (N, p), Σ ν₀ᵀ S⁻¹ ν₀, Σ ln det S, and for `smooth`: means
    (N, s, p + 1) and covariances (N, s, s) after each sample's readings, and gains (N, s, m).
    """
    N, m, s = C.shape
    p = D.shape[2]
    information, gradient, scores = np.zeros((p, p)), np.zeros(p), np.zeros((N, p))
    chi_square, log_volume = 0.0, 0.0
    means, covariances, gains = np.zeros((N, s, p + 1)), np.zeros((N, s, s)), np.zeros((N, s, m))
    d, P = np.zeros((s, p + 1)), np.diag(start)
    V = np.zeros(p + 1)
    for k in range(N):
        # one reading after another: their noises are independent, so that S is a number
        for i in range(m):
            if not seen[k, i]:
                continue
            row = C[k, i]
            PC = P @ row
            S = R[i]
            for a in range(s):
                S += row[a] * PC[a]
            for b in range(p):
                V[b] = D[k, i, b]
            V[p] = r[k, i]
            for a in range(s):
                if row[a] != 0.0:
                    for b in range(p):
                        V[b] += row[a] * d[a, b]
                    V[p] -= row[a] * d[a, p]
            chi_square += V[p] * V[p] / S
            log_volume += np.log(S)
            for b in range(p):
                weighted = V[b] / S
                scores[k, b] += weighted * V[p]
                for a in range(b + 1):
                    information[a, b] += weighted * V[a]
            for a in range(s):
                gain = PC[a] / S
                gains[k, a, i] = gain
                for b in range(p):
                    d[a, b] -= gain * V[b]
                d[a, p] += gain * V[p]
            # Joseph's form for one reading: P stays positive where a reading takes all that was open
            for a in range(s):
                for b in range(a + 1):
                    P[a, b] += -PC[a] * gains[k, b, i] - gains[k, a, i] * PC[b] + S * gains[k, a, i] * gains[k, b, i]
                    P[b, a] = P[a, b]
        for b in range(p):
            gradient[b] += scores[k, b]
        for a in range(s):
            for b in range(p + 1):
                means[k, a, b] = d[a, b]
            for b in range(s):
                covariances[k, a, b] = P[a, b]
        if k + 1 < N:
            d = A[k] @ d
            for a in range(s):
                for b in range(p):
                    d[a, b] += B[k, a, b]
                d[a, p] += c[k, a]
            P = A[k] @ P @ A[k].T + E[k] @ E[k].T
            P = 0.5 * (P + P.T)
    for a in range(p):
        for b in range(a):
            information[a, b] = information[b, a]
    return information, gradient, scores, chi_square, log_volume, means, covariances, gains


@compiled
def smooth(
    A: Array, C: Array, D: Array, r: Array, R: Array, seen: Flags, theta: Array,
    means: Array, covariances: Array, gains: Array, c: Array, B: Array, E: Array, start: Array,
) -> Array:  # fmt: skip
    """Deviations of the states (N, s) given all readings, for parameters `theta` (p,).

    A recursion of adjoints backwards, which inverts no covariance (Bryson, Frazier, 1963; Bierman, Automatica 9(4),
    1973).
    """
    N, m, s = C.shape
    result = np.empty((N, s))
    adjoint = np.zeros(s)
    p = len(theta)
    for k in range(N - 1, -1, -1):
        after = means[k, :, p].copy()
        for a in range(s):
            for b in range(p):
                after[a] += means[k, a, b] * theta[b]
        for a in range(s):
            result[k, a] = after[a]
            for b in range(s):
                result[k, a] -= covariances[k, a, b] * adjoint[b]
        if k == 0:
            break
        # the state and covariance before this sample's readings
        d, P = np.zeros(s), A[k - 1] @ covariances[k - 1] @ A[k - 1].T + E[k - 1] @ E[k - 1].T
        previous = means[k - 1, :, p].copy()
        for a in range(s):
            for b in range(p):
                previous[a] += means[k - 1, a, b] * theta[b]
        for a in range(s):
            d[a] = c[k - 1, a]
            for b in range(s):
                d[a] += A[k - 1, a, b] * previous[b]
            for b in range(p):
                d[a] += B[k - 1, a, b] * theta[b]
        error, volume = np.zeros(m), np.ones(m)
        for i in range(m):
            if not seen[k, i]:
                continue
            row = C[k, i]
            PC = P @ row
            S, left = R[i], r[k, i]
            for a in range(s):
                S += row[a] * PC[a]
                left -= row[a] * d[a]
            for b in range(p):
                left -= D[k, i, b] * theta[b]
            error[i], volume[i] = left, S
            for a in range(s):
                d[a] += PC[a] / S * left
            P = P - np.outer(PC, PC) / S
        for i in range(m - 1, -1, -1):
            if not seen[k, i]:
                continue
            row, along = C[k, i], 0.0
            for a in range(s):
                along += gains[k, a, i] * adjoint[a]
            for a in range(s):
                adjoint[a] -= row[a] * (along + error[i] / volume[i])
        adjoint = A[k - 1].T @ adjoint
    return result
