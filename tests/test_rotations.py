"""Quaternions against Drake's."""

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RotationMatrix

from drake_cafim.dynamics import rigid_body as rigid
from drake_cafim.dynamics.rotations import exponential, inverse, logarithm, product, rotation_matrices


def _random(count: int) -> np.ndarray:
    q = np.random.default_rng(3).normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def test_matrices_and_products_are_drakes() -> None:
    a, b = _random(5), _random(10)[5:]
    for first, other, both in zip(a, b, product(a, b), strict=True):
        R = RotationMatrix(Quaternion(first)).matrix()
        np.testing.assert_allclose(rotation_matrices(first[None])[0], R, atol=1e-14)
        np.testing.assert_allclose(
            rotation_matrices(both[None])[0], R @ RotationMatrix(Quaternion(other)).matrix(), atol=1e-14
        )


def test_logarithm_undoes_the_exponential() -> None:
    turns = np.random.default_rng(4).uniform(-1.5, 1.5, (20, 3))
    np.testing.assert_allclose(logarithm(exponential(turns)), turns, atol=1e-13)
    np.testing.assert_allclose(logarithm(-exponential(turns)), turns, atol=1e-13)


def test_rate_is_the_slope_of_turning_about_the_worlds_axes() -> None:
    q, w, h = _random(4), np.random.default_rng(5).normal(size=(4, 3)), 1e-6
    later = product(exponential(h * w), q)
    numbers, rate = np.concatenate([np.zeros((4, 3)), q, np.zeros((4, 3)), w], axis=1), np.empty((4, 13))
    rigid.rates(numbers, np.zeros((4, 6)), rate)
    np.testing.assert_allclose((later - q) / h, rate[:, 3:7], atol=1e-5)
    np.testing.assert_allclose(logarithm(product(later, inverse(q))) / h, w, atol=1e-6)
