"""Unit quaternions (w, x, y, z), rotation vectors and rotation matrices, over many samples at once."""

import numpy as np

from drake_cafim.numerics.compiled import compiled
from drake_cafim.numerics.cross import cross
from drake_cafim.typing import Array

_OF_VECTOR = np.array([[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]], float)


def crossing(vector: Array) -> Array:
    """The skew-symmetric matrices (B, 3, 3) of `vector` × for vectors (B, 3)."""
    return np.asarray((vector @ _OF_VECTOR).reshape(-1, 3, 3))


def rotation_matrices(quaternion: Array) -> Array:
    """R (..., 3, 3) of unit quaternions (..., 4)."""
    R = rotation_matrices_of(np.ascontiguousarray(quaternion.reshape(-1, 4)))
    return np.asarray(R.reshape(*quaternion.shape[:-1], 3, 3), dtype=float)


@compiled
def rotation_matrices_of(quaternion: Array) -> Array:
    """R (B, 3, 3) of unit quaternions (B, 4), callable from compiled functions."""
    R = np.empty((len(quaternion), 3, 3))
    for i in range(len(quaternion)):
        a, b, c, d = quaternion[i]
        R[i, 0, 0], R[i, 0, 1], R[i, 0, 2] = a * a + b * b - c * c - d * d, 2.0 * (b * c - a * d), 2.0 * (b * d + a * c)
        R[i, 1, 0], R[i, 1, 1], R[i, 1, 2] = 2.0 * (b * c + a * d), a * a - b * b + c * c - d * d, 2.0 * (c * d - a * b)
        R[i, 2, 0], R[i, 2, 1], R[i, 2, 2] = 2.0 * (b * d - a * c), 2.0 * (c * d + a * b), a * a - b * b - c * c + d * d
    return R


def product(a: Array, b: Array) -> Array:
    """The quaternion (..., 4) of the rotation b followed by a."""
    scalar = a[..., :1] * b[..., :1] - np.sum(a[..., 1:] * b[..., 1:], axis=-1, keepdims=True)
    vector = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + cross(a[..., 1:], b[..., 1:])
    return np.concatenate([scalar, vector], axis=-1)


def inverse(quaternion: Array) -> Array:
    """The inverse of a unit quaternion (..., 4): its conjugate."""
    return np.asarray(quaternion * np.array([1.0, -1.0, -1.0, -1.0]), dtype=float)


def exponential(turn: Array) -> Array:
    """The quaternion (..., 4) of a rotation vector (..., 3) rad."""
    half = 0.5 * np.linalg.norm(turn, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * turn], axis=-1)


def logarithm(quaternion: Array) -> Array:
    """The shortest rotation vector (..., 3) rad of a quaternion (..., 4)."""
    q = np.where(quaternion[..., :1] < 0.0, -quaternion, quaternion)
    size = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(size, q[..., :1])
    return np.asarray(np.where(size > 1e-12, angle / np.maximum(size, 1e-300), 2.0) * q[..., 1:])


def rotated(R: Array, vector: Array) -> Array:
    """R (..., 3, 3) times vectors (..., 3)."""
    return np.asarray((R @ vector[..., None])[..., 0])
