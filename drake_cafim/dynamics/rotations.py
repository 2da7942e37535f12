"""Unit quaternions (w, x, y, z) and small rotations about the world's axes, over many samples at once."""

import numpy as np

from drake_cafim.cross import cross
from drake_cafim.typing import Array


def _of_squares() -> Array:
    """(16, 9): the rotation matrix is linear in the products of a quaternion's numbers."""
    table = np.zeros((4, 4, 3, 3))
    for i in range(3):
        table[0, 0, i, i] = 1.0
        for j in range(3):
            table[i + 1, i + 1, j, j] += 1.0 if i == j else -1.0
        j, k = (i + 1) % 3, (i + 2) % 3
        table[j + 1, k + 1, j, k] = table[j + 1, k + 1, k, j] = 2.0
        table[0, i + 1, k, j], table[0, i + 1, j, k] = 2.0, -2.0
    return table.reshape(16, 9)


_OF_SQUARES = _of_squares()
_OF_VECTOR = np.array([[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]], float)


def crossing(vector: Array) -> Array:
    """(B, 3, 3) the matrices of vector × for (B, 3)."""
    return np.asarray((vector @ _OF_VECTOR).reshape(-1, 3, 3))


def rotation_matrices(quaternion: Array) -> Array:
    """R (..., 3, 3) of unit quaternions (..., 4)."""
    squares = (quaternion[..., :, None] * quaternion[..., None, :]).reshape(-1, 16)
    return np.asarray((squares @ _OF_SQUARES).reshape(*quaternion.shape[:-1], 3, 3))


def product(a: Array, b: Array) -> Array:
    """The quaternion (..., 4) of the rotation b followed by a."""
    scalar = a[..., :1] * b[..., :1] - np.sum(a[..., 1:] * b[..., 1:], axis=-1, keepdims=True)
    vector = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + cross(a[..., 1:], b[..., 1:])
    return np.concatenate([scalar, vector], axis=-1)


def inverse(quaternion: Array) -> Array:
    """The opposite rotation, (..., 4)."""
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


def rate(quaternion: Array, w: Array) -> Array:
    """q̇ = ½ (0, ω) q (..., 4) for an angular velocity (..., 3) rad/s in world axes."""
    products = (quaternion[..., :, None] * w[..., None, :]).reshape(-1, 12)
    return np.asarray((products @ _OF_RATE).reshape(quaternion.shape))


def _of_rate() -> Array:
    """(12, 4): q̇ is linear in the products of q and ω."""
    table = np.zeros((4, 3, 4))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        table[i + 1, i, 0], table[0, i, i + 1] = -0.5, 0.5
        table[j + 1, i, k + 1], table[k + 1, i, j + 1] = 0.5, -0.5
    return table.reshape(12, 4)


_OF_RATE = _of_rate()


def rotated(R: Array, vector: Array) -> Array:
    """R (..., 3, 3) times vectors (..., 3)."""
    return np.asarray((R @ vector[..., None])[..., 0])
