"""A law that would take whatever effort there is away again is no explanation."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import drake_cafim
from tests.turntable import write_turntable

INERTIA = 0.002
"""kg m²: next to nothing beside the friction."""


@pytest.mark.long
def test_dry_friction_that_wanders_is_not_told_as_a_share_of_the_effort(tmp_path: Path) -> None:
    """All effort goes into friction, so that with a share of 1 of it lost nothing would be left, whatever it was."""
    random, time = np.random.default_rng(3), np.arange(0.0, 12.0, 0.004)
    rates, phases, sizes = (
        2.0 * np.pi * np.array([0.31, 0.73, 1.1]),
        np.array([0.3, 1.0, 2.0]),
        np.array([0.8, 0.4, 0.2]),
    )
    angles = rates * time[:, None] + phases
    q, v, a = np.sin(angles) @ sizes, np.cos(angles) @ (sizes * rates), -np.sin(angles) @ (sizes * rates**2)
    level = 0.3 + 0.15 * np.sin(0.9 * time) + 0.1 * np.sin(2.0 * q)
    table = {
        "time": time,
        "q.axis": q + random.normal(0.0, 1e-4, time.size),
        "v.axis": v + random.normal(0.0, 1e-3, time.size),
        "u.axis": INERTIA * a + level * np.tanh(v / 0.01) + random.normal(0.0, 0.005, time.size),
    }
    write_turntable(tmp_path, pd.DataFrame(table), (1e-4, 1e-3), INERTIA)
    recording = drake_cafim.read(tmp_path / "run.parquet")
    verdict = drake_cafim.diagnose(drake_cafim.Scene.load(tmp_path / "scenario.yaml"), [recording])
    assert verdict.kind == "unexplained"
    named = [found.effect.name for found in verdict.explanation]
    assert "joint_load_dependent_friction" not in named and "actuator_gain_error" not in named
