"""The smoothed motion that a contact with memory integrates: its smoothness is that which the noise requires."""

import numpy as np
import pytest

from drake_cafim.diagnosis.noise.coloured import Memory, drawn
from drake_cafim.diagnosis.rows.position_smoothing import track_of
from drake_cafim.diagnosis.thresholds import POSITION_SMOOTHING_REACHES
from drake_cafim.typing import Array

STD_Q, STD_V, TURNING = 5e-6, 3e-4, 12.0
FORTH, BACK = 0.15, 0.05
"""m/s: it goes back slower than forth, so the acceleration jumps by 1.2 m/s² where it turns, as friction makes it."""


def _clock(jitter: float, rng: np.random.Generator) -> Array:
    return 0.002 * np.arange(3000) + jitter * rng.uniform(-1.0, 1.0, 3000)


def _to_and_fro(time: Array) -> tuple[Array, Array]:
    turns, phase = np.divmod(TURNING * time, 2.0 * np.pi)
    forth = FORTH * (1.0 - np.cos(phase))
    back = 2.0 * FORTH - BACK * (1.0 + np.cos(phase))
    q = (turns * 2.0 * (FORTH - BACK) + np.where(phase < np.pi, forth, back)) / TURNING
    return q, np.where(phase < np.pi, FORTH, BACK) * np.sin(phase)


def _bent(track: Array, q: Array) -> float:
    """The root mean square of an error, m, in the middle of a recording."""
    return float(np.sqrt(np.mean((track - q)[100:-100] ** 2)))


@pytest.mark.parametrize("jitter", [0.0, 0.0003])
def test_a_reversal_is_not_rounded_off(jitter: float) -> None:
    """Twelve micrometres were taken off, which is much to a bristle of twenty-seven."""
    rng = np.random.default_rng(1)
    time = _clock(jitter, rng)
    q, v = _to_and_fro(time)
    noisy = q + STD_Q * rng.normal(size=q.size), v + STD_V * rng.normal(size=q.size)
    track = track_of(time, STD_Q, STD_V, None, None).of(*noisy)
    turned = np.abs(v) < 0.02
    assert np.abs(track_of(time, STD_Q, STD_V, None, None, widest=True).of(q, v) - q)[100:-100].max() > 1e-5
    assert _bent(track, q) < 0.3 * STD_Q
    assert np.sqrt(np.mean((track - q)[turned] ** 2)) < 0.5 * STD_Q


@pytest.mark.parametrize("memory", [None, Memory(0.01)])
def test_noise_alone_is_smoothed_as_widely_as_can_be(memory: Memory | None) -> None:
    rng = np.random.default_rng(2)
    time = _clock(0.0, rng)
    track = track_of(time, STD_Q, STD_V, memory, memory)
    widest = []
    for _ in range(10):
        q, v = STD_Q * drawn(rng, time, memory), STD_V * drawn(rng, time, memory)
        from_q, from_v = track.smoothers[0]
        widest.append(np.mean(track.of(q, v) == from_q @ q + from_v @ v))
    assert np.mean(widest) > 0.98


def test_positions_alone_turn_too() -> None:
    rng = np.random.default_rng(3)
    time = _clock(0.0, rng)
    q, v = _to_and_fro(time)
    noisy = q + 1e-6 * rng.normal(size=q.size)
    near, wide = (track_of(time, 1e-6, 0.0, None, None, widest).of(noisy, v) for widest in (False, True))
    assert _bent(near, q) < 0.6 * _bent(wide, q)


def test_what_was_laid_between_samples_is_smoothed_by_one_width() -> None:
    time = _clock(0.0, np.random.default_rng(4))
    assert len(track_of(time, STD_Q, STD_V, None, None, widest=True).smoothers) == 1
    assert len(track_of(time, STD_Q, STD_V, None, None).smoothers) == len(POSITION_SMOOTHING_REACHES)
