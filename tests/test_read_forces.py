"""A law of a joint that makes up for a contact's force is refuted by the sensor that reads this force."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import Fit, unbiased_fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.search import shared_evidence
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.search.search import Outcome
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.actuator import ActuatorSaturation
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointCoulombFriction, JointViscousFriction
from drake_cafim.effects.link import Payload
from drake_cafim.effects.sensor import SensorDrift
from tests.test_diagnosis_contact import known

DRIFT = SensorDrift("q.pz", {"rate": 1e-5})
LIMIT, DRAG, RUB = (
    ActuatorSaturation("px", {"limit": 1.8}),
    JointViscousFriction("px", {"coefficient": 1.0}),
    JointCoulombFriction("py", {"torque": 1.0}),
)


def _refuted(problem: Any, *effects: Effect, kind: Any = "unexplained") -> tuple[list[Effect], Trace]:
    model, trace = Model(np.zeros(0), effects), Trace()
    fitted = Fit(model, np.zeros(1), np.zeros((1, 0)), np.zeros((0, 0)), 1)
    nominal = replace(fitted, model=Model(np.zeros(0)))
    outcome: Any = Outcome(problem, problem, nominal, fitted, (), 1, (), 0.0, {})
    judgement = Judgement(outcome, fitted, kind)
    return shared_evidence._of_forces_that_are_read(judgement, Settings(), trace), trace


@pytest.mark.parametrize(
    ("read", "beside", "refuted"),
    [
        (30.0, 900.0, True),  # the reading explains what the law was named for, and the law is against it
        (30.0, 65.0, False),  # by chance, so much
        (30.0, 20.0, False),  # what is left with the reading is the law's
        (60.0, 900.0, False),  # much is missing with the reading too
    ],
)
def test_a_law_is_refuted_where_the_reading_explains_what_it_was_named_for(
    read: float, beside: float, refuted: bool
) -> None:
    def with_reading(model: Model) -> tuple[Any, Any]:
        # of px alone, the law at py and what rides on it stand beside
        return np.array([1000.0, 0.0]), np.array([beside if LIMIT in model.effects else read, 0.0])

    tree = SimpleNamespace(joint_index=("px", "py").index)
    problem = SimpleNamespace(with_reading=with_reading, scene=SimpleNamespace(tree=tree))
    found, trace = _refuted(problem, LIMIT, Payload("tool", {"mass": 0.1}))
    assert found == ([LIMIT] if refuted else [])
    [record] = trace.records
    assert record.passed is not refuted and ("so it is not named" in record.words) is refuted


def test_laws_at_one_joint_do_not_hide_each_other() -> None:
    """Each is asked without the others there, which make up for the same force."""
    asked: list[frozenset[Any]] = []

    def with_reading(model: Model) -> tuple[Any, Any]:
        asked.append(model.keys)
        there = [effect for effect in model.effects if effect.at == "px"]
        return np.array([1000.0, 9.0]), np.array([10.0 + 500.0 * len(there), 5.0])

    tree = SimpleNamespace(joint_index=("px", "py").index)
    problem = SimpleNamespace(with_reading=with_reading, scene=SimpleNamespace(tree=tree))
    assert _refuted(problem, LIMIT, DRAG, RUB)[0] == [LIMIT, DRAG]
    assert {RUB.key} in asked and {LIMIT.key, RUB.key} in asked and {DRAG.key, RUB.key} in asked


def test_a_law_is_refuted_by_what_the_reading_says_without_any_effect() -> None:
    """An error of a sensor that was named beside it may spoil what the reading would make good."""

    def with_reading(model: Model) -> tuple[Any, Any]:
        spoilt = 400.0 if DRIFT in model.effects else 0.0
        return np.array([1000.0, 0.0]), np.array([5.0 + spoilt + 700.0 * (LIMIT in model.effects), 0.0])

    tree = SimpleNamespace(joint_index=("px", "py").index)
    problem = SimpleNamespace(with_reading=with_reading, scene=SimpleNamespace(tree=tree))
    assert _refuted(problem, LIMIT, DRIFT)[0] == [LIMIT]


def test_without_a_sensor_nothing_is_refuted() -> None:
    found, trace = _refuted(SimpleNamespace(with_reading=lambda model: None), LIMIT)
    assert not found and not trace.records


@pytest.mark.parametrize(
    ("kind", "seed", "law", "refuted"),
    [
        ("odd:odd_ageing_friction", 4, JointCoulombFriction("px", {"torque": 1.0}), True),
        ("single:joint_coulomb_friction", 5, None, False),
    ],
)
def test_of_a_press_whose_contact_is_odd_joints_are_not_blamed(
    kind: str, seed: int, law: Effect | None, refuted: bool, tmp_path: Path
) -> None:
    case = known(kind, seed, tmp_path, ("train_1",))
    prepared = case.prepared
    problem = WeakProblem.of(prepared.scene, prepared.weak, Model(prepared.scene.priors.mean))
    effects = (law,) if law is not None else case.model.effects
    fitted = unbiased_fit(problem, problem.nominal().with_effects(effects))
    nominal = unbiased_fit(problem, problem.nominal())
    outcome: Any = Outcome(problem, problem, nominal, fitted, (), 1, (), 0.0, {})
    trace = Trace()
    found = shared_evidence._of_forces_that_are_read(Judgement(outcome, fitted, "unexplained"), Settings(), trace)
    assert [effect.key for effect in found] == ([effects[0].key] if refuted else [])
    without = problem.with_reading(replace(fitted.model, effects=()))
    assert without is not None
    predicted, read = without
    if refuted:
        # with the reading all joints move as their model says
        rows = sum(run.shape[0] for run in problem.runs)
        assert np.all(read < 0.5 * rows) and np.max(predicted) > 100.0 * rows
