"""A Kalman filter and smoother of several coupled states from scalar readings, compiled.

State x of m numbers, readings of C channels, and forces of variances s that push the state through `entering` G:

    x₊ = F x + r + G f + e,    cov f = diag s,    cov e = `fresh`,    y_c = (seen x)_c + noise.

The smoother is the modified one of Bryson and Frazier (Bierman, Automatica 9, 1973), channel by channel.
"""

from dataclasses import dataclass

import numpy as np

from drake_cafim.numerics.backward_pass import absorb_reading, forget, step_back
from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array, Flags


@dataclass(frozen=True)
class StateSpace:
    """The model of N samples: `read` (N, C) with white `variance` (N, C), infinite where there is none.

    `seen` (C, m) is what of the state is read, correlated noise included, and `told` (S, m) what is to be known of it;
    `steps` F (N − 1, m, m), `rise` r (N − 1, m), `entering` G (N − 1, m, f), `fresh` (N − 1, m, m), and
    the covariance `start` (m, m) of the state where it starts `anew` (N,).
    """

    read: Array
    variance: Array
    seen: Array
    told: Array
    steps: Array
    rise: Array
    entering: Array
    fresh: Array
    start: Array
    anew: Flags

    def smooth(self, forces: Array) -> "Smoothed":
        """The smoothed state under forces of the variances `forces` (N − 1, f)."""
        arrays = (self.seen, self.told, self.steps, self.rise, self.entering, self.fresh, self.start)
        numbers = [np.ascontiguousarray(array, dtype=float) for array in (self.read, self.variance, *arrays, forces)]
        return Smoothed(*_smoothed(*numbers, np.ascontiguousarray(self.anew)))


@dataclass(frozen=True)
class Smoothed:
    """`mean` and `std` (N, S) of what is `told` of the state, and −2 ln likelihood `cost` but for a constant.

    `asked` and `expected` (N − 1, f) are a² and E a² of the slope a of ln likelihood by each force over each interval,
    at the forces' variances: at the likeliest ones their sums, weighed by these variances, are equal.
    """

    mean: Array
    std: Array
    asked: Array
    expected: Array
    cost: float


@compiled
def _smoothed(
    read: Array,
    variance: Array,
    seen: Array,
    told: Array,
    steps: Array,
    rise: Array,
    entering: Array,
    fresh: Array,
    start: Array,
    forces: Array,
    anew: Flags,
) -> tuple[Array, Array, Array, Array, float]:
    N, C = read.shape
    m, f = len(start), entering.shape[2]
    means, covariances = np.empty((N, m)), np.empty((N, m, m))
    innovations, gains = np.empty((N, C, 2)), np.empty((N, C, m))
    cost, started = 0.0, 0
    x, P = np.zeros(m), np.zeros((m, m))
    moved, carried = np.zeros(m), np.zeros((m, m))
    for k in range(N):
        if k == 0 or anew[k]:
            started = k
            for i in range(m):
                x[i] = 0.0
                for j in range(m):
                    P[i, j] = start[i, j]
        else:
            F, G = steps[k - 1], entering[k - 1]
            for i in range(m):
                moved[i] = rise[k - 1, i]
                for p in range(m):
                    moved[i] += F[i, p] * x[p]
                for j in range(m):
                    carried[i, j] = 0.0
                for p in range(m):
                    along = F[i, p]
                    if along != 0.0:
                        for j in range(m):
                            carried[i, j] += along * P[p, j]
            for i in range(m):
                x[i] = moved[i]
                for j in range(i + 1):
                    total = fresh[k - 1, i, j]
                    for p in range(m):
                        total += carried[i, p] * F[j, p]
                    for p in range(f):
                        total += G[i, p] * forces[k - 1, p] * G[j, p]
                    P[i, j] = P[j, i] = total
        for c in range(C):
            if not np.isfinite(variance[k, c]):
                continue
            s, e = variance[k, c], read[k, c]
            for i in range(m):
                e -= seen[c, i] * x[i]
                moved[i] = 0.0
                for j in range(m):
                    moved[i] += P[i, j] * seen[c, j]
                s += seen[c, i] * moved[i]
            if k > started + 1:
                cost += e * e / s + np.log(s)
            innovations[k, c, 0], innovations[k, c, 1] = e, s
            for i in range(m):
                gains[k, c, i] = moved[i] / s
                x[i] += gains[k, c, i] * e
                for j in range(m):
                    P[i, j] -= gains[k, c, i] * moved[j]
        for i in range(m):
            means[k, i] = x[i]
            for j in range(m):
                covariances[k, i, j] = P[i, j]
    S = len(told)
    mean, std = np.empty((N, S)), np.empty((N, S))
    asked, expected = np.zeros((N - 1, f)), np.zeros((N - 1, f))
    # what the samples after k say: the state is x − P a, its covariance P − P A P
    a, A = np.zeros(m), np.zeros((m, m))
    turned, product = np.zeros(m), np.zeros((m, m))
    for k in range(N - 1, -1, -1):
        x, P = means[k], covariances[k]
        for c in range(S):
            value, spread = 0.0, 0.0
            for i in range(m):
                value += told[c, i] * x[i]
                turned[i] = 0.0
                for j in range(m):
                    turned[i] += P[i, j] * told[c, j]
            for i in range(m):
                value -= turned[i] * a[i]
                spread += told[c, i] * turned[i]
                for j in range(m):
                    spread -= turned[i] * A[i, j] * turned[j]
            mean[k, c], std[k, c] = value, np.sqrt(max(spread, 0.0))
        if k == 0:
            break
        for back in range(C):
            c = C - 1 - back
            if not np.isfinite(variance[k, c]):
                continue
            innovation, spread = innovations[k, c]
            absorb_reading(a, A, seen[c], gains[k, c], innovation, spread, turned)
        if anew[k]:
            forget(a, A)
            continue
        F, G = steps[k - 1], entering[k - 1]
        for p in range(f):
            slope, square = 0.0, 0.0
            for i in range(m):
                slope += G[i, p] * a[i]
                for j in range(m):
                    square += G[i, p] * A[i, j] * G[j, p]
            asked[k - 1, p], expected[k - 1, p] = slope * slope, square
        step_back(a, A, F, turned, product)
    return mean, std, asked, expected, cost
