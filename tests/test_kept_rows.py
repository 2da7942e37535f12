"""Cached rows serve only the parameter values for which they were computed."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.dynamics.inverses import inverses
from drake_cafim.effects.actuator import ActuatorLag
from drake_cafim.effects.body import AerodynamicDrag, ExternalDisturbance
from drake_cafim.effects.coupling import JointElasticity
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointCoulombFriction
from drake_cafim.effects.link import Payload
from drake_cafim.effects.plane import UnmodeledContact
from drake_cafim.effects.timing import SensorDelay, SensorLag
from drake_cafim.scene.scene import Scene
from tests.concealed.make import simulate


def _problem(folder: Path) -> WeakProblem:
    """Of one recording of an arm that lacks nothing."""
    simulate("null", "arm2", 3).write(folder)
    scene = Scene.load(folder / "scenario.yaml")
    prepared = prepare(scene, [recordings.read(folder / "train_1.parquet")])
    assert isinstance(prepared, Prepared)
    problem = prepared.problem()
    assert isinstance(problem, WeakProblem)
    return problem


def _fresh(problem: WeakProblem) -> WeakProblem:
    """The same problem, which nothing was asked of but its nominal rows."""
    forms = [WeakForm(form.samples, form.sensors) for form in problem.forms]
    fresh = WeakProblem.of(problem.scene, forms, problem.under)
    fresh.residual(problem.nominal())
    return fresh


def _trials(problem: WeakProblem) -> list[list[Effect]]:
    """Effects of which each shares all but a number or two with another one."""
    first, second = problem.scene.tree.joint_names
    body = next(body.name for body in problem.scene.tree.bodies if body.joint == 1)
    recording, beside = problem.runs[0].name, {"x": 3.0, "y": 1.0, "z": 2.0, "start": 0.5, "stop": 0.9}
    plane = {"offset": 0.1, "stiffness": 50.0, "damping": 1.0, "nx": 0.0, "ny": 0.0, "nz": 1.0}
    return [
        [ExternalDisturbance(body, beside, recording)],
        [ExternalDisturbance(body, {**beside, "y": -2.0}, recording)],
        [ExternalDisturbance(body, {**beside, "stop": 1.0}, recording)],
        [ExternalDisturbance(body, beside, "another")],
        [AerodynamicDrag(body, {"coefficient": 0.4}), Payload(body, {"mass": 0.3, "x": 0.05, "y": 0.0, "z": 0.0})],
        [AerodynamicDrag(body, {"coefficient": 0.4}), Payload(body, {"mass": 0.6, "x": 0.15, "y": 0.0, "z": 0.0})],
        [UnmodeledContact(body, plane), JointCoulombFriction(first, {"torque": 0.4})],
        [UnmodeledContact(body, {**plane, "offset": 0.2}), JointCoulombFriction(second, {"torque": 0.4})],
        [JointCoulombFriction(second, {"torque": 0.4, "slip_velocity": 0.05})],
        [SensorDelay(f"q.{second}", {"delay": 0.004}), ActuatorLag(first, {"time_constant": 0.01})],
        [SensorDelay(f"q.{first}", {"delay": 0.004}), ActuatorLag(first, {"time_constant": 0.02})],
        [SensorLag(f"v.{second}", {"time_constant": 0.004}), ActuatorLag(second, {"time_constant": 0.02})],
        [
            SensorLag(f"q.{second}", {"time_constant": 0.006}),
            JointElasticity(first, {"stiffness": 900.0, "damping": 1.0}),
        ],
    ]


@pytest.mark.long
def test_rows_are_those_of_a_problem_that_was_asked_nothing_else(tmp_path: Path) -> None:
    problem = _problem(tmp_path)
    nominal = problem.nominal()
    models = [nominal.with_effects(effects) for effects in _trials(problem)]
    for model in (*models, *reversed(models)):
        problem.residual(model)
    for model in models:
        _assert_alike(problem, _fresh(problem), model)


def _assert_alike(problem: WeakProblem, fresh: WeakProblem, model: Model) -> None:
    np.testing.assert_allclose(problem.residual(model), fresh.residual(model), rtol=1e-9, atol=1e-9)
    # unknowns' columns are kept from a whitening's first look at them
    for position in range(len(model.effects)):
        known, anew = (each.effect_columns(model, position) for each in (problem, fresh))
        np.testing.assert_allclose(known, anew, rtol=0.0, atol=1e-7 * float(np.max(np.abs(anew)) + 1e-30))
    assert problem.penalty(model) == pytest.approx(fresh.penalty(model), abs=1e-6)


def test_a_push_is_the_sum_of_its_parts() -> None:
    push = ExternalDisturbance("link", {"x": 3.0, "y": 0.0, "z": -2.0, "start": 0.1, "stop": 0.4}, "one")
    time, rest = np.linspace(0.0, 0.5, 50), np.zeros((50, 3))
    parts = [share * part.force(rest, rest, time, "one") for share, part in push.parts()]
    np.testing.assert_allclose(sum(parts), push.force(rest, rest, time, "one"), atol=1e-12)


def test_small_matrices_are_inverted_whatever_their_pivots() -> None:
    rng = np.random.default_rng(2)
    for n in (1, 2, 5):
        matrices = rng.normal(size=(40, n, n))
        matrices[:, 0, 0] = 0.0 if n > 1 else 1.5
        np.testing.assert_allclose(inverses(matrices), np.linalg.inv(matrices), rtol=1e-7, atol=1e-9)
    assert not np.any(np.isfinite(inverses(np.zeros((1, 1, 1)))))
