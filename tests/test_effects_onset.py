"""Forces that begin at a depth, averaged over the duration of a sample."""

import numpy as np
import pytest

from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.effects.onset import Onset
from drake_cafim.effects.transmission import JointHardStop


def test_shares_and_depths_are_means_over_the_passage() -> None:
    depth = np.array([-3.0, -0.4, 0.0, 0.7, 5.0])
    passage = depth + np.linspace(-1.0, 1.0, 200_001)[:, None]
    onset = Onset.of(depth, 1.0)
    assert onset.share == pytest.approx(np.mean(passage > 0.0, axis=0), abs=1e-5)
    assert onset.depth == pytest.approx(np.mean(np.maximum(passage, 0.0), axis=0), abs=1e-5)
    ahead, behind = Onset.of(depth + 1e-6, 1.0), Onset.of(depth - 1e-6, 1.0)
    assert onset.slope == pytest.approx((ahead.share - behind.share) / 2e-6, abs=1e-6)
    assert onset.share == pytest.approx((ahead.depth - behind.depth) / 2e-6, abs=1e-6)


def test_the_impulse_of_a_damped_stop_does_not_depend_on_where_between_samples_it_is_met() -> None:
    stop = JointHardStop("elbow", {"position": 0.3, "stiffness": 1000.0, "damping": 30.0, "side": 1.0})
    step, speed = 2e-3, 2.0
    impulses: dict[float, list[float]] = {0.0: [], 0.5 * speed * step: []}
    for early in np.linspace(0.0, 1.0, 21):
        time = step * (np.arange(60) - early)
        q = 0.3 + speed * (time - 0.06)
        for reach, found in impulses.items():
            samples = JointSamples(q, np.full(60, speed), np.zeros(60), 0.0, np.full(60, reach))
            beyond = q[-1] + 0.5 * speed * step - 0.3
            whole = -(0.5 * 1000.0 * beyond**2 / speed + 30.0 * beyond)
            found.append(step * float(np.sum(stop.force(samples).value)) - whole)
    pointwise, averaged = (float(np.max(np.abs(found))) for found in impulses.values())
    assert averaged < 1e-9 < 0.04 < pointwise
