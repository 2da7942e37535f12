"""Sampling of a cloud of candidate parameters: the minimum that it finds, and the covariance that it learns."""

import numpy as np
import pytest

from drake_cafim.discrimination.cloud import WIDEST, Cloud
from drake_cafim.typing import Array

OPTIMUM: Array = np.array([0.3, -0.2, 0.5, 0.0, -0.6, 0.1])
# a valley a hundred times as long as it is wide, along no axis
TURNED: Array = np.linalg.qr(np.random.default_rng(1).normal(size=(6, 6)))[0]
HESSIAN: Array = TURNED @ np.diag(np.logspace(0.0, 4.0, 6)) @ TURNED.T


def score(candidates: Array) -> Array:
    apart = candidates - OPTIMUM
    return np.asarray(-np.einsum("ni,ij,nj->n", apart, HESSIAN, apart))


def searched(generations: int, seed: int) -> Cloud:
    random, cloud = np.random.default_rng(seed), Cloud.about(np.zeros(6), 0.5)
    for _ in range(generations):
        drawn = cloud.drawn(16, random)
        cloud = cloud.after(drawn, score(drawn))
    return cloud


@pytest.mark.parametrize("seed", range(3))
def test_a_cloud_walks_down_a_narrow_valley(seed: int) -> None:
    cloud = searched(150, seed)
    np.testing.assert_allclose(cloud.mean, OPTIMUM, atol=1e-3)
    # the longest axis of the cloud is the valley
    _, vectors = np.linalg.eigh(cloud.covariance)
    assert abs(vectors[:, -1] @ TURNED[:, 0]) > 0.9


def test_candidates_stay_within_bounds_and_the_cloud_within_its_widest() -> None:
    random, cloud = np.random.default_rng(0), Cloud.about(np.full(4, 0.9), 0.9)
    for _ in range(30):
        drawn = cloud.drawn(10, random)
        assert np.all(np.abs(drawn) <= 1.0)
        cloud = cloud.after(drawn, drawn.sum(axis=1))
    assert cloud.scale <= WIDEST
    np.testing.assert_allclose(cloud.mean, 1.0, atol=0.05)


def test_a_candidate_worth_nothing_is_no_parent() -> None:
    cloud = Cloud.about(np.zeros(3), 0.5)
    drawn = cloud.drawn(8, np.random.default_rng(0))
    scores = np.where(np.arange(8) < 4, np.arange(8.0), -np.inf)
    other = drawn.copy()
    other[4:] = 0.77
    np.testing.assert_array_equal(cloud.after(drawn, scores).mean, cloud.after(other, scores).mean)
