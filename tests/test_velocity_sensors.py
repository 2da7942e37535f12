"""Rows under sensor effects: their derivatives, and the motion between samples, which is corrected as the samples."""

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.effects.catalogue import effect_named
from tests.concealed.make import simulate
from tests.concealed_case import written

STRENGTHS = {"sensor_bias": ("bias", 0.02), "sensor_gain_error": ("gain", 1.005), "sensor_delay": ("delay", 0.002)}


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> WeakProblem:
    """Three joints whose inertias couple, with nothing missing."""
    scene, read = written(simulate("null", "arm3", 5), tmp_path_factory.mktemp("arm"))
    problem = prepare(scene, read).problem()
    assert isinstance(problem, WeakProblem) and all(f"v.{joint}" in read[0].columns for joint in scene.tree.joint_names)
    return problem


@pytest.mark.parametrize("name", STRENGTHS)
def test_rows_change_as_their_derivative_says(arm: WeakProblem, name: str) -> None:
    """Momenta and the forces between samples had been of two velocities, by which rows changed two to four times."""
    strength, value = STRENGTHS[name]
    joint, unknown = arm.scene.tree.joint_names[1], arm.nominal().unknown
    model = Model(unknown).with_effects([effect_named(name)(f"v.{joint}", {strength: value})])
    slope, step = arm.jacobian(model)[:, -1], 1e-3 * value
    ahead, behind = (arm.residual(model.at(np.append(unknown, value + d))) for d in (step, -step))
    change = (ahead - behind) / (2.0 * step)
    assert slope @ change == pytest.approx(change @ change, rel=0.02)
    assert np.linalg.norm(slope - change) < 0.06 * np.linalg.norm(change)


@pytest.mark.parametrize("channel", ["q", "v"])
def test_rows_that_are_whitened_under_a_gain_have_their_derivative_there(arm: WeakProblem, channel: str) -> None:
    """It had been that of a gain of 1, by which standard deviations of a gain of 1.1 were a tenth too small."""
    joint, unknown = arm.scene.tree.joint_names[1], arm.nominal().unknown
    gain = effect_named("sensor_gain_error")(f"{channel}.{joint}", {"gain": 1.1})
    model = Model(unknown).with_effects([gain])
    problem = arm.rewhitened(model)
    slope = problem.jacobian(model)[:, -1]
    ahead, behind = (problem.residual(model.at(np.append(unknown, 1.1 + d))) for d in (1e-4, -1e-4))
    change = (ahead - behind) / 2e-4
    assert slope @ change == pytest.approx(change @ change, rel=0.01)
