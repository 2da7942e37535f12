"""A Kalman filter and smoother of one joint under a white acceleration, compiled.

The state is the joint's position and velocity, and m − 2 states of the noise of its two channels; between samples

    x₊ = F x + r + e,    cov e = `fresh` + S (h³/3, h²/2; h²/2, h) in position and velocity,

S the spectral density of the acceleration, and the channels read y = `seen` x + white noise. They are
taken one after the other, see `backward_pass`.
"""

import numpy as np

from drake_cafim.numerics.backward_pass import absorb_reading, forget, step_back
from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array


@compiled
def filter_joint(
    longest: float,
    h: Array,
    read: Array,
    variance: Array,
    seen: Array,
    steps: Array,
    rise: Array,
    fresh: Array,
    start: Array,
    densities: Array,
    means: Array,
    covariances: Array,
    innovations: Array,
    gains: Array,
) -> Array:
    """(D,) twice the negative log likelihoods of the innovations under each of the `densities` (D,).

    Fills the filtered `means` (N, m), `covariances` (N, m, m), the `innovations` (N, 2, 2) with their variances, and
    the `gains` (N, 2, m) of the samples, under the first density, unless these are empty. Loops over the densities are
    innermost, so that several are computed at once.
    """
    N, m, D, started, filled = len(read), len(start), len(densities), 0, len(means) > 0
    cost, volume, error, spread = np.zeros(D), np.ones(D), np.zeros(D), np.zeros(D)
    x, P = np.zeros((m, D)), np.zeros((m, m, D))
    moved, carried = np.zeros((m, D)), np.zeros((m, m, D))
    for k in range(N):
        if k == 0 or h[k - 1] > longest:
            # nobody knows what happened in between: the joint starts anew
            started = k
            for i in range(m):
                begin = read[k, i] if i < 2 and np.isfinite(variance[k, i]) else 0.0
                for d in range(D):
                    x[i, d] = begin
                for j in range(m):
                    for d in range(D):
                        P[i, j, d] = start[i, j]
        else:
            dt, F = h[k - 1], steps[k - 1]
            for i in range(m):
                begin = rise[k - 1, i] if i < 2 else 0.0
                for d in range(D):
                    moved[i, d] = begin
                for j in range(m):
                    for d in range(D):
                        carried[i, j, d] = 0.0
                for p in range(m):
                    by = F[i, p]
                    # the states of the channels' noise move by themselves
                    if by == 0.0:
                        continue
                    for d in range(D):
                        moved[i, d] += by * x[p, d]
                    for j in range(m):
                        for d in range(D):
                            carried[i, j, d] += by * P[p, j, d]
            for i in range(m):
                for d in range(D):
                    x[i, d] = moved[i, d]
                for j in range(i + 1):
                    for d in range(D):
                        spread[d] = fresh[k - 1, i, j]
                    for p in range(m):
                        by = F[j, p]
                        if by == 0.0:
                            continue
                        for d in range(D):
                            spread[d] += carried[i, p, d] * by
                    for d in range(D):
                        P[i, j, d] = P[j, i, d] = spread[d]
            for d in range(D):
                P[0, 0, d] += densities[d] * dt**3 / 3.0
                P[0, 1, d] += densities[d] * dt**2 / 2.0
                P[1, 0, d] = P[0, 1, d]
                P[1, 1, d] += densities[d] * dt
        for c in range(2):
            if not np.isfinite(variance[k, c]):
                continue
            for d in range(D):
                spread[d], error[d] = variance[k, c], read[k, c]
            for i in range(m):
                for d in range(D):
                    moved[i, d] = 0.0
                for j in range(m):
                    by = seen[c, j]
                    if by == 0.0:
                        continue
                    for d in range(D):
                        moved[i, d] += P[i, j, d] * by
                by = seen[c, i]
                for d in range(D):
                    error[d] -= by * x[i, d]
                    spread[d] += by * moved[i, d]
            if k > started + 1:
                for d in range(D):
                    cost[d] += error[d] * error[d] / spread[d]
                    volume[d] *= spread[d]
            if filled:
                innovations[k, c, 0], innovations[k, c, 1] = error[0], spread[0]
                for i in range(m):
                    gains[k, c, i] = moved[i, 0] / spread[0]
            for d in range(D):
                error[d] /= spread[d]
                spread[d] = 1.0 / spread[d]
            for i in range(m):
                for d in range(D):
                    x[i, d] += moved[i, d] * error[d]
                for j in range(i + 1):
                    for d in range(D):
                        P[i, j, d] -= moved[i, d] * moved[j, d] * spread[d]
            for i in range(m):
                for j in range(i + 1, m):
                    for d in range(D):
                        P[i, j, d] = P[j, i, d]
        # a logarithm takes as long as many products, and of so few these stay within the numbers' range
        if k % 4 == 3 or k == N - 1:
            for d in range(D):
                cost[d] += np.log(volume[d])
                volume[d] = 1.0
        if filled:
            for i in range(m):
                means[k, i] = x[i, 0]
                for j in range(m):
                    covariances[k, i, j] = P[i, j, 0]
    return cost


@compiled
def smooth_joint(
    longest: float,
    h: Array,
    read: Array,
    variance: Array,
    seen: Array,
    steps: Array,
    rise: Array,
    fresh: Array,
    start: Array,
    density: float,
) -> tuple[Array, Array, Array, Array, float]:
    """Smoothed q, v and their standard deviations, (N,) each, and −2 ln likelihood of the innovations."""
    N, m = len(read), len(start)
    means, covariances = np.empty((N, m)), np.empty((N, m, m))
    innovations, gains = np.empty((N, 2, 2)), np.empty((N, 2, m))
    model = (variance, seen, steps, rise, fresh, start)
    cost = filter_joint(longest, h, read, *model, np.array([density]), means, covariances, innovations, gains)[0]
    q, v, q_std, v_std = np.empty(N), np.empty(N), np.empty(N), np.empty(N)
    # what the samples after k say: the state is x − P a, its covariance P − P A P
    a, A = np.zeros(m), np.zeros((m, m))
    turned, product = np.zeros(m), np.zeros((m, m))
    for k in range(N - 1, -1, -1):
        x, P = means[k], covariances[k]
        for c in range(2):
            mean, spread = x[c], P[c, c]
            for i in range(m):
                mean -= P[c, i] * a[i]
                for j in range(m):
                    spread -= P[c, i] * A[i, j] * P[j, c]
            if c == 0:
                q[k], q_std[k] = mean, np.sqrt(max(spread, 0.0))
            else:
                v[k], v_std[k] = mean, np.sqrt(max(spread, 0.0))
        if k == 0:
            break
        for c in (1, 0):
            if not np.isfinite(variance[k, c]):
                continue
            innovation, spread = innovations[k, c]
            absorb_reading(a, A, seen[c], gains[k, c], innovation, spread, turned)
        if h[k - 1] > longest:
            forget(a, A)
            continue
        step_back(a, A, steps[k - 1], turned, product)
    return q, v, q_std, v_std, cost
