"""Fast products of small vectors: a constant matrix times all pairs of components."""

from __future__ import annotations

import itertools

import numpy as np

from .robots import Array

_CROSS = np.zeros((9, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _CROSS[3 * _i + _j, _k], _CROSS[3 * _j + _i, _k] = 1.0, -1.0

# rows: pairs of (w, x, y, z) and (w, x, y, z)
_TURN = np.zeros((16, 9))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _TURN[[0, 5, 10, 15], 4 * _i] = [1.0 if _n in (0, _i + 1) else -1.0 for _n in range(4)]
    for (_row, _column), _sign in (((_i, _j), -1.0), ((_j, _i), 1.0)):
        _TURN[4 * (_i + 1) + _j + 1, 3 * _row + _column] = 2.0
        _TURN[_k + 1, 3 * _row + _column] = 2.0 * _sign

# rows: pairs of a spin's (x, y, z) and (w, x, y, z)
_SPUN = np.zeros((12, 4))
for _i in range(3):
    _SPUN[4 * _i + _i + 1, 0], _SPUN[4 * _i, _i + 1] = -0.5, 0.5
for _i, _j, _k in itertools.permutations(range(3)):
    _SPUN[4 * _i + _j + 1, _k + 1] = 0.5 * _CROSS[3 * _i + _j, _k]


def _products(a: Array, b: Array, table: Array) -> Array:
    pairs = a[..., :, None] * b[..., None, :]
    out: Array = pairs.reshape(-1, len(table)) @ table
    return out.reshape(*pairs.shape[:-2], table.shape[1])


def cross(a: Array, b: Array) -> Array:
    """Products (..., 3) of vectors (..., 3)."""
    return _products(a, b, _CROSS)


def turn_of(unit: Array) -> Array:
    """Rotation matrices (B, 3, 3) of unit quaternions (w, x, y, z)."""
    return _products(unit, unit, _TURN).reshape(-1, 3, 3)


def quaternion_rate(q: Array, omega: Array) -> Array:
    """q' = half (0, omega) q (B, 4) for omega (B, 3) in world axes."""
    return _products(omega, q, _SPUN)


def size_of(vectors: Array) -> Array:
    """Lengths (...) of vectors (..., 3)."""
    return np.sqrt(np.add.reduce(vectors * vectors, axis=-1))
