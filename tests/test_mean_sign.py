"""The mean of a dry friction's sign over the velocity's error, near rest and far from it."""

import numpy as np
import pytest

from drake_cafim.effects.mean_sign import REST, MeanSign, mean_sides

WIDTH, STD = 5e-3, 3e-3
VELOCITIES = np.concatenate([np.linspace(-0.3, 0.3, 601), [-40.0, 0.0, 40.0]])


def _mean(law: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    shares = np.exp(-0.5 * nodes**2)
    return np.asarray(law @ (shares / shares.sum()))


@pytest.mark.parametrize("std", [STD, np.full(len(VELOCITIES), STD)])
def test_means_and_slopes_are_those_by_quadrature_at_every_speed(std: float) -> None:
    nodes = np.linspace(-8.0, 8.0, 4001)
    sign = MeanSign.of(VELOCITIES, std, WIDTH)
    sides, slopes = mean_sides(sign, VELOCITIES, std, WIDTH)
    exact = np.tanh((VELOCITIES[:, None] + STD * nodes) / WIDTH)
    np.testing.assert_allclose(sign.value, _mean(exact, nodes), atol=2e-5)
    np.testing.assert_allclose(sides[:, 0], -_mean(np.maximum(exact, 0.0), nodes), atol=0.01)
    np.testing.assert_allclose(sides[:, 1], _mean(np.maximum(-exact, 0.0), nodes), atol=0.01)
    moved = [
        mean_sides(MeanSign.of(at, std, WIDTH), at, std, WIDTH)[0] for at in (VELOCITIES + 1e-6, VELOCITIES - 1e-6)
    ]
    np.testing.assert_allclose(slopes, (moved[0] - moved[1]) / 2e-6, atol=1e-4 / WIDTH)


def test_far_from_rest_the_sign_is_settled() -> None:
    sign = MeanSign.of(np.array([-1.0, 1.0]), STD, WIDTH)
    np.testing.assert_allclose(sign.value, [-1.0, 1.0], atol=2e-5)
    assert not np.any(sign.by_v) and not np.any(sign.by_std)


def test_the_mean_size_is_that_of_all_its_terms_near_rest_and_far_from_it() -> None:
    """Where the loop leaves terms out, they are nothing to rounding."""
    std = np.full(len(VELOCITIES), STD)
    sides, slopes = mean_sides(MeanSign.of(VELOCITIES, std, WIDTH), VELOCITIES, std, WIDTH)
    size, by_v = np.ones_like(VELOCITIES), np.zeros_like(VELOCITIES)
    for share, rate in REST:
        spread = WIDTH**2 + 2.0 * rate * STD**2
        bell = share * WIDTH / np.sqrt(spread) * np.exp(-rate * VELOCITIES**2 / spread)
        size, by_v = size - bell, by_v + 2.0 * rate * VELOCITIES / spread * bell
    np.testing.assert_allclose(sides[:, 1] - sides[:, 0], size, atol=1e-14)
    np.testing.assert_allclose(slopes[:, 1] - slopes[:, 0], by_v, atol=1e-12 / WIDTH)
