"""Which of two wrong explanations predicts better is a matter of chance unless blocks of time agree on it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.robust_covariance import blocks_of_time, p_value_of_no_better
from drake_cafim.diagnosis.fit.screening import Candidate
from drake_cafim.diagnosis.search import shared_evidence
from drake_cafim.diagnosis.search.conclusion import record_conclusion
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.diagnosis.verdict import Rival
from drake_cafim.effects.actuator import ActuatorBias
from drake_cafim.effects.body import ExternalDisturbance
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointViscousFriction
from drake_cafim.effects.link import RotorInertia
from drake_cafim.typing import Array
from tests.test_refuted_laws import NOTHING_UNKNOWN

WINDOWS, ROWS = 800, 2


def _problem(**more: Any) -> Any:
    runs = [SimpleNamespace(name=name, shape=(WINDOWS, ROWS)) for name in "ab"]
    known = {"realised_noise": None, "forced_joints": (), "with_reading": lambda model: None}
    return SimpleNamespace(rows=2 * WINDOWS * ROWS, runs=runs, **known, **more)


def _fit(residual: Array) -> Fit:
    return Fit(Model(np.zeros(0)), residual, np.zeros((len(residual), 0)), np.eye(0), len(residual), unbiased=True)


def test_two_that_are_as_wrong_are_told_apart_as_seldom_as_the_level_says() -> None:
    problem, p_values = _problem(), []
    for seed in range(400):
        rng = np.random.default_rng(seed)
        missing, first, second = rng.normal(size=(3, problem.rows))
        p_values.append(p_value_of_no_better(problem, _fit(missing - 0.5 * first), _fit(missing - 0.5 * second)))
    assert 0.025 < np.mean(np.array(p_values) < 0.05) < 0.08
    assert 0.025 < np.mean(np.array(p_values) > 0.95) < 0.08


def test_one_that_is_better_in_every_block_is_surely_better() -> None:
    problem, rng = _problem(), np.random.default_rng(1)
    missing, law = rng.normal(size=(2, problem.rows))
    better, worse = _fit(missing), _fit(missing + 0.5 * law)
    assert p_value_of_no_better(problem, better, worse) < 1e-3
    assert p_value_of_no_better(problem, worse, better) > 1.0 - 1e-3


def test_a_single_block_tells_nothing() -> None:
    problem = _problem()
    problem.runs = [SimpleNamespace(name="a", shape=(30, ROWS))]
    problem.rows = 30 * ROWS
    assert len(blocks_of_time(problem, _fit(np.zeros(problem.rows)))) == 1
    assert p_value_of_no_better(problem, _fit(np.zeros(problem.rows)), _fit(np.ones(problem.rows))) == 0.5


def test_the_blocks_hold_each_row_once() -> None:
    problem = _problem()
    blocks = blocks_of_time(problem, _fit(np.zeros(problem.rows)))
    assert np.concatenate([np.arange(problem.rows)[rows] for rows in blocks]).tolist() == list(range(problem.rows))


REFUTED, STANDS, OTHER = (
    JointViscousFriction("elbow", {"coefficient": 1.0}),
    RotorInertia("elbow", {"inertia": 1.0}),
    ActuatorBias("elbow", {"torque": 1.0}),
)


PUSH = ExternalDisturbance("hand", {"x": 1.0, "y": 0.0, "z": 0.0, "start": 1.0, "stop": 2.0}, "a")


def _judgement(
    monkeypatch: pytest.MonkeyPatch, alike: float, gains: float = 1.0, plausible: bool = True, name: str = ""
) -> Judgement:
    """A law whose strength changes its sign beside one that stands, with another `alike` as a part of it.

    What nobody knows takes up the rest: three times the noise. To first order that other one gains this multiple of
    what it does, and a push more than any. It was found by the search of this `name`.
    """
    rng = np.random.default_rng(3)
    first, second, else_ = rng.normal(size=(3, 2, WINDOWS, ROWS))
    slopes: dict[str, Array] = {
        REFUTED.name: first,
        STANDS.name: second,
        OTHER.name: alike * second + np.sqrt(1.0 - alike**2) * else_,
    }
    turns = np.repeat([[1.0, -0.9], [1.0, -0.9]], WINDOWS // 2, axis=1)[:, :, None]
    rows = (3.0 * rng.normal(size=first.shape) - turns * first - 0.7 * second).ravel()

    def fitted(problem: Any, model: Model) -> Fit:
        columns = [slopes[effect.name].ravel() for effect in model.effects]
        jacobian = np.stack(columns, axis=1) if columns else np.zeros((rows.size, 0))
        step = np.linalg.lstsq(jacobian, -rows, rcond=None)[0]
        covariance = np.linalg.inv(jacobian.T @ jacobian) if columns else np.eye(0)
        return Fit(model.at(step), rows + jacobian @ step, jacobian, covariance, rows.size, unbiased=True)

    def screened(problem: Any, rest: Fit, laws: list[Effect], jobs: int) -> list[Candidate]:
        assert [law.key for law in laws] == [OTHER.key]
        gained = rest.chi_square - fitted(problem, rest.model.with_effects(laws)).chi_square
        return [Candidate(PUSH, 1e9, 5, 1), Candidate(OTHER, gains * gained, 1, 1)]

    monkeypatch.setattr(shared_evidence, "unbiased_fit", fitted)
    monkeypatch.setattr(shared_evidence, "screen", screened)
    monkeypatch.setattr(shared_evidence, "mean_square", lambda *of: 9.0)
    monkeypatch.setattr(shared_evidence, "misfit_by_row", lambda problem, model: np.full(2, 9.0))
    monkeypatch.setattr(shared_evidence, "misfits_by_row", lambda of, model, others: np.full((1 + len(others), 2), 9.0))
    searched = _problem(scene=NOTHING_UNKNOWN, residual=lambda model: fitted(None, model).residual)
    nominal = _problem(
        hypotheses=lambda: (REFUTED, STANDS, OTHER),
        plausible=lambda model: plausible,
        equations=slice(None),
        likeliest_force=lambda model: None,
    )
    nothing = Model(np.zeros(0))
    outcome: Any = SimpleNamespace(
        problem=searched, nominal_problem=nominal, nominal=fitted(nominal, nothing), hypotheses=1000
    )
    found = fitted(searched, nothing.with_effects([REFUTED, STANDS]))
    return Judgement(outcome, found, "unexplained", search=name)


@pytest.mark.parametrize(("alike", "named"), [(0.999, []), (0.1, [STANDS.key])])
def test_what_stands_after_others_are_refuted_has_to_predict_better_than_what_may_replace_it(
    monkeypatch: pytest.MonkeyPatch, alike: float, named: list[Key]
) -> None:
    trace = Trace()
    found = shared_evidence.withhold_refuted(_judgement(monkeypatch, alike), Settings(), trace)
    assert found.kind == "unexplained"
    assert [effect.key for effect in found.best.model.effects] == named
    compared = [record for record in trace.records if record.test == "p-value of no better"]
    if named:
        assert not found.rivals and all(record.passed for record in compared)
    else:
        assert found.rivals.keys() == {STANDS.key, OTHER.key}
        assert sum(found.rivals.values()) == pytest.approx(1.0) and min(found.rivals.values()) > 0.01
        assert [record.passed for record in compared] == [False]


@pytest.mark.parametrize("why", [{"gains": 0.3}, {"plausible": False}, {"name": "unknown forces"}])
def test_what_is_no_explanation_of_its_own_takes_no_place(monkeypatch: pytest.MonkeyPatch, why: dict[str, Any]) -> None:
    """It gains far less to first order, acts otherwise than its name says, or was compared place by place."""
    trace = Trace()
    found = shared_evidence.withhold_refuted(_judgement(monkeypatch, 0.999, **why), Settings(), trace)
    assert [effect.key for effect in found.best.model.effects] == [STANDS.key] and not found.rivals
    assert not [record for record in trace.records if record.test == "p-value of no better"]


def test_of_two_that_predict_the_same_the_one_with_more_numbers_is_not_better() -> None:
    problem, rows = _problem(), np.ones(2 * WINDOWS * ROWS)
    larger = Fit(Model(np.zeros(1)), rows, np.zeros((len(rows), 1)), np.eye(1), len(rows), unbiased=True)
    assert p_value_of_no_better(problem, _fit(rows), _fit(rows)) == 0.5
    assert p_value_of_no_better(problem, _fit(rows), larger) == 0.0
    assert p_value_of_no_better(problem, larger, _fit(rows)) == 1.0


def test_where_nothing_is_refuted_nothing_is_compared_again(monkeypatch: pytest.MonkeyPatch) -> None:
    judgement = _judgement(monkeypatch, 0.999)
    best = shared_evidence.unbiased_fit(judgement.outcome.problem, Model(np.zeros(0)).with_effects([STANDS]))
    alone = Judgement(judgement.outcome, best, "unexplained")
    assert shared_evidence.withhold_refuted(alone, Settings(), Trace()) is alone


def test_rivals_that_were_compared_by_blocks_are_recorded_there_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """χ² of what they were found beside, which is refuted, says nothing of them."""
    judgement = shared_evidence.withhold_refuted(_judgement(monkeypatch, 0.999), Settings(), Trace())
    competing = [judgement.outcome.nominal, shared_evidence.unbiased_fit(None, Model(np.zeros(0), (OTHER,)))]  # type: ignore[arg-type]
    judgement.outcome.competing = competing  # type: ignore[misc]
    rivals = [Rival(name, at, value, "") for (name, at), value in judgement.rivals.items()]
    verdict: Any = SimpleNamespace(rivals=rivals, kind="unexplained", adequate=False)
    assert [record.step for record in record_conclusion(verdict, judgement)] == ["verdict"]
