"""Quantised channels are recognised, and the autocorrelation of a slow channel's rounding errors is estimated."""

import numpy as np
import pytest

from drake_cafim.diagnosis.noise.coloured import covariance, drawn
from drake_cafim.diagnosis.noise.quantised import Rounding, dwell, quantised_memories, quantum
from drake_cafim.recordings.recording import Recording

INTERVAL, LEVEL = 0.002, 4e-4
TIME = INTERVAL * np.arange(4000)


def _rounded(values: np.ndarray) -> np.ndarray:
    return LEVEL * np.round(values / LEVEL)


def test_lattice_is_seen_and_nothing_else_taken_for_one() -> None:
    motion = 0.1 * np.sin(2.0 * TIME)
    assert quantum(_rounded(motion)) == pytest.approx(LEVEL)
    assert quantum(motion + 1e-4 * np.random.default_rng(0).standard_normal(len(TIME))) is None
    assert quantum(np.zeros(100)) is None


def test_dwell_is_the_step_over_the_speed() -> None:
    assert np.median(dwell(TIME, _rounded(0.004 * TIME), LEVEL)) == pytest.approx(0.1, rel=0.05)
    lasting = dwell(TIME, _rounded(0.004 * TIME + 0.004 * TIME**2), LEVEL)
    np.testing.assert_allclose(lasting[500:3500:500], 0.1 / (1.0 + 2.0 * TIME[500:3500:500]), rtol=0.2)


@pytest.mark.parametrize(("dither", "steps"), [(0.0, 0), (0.15, 0), (0.0, 1), (0.0, -3)])
def test_memory_is_that_of_the_errors(dither: float, steps: int) -> None:
    """The variance of differences over 10 samples, of ramps of many speeds, against the memory's own.

    A ramp that is faster by whole `steps` a sample has the same errors.
    """
    rng = np.random.default_rng(1)
    ratios = []
    for speed in rng.uniform(0.005, 0.02, 40):
        true = rng.uniform() + (speed + steps * LEVEL / INTERVAL) * TIME
        seen = _rounded(true + dither * LEVEL * rng.standard_normal(len(TIME)))
        std = float(np.std(seen - true))
        memory = quantised_memories(Recording("a", TIME, {"q.a": seen}), {"q.a": std})["q.a"]
        error = (seen - true) / std
        expected = covariance(TIME, memory)[:11, :11].toarray()
        ratios.append(np.mean((error[10:] - error[:-10]) ** 2) / (2.0 * (expected[0, 0] - expected[0, 10])))
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.2)


def test_errors_last_where_the_channel_is_slow() -> None:
    """Variances of differences, at the reversals of many swings and between them, against the memory's own."""
    rng = np.random.default_rng(3)
    ratios = []
    for swing in rng.uniform(0.02, 0.03, 60):
        true = rng.uniform() + swing * np.sin(2.0 * TIME + rng.uniform())
        seen = _rounded(true)
        memory = quantised_memories(Recording("a", TIME, {"q.a": seen}), {"q.a": LEVEL / np.sqrt(12.0)})["q.a"]
        error, size = (seen - true) / (LEVEL / np.sqrt(12.0)), covariance(TIME, memory)
        speed = np.abs(np.gradient(true, TIME))
        ratios.append([])
        for lag, there in ((5, speed < 0.01), (1, speed > 0.03)):
            at = np.flatnonzero(there[:-lag])
            expected = 2.0 * size.diagonal().mean() - 2.0 * np.mean(size.diagonal(lag)[at])
            ratios[-1].append(np.mean((error[at + lag] - error[at]) ** 2) / expected)
    np.testing.assert_allclose(np.mean(ratios, axis=0), 1.0, atol=0.2)


def test_drawn_errors_have_the_memorys_covariance() -> None:
    time = INTERVAL * np.arange(12)
    memory = Rounding(np.geomspace(0.004, 0.1, len(time)), 0.8, 0.2, LEVEL)
    rng = np.random.default_rng(4)
    samples = np.stack([drawn(rng, time, memory) for _ in range(20000)])
    np.testing.assert_allclose(samples.T @ samples / len(samples), covariance(time, memory).toarray(), atol=0.03)


def test_dithered_and_continuous_channels_are_white() -> None:
    noise = LEVEL * np.random.default_rng(2).standard_normal(len(TIME))
    fast = _rounded(0.3 * np.sin(9.0 * TIME) + noise)
    noisy = 0.3 * np.sin(9.0 * TIME) + noise
    recording = Recording("a", TIME, {"q.a": fast, "q.b": noisy})
    assert quantised_memories(recording, {"q.a": 1.04 * LEVEL, "q.b": LEVEL}) == {}


def test_a_channel_that_moves_by_other_shares_of_a_step_all_the_time_is_white() -> None:
    """Ever faster, by 1.7 steps a sample more from one to the next: shares .0, .7, .4, .1, .8 and so on."""
    faster = _rounded(0.5 * 1.7 * LEVEL * np.arange(len(TIME)) ** 2)
    assert quantised_memories(Recording("a", TIME, {"q.a": faster}), {"q.a": LEVEL / np.sqrt(12.0)}) == {}


def test_readings_of_a_motion_err_as_its_encoder_does() -> None:
    motion = 0.1 * np.sin(TIME)
    memory = quantised_memories(Recording("a", TIME, {"q.a": _rounded(motion)}), {"q.a": LEVEL / np.sqrt(12.0)})["q.a"]
    errors = memory.of_readings(np.random.default_rng(5), motion, LEVEL / np.sqrt(12.0), 200)
    assert np.abs(errors).max() <= 0.5 * LEVEL
    assert np.std(errors) == pytest.approx(LEVEL / np.sqrt(12.0), rel=0.05)
    # beside the lattice anywhere: the motion plus the error is a multiple of the step after one shift of all samples
    lattice = (motion[:, None] + errors) / LEVEL
    np.testing.assert_allclose((lattice - lattice[0] + 0.5) % 1.0, 0.5, atol=1e-6)
