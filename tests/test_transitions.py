"""Derivatives over sample intervals in which a law changes: those of fine simulations, by coarser ones."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.likelihood import transitions as module
from drake_cafim.diagnosis.likelihood.flow import Intervals, flow, steps_of
from drake_cafim.diagnosis.likelihood.transitions import Displaced, transitions
from drake_cafim.effects.joint import JointCoulombFriction
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array, Indices
from tests.test_inertials import arm

FRICTION = JointCoulombFriction("lift", {"torque": 0.5, "slip_velocity": 5e-3})


def _moving(folder: Path) -> tuple[Physics, list[Displaced], Array, Intervals]:
    """An arm whose middle joint rubs; in half of the intervals it turns round."""
    scene, rng, B = arm(folder), np.random.default_rng(0), 40
    physics = scene.physics.with_effects([FRICTION])
    q, v = rng.uniform(-0.5, 0.5, (B, 3)), rng.uniform(0.1, 0.2, (B, 3))
    v[::2, 1] = rng.uniform(-2e-3, 2e-3, B // 2)
    effort = physics.loads(q) + rng.normal(size=(B, 3))
    intervals = Intervals(np.zeros(B), np.full(B, 4e-3), effort, effort)
    stronger = scene.physics.with_effects([replace(FRICTION, values={**FRICTION.values, "torque": 0.5 + 1e-4})])
    return physics, [Displaced(stronger, 1e-4, intervals)], np.hstack([q, v]), intervals


def test_derivatives_where_a_joint_turns_round(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    physics, displaced, state, intervals = _moving(tmp_path)
    steps = steps_of(physics, state, intervals)
    rough = steps > np.min(steps)
    assert np.all(rough[::2]) and np.max(steps) >= 4 * module.STEPS_PER_DERIVATIVE_STEP
    taken: list[Indices] = []

    def counted(item: Physics, at: Array, over: Intervals, count: Indices) -> Array:
        taken.append(count)
        return flow(item, at, over, count)

    monkeypatch.setattr(module, "flow", counted)
    found = transitions(physics, displaced, state, intervals, steps)
    # once as finely as the steps say, then for each derivative and what it is compared with
    assert np.array_equal(taken[0], steps) and len(taken) == 2 + 6 + 1 + 6
    fewer = np.maximum(steps[rough] // module.STEPS_PER_DERIVATIVE_STEP, np.min(steps))
    assert all(np.array_equal(count, fewer) for count in taken[1:])
    monkeypatch.setattr(module, "STEPS_PER_DERIVATIVE_STEP", 1)
    exact = transitions(physics, displaced, state, intervals, steps)
    np.testing.assert_array_equal(found.after, exact.after)
    for name in ("by_state", "by_parameters", "by_first", "by_last"):
        coarse, fine = (getattr(each, name) for each in (found, exact))
        off = np.linalg.norm(coarse - fine, axis=(1, 2)) / np.linalg.norm(fine, axis=(1, 2))
        assert np.max(off) < 0.02, name
        assert not np.any(off[~rough]), "a smooth interval's are those of its middle"
