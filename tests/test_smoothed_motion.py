"""The smoother of a joint's motion: by direct inversion of all samples' covariance, and the truth within its stds."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.random import Generator
from scipy.linalg import block_diag

from drake_cafim.diagnosis.noise.coloured import CorrelatedNoise, Memory
from drake_cafim.diagnosis.noise.quantised import Rounding
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.rows.trajectory import ChannelNoise, Trajectory, Transition, smooth
from drake_cafim.typing import Array
from tests import two_links

STEP, Q_STD, V_STD = 0.002, 2e-4, 4e-3
WHITE = 0.1
"""Share of white noise in each channel's variance, beside noise that lasts."""


def _noise(time: Array, std: float, memory: CorrelatedNoise | None) -> ChannelNoise:
    if memory is None:
        return ChannelNoise(np.full(len(time), std**2))
    return ChannelNoise(np.full(len(time), WHITE * std**2), std, memory.process(time))


def _covariance(time: Array, std: float, memory: CorrelatedNoise | None) -> Array:
    if memory is None:
        return std**2 * np.eye(len(time))
    age = memory.age(time)
    alike = memory.correlation(np.abs(age[:, None] - age))
    return std**2 * (alike + WHITE * np.eye(len(time)))


def _wandering(rng: Generator, time: Array, density: float) -> Array:
    """Position and velocity (2, N) of a body that white noise of this density accelerates, from rest."""
    h = np.diff(time)
    pushes = rng.normal(size=(2, len(h))) * np.sqrt(density * h)
    v = np.concatenate([[0.0], np.cumsum(pushes[0])])
    way = h * (0.5 * (v[1:] + v[:-1]) + pushes[1] / h**0.5 * np.sqrt(h / 12.0))
    return np.stack([np.concatenate([[0.0], np.cumsum(way)]), v])


def _read(rng: Generator, truth: Array, covariances: tuple[Array, ...]) -> Array:
    return np.stack(
        [x + np.linalg.cholesky(C) @ rng.normal(size=len(x)) for x, C in zip(truth, covariances, strict=True)]
    )


def _smoothed(time: Array, read: Array, noises: tuple[ChannelNoise, ChannelNoise]) -> Trajectory:
    unknown = Transition.unknown(time, 1)
    return smooth(time, read[0][:, None], read[1][:, None], noises[:1], noises[1:], unknown)


def _by_inversion(time: Array, read: Array, covariances: tuple[Array, ...], density: float) -> tuple[Array, Array]:
    """Means and variances (2 N,) of q and v given all samples of both, or of q; of a motion whose start is unknown."""
    t, s = time[:, None] - time[0], time[None] - time[0]
    first, apart = np.minimum(t, s), np.abs(t - s)
    own = density * np.block(
        [
            [first**3 / 3.0 + apart * first**2 / 2.0, _cross(t, s)],
            [_cross(s, t), first],
        ]
    )
    start = np.block([[1.0 + 0.0 * t, t], [0.0 * t, 1.0 + 0.0 * t]])
    prior = own + 1e2 * start @ start.T
    noise = block_diag(*covariances)
    seen = prior[: len(noise)]
    gain = np.linalg.solve(seen[:, : len(noise)] + noise, seen).T
    return gain @ read.ravel(), np.diag(prior - gain @ seen)


def _cross(t: Array, s: Array) -> Array:
    """The covariance of ∫₀ᵗ w and w at s, of a Wiener process w with unit density."""
    return np.where(s <= t, s * t - s**2 / 2.0, t**2 / 2.0)


MEMORIES = [
    (None, None),
    (None, Memory(0.02)),
    (Memory(0.01), Memory(0.01)),
    (Rounding(np.full(60, 0.015), 1.0, 0.0, 1e-3), None),
]


@pytest.mark.parametrize("memories", MEMORIES)
def test_it_is_the_mean_given_all_samples(memories: tuple[CorrelatedNoise | None, CorrelatedNoise | None]) -> None:
    rng = np.random.default_rng(3)
    time = STEP * np.arange(60) + rng.uniform(0.0, 0.3 * STEP, 60)
    stds = (Q_STD, V_STD)
    noises = tuple(_noise(time, *both) for both in zip(stds, memories, strict=True))
    covariances = tuple(_covariance(time, *both) for both in zip(stds, memories, strict=True))
    read = _read(rng, _wandering(rng, time, 1.0), covariances)
    found = _smoothed(time, read, noises)
    mean, variance = _by_inversion(time, read, covariances, float(found.density[0]))
    std = np.sqrt(variance)
    inner = slice(2, None)
    np.testing.assert_allclose(found.q[inner, 0], mean[:60][inner], atol=1e-3 * std[30])
    np.testing.assert_allclose(found.v[inner, 0], mean[60:][inner], atol=1e-3 * std[90])
    np.testing.assert_allclose(found.q_std[inner, 0], std[:60][inner], rtol=1e-3)
    np.testing.assert_allclose(found.v_std[inner, 0], std[60:][inner], rtol=1e-3)


def test_rounding_leaves_the_first_state_of_positions_that_hardly_scatter() -> None:
    """A start that is as good as unknown loses digits: without white noise the first velocity had no std at all."""
    rng, memory, white, q_std = np.random.default_rng(3), Memory(0.03), 1e-6, 5e-4
    time = STEP * np.arange(60)
    covariance = _covariance(time, q_std, memory) + (white - WHITE) * q_std**2 * np.eye(60)
    read = _read(rng, _wandering(rng, time, 1.0)[:1], (covariance,))
    noises = ChannelNoise(np.full(60, white * q_std**2), q_std, memory.process(time)), ChannelNoise(np.full(60, np.inf))
    found = _smoothed(time, np.stack([read[0], np.zeros(60)]), noises)
    _, variance = _by_inversion(time, read, (covariance,), float(found.density[0]))
    np.testing.assert_allclose(found.v_std[:, 0], np.sqrt(variance[60:]), rtol=1e-3)


@pytest.mark.parametrize("memories", [(None, None), (None, Memory(0.02)), (Memory(0.01), Memory(0.01))])
def test_the_truth_lies_within_its_stds(memories: tuple[Memory | None, Memory | None]) -> None:
    """Noise that lasts, taken as white of its long-run variance, had stds twice the errors."""
    rng, time = np.random.default_rng(4), STEP * np.arange(2000)
    stds = (Q_STD, V_STD)
    truth = _wandering(rng, time, 1.0)
    covariances = tuple(_covariance(time, *both) for both in zip(stds, memories, strict=True))
    read = _read(rng, truth, covariances)
    found = _smoothed(time, read, tuple(_noise(time, *both) for both in zip(stds, memories, strict=True)))
    errors = (found.q[:, 0] - truth[0]) / found.q_std[:, 0], (found.v[:, 0] - truth[1]) / found.v_std[:, 0]
    for error in errors:
        assert float(np.sqrt(np.mean(error[5:] ** 2))) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("seed", [1, 3])
def test_coloured_velocities_of_an_arm_with_friction_nobody_knows(tmp_path: Path, seed: int) -> None:
    """As above, of a recording whose scenario states that the noise of v lasts for 20 ms."""
    channels = "channels: {q: {std: 2.0e-4}, v: {std: 4.0e-3, correlation_time: 0.02}, u: {std: 0.0}}"
    scene = two_links.scene(tmp_path, channels, "")
    exact = two_links.recording("exact", seed, friction=(0.5, 0.2), noise=(0.0, 0.0, 0.0))
    rng, noise = np.random.default_rng(seed), Memory(0.02)
    read = {name: value.copy() for name, value in exact.columns.items()}
    for joint in two_links.JOINTS:
        read[f"q.{joint}"] += 2e-4 * rng.normal(size=len(exact.time))
        read[f"v.{joint}"] += 4e-3 * noise.drawn(rng, exact.time)
    prepared = prepare(scene, [replace(exact, columns=read)])
    assert isinstance(prepared, Prepared)
    found = prepared.problem().runs[0].weak.samples
    assert found.estimated is not None
    error = found.v - exact.matrix("v", two_links.JOINTS)
    assert float(np.sqrt(np.mean((error / found.estimated.v_std)[5:] ** 2))) == pytest.approx(1.0, abs=0.25)
