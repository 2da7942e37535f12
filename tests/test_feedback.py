"""Sensor noise that a controller feeds back: gains are found from the efforts, and the motion it causes informs."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from drake_cafim.diagnosis.joints.more_noise import MOST_DRAWS, draws
from drake_cafim.diagnosis.noise.feedback import Feedback
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.rows.samples import with_recording
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.effects.coupling import JointElasticity
from tests.concealed.case import World
from tests.concealed.make import simulate
from tests.concealed_case import written


def test_gains_of_a_noisy_loop_are_found_and_an_open_loop_has_none() -> None:
    rng = np.random.default_rng(0)
    time = 0.002 * np.arange(4000)
    smooth = np.stack([np.sin(5.0 * time), np.cos(3.0 * time)], axis=1)
    e_q, e_v = 1e-4 * rng.normal(size=smooth.shape), 1e-2 * rng.normal(size=smooth.shape)
    forward = 3.0 * smooth
    late = np.concatenate([np.zeros((1, 2)), e_v[:-1]])
    u = forward - 400.0 * e_q - late @ np.array([[20.0, 2.0], [0.0, 10.0]])
    feedback = Feedback.of(smooth + e_q, smooth + e_v, u)
    expected = -400.0 * e_q - late @ np.array([[20.0, 2.0], [0.0, 10.0]])
    error = feedback.carry_noise(e_q, e_v)[1:] - expected[1:]
    assert np.std(error) < 0.05 * np.std(expected)
    alone = Feedback.of(smooth + e_q, smooth + e_v, forward + 1e-3 * rng.normal(size=smooth.shape))
    assert np.all(alone.gains == 0.0)


def test_what_noisy_efforts_shake_informs(tmp_path: Path) -> None:
    """Information is that of slopes without error, of the motion that noise has made too: here it is most of it."""
    case = simulate("single:joint_elasticity", "arm2", 104)
    [concealed] = case.truth["effects"]
    scene, [noisy, *_] = written(case, tmp_path)
    world = case.study["world"]
    assert isinstance(world, World)
    columns = noisy.columns | {name: values[0] for name, values in world.measured.items()}
    clean = replace(noisy, columns=columns)
    prepared = prepare(scene, [noisy])
    assert isinstance(prepared, Prepared)
    values = {name: value for name, (value, _) in concealed["parameters"].items()}
    problem = prepared.problem()
    model = problem.nominal().with_effects([JointElasticity(concealed["at"], values)])
    problem = problem.rewhitened(model)
    [run] = problem.runs
    samples = with_recording(run.weak.samples, scene, clean)
    exact = replace(problem, runs=(replace(run, weak=WeakForm(samples, run.weak.sensors)),))
    jacobian, true = problem.jacobian(model), exact.jacobian(model)
    _, excess = problem.shared_noise(model, problem.residual(model), jacobian)
    shared = problem.noisier_in_loop.jacobian(model) - jacobian
    # what such efforts shake has to do with the rows' noise by chance alone, of which one dose holds too much
    assert draws(shared, jacobian) == MOST_DRAWS and draws(0.1 * jacobian, jacobian) == 1
    np.testing.assert_allclose(np.diag(jacobian.T @ jacobian - excess), np.diag(true.T @ true), rtol=0.1)
