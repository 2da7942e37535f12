"""What a controller makes of its sensors' noise is read off the efforts."""

import numpy as np

from drake_cafim.diagnosis.feedback import Feedback


def test_gains_of_a_noisy_loop_are_found_and_an_open_loop_has_none() -> None:
    rng = np.random.default_rng(0)
    time = 0.002 * np.arange(4000)
    smooth = np.stack([np.sin(5.0 * time), np.cos(3.0 * time)], axis=1)
    e_q, e_v = 1e-4 * rng.normal(size=smooth.shape), 1e-2 * rng.normal(size=smooth.shape)
    forward = 3.0 * smooth
    late = np.concatenate([np.zeros((1, 2)), e_v[:-1]])
    u = forward - 400.0 * e_q - late @ np.array([[20.0, 2.0], [0.0, 10.0]])
    feedback = Feedback.of(smooth + e_q, smooth + e_v, u)
    expected = -400.0 * e_q - late @ np.array([[20.0, 2.0], [0.0, 10.0]])
    error = feedback.passed_on(e_q, e_v)[1:] - expected[1:]
    assert np.std(error) < 0.05 * np.std(expected)
    alone = Feedback.of(smooth + e_q, smooth + e_v, forward + 1e-3 * rng.normal(size=smooth.shape))
    assert np.all(alone.gains == 0.0)
