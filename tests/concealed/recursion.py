"""First-order recursions over samples by parallel prefix: steps of 1 are combined to steps of 2, 4 and so on."""

from __future__ import annotations

from .robots import Array


def followed(keep: Array, fed: Array) -> Array:
    """y (B, N, ...) of y_k = keep_k y_(k-1) + fed_k, from y_0 = fed_0; keep (B, N) is at most one in size."""
    out = fed.copy()
    over = keep.reshape(*keep.shape, *[1] * (fed.ndim - 2)).copy()
    step = 1
    while step < fed.shape[1]:
        out[:, step:] += over[:, step:] * out[:, :-step]
        over[:, step:] = over[:, step:] * over[:, :-step]
        step *= 2
    return out
