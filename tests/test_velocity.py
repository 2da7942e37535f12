"""The velocity estimate for kinked friction laws, of a joint that creeps at rest, slips and stops again."""

import numpy as np
import pytest

from drake_cafim.diagnosis.rows.velocity_smoothing import Noise, Velocity, VelocityNoise, resting
from drake_cafim.diagnosis.thresholds import RESTING_SMOOTHING_REACHES, VELOCITY_SMOOTHING_REACH

STEP = 0.002
TIME = np.arange(0.0, 6.0, STEP)
CREEP = 0.002 * np.sin(2.0 * np.pi * 0.7 * TIME)
SLIPPING = (TIME > 2.0) & (TIME < 2.5)
"""It sets off and stops with a jump of its acceleration."""
V = CREEP + np.where(SLIPPING, 0.4 * np.sin(2.0 * np.pi * (TIME - 2.0)), 0.0)
Q = np.cumsum(V) * STEP
NOISE = VelocityNoise(Noise(1e-4), Noise(0.008))


def measured(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return Q + 1e-4 * rng.normal(size=len(TIME)), V + 0.008 * rng.normal(size=len(TIME))


@pytest.mark.parametrize("noise", [NOISE, VelocityNoise(NOISE.q, None)], ids=["measured", "differentiated"])
def test_a_rest_is_known_far_better_than_a_motion_and_as_well_as_it_says(noise: VelocityNoise) -> None:
    near = Velocity.over(VELOCITY_SMOOTHING_REACH, TIME, noise)
    creeping = (TIME > 3.0) & (TIME < 5.5)
    errors = []
    for seed in range(10):
        q, v = measured(seed)
        found = resting(TIME, q, v, noise)
        assert np.median(found.std[creeping]) < 0.5 * np.median(near.std[creeping])
        errors.append(((found.of(q, v) - V) / found.std)[creeping])
    assert 0.8 < np.sqrt(np.mean(np.square(errors))) < 1.2


def test_a_slip_is_not_rounded_off() -> None:
    """Its ends are corners, from which a wide window would swing, by 20 times its noise on the average."""
    around, wide = (TIME > 1.8) & (TIME < 2.7), Velocity.over(RESTING_SMOOTHING_REACHES[-1], TIME, NOISE)
    errors, swings = [], []
    for seed in range(10):
        q, v = measured(seed)
        found = resting(TIME, q, v, NOISE)
        errors.append(((found.of(q, v) - V) / found.std)[around])
        swings.append(((wide.of(q, v) - V) / wide.std)[around])
    assert np.sqrt(np.mean(np.square(errors))) < 1.2
    assert np.max(np.abs(np.mean(errors, axis=0))) < 3.0
    assert np.sqrt(np.mean(np.square(swings))) > 15.0
