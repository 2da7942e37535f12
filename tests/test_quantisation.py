"""Rounding that lasts: recognised, with the memory that the errors of a slow channel really have."""

import numpy as np
import pytest

from drake_cafim.diagnosis.coloured_noise import covariance
from drake_cafim.diagnosis.quantisation import dwell, quantised_memories, quantum
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
    assert dwell(TIME, _rounded(0.004 * TIME), LEVEL) == pytest.approx(0.1, rel=0.05)


@pytest.mark.parametrize("dither", [0.0, 0.15])
def test_memory_is_that_of_the_errors(dither: float) -> None:
    """The variance of differences over 10 samples, of ramps of many speeds, against the memory's own."""
    rng = np.random.default_rng(1)
    ratios = []
    for speed in rng.uniform(0.005, 0.02, 40):
        true = rng.uniform() + speed * TIME
        seen = _rounded(true + dither * LEVEL * rng.standard_normal(len(TIME)))
        std = float(np.std(seen - true))
        memory = quantised_memories(Recording("a", TIME, {"q.a": seen}), {"q.a": std})["q.a"]
        error = (seen - true) / std
        expected = covariance(TIME[:11], memory).toarray()
        ratios.append(np.mean((error[10:] - error[:-10]) ** 2) / (2.0 * (expected[0, 0] - expected[0, 10])))
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.2)


def test_fast_and_continuous_channels_are_white() -> None:
    fast = _rounded(0.3 * np.sin(9.0 * TIME))
    noisy = 0.3 * np.sin(9.0 * TIME) + 1e-4 * np.random.default_rng(2).standard_normal(len(TIME))
    recording = Recording("a", TIME, {"q.a": fast, "q.b": noisy})
    assert quantised_memories(recording, {"q.a": LEVEL / 3.46, "q.b": 1e-4}) == {}
