"""AutoDiffXd through robot, control and contact: against differences, against tangents, and in a run."""

from dataclasses import replace

import numpy as np
import pytest

from drake_cafim.design.planner import PlannerConfig
from drake_cafim.diagrams.catalogue import stage_of
from drake_cafim.diagrams.tracked_contact import TrackedEvaluator
from drake_cafim.experiment import closed_loop
from drake_cafim.experiment.closed_loop import Options
from drake_cafim.information import fisher_information
from drake_cafim.parameters import Parameter, Parameters
from drake_cafim.scenario.schema import load
from drake_cafim.scene.address import resolve
from drake_cafim.sensitivity.automatic import AutoDiffEvaluator
from drake_cafim.sensitivity.tangent import TangentEvaluator

MOTIONS = {
    "pinching": ([0.019, 0.0], [[-0.2], [-0.1], [0.0], [0.2]]),
    "rubbing": ([0.035, 0.8, 0.0, 0.0], [[-0.3, 0.0], [0.0, 0.4], [0.0, 0.4]]),
    "contouring": ([0.5, -0.034, 0.0, 0.0], [[0.0, 0.1], [0.1, 0.0]]),
}


def stage_named(name):
    return stage_of(load(resolve(name)), name)


def fisher_of(rollout, model):
    return fisher_information(rollout.sensitivities, model.noise_std)[0]


@pytest.mark.parametrize("name", MOTIONS)
def test_the_whole_derivative_is_that_of_differences_through_the_diagram(name):
    stage = stage_named(name)
    model, theta = stage.task.model, stage.task.theta
    start, commands = (np.array(part) for part in MOTIONS[name])
    evaluator = stage.evaluator(model)
    q = evaluator._posture(start[: len(start) // 2])
    np.testing.assert_allclose(evaluator.robot.mover.position(q), start[: len(start) // 2], atol=1e-6)
    _, forces, _, slopes = evaluator.simulate(start, commands, theta, q)
    assert np.abs(forces).max() > 0.05
    for index in range(len(theta)):
        step = 1e-4 * theta[index] * np.eye(len(theta))[index]
        ends = [evaluator.simulate(start, commands, theta + sign * step, q, automatic=False)[2] for sign in (1, -1)]
        differences = (ends[0] - ends[1]) / (2.0 * step[index])
        np.testing.assert_allclose(slopes[..., index], differences, atol=1e-6 * np.abs(slopes[..., index]).max())


@pytest.mark.parametrize("softer, tolerance", [(1e-6, 1e-6), (1.0, None)])
def test_where_the_robot_tracks_perfectly_it_is_the_tangent_along_its_motion(softer, tolerance):
    """A contact a million times softer leaves the jaws where they are; the scenario's own pushes them back."""
    stage = stage_named("pinching")
    model = replace(
        stage.task.model,
        force_std=2.0 * softer,
        parameters=Parameters(
            (
                Parameter("stiffness", 800.0 * softer, std=100.0 * softer),
                Parameter("damping", 10.0 * softer, std=10.0 * softer),
            )
        ),
    )
    start, commands = (np.array(part) for part in MOTIONS["pinching"])
    theta = model.parameters.mean
    rollout = stage.evaluator(model)(model.motion(start, commands[np.newaxis]), theta, model.start(start, theta))
    tangent = TangentEvaluator(model)(rollout.motion, theta, model.start(start, theta))
    np.testing.assert_allclose(rollout.measurements, tangent.measurements, rtol=1e-9)
    through, along = fisher_of(rollout, model), fisher_of(tangent, model)
    assert np.linalg.matrix_rank(along) == 2
    if tolerance is None:
        assert np.abs(through / along - 1.0).max() > 0.05
    else:
        np.testing.assert_allclose(through, along, rtol=tolerance)


def test_a_run_plans_by_it():
    stage = stage_named("pinching")
    task = replace(stage.task, robot_start=np.array([0.019, 0.0]), periods=2, experiments=1)
    world = stage.world("model", 1)
    made = []

    def automatic(model):
        made.append(stage.evaluator(model))
        return made[-1]

    world = replace(world, automatic=automatic, recorded=())
    few = PlannerConfig(candidates=2, horizon=2)
    result = closed_loop.run(task, Options(fisher="autodiff", force_guard=False, planner_config=few, seed=1), world)
    assert made and all(isinstance(each, TrackedEvaluator) for each in made)
    assert all("_automatic" in vars(each) for each in made), "made, but not asked"
    assert np.isfinite(result.experiments[0].fisher).all()
    hefting = stage_named("hefting")
    assert isinstance(hefting.evaluator(hefting.task.model), AutoDiffEvaluator)
