"""The backward pass of the modified Bryson–Frazier smoother (Bierman, Automatica 9, 1973), compiled.

What the samples after one say of its state is a vector a and a matrix A: with the filtered mean x and covariance P the
smoothed ones are x − P a and P − P A P. Both change at each reading and at each step between samples, in place.
"""

from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array


@compiled
def absorb_reading(
    a: Array, A: Array, seen: Array, gain: Array, innovation: float, variance: float, turned: Array
) -> None:
    """Takes a reading into `a` (m,) and `A` (m, m): its row `seen` (m,), the filter's `gain` (m,) and its innovation.

    `variance` is that of the innovation, `turned` (m,) is room for A times the gain.
    """
    m = len(a)
    along, twice = innovation / variance, 1.0 / variance
    for i in range(m):
        along += gain[i] * a[i]
        turned[i] = 0.0
        for j in range(m):
            turned[i] += A[i, j] * gain[j]
        twice += gain[i] * turned[i]
    for i in range(m):
        a[i] -= seen[i] * along
        for j in range(m):
            A[i, j] += twice * seen[i] * seen[j] - seen[i] * turned[j] - turned[i] * seen[j]


@compiled
def step_back(a: Array, A: Array, F: Array, turned: Array, product: Array) -> None:
    """Takes `a` and `A` to the sample before, Fᵀ a and Fᵀ A F; `turned` (m,) and `product` (m, m) are room."""
    m = len(a)
    for i in range(m):
        turned[i] = 0.0
        for j in range(m):
            turned[i] += F[j, i] * a[j]
            product[i, j] = 0.0
        for p in range(m):
            along = F[p, i]
            if along != 0.0:
                for j in range(m):
                    product[i, j] += along * A[p, j]
    for i in range(m):
        a[i] = turned[i]
        for j in range(m):
            A[i, j] = 0.0
            for p in range(m):
                A[i, j] += product[i, p] * F[p, j]


@compiled
def forget(a: Array, A: Array) -> None:
    """Sets `a` and `A` to zero: the samples after a pause say nothing of the state before it."""
    for i in range(len(a)):
        a[i] = 0.0
        for j in range(len(a)):
            A[i, j] = 0.0
