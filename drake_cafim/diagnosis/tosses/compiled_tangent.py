"""Propagation of first-order changes along the steps of flights, compiled; see `tangent` for the terms."""

from typing import Any

import numpy as np

from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array


@compiled
def propagate_flights(
    initial: Array, first: Any, sample: Any, transition: Array, pushes: Array, memory: Any, landed: Any, shape: Any
) -> Array:
    """δx (B, S, 12, k) at the samples of flights that start from δx₀ = `initial` (B, 12, k); `shape` is (B, S).

    Flight b has the steps first[b] to first[b + 1], which end on `sample` (F,), or on none where that is −1. In a step,
    with the change δz (M, k) of the contact's memory,

        δx₊ = T δx + A δz + p,      δz₊ = K δz + P δx₊,

    T `transition` (F, 12, 12), p `pushes` (F, 12, k), and `memory` = A (F, 12, M), K (F, points, m, m), P (F, M, 12).
    `landed` = (row, gain, by_state, deeper) are the touch-downs in order: before step `row` (E,), `gain` (E, 12 + M)
    times δd = `by_state` (E, 12) δx + `deeper` (E, k) is added to (δx, δz).
    """
    by_memory, kept, remembered = memory
    row, gain, by_state, deeper = landed
    B, S = shape
    columns, M, m, landing = initial.shape[2], by_memory.shape[2], kept.shape[2], 0
    result = np.zeros((B, S, 12, columns))
    for b in range(B):
        x, z = initial[b].copy(), np.zeros((M, columns))
        result[b, 0] = x
        for f in range(first[b], first[b + 1]):
            while landing < len(row) and row[landing] == f:
                depth = deeper[landing].copy()
                _add(depth.reshape(1, columns), by_state[landing].reshape(1, 12), x)
                for i in range(12):
                    x[i] += gain[landing, i] * depth
                for i in range(M):
                    z[i] += gain[landing, 12 + i] * depth
                landing += 1
            moved, known = pushes[f].copy(), np.zeros((M, columns))
            _add(moved, transition[f], x)
            if M:
                _add(moved, by_memory[f], z)
                for p in range(M // m):
                    _add(known[p * m : (p + 1) * m], kept[f, p], z[p * m : (p + 1) * m])
                _add(known, remembered[f], moved)
            x, z = moved, known
            if sample[f] >= 0:
                result[b, sample[f]] = x
    return result


@compiled
def _add(total: Array, matrix: Array, values: Array) -> None:
    """Adds `matrix` (i, j) @ `values` (j, k) to `total` (i, k); skips zeros, of which such a matrix has many."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            share = matrix[i, j]
            if share != 0.0:
                for k in range(values.shape[1]):
                    total[i, k] += share * values[j, k]
