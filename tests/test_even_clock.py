"""Uneven clocks: the motion on an even clock with its noise unchanged, and estimates of noise and rounding."""

from pathlib import Path

import numpy as np
import pytest

import drake_cafim
from drake_cafim.diagnosis.noise.clock import remove_clock_jitter
from drake_cafim.diagnosis.noise.coloured import Memory, drawn, estimate_memories
from drake_cafim.diagnosis.noise.stated import noise_of
from drake_cafim.recordings.recording import Recording

STEP, STD = 0.002, 2e-5


def _clock(rng: np.random.Generator, jitter: float) -> np.ndarray:
    steps = np.arange(3400) + jitter * rng.uniform(-0.5, 0.5, 3400)
    return STEP * np.delete(steps, slice(1200, 1600))


def _motion(time: np.ndarray) -> np.ndarray:
    return 0.7 * np.sin(4.0 * time)


@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_what_is_left_is_the_even_motion_with_the_noise_as_it_was(jitter: float) -> None:
    rng = np.random.default_rng(0)
    time, noise = _clock(rng, jitter), STD * rng.standard_normal(3000)
    even = STEP * np.delete(np.arange(3400), slice(1200, 1600))
    left = remove_clock_jitter(time, _motion(time) + noise) - _motion(even) - noise
    # the even clock may be early or late by the mean of its instants' errors
    change = np.abs(np.diff(left))
    assert np.quantile(change, 0.99) < 0.1 * STD and change.max() < STD
    if jitter:
        assert np.abs(_motion(time) - _motion(even)).max() > 20.0 * STD


def test_without_an_even_clock_nothing_is_changed() -> None:
    rng = np.random.default_rng(1)
    time = np.sort(rng.uniform(0.0, 6.0, 3000))
    np.testing.assert_array_equal(remove_clock_jitter(time, _motion(time)), _motion(time))


def test_undeclared_memory_is_seen_on_an_uneven_clock() -> None:
    found = {}
    for truth in (None, Memory(0.006)):
        runs = []
        for seed in range(3):
            rng = np.random.default_rng(seed)
            time = _clock(rng, 0.3)
            runs.append(Recording(f"run {seed}", time, {"q.a": _motion(time) + STD * drawn(rng, time, truth)}))
        found[truth], _ = estimate_memories(runs, {"q.a": STD}, {}, set())
    assert found[None] == {}
    assert found[Memory(0.006)]["q.a"].time == pytest.approx(0.006, rel=0.35)


@pytest.mark.parametrize(("speed", "quantum"), [(4.0, 0.0), (4.0, 3e-4), (0.004, 3e-4)])
def test_noise_is_estimated_on_an_uneven_clock(speed: float, quantum: float, tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(
        '<robot name="arm"><link name="base"/><link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" '
        'izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="a" type="revolute"><parent link="base"/>'
        '<child link="a"/><axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="9" velocity="9"/></joint></robot>'
    )
    rng = np.random.default_rng(3)
    time = _clock(rng, 0.3)
    true = 0.7 * np.sin(speed * time)
    seen = true + 1e-4 * rng.standard_normal(len(time))
    seen = quantum * np.round(seen / quantum) if quantum else seen
    recording = Recording("run", time, {"q.a": seen, "u.a": np.zeros(len(time))})
    scene = drake_cafim.Scene.from_model(tmp_path / "arm.urdf", weld=["base"])
    std, _ = noise_of(scene, [recording])
    assert std["q.a"] == pytest.approx(float(np.std(seen - true)), rel=0.1)
