"""A push is named only where nothing but noise is left while it acts."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.search import pushes
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.body import ExternalDisturbance
from drake_cafim.effects.joint import JointViscousFriction
from drake_cafim.typing import Array

WINDOWS, ROWS = 200, 3
TIME = np.linspace(0.0, 10.0, WINDOWS)
FRICTION = JointViscousFriction("elbow", {"coefficient": 1.0})


def _push(start: float, stop: float, recording: str) -> ExternalDisturbance:
    return ExternalDisturbance("hand", {"x": 1.0, "y": 0.0, "z": 0.0, "start": start, "stop": stop}, recording)


EARLY, LATE = _push(1.0, 2.0, "a"), _push(6.0, 7.0, "b")


@pytest.fixture
def judgement(monkeypatch: pytest.MonkeyPatch) -> Judgement:
    """Two pushes and a friction. Far more than noise is left in "a" from 6 to 7 s, and in "b" while the push acts."""
    left = np.random.default_rng(1).normal(size=(2, WINDOWS, ROWS))
    left[:, (TIME > 6.0) & (TIME < 7.0)] *= 2.0
    problem: Any = SimpleNamespace(
        rows=left.size,
        runs=[SimpleNamespace(name=name, shape=(WINDOWS, ROWS), time=TIME) for name in ("a", "b")],
        rows_of=lambda model: left.ravel(),
    )
    problem.rewhitened = lambda model: problem
    monkeypatch.setattr(pushes, "unbiased_fit", lambda problem, model: _fit(model, left))
    monkeypatch.setattr(pushes, "mean_square", lambda problem, fit: 3.0)
    outcome: Any = SimpleNamespace(problem=problem, nominal_problem=problem, nominal=_fit(Model(np.zeros(0)), left))
    return Judgement(outcome, _fit(Model(np.zeros(0), (EARLY, FRICTION, LATE)), left), "unexplained", left=2.0)


def _fit(model: Model, left: Array) -> Fit:
    width = len(model.vector)
    return Fit(model, left.ravel(), np.zeros((left.size, width)), np.eye(width), left.size)


def test_the_push_during_which_more_is_left_is_not_named(judgement: Judgement) -> None:
    trace = Trace()
    found = pushes.withhold_refuted_pushes(judgement, Settings(), trace)
    assert found.best.model.effects == (EARLY, FRICTION)
    assert found.kind == "unexplained" and found.left == 3.0 and not found.withheld
    asked = {record.asked: record for record in trace.records}
    assert len(trace.records) == 2 and {record.passed for record in trace.records} == {True, False}
    assert all("while it acts" in record.words for record in asked.values())


def test_without_any_other_effect_the_nominal_fit_stands(judgement: Judgement) -> None:
    alone = Judgement(
        judgement.outcome, _fit(Model(np.zeros(0), (LATE,)), np.full((2, WINDOWS, ROWS), 9.0)), "unexplained"
    )
    assert pushes.withhold_refuted_pushes(alone, Settings(), Trace()).best is alone.outcome.nominal


@pytest.mark.parametrize("change", [{"kind": "explained"}, {"adequate": True}])
def test_where_nothing_but_noise_is_left_no_push_is_asked(judgement: Judgement, change: dict[str, Any]) -> None:
    sure, trace = Judgement(**{**vars(judgement), **change}), Trace()
    assert pushes.withhold_refuted_pushes(sure, Settings(), trace) is sure and not trace.records
