"""Derivatives by inertias where an initial state is unknown: those of the rows with it marginalised, without anew."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.effects.actuator import ActuatorLag
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.coupling import JointElasticity
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointCoulombFriction
from drake_cafim.effects.link import Payload, RotorInertia
from drake_cafim.effects.timing import SensorDelay
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.recoveries.rig import recorded, waves
from tests.test_inertials import arm

LAG = ActuatorLag("lift", {"time_constant": 0.03})


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, list[Recording]]:
    """An arm of which all inertials are unknown, and a recording of it that begins while its efforts change."""
    scene = arm(tmp_path_factory.mktemp("arm"))
    return scene, [recorded(scene, waves((0.0, 0.3, 0.5), (0.5, 0.4, 0.5), 1), 2.5, 0)]


def _problem(late: tuple[Scene, list[Recording]]) -> WeakProblem:
    problem = prepare(late[0], late[1]).problem()
    assert isinstance(problem, WeakProblem)
    return problem


def _residual_at(problem: WeakProblem, model: Model, change: Array, widths: list[Array]) -> Array:
    """Whitened rows (R,) of `model` changed by `change`, initial states marginalised with these `widths`."""
    physics = model.at(model.vector + change).physics(problem.scene)
    marginals = [run.marginalise_start(physics, own) for run, own in zip(problem.runs, widths, strict=True)]
    return np.concatenate([marginal.rows for marginal in marginals])


@pytest.mark.parametrize(
    "effect", [Payload("l3", {"mass": 0.4, "x": 0.1, "y": -0.05, "z": 0.2}), RotorInertia("lift", {"inertia": 0.02})]
)
def test_slopes_by_inertias_are_those_of_differences(late: tuple[Scene, list[Recording]], effect: Effect) -> None:
    problem = _problem(late)
    model = Model(problem.scene.priors.mean, (LAG, effect))
    physics = model.physics(problem.scene)
    marginals = [run.marginalise_start(physics) for run in problem.runs]
    widths = [marginal.widths for marginal in marginals]
    assert max(np.max(own) for own in widths) > 0.1, "the start matters"
    jacobian = problem.jacobian(model)[: problem.rows]
    for i in (0, 12, 25, *range(31, len(model.vector))):
        change = 1e-4 * np.eye(len(model.vector))[i]
        ahead, behind = (_residual_at(problem, model, sign * change, widths) for sign in (1.0, -1.0))
        expected = (ahead - behind) / 2e-4
        np.testing.assert_allclose(jacobian[:, i], expected, atol=2e-3 * np.abs(expected).max())


def test_a_load_is_looked_for_without_computing_the_rows(
    late: tuple[Scene, list[Recording]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """To first order its columns are those of differences of all rows."""
    problem = _problem(late)
    model = Model(problem.scene.priors.mean, (LAG,))
    found = Fit(model, problem.residual(model), problem.jacobian(model), np.zeros((31, 31)), problem.rows)
    load, physics = Payload("l3"), model.physics(problem.scene)

    def computed(weak: WeakForm, physics: Physics) -> Array:
        raise AssertionError("rows were computed")

    with monkeypatch.context() as patched:
        patched.setattr(WeakForm, "residual", computed)
        (columns, _), *others = problem.looks(found, load).found
    assert not others and isinstance(columns, np.ndarray)
    for k, direction in enumerate(load.directions()):
        behind = found.residual[: problem.rows]
        if direction.behind is not None:
            behind = problem.data_rows(physics.with_effects([load.with_values(direction.behind)]))
        ahead = problem.data_rows(physics.with_effects([load.with_values(direction.ahead)]))
        expected = (ahead - behind) / direction.size
        np.testing.assert_allclose(columns[:, k], expected, atol=2e-3 * np.abs(expected).max())


def test_a_load_beside_friction_that_follows_loads_is_looked_for_by_differences(
    late: tuple[Scene, list[Recording]],
) -> None:
    """The friction changes with the load, which the inertial columns do not know."""
    problem = _problem(late)
    values = {"torque": 0.1, "coefficient": 0.0, "external": 0.5, "slip_velocity": 0.05}
    friction = effect_named("joint_load_dependent_friction")("lift", values)
    model = Model(problem.scene.priors.mean, (friction,))
    physics = model.physics(problem.scene)
    assert physics.depends_on_load
    found = Fit(model, problem.residual(model), problem.jacobian(model), np.zeros((0, 0)), problem.rows)
    load = Payload("l3")
    (columns, _), *_ = problem.looks(found, load).found
    assert isinstance(columns, np.ndarray)
    (direction, *_) = load.directions()
    ahead = problem.data_rows(physics.with_effects([load.with_values(direction.ahead)]))
    np.testing.assert_allclose(columns[:, 0], (ahead - found.residual[: problem.rows]) / direction.size)


def test_slopes_do_not_depend_on_what_was_asked_before(late: tuple[Scene, list[Recording]]) -> None:
    """Those beside a sensor's delay are taken at two digits of it, whichever value of these came first."""
    near = [SensorDelay("v.lift", {"delay": delay}) for delay in (0.01213, 0.01187)]
    fresh, asked = _problem(late), _problem(late)
    first, second = (Model(fresh.scene.priors.mean, (delay,)) for delay in near)
    asked.jacobian(first)
    np.testing.assert_array_equal(asked.jacobian(second)[:, :30], fresh.jacobian(second)[:, :30])
    np.testing.assert_array_equal(fresh.jacobian(first)[:, :30], fresh.jacobian(second)[:, :30])


def test_the_initial_state_of_a_model_is_marginalised_once(
    late: tuple[Scene, list[Recording]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = _problem(late)
    model = Model(problem.scene.priors.mean, (LAG, RotorInertia("lift", {"inertia": 0.02})))
    other = model.at(model.vector + 0.1)
    computed: list[Physics] = []
    residual = WeakForm.residual

    def counted(weak: WeakForm, physics: Physics) -> Array:
        computed.append(physics)
        return residual(weak, physics)

    monkeypatch.setattr(WeakForm, "residual", counted)
    rows = problem.residual(model)
    problem.jacobian(model), problem.penalty(model, own_noise=False)
    own = model.physics(problem.scene)
    assert sum(physics is own for physics in computed) == len(problem.runs)
    assert len(computed) == 3 * len(problem.runs), "and on either side of the lag, which has no analytic slope"
    assert model.physics(problem.scene) is model.physics(problem.scene)
    assert not np.array_equal(problem.residual(other), rows)
    np.testing.assert_array_equal(problem.residual(model), rows)
    # what a process gives back to another one is the model alone
    assert not pickle.loads(pickle.dumps(model))._physics
    # another scene has other physics
    moved = arm(tmp_path, gravity=[0.0, 0.0, 0.0])
    assert np.all(model.physics(moved).gravity == 0.0) and np.any(model.physics(problem.scene).gravity != 0.0)


def test_more_noise_of_efforts_shows_beside_an_unknown_start(
    late: tuple[Scene, list[Recording]], tmp_path: Path
) -> None:
    """What is known of the recording as it is says nothing of one with more noise, which biases the fit to be seen."""
    channels = {"q": {"std": 1e-4}, "v": {"std": 2e-3}, "u": {"std": 0.05}}
    problem = prepare(arm(tmp_path, channels=channels), late[1]).problem()
    assert isinstance(problem, WeakProblem) and problem.regressors_noisy
    model = Model(problem.scene.priors.mean, (LAG,))
    residual = problem.residual(model)
    assert np.linalg.norm(problem.noisier.residual(model) - residual) > 1.0
    _, excess = problem.shared_noise(model, residual, problem.jacobian(model))
    assert excess[30, 30] > 0.0


def test_behind_a_soft_gear_slopes_by_inertias_are_differences(late: tuple[Scene, list[Recording]]) -> None:
    """What the rotor does there is not linear in the link's inertia."""
    problem = _problem(late)
    rotor, spring = (
        RotorInertia("lift", {"inertia": 0.02}),
        JointElasticity("lift", {"stiffness": 50.0, "damping": 0.1}),
    )
    model = Model(problem.scene.priors.mean, (rotor, spring))
    jacobian, exact = problem.jacobian(model), problem._by_unknowns.differences
    for i in (12, 25):
        np.testing.assert_array_equal(jacobian[:, i], exact.by_unknown(model, i))
    np.testing.assert_array_equal(jacobian[:, 30], exact.by_strength(model, 0, 0))
    assert np.any(jacobian[: problem.rows, 30])


def test_a_law_with_other_values_is_another_force(late: tuple[Scene, list[Recording]]) -> None:
    """Its rows, and its slopes, are those of its values now, though it was computed with others just before."""
    problem, mean = _problem(late), late[0].priors.mean
    torques, width = (0.1, 0.2), 0.05
    laws = [JointCoulombFriction("lift", {"torque": torque, "slip_velocity": width}) for torque in torques]
    without, *rows = (problem.residual(Model(mean, tuple(laws[:k][-1:]))) for k in (0, 1, 2))
    np.testing.assert_allclose(rows[1] - without, 2.0 * (rows[0] - without), atol=1e-9 * np.abs(rows[1]).max())
    narrow = Model(mean, (JointCoulombFriction("lift", {"torque": 0.2, "slip_velocity": 0.5 * width}),))
    slope = (problem.residual(narrow) - without) / 0.2
    np.testing.assert_allclose(problem.jacobian(narrow)[:, 30], slope, atol=1e-6 * np.abs(slope).max())
