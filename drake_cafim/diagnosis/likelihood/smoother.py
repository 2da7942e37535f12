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
def _multiply(A: Array, X: Array, product: Array) -> None:
    """Fills `product` with A X; loops compile in a fraction of the time of matrix products, and run as fast here."""
    for a in range(len(A)):
        for b in range(X.shape[1]):
            product[a, b] = 0.0
        for k in range(A.shape[1]):
            by = A[a, k]
            if by != 0.0:
                for b in range(X.shape[1]):
                    product[a, b] += by * X[k, b]


@compiled
def _propagate(A: Array, P: Array, E: Array, room: Array, later: Array) -> None:
    """Fills `later` (s, s) with A P Aᵀ + E Eᵀ of a symmetric P; `room` (s, s) is for what is in between."""
    s = len(A)
    _multiply(A, P, later)
    for a in range(s):
        for b in range(s):
            room[b, a] = later[a, b]
    _multiply(A, room, later)
    for a in range(s):
        for b in range(a + 1):
            total = 0.5 * (later[a, b] + later[b, a])
            for k in range(E.shape[1]):
                total += E[a, k] * E[b, k]
            later[a, b] = later[b, a] = total


@compiled
def _seen_covariance(P: Array, row: Array, PC: Array) -> float:
    """Fills `PC` (s,) with P c of a symmetric P and a `row` c of the readings; returns cᵀ P c."""
    for a in range(len(row)):
        PC[a] = 0.0
    for a in range(len(row)):
        if row[a] != 0.0:
            for b in range(len(row)):
                PC[b] += row[a] * P[a, b]
    total = 0.0
    for a in range(len(row)):
        total += row[a] * PC[a]
    return total


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
    d, P = np.zeros((s, p + 1)), np.zeros((s, s))
    for a in range(s):
        P[a, a] = start[a]
    moved, room, V, PC = np.zeros((s, p + 1)), np.zeros((s, s)), np.zeros(p + 1), np.zeros(s)
    for k in range(N):
        # one reading after another: their noises are independent, so that S is a number
        for i in range(m):
            if not seen[k, i]:
                continue
            row = C[k, i]
            S = R[i] + _seen_covariance(P, row, PC)
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
            _multiply(A[k], d, moved)
            for a in range(s):
                for b in range(p):
                    d[a, b] = moved[a, b] + B[k, a, b]
                d[a, p] = moved[a, p] + c[k, a]
            _propagate(A[k], covariances[k], E[k], room, P)
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
    p = len(theta)
    result, adjoint, turned = np.empty((N, s)), np.zeros(s), np.zeros(s)
    previous, d, PC, P, room = np.zeros(s), np.zeros(s), np.zeros(s), np.zeros((s, s)), np.zeros((s, s))
    error, volume = np.zeros(m), np.ones(m)
    for k in range(N - 1, -1, -1):
        for a in range(s):
            result[k, a] = means[k, a, p]
            for b in range(p):
                result[k, a] += means[k, a, b] * theta[b]
            for b in range(s):
                result[k, a] -= covariances[k, a, b] * adjoint[b]
        if k == 0:
            break
        # the state and covariance before this sample's readings
        _propagate(A[k - 1], covariances[k - 1], E[k - 1], room, P)
        for a in range(s):
            previous[a] = means[k - 1, a, p]
            for b in range(p):
                previous[a] += means[k - 1, a, b] * theta[b]
        for a in range(s):
            d[a] = c[k - 1, a]
            for b in range(s):
                d[a] += A[k - 1, a, b] * previous[b]
            for b in range(p):
                d[a] += B[k - 1, a, b] * theta[b]
        for i in range(m):
            if not seen[k, i]:
                continue
            row, left = C[k, i], r[k, i]
            S = R[i] + _seen_covariance(P, row, PC)
            for a in range(s):
                left -= row[a] * d[a]
            for b in range(p):
                left -= D[k, i, b] * theta[b]
            error[i], volume[i] = left, S
            for a in range(s):
                d[a] += PC[a] / S * left
                for b in range(s):
                    P[a, b] -= PC[a] * PC[b] / S
        for i in range(m - 1, -1, -1):
            if not seen[k, i]:
                continue
            row, along = C[k, i], 0.0
            for a in range(s):
                along += gains[k, a, i] * adjoint[a]
            for a in range(s):
                adjoint[a] -= row[a] * (along + error[i] / volume[i])
        for a in range(s):
            turned[a] = 0.0
            for b in range(s):
                turned[a] += A[k - 1, b, a] * adjoint[b]
        for a in range(s):
            adjoint[a] = turned[a]
    return result
