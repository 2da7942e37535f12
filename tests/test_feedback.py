"""A controller answers forces that nobody knows: what acts by changes of efforts has to be confirmed by simulations."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from drake_cafim.diagnosis import diagnose
from drake_cafim.diagnosis.diagnose import _Predictions
from drake_cafim.diagnosis.fit.fitting import CONVERGED, fit, unbiased_fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.left_out import feedback
from drake_cafim.diagnosis.left_out.feedback import _acts_by_changes_of_efforts, withhold_unconfirmed_by_simulation
from drake_cafim.diagnosis.preparation import PreparedRecordings, prepare
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.search.search import Outcome
from drake_cafim.diagnosis.search.search_under_unknown_force import UNKNOWN_FORCES
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.actuator import ActuatorDelay
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointViscousFriction
from drake_cafim.recordings.recording import Recording
from tests.concealed.noise import ChannelNoise
from tests.test_left_out import FINER, FRICTION, NOISE, STEP, recording, scene

MASS, STIFFNESS, DAMPING = 2.0, 60.0, 18.0
"""kg; N/m and N s/m of the controller."""
LASTING = 0.02
"""Time constant of the correlation of the forces that nobody knows, s."""


def _recording(name: str, seed: int, delay: int, shaking: float) -> Recording:
    """The mass under a controller that sees its motion, shaken by `shaking` N; its efforts act `delay` samples late."""
    rng = np.random.default_rng(seed)
    time = STEP * np.arange(1500)
    rates, phases = 2.0 * np.pi * np.array([0.5, 1.1]), rng.uniform(0.0, 6.0, 2)
    wanted = 0.2 * np.sin(np.outer(time, rates) + phases).sum(axis=1)
    rate = (0.2 * rates * np.cos(np.outer(time, rates) + phases)).sum(axis=1)
    unknown = ChannelNoise(shaking, LASTING).draw(rng, time[None], 1)[0, :, 0]
    q, v, u = (np.zeros(len(time)) for _ in range(3))
    q[0], v[0] = wanted[0], rate[0]
    for k in range(len(time)):
        u[k] = STIFFNESS * (wanted[k] - q[k]) + DAMPING * (rate[k] - v[k]) + FRICTION * rate[k]
        if k + 1 < len(time):
            force, x, y = u[max(k - delay, 0)] + unknown[k], q[k], v[k]
            for _ in range(FINER):
                before, y = y, y + STEP / FINER * (force - FRICTION * y) / MASS
                x = x + 0.5 * STEP / FINER * (before + y)
            q[k + 1], v[k + 1] = x, y
    noisy = q + NOISE[0] * rng.normal(size=len(q)), v + NOISE[1] * rng.normal(size=len(v))
    return Recording(name, time, {"q.rail": noisy[0], "v.rail": noisy[1], "u.rail": u})


def _told(folder: Path, delay: int, shaking: float) -> tuple[PreparedRecordings, Judgement]:
    """The judgement that an effort is late, and the joint viscous, under the forces that this leaves."""
    prepared = prepare(scene(folder), [_recording(f"run{k}", k, delay, shaking) for k in range(3)])
    bare = prepared.problem()
    nominal = unbiased_fit(bare, bare.nominal())
    effects = (JointViscousFriction("rail", {"coefficient": 1.0}), ActuatorDelay("rail", {"delay": 0.006}))
    model, problem = Model(prepared.scene.priors.mean, effects), bare
    for _ in range(2):
        problem = bare.with_unknown_force(bare.likeliest_force(model), model)
        model = fit(problem, model, tolerance=CONVERGED).model
    best = unbiased_fit(problem, model)
    outcome = Outcome(problem, bare, nominal, best, (best,), 10, (), 0.0, {})
    return prepared, Judgement(outcome, best, "unexplained", search=UNKNOWN_FORCES)


@pytest.fixture(scope="module")
def pretended(tmp_path_factory: pytest.TempPathFactory) -> tuple[PreparedRecordings, Judgement]:
    """A late effort that is told, by more than ten standard deviations, where there is none."""
    prepared, told = _told(tmp_path_factory.mktemp("pretended"), 0, 2.0)
    assert told.best.model.effects[1].values["delay"] > 10.0 * told.best.std[-1]
    return prepared, told


def _withheld(prepared: PreparedRecordings, told: Judgement, trace: Trace) -> Judgement:
    return withhold_unconfirmed_by_simulation(told, lambda it: _Predictions(prepared, it.best, 1), None, trace)


def test_a_late_effort_that_feedback_pretends_is_not_named(pretended: tuple[PreparedRecordings, Judgement]) -> None:
    """The equations of motion show the controller's answer to what shakes the mass."""
    prepared, told = pretended
    viscous, late = told.best.model.effects
    trace = Trace()
    found = _withheld(prepared, told, trace)
    [record] = trace.records
    assert record.asked == "actuator_delay@rail" and not record.passed and record.words.endswith("so it is not named")
    assert found.withheld == (late,) and [effect.key for effect in found.best.model.effects] == [viscous.key]


def test_a_late_effort_that_is_there_is_named(tmp_path: Path) -> None:
    prepared, told = _told(tmp_path, 3, 0.2)
    trace = Trace()
    assert _withheld(prepared, told, trace) is told
    [record] = trace.records
    assert record.passed and record.words.endswith("so it is named")


def test_only_what_unknown_forces_may_pretend_has_to_be_confirmed(
    pretended: tuple[PreparedRecordings, Judgement],
) -> None:
    """Neither where noise alone is left, nor where all is known but a parameter, nor what simulations cannot tell."""
    prepared, told = pretended
    trace = Trace()
    bare = replace(told, outcome=replace(told.outcome, problem=told.outcome.nominal_problem))
    for other in (replace(told, kind="explained"), replace(told, adequate=True), bare):
        assert _withheld(prepared, other, trace) is other
    silent = SimpleNamespace(jobs=1, simulate=lambda model, part, horizon: [])
    assert withhold_unconfirmed_by_simulation(told, lambda it: cast(Any, silent), None, trace) is told
    assert not trace.records


def test_each_judgement_is_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def confirmed(judgement: Judgement, **of: Any) -> Judgement:
        asked.append(of)
        return judgement

    monkeypatch.setattr(diagnose, "withhold_unconfirmed_by_simulation", confirmed)
    prepared = prepare(scene(tmp_path), [recording(f"run{k}", k, 4.0, 0.0) for k in range(2)])
    _, judgement, _ = diagnose.judge_prepared(prepared, None, Settings(), lambda text: None)
    [of] = asked
    assert of["given"] is None and of["predictions"](judgement).fitted is judgement.best


def test_what_acts_by_changes_of_efforts_are_late_ones_and_soft_joints() -> None:
    names = ("actuator_delay", "actuator_lag", "joint_elasticity", "joint_backlash")
    assert all(_acts_by_changes_of_efforts(effect_named(name)("rail")) for name in names)
    others = ("sensor_delay", "sensor_lag", "joint_viscous_friction", "actuator_gain_error", "payload")
    assert not any(_acts_by_changes_of_efforts(effect_named(name)("rail")) for name in others)


def test_laws_are_withheld_one_by_one_the_least_confirmed_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """A soft joint with which simulations are worse goes first; without it the lag is confirmed."""
    lag, soft = (effect_named(name)("rail") for name in ("actuator_lag", "joint_elasticity"))
    laws = (JointViscousFriction("rail", {"coefficient": 1.0}), lag, soft)
    errors = {frozenset({0, 1, 2}): 0.2, frozenset({0, 2}): 0.25, frozenset({0, 1}): 0.1, frozenset({0}): 0.4}

    def judged(effects: tuple[Effect, ...]) -> Any:
        best = SimpleNamespace(model=SimpleNamespace(effects=effects))
        problem = SimpleNamespace(forced_joints=("rail",), runs=())
        outcome = SimpleNamespace(problem=problem)
        return SimpleNamespace(kind="unexplained", adequate=False, outcome=outcome, best=best, search=UNKNOWN_FORCES)

    def refits(problem: Any, best: Any, parts: Any, given: Any) -> Any:
        numbers = [laws.index(effect) for effect in best.model.effects]
        return SimpleNamespace(
            items=tuple(range(len(numbers))),
            shown=lambda item: np.ones(2, dtype=bool),
            models=lambda items: [frozenset(numbers[item] for item in items)] * 2,
        )

    def simulated(predictions: Any, models: Any, parts: Any, horizon: float) -> Any:
        return [{"q.rail": errors[models[0]]} for _ in parts], np.zeros(2, dtype=bool)

    def without(judgement: Any, effects: list[Effect]) -> Any:
        return judged(tuple(effect for effect in judgement.best.model.effects if effect not in effects))

    monkeypatch.setattr(feedback, "parts_of", lambda runs: (0, 1))
    monkeypatch.setattr(feedback, "Refits", SimpleNamespace(of=refits))
    monkeypatch.setattr(feedback, "errors_over", simulated)
    monkeypatch.setattr(feedback, "withhold", without)
    trace = Trace()
    found = withhold_unconfirmed_by_simulation(judged(laws), lambda it: cast(Any, None), None, trace)
    assert found.best.model.effects == laws[:2]
    assert [(record.asked, record.passed) for record in trace.records] == [
        ("joint_elasticity@rail", False),
        ("actuator_lag@rail", True),
    ]
