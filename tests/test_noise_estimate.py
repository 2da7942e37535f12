"""The estimated noise of a channel without a stated std, the same for a joint as for a tracked body."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.noise.differences import noise_std
from drake_cafim.diagnosis.noise.stated import noise_of
from drake_cafim.diagnosis.tosses.poses import PoseTrack, noise_of_poses
from drake_cafim.recordings.recording import Recording
from tests import two_links

ROUNDED, WHITE = "rounded to 1 mm", "white"


def _values(kind: str, time: np.ndarray) -> np.ndarray:
    moving = 0.3 * np.sin(2.0 * time)
    if kind == ROUNDED:
        return np.asarray(1e-3 * np.round(moving / 1e-3))
    return np.asarray(moving + 5e-4 * np.random.default_rng(1).standard_normal(len(time)))


@pytest.mark.parametrize(("kind", "true"), [(ROUNDED, 1e-3 / np.sqrt(12.0)), (WHITE, 5e-4)])
def test_joints_and_throws_have_one_estimate(kind: str, true: float, tmp_path: Path) -> None:
    scene = two_links.scene(tmp_path, channels="channels: {v: {std: 2.0e-3}, u: {std: 0.0}}")
    time = 0.002 * np.arange(1500)
    values = _values(kind, time)
    zero = np.zeros_like(values)
    columns = {"q.shoulder": values, "q.elbow": values} | {f"{k}.{j}": zero for k in "vu" for j in two_links.JOINTS}
    recording = Recording("run", time, columns)
    joint = noise_of(scene, [recording])[0]["q.elbow"]
    still = np.tile([1.0, 0.0, 0.0, 0.0], (len(time), 1)) + 1e-4 * np.random.default_rng(2).normal(size=(len(time), 4))
    track = PoseTrack(recording, time, np.stack([values] * 3, axis=1), still)
    body = noise_of_poses(scene, "lower", [track])[0].position
    assert joint == pytest.approx(body, rel=1e-12) and joint == noise_std([(time, values)])
    assert joint == pytest.approx(true, rel=0.1)


def test_a_gap_is_no_noise() -> None:
    """What moves over a gap is left out."""
    time = 0.002 * np.arange(3000)
    values = np.sin(20.0 * time) + 2e-5 * np.random.default_rng(3).standard_normal(len(time))
    kept = np.arange(len(time)) % 12 < 9
    values = np.where(kept, values, np.nan)
    assert noise_std([(time, values)]) == pytest.approx(2e-5, rel=0.15)
