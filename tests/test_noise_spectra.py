"""How long undeclared noise lasts, by its spectrum down to where the motion shows; its variance stated or not."""

from collections.abc import Callable

import numpy as np
import pytest

from drake_cafim.diagnosis.noise.coloured import Memory, drawn, estimate_memories, step_of
from drake_cafim.diagnosis.noise.differences import correct_for_memory, noise_std
from drake_cafim.diagnosis.noise.spectra import MAIN_LOBE, first_order_memory, spectrum
from drake_cafim.diagnosis.thresholds import ESTIMATED_NOISE_LOG_VARIANCE_REACH
from drake_cafim.recordings.recording import Recording
from drake_cafim.typing import Array

STD, SEEDS = 1e-3, 8
Motion = Callable[[Array], Array]


def slow(time: Array) -> Array:
    return np.asarray(0.7 * np.sin(7.0 * time), dtype=float)


def abrupt(time: Array) -> Array:
    """Harmonics up to 80 Hz that fall as those of a motion whose acceleration jumps; the noise is above from 30 Hz."""
    return slow(time) + sum(0.2 * k**-3.0 * np.sin(2.0 * np.pi * k * time + k * k) for k in range(1, 80))


def _found(
    tau: float, seed: int, *, step: float = 0.002, motion: Motion = slow, stated: bool = True
) -> tuple[float, float]:
    """The estimated correlation time and std of the noise of three recordings of 6 s, each over the true one."""
    rng, time = np.random.default_rng(seed), step * np.arange(round(6.0 / step))
    runs = [Recording(f"run {k}", time, {"v.a": motion(time) + STD * drawn(rng, time, Memory(tau))}) for k in range(3)]
    std = {"v.a": STD if stated else noise_std([(run.time, run.columns["v.a"]) for run in runs])}
    estimated = set() if stated else {"v.a"}
    memories, _ = estimate_memories(runs, std, {}, estimated)
    wide = correct_for_memory(std, memories, estimated, step_of(runs))
    return memories["v.a"].time / tau if memories else 0.0, wide["v.a"] / STD


@pytest.mark.parametrize("memory", [None, Memory(0.02)], ids=["white", "coloured"])
@pytest.mark.parametrize("samples", [128, 250])
def test_a_spectrum_is_what_its_window_makes_of_the_noise(samples: int, memory: Memory | None) -> None:
    rng, time = np.random.default_rng(3), 0.002 * np.arange(samples * 200)
    seen = spectrum([drawn(rng, time, memory) for _ in range(10)], samples)
    assert seen is not None and seen.segments == 10 * (2 * 200 - 1)
    off = seen.log_power - seen.of_noise(np.exp(-0.002 / memory.time) if memory else 0.0)
    # lower down and at the highest frequency the periodogram is no sum of two equal squares
    used = slice(MAIN_LOBE, -1)
    assert np.abs(off[used]).max() < 4.0 * np.sqrt(seen.variance)
    assert np.sqrt(np.mean(off[used] ** 2) / seen.variance) == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize(("motion", "within"), [(slow, 0.1), (abrupt, 0.16)])
@pytest.mark.parametrize("tau", [0.003, 0.007, 0.02, 0.03])
def test_the_correlation_time_of_noise_of_a_stated_variance(tau: float, motion: Motion, within: float) -> None:
    """It was off by a fifth either way: a variance within the stated one's reach was as good as any other.

    What the abrupt motion adds at 12 and 16 Hz is too little to be seen, and makes long times a tenth longer.
    """
    found = np.array([_found(tau, seed, motion=motion)[0] for seed in range(SEEDS)])
    assert np.sqrt(np.mean((found - 1.0) ** 2)) < within


@pytest.mark.parametrize("step", [0.002, 0.001])
@pytest.mark.parametrize(("tau", "within"), [(0.003, 0.1), (0.007, 0.1), (0.02, 0.35)])
def test_variance_and_correlation_time_are_told_apart(tau: float, within: float, step: float) -> None:
    """Above 60 Hz they are not, but for the shortest: 7 ms were told as 4 to 50."""
    found = np.array([_found(tau, seed, step=step, stated=False) for seed in range(SEEDS)])
    assert np.sqrt(np.mean((found[:, 0] - 1.0) ** 2)) < within
    assert np.sqrt(np.mean((found[:, 1] - 1.0) ** 2)) < 0.5 * within


@pytest.mark.parametrize("stated", [True, False])
def test_a_fast_recording_hides_no_colour(stated: bool) -> None:
    """At 4 kHz the lowest frequencies of the periodogram hold mainly what Hann's window lets in from beside."""
    found = np.array([_found(0.007, seed, step=0.00025, stated=stated)[0] for seed in range(3)])
    assert np.abs(found - 1.0).max() < 0.15


@pytest.mark.parametrize(("tau", "step", "seconds"), [(0.008, 0.004, 8.0), (0.025, 0.01, 16.0)])
def test_a_single_slowly_sampled_joint_tells_that_its_noise_lasts(tau: float, step: float, seconds: float) -> None:
    """Of segments that share nothing, half of these were told as white; with that noise more than it is left over."""
    time, told = step * np.arange(round(seconds / step)), []
    for seed in range(2 * SEEDS):
        rng = np.random.default_rng(seed)
        pieces = [slow(time) / STD + drawn(rng, time, Memory(tau)) for _ in range(3)]
        told.append(first_order_memory(pieces, step, ESTIMATED_NOISE_LOG_VARIANCE_REACH, 0.99) > 0.0)
    assert np.mean(told) > 0.8


@pytest.mark.parametrize("step", [0.001, 0.004, 0.01])
def test_white_noise_is_told_as_white(step: float) -> None:
    time = step * np.arange(2000)
    for seed in range(20 * SEEDS):
        rng = np.random.default_rng(seed)
        pieces = [slow(time) / STD + rng.standard_normal(time.size) for _ in range(3)]
        assert first_order_memory(pieces, step, ESTIMATED_NOISE_LOG_VARIANCE_REACH, 0.99) == 0.0
