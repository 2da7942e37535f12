"""What is named although other laws explain as much has not earned its name."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

import drake_cafim
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.search import shared_evidence
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.joint import JointCoulombFriction
from tests.turntable import write_turntable

COULOMB = JointCoulombFriction("j1", {"torque": 1.0})


def _judgement(monkeypatch: pytest.MonkeyPatch, probability: float) -> Judgement:
    """An explained verdict by a friction of that probability."""
    nominal = Fit(Model(np.zeros(0)), np.ones(1000), np.zeros((1000, 0)), np.eye(0), 1000)
    best = Fit(Model(np.zeros(0), (COULOMB,)), np.ones(1000), np.zeros((1000, 1)), np.eye(1), 1000, unbiased=True)
    monkeypatch.setattr(shared_evidence, "mean_square", lambda *of: 2.0)
    outcome: Any = SimpleNamespace(
        problem=None, nominal_problem=None, nominal=nominal, scale=1.0, probability={COULOMB.key: probability}
    )
    return Judgement(outcome, best, "explained")


def test_a_name_that_shares_its_evidence_is_withheld_and_told_why(monkeypatch: pytest.MonkeyPatch) -> None:
    trace = Trace()
    found = shared_evidence.withhold_shared(_judgement(monkeypatch, 0.49), trace)
    assert found.kind == "unexplained" and found.withheld == (COULOMB,) and found.best is found.outcome.nominal
    assert found.left == 2.0
    (record,) = trace.records
    assert record.test == "probability" and not record.passed


def test_what_has_half_of_the_probability_keeps_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    judgement, trace = _judgement(monkeypatch, 0.5), Trace()
    assert shared_evidence.withhold_shared(judgement, trace) is judgement and not trace.records


def test_a_steady_turn_does_not_tell_which_friction(tmp_path: Path) -> None:
    """At one speed a viscous, a Coulomb friction and a biased motor are the same."""
    rng, time = np.random.default_rng(2), np.arange(0.0, 4.0, 0.004)
    table = {
        "time": time,
        "q.axis": time + rng.normal(0.0, 1e-4, time.size),
        "v.axis": 1.0 + rng.normal(0.0, 1e-3, time.size),
        "u.axis": np.full(time.size, 0.3),
    }
    write_turntable(tmp_path, pd.DataFrame(table), (1e-4, 1e-3), 0.1)
    recording = drake_cafim.read(tmp_path / "run.parquet")
    verdict = drake_cafim.diagnose(drake_cafim.Scene.load(tmp_path / "scenario.yaml"), [recording])
    assert verdict.kind == "unexplained" and not verdict.explanation
    assert {"joint_coulomb_friction", "actuator_bias"} <= {rival.effect for rival in verdict.rivals}
    assert "do not tell which" in str(verdict)
    assert verdict.mismatch.locations[0].name == "axis"
    # the corrected scene has the force all the same, without a name
    (learned,) = verdict.learned
    assert learned.words == "at axis a force that is −0.30 N m throughout"
