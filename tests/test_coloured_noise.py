"""Coloured noise: drawn, detected, and not detected where the noise is white."""

import numpy as np
import pytest

from drake_cafim.diagnosis.noise import coloured as coloured_noise
from drake_cafim.diagnosis.noise.coloured import (
    Memory,
    covariance,
    difference_std,
    drawn,
    estimate_memories,
    filtered_std,
)
from drake_cafim.diagnosis.noise.differences import correct_for_memory
from drake_cafim.numerics.local_polynomial import local_polynomial
from drake_cafim.recordings.recording import Recording

STEP, STD = 0.002, 1e-3


def _recordings(correlation_time: float) -> list[Recording]:
    time = STEP * np.arange(3000)
    motion = 0.7 * np.sin(7.0 * time)
    rngs = [np.random.default_rng(seed) for seed in range(3)]
    memory = Memory(correlation_time) if correlation_time else None
    noises = [STD * drawn(rng, time, memory) for rng in rngs]
    return [Recording(f"run {k}", time, {"v.joint": motion + noise}) for k, noise in enumerate(noises)]


@pytest.mark.parametrize("memory", [Memory(0.004), Memory(0.004, share=0.5, white=0.2)])
def test_drawn_noise_has_the_covariance(memory: Memory) -> None:
    rng, time = np.random.default_rng(0), STEP * np.arange(6)
    samples = np.stack([drawn(rng, time, memory) for _ in range(20000)])
    np.testing.assert_allclose(samples.T @ samples / len(samples), covariance(time, memory).toarray(), atol=0.03)


@pytest.mark.parametrize("memory", [None, Memory(0.012)])
def test_what_a_smoother_leaves_of_noise(memory: Memory | None) -> None:
    """A slope over 16 ms of noise that hardly changes meanwhile is far quieter than one of white noise."""
    rng, time = np.random.default_rng(0), STEP * np.arange(20)
    slope = local_polynomial(time, 0.008, 3, 1)
    results = slope @ np.stack([drawn(rng, time, memory) for _ in range(20000)], axis=1)
    np.testing.assert_allclose(filtered_std(slope, time, memory), np.std(results, axis=1), rtol=0.03)


# with σ unknown, only a memory that ends within the quiet frequencies can be told from a shorter, louder one
@pytest.mark.parametrize(("correlation_time", "estimated"), [(0.003, set()), (0.02, set()), (0.003, {"v.joint"})])
def test_undeclared_memory_is_seen(correlation_time: float, estimated: set[str]) -> None:
    found, told = estimate_memories(_recordings(correlation_time), {"v.joint": STD}, {}, estimated)
    assert found["v.joint"].time == pytest.approx(correlation_time, rel=0.35)
    assert len(told) == 1 and "noise of v" in told[0]


def test_white_noise_is_left_alone() -> None:
    assert estimate_memories(_recordings(0.0), {"v.joint": STD}, {}, set()) == ({}, ())
    assert estimate_memories(_recordings(0.02), {"v.joint": STD}, {"v.joint": Memory(0.02)}, set()) == ({}, ())


def test_what_fourth_differences_miss_of_slow_noise_is_put_back() -> None:
    time = STEP * np.arange(200000)
    noise = drawn(np.random.default_rng(1), time, Memory(0.01))
    seen = float(np.std(np.diff(noise, n=4))) / np.sqrt(70.0)
    assert seen < 0.5
    wide = correct_for_memory({"v.joint": seen, "q.joint": 1.0}, {"v.joint": Memory(0.01)}, {"v.joint"}, STEP)
    assert wide["v.joint"] == pytest.approx(1.0, rel=0.02) and wide["q.joint"] == 1.0


@pytest.mark.parametrize("memory", [None, Memory(0.01), Memory(0.004, share=0.6, white=0.4)])
def test_how_far_two_smoothers_are_apart(memory: Memory | None) -> None:
    time = 0.002 * np.arange(300)
    smoothers = [local_polynomial(time, reach, 3, 0) for reach in (0.05, 0.03, 0.02)]
    apart = difference_std(smoothers, time, memory)
    for i, smoother in enumerate(smoothers):
        for j, other in enumerate(smoothers):
            np.testing.assert_allclose(apart[i, j], filtered_std(smoother - other, time, memory), rtol=1e-9, atol=1e-9)


def test_covariances_are_kept_by_all_that_they_depend_on(monkeypatch: pytest.MonkeyPatch) -> None:
    times = [0.002 * np.arange(50), 0.003 * np.arange(50)]
    cases = [
        (time, Memory(tau, share, 1.0 - share)) for time in times for tau in (0.0101, 0.0203) for share in (1.0, 0.5)
    ]
    for most in (coloured_noise.CACHED_ENTRIES, 1000):
        monkeypatch.setattr(coloured_noise, "CACHED_ENTRIES", most)
        monkeypatch.setattr(coloured_noise, "_COVARIANCES", {})
        for _ in range(2):
            for time, memory in cases:
                age = np.abs(np.subtract.outer(time, time)) / memory.time
                wanted = np.where(age > coloured_noise.MEMORY, 0.0, memory.share * np.exp(-age))
                found = covariance(time, memory).toarray()
                np.testing.assert_allclose(found, wanted + memory.white * np.eye(50), atol=1e-12)
