"""What is named although another law explains as much, or with any strength, has not earned its name."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

import drake_cafim
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.search import support
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.friction import JointStribeckFriction
from drake_cafim.effects.joint import JointCoulombFriction
from drake_cafim.effects.normal_contact import ContactAdhesion

TURNTABLE = """
<robot name="turntable">
  <link name="base"/>
  <link name="plate">
    <inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="axis" type="continuous"><parent link="base"/><child link="plate"/><axis xyz="0 0 1"/></joint>
</robot>
"""


def _judgement(monkeypatch: pytest.MonkeyPatch, effect: Effect, std: list[float], probability: float) -> Judgement:
    """An explained verdict by `effect`, known to `std`."""
    k = len(effect.strengths)
    best = Fit(Model(np.zeros(0), (effect,)), np.ones(1000), np.zeros((1000, k)), np.eye(k), 1000, unbiased=True)
    monkeypatch.setattr(support, "standard_deviations", lambda *of: np.array(std[: len(of[1].model.vector)]))
    monkeypatch.setattr(support, "mean_square", lambda *of: 2.0)
    nominal = Fit(Model(np.zeros(0)), np.ones(1000), np.zeros((1000, 0)), np.eye(0), 1000)
    outcome: Any = SimpleNamespace(
        problem=None, nominal_problem=None, nominal=nominal, scale=1.0, probability={effect.key: probability}
    )
    return Judgement(outcome, best, "explained")


COULOMB = JointCoulombFriction("j1", {"torque": 1.0})
STRIBECK = JointStribeckFriction("j1", {"coulomb": 1.0, "static": 1.2, "velocity": 0.1})
ADHESION = ContactAdhesion("ball/ground", {"force": 1.0, "range": 0.003})


@pytest.mark.parametrize(
    ("effect", "std", "probability", "reason"),
    [
        (COULOMB, [0.01], 0.49, "probability"),
        (COULOMB, [0.34], 1.0, "undetermined"),
        (STRIBECK, [0.4, 0.5, 0.01], 1.0, "undetermined"),
    ],
)
def test_a_name_without_support_is_withheld_and_told_why(
    monkeypatch: pytest.MonkeyPatch, effect: Effect, std: list[float], probability: float, reason: str
) -> None:
    trace = Trace()
    found = support.withhold_unsupported(_judgement(monkeypatch, effect, std, probability), trace)
    assert found.kind == "unexplained" and found.withheld == (effect,) and not found.best.model.effects
    assert found.left == 2.0
    (record,) = trace.records
    assert record.test == reason and not record.passed


@pytest.mark.parametrize(
    ("effect", "std", "probability"),
    [(COULOMB, [0.01], 0.5), (COULOMB, [0.33], 1.0), (ADHESION, [0.01, 0.05], 1.0), (STRIBECK, [0.01, 0.5, 0.01], 0.6)],
)
def test_what_is_determined_keeps_its_name(
    monkeypatch: pytest.MonkeyPatch, effect: Effect, std: list[float], probability: float
) -> None:
    """The range of an adhesion only shapes it."""
    judgement = _judgement(monkeypatch, effect, std, probability)
    found = support.withhold_unsupported(judgement, Trace())
    assert found.kind == "explained" and found.best is judgement.best and not found.withheld
    assert found.std is not None and list(found.std) == std


def test_a_steady_turn_does_not_tell_which_friction(tmp_path: Any) -> None:
    """At one speed a viscous, a Coulomb friction and a biased motor are the same."""
    (tmp_path / "turntable.urdf").write_text(TURNTABLE)
    (tmp_path / "scenario.yaml").write_text(
        "model: turntable.urdf\nweld: [{body: base}]\nchannels: {q: {std: 1.0e-4}, v: {std: 1.0e-3}, u: {std: 0.0}}\n"
    )
    rng, time = np.random.default_rng(2), np.arange(0.0, 4.0, 0.004)
    table = {
        "time": time,
        "q.axis": time + rng.normal(0.0, 1e-4, time.size),
        "v.axis": 1.0 + rng.normal(0.0, 1e-3, time.size),
        "u.axis": np.full(time.size, 0.3),
    }
    pd.DataFrame(table).to_parquet(tmp_path / "steady.parquet")
    recording = drake_cafim.read(tmp_path / "steady.parquet")
    verdict = drake_cafim.diagnose(drake_cafim.Scene.load(tmp_path / "scenario.yaml"), [recording])
    assert verdict.kind == "unexplained" and not verdict.explanation
    assert {"joint_coulomb_friction", "actuator_bias"} <= {rival.effect for rival in verdict.rivals}
    assert "do not tell which" in str(verdict)
    assert verdict.mismatch.locations[0].name == "axis"
    # the corrected scene has the force all the same, without a name
    (learned,) = verdict.learned
    assert learned.words == "at axis a force that is −0.30 N m throughout"
