"""Small changes of flights carried along their steps, compiled; `tangent` says what they are made of."""

from typing import Any

import numpy as np

from drake_cafim.numerics.compiled import compiled
from drake_cafim.typing import Array


@compiled
def carried(
    initial: Array, first: Any, sample: Any, transition: Array, pushes: Array, memory: Any, landed: Any, shape: Any
) -> Array:
    """δx (B, S, 12, k) at the samples, of flights that begin with `initial` (B, 12, k); `shape` is (B, S).

    Flight b has the steps first[b] to first[b + 1], which end on `sample` (F,) or, -1, on none. A step makes of δx, and
    of the memory's δz (M, k), δx₊ = T δx + A δz + p with T `transition` (F, 12, 12) and p `pushes` (F, 12, k); then
    δz₊ = K δz + P δx₊. `memory` is A (F, 12, M), K (F, points, m, m) and P (F, M, 12). Before the step `row` (E,) of
    `landed`, in order, there is added `gain` (E, 12 + M) times how much deeper a point then is: by `by_state` (E, 12)
    of δx, and by `deeper` (E, k).
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
    """Adds `matrix` (i, j) times `values` (j, k) to `total` (i, k); much of a matrix is zero."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            share = matrix[i, j]
            if share != 0.0:
                for k in range(values.shape[1]):
                    total[i, k] += share * values[j, k]
