"""What acts in one of the recordings alone is no name while more than noise remains: no other one confirms it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.fit.without_effects import parts_that_show
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search import growth_by_place, shared_evidence
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.actuator import ActuatorSaturation
from drake_cafim.effects.joint import JointCoulombFriction
from tests import two_links


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> tuple[SearchProblem, Fit]:
    """Friction, and a limit that the efforts of one of three recordings pass."""
    read = [two_links.recording(f"run{seed}", seed, duration=0.8, friction=(0.5, 0.0)) for seed in (1, 2, 3)]
    largest = np.sort([np.abs(run.columns["u.shoulder"]).max() for run in read])
    friction = JointCoulombFriction("shoulder", {"torque": 0.5})
    limit = ActuatorSaturation("shoulder", {"limit": 0.5 * float(largest[1] + largest[2])})
    problem = prepare(two_links.scene(tmp_path_factory.mktemp("arm")), read).problem()
    model = problem.nominal().with_effects([friction, limit])
    jacobian, residual = problem.jacobian(model), problem.residual(model)
    return problem, Fit(model, residual, jacobian, 1e-4 * np.eye(len(model.vector)), problem.rows, unbiased=True)


def test_the_parts_that_show_an_effect(fitted: tuple[SearchProblem, Fit]) -> None:
    problem, found = fitted
    friction, limit = found.model.effects
    assert np.all(parts_that_show(problem, found, friction))
    assert np.count_nonzero(parts_that_show(problem, found, limit)) == 1


@pytest.mark.parametrize("kind", ["unexplained", "explained"])
def test_it_is_withheld_where_more_than_noise_remains(
    fitted: tuple[SearchProblem, Fit], kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, found = fitted
    _, limit = found.model.effects
    for other in ("_refuted_at_place", "_varying", "_helping_some"):
        monkeypatch.setattr(shared_evidence, other, lambda *of: [])
    outcome: Any = SimpleNamespace(problem=problem, nominal_problem=problem, nominal=found)
    trace = Trace()
    judged = shared_evidence.withhold_refuted(Judgement(outcome, found, kind), Settings(), trace)
    if kind == "explained":
        assert judged.best is found and not trace.records
        return
    assert judged.withheld == (limit,) and limit not in judged.best.model.effects
    (record,) = trace.records
    assert "1 of 3 parts" in record.words and not record.passed
    assert (record.statistic, record.threshold) == (1.0, 2.0)


@pytest.mark.parametrize("noise_alone", [False, True])
def test_it_is_not_admitted_where_more_than_noise_remains(
    fitted: tuple[SearchProblem, Fit], noise_alone: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, found = fitted
    _, limit = found.model.effects
    monkeypatch.setattr(growth_by_place, "leaves_noise", lambda *of: noise_alone)
    growth: Any = SimpleNamespace(
        nominal=SimpleNamespace(plausible=lambda model: True),
        wald=lambda *of: (1e9, 1),
        threshold=lambda freedom: 1.0,
        settings=Settings(),
    )
    failure = growth_by_place.GrowthByPlace._failure(growth, problem, found, limit)
    if noise_alone:
        assert failure is None
        return
    assert failure is not None and failure[0].test == "parts that show it" and failure[0].step == "admit"
