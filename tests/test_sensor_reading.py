"""Channels interpolated between samples: smoothing by the polynomials must not lower the χ² of any model."""

from dataclasses import replace

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.whitening.covariance import whitening
from drake_cafim.effects.timing import ClockSkew, SensorDelay, ShiftedSensor
from tests.concealed.make import make
from tests.concealed_case import written

COARSE = 4
STEP = 0.002 * COARSE


@pytest.fixture(scope="module", params=[("arm2", 1), ("arm3", 3)], ids=["white", "correlated"])
def problem(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> WeakProblem:
    """Of a recording at 125 Hz from which nothing is missing; windows hold a dozen samples."""
    scene, read = written(make("null", *request.param), tmp_path_factory.mktemp("null"))
    every = slice(None, None, COARSE)
    columns = {name: values[every] for name, values in read[0].columns.items()}
    prepared = prepare(scene, [replace(read[0], time=read[0].time[every], columns=columns)])
    assert isinstance(prepared, Prepared)
    return prepared.problem()


def _luck(problem: WeakProblem, model: Model) -> float:
    """What the samples' noise gains in χ² under `model`, whitened as in `problem`: R − tr C⁻¹ D."""
    [run] = problem.runs
    let_through = whitening(run.weak, model.physics(problem.scene))[0].covariance
    half = run.whiten(np.asarray(let_through.todense()))
    return run.rows - float(np.trace(run.whiten(half.T)))


SHIFTS = (SensorDelay("q.", {"delay": 0.5 * STEP}), ClockSkew("q.", {"skew": 5e-4}))


@pytest.mark.parametrize("shift", SHIFTS, ids=lambda shift: shift.name)
def test_noise_gains_nothing_by_being_read_between_samples(problem: WeakProblem, shift: ShiftedSensor) -> None:
    """0.2 to 0.7 of χ² in a recording of seven seconds, and more the longer it is."""
    channel = f"q.{problem.scene.tree.joint_names[0]}"
    model = Model(problem.scene.priors.mean, (replace(shift, at=channel),))
    gained = _luck(problem, model)
    assert gained > 0.1
    assert problem.penalty(model) == pytest.approx(gained, rel=0.1)
    # nor does anything lose where rows are whitened as they are read
    [own, known] = problem.rewhitened(model), problem.nominal()
    assert own.penalty(model) == 0.0
    assert own.penalty(known) == pytest.approx(_luck(own, known), rel=0.1)


def test_a_whole_sample_smooths_nothing(problem: WeakProblem) -> None:
    channel = f"q.{problem.scene.tree.joint_names[0]}"
    model = Model(problem.scene.priors.mean, (SensorDelay(channel, {"delay": STEP}),))
    assert problem.penalty(model) == pytest.approx(0.0, abs=0.02)
