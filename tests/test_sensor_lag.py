"""Sensors with a lag: the noise that inverting the lag amplifies is accounted for in the rows' covariance."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import unbiased_fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.rows.kinematic_rows import KinematicRows
from drake_cafim.effects.sensor import SensorBias
from drake_cafim.effects.timing import SensorDelay, SensorLag
from drake_cafim.scene.scene import Scene
from tests.concealed.make import simulate
from tests.concealed_case import written


def _problem(kind: str, rig: str, seed: int, folder: Path) -> tuple[WeakProblem, Scene, dict[str, Any]]:
    """Of two recordings, and the effect that is concealed in them."""
    case = simulate(kind, rig, seed)
    scene, read = written(case, folder)
    prepared = prepare(scene, read[:2])
    assert isinstance(prepared, Prepared)
    [effect] = case.truth["effects"]
    return (
        prepared.problem(),
        scene,
        {"at": effect["at"]} | {k: value for k, (value, _) in effect["parameters"].items()},
    )


def test_a_lag_gains_nothing_by_smoothing(tmp_path: Path) -> None:
    """A slow motion is late either way; the velocity, which is made to lag with the position, must stay as noisy."""
    problem, scene, effect = _problem("single:sensor_delay", "arm3", 0x280017AAF7355E9A72CB14778AD7D97E, tmp_path)
    mean, late = scene.priors.mean, effect["delay"]
    delay = unbiased_fit(problem, Model(mean, (SensorDelay(effect["at"], {"delay": late}),)))
    lag = unbiased_fit(problem, Model(mean, (SensorLag(effect["at"], {"time_constant": late}),)))
    assert delay.chi_square < lag.chi_square - 10.0


def test_a_lag_and_a_delay_see_the_same_noise(tmp_path: Path) -> None:
    """Where they do not, one of two explanations of a slow motion wins by luck: by 33 here, against the truth."""
    problem, scene, effect = _problem("single:sensor_lag", "arm3", 4, tmp_path)
    mean, late = scene.priors.mean, effect["time_constant"]
    lag = unbiased_fit(problem, Model(mean, (SensorLag(effect["at"], {"time_constant": late}),)))
    delay = unbiased_fit(problem, Model(mean, (SensorDelay(effect["at"], {"delay": late}),)))
    joint = scene.tree.joint_index(effect["at"].split(".")[1])
    width = problem.runs[0].weak.rows_per_window
    rows = [model.residual[: problem.rows].reshape(-1, width)[:, joint] for model in (lag, delay)]
    assert np.corrcoef(*rows)[0, 1] > 0.95
    assert lag.chi_square < delay.chi_square


@pytest.mark.long
def test_a_velocity_whose_lag_is_undone_is_as_noisy_as_is_reckoned(tmp_path: Path) -> None:
    """Of a controller that shakes with its sensors' noise; also where the rows are whitened without the lag."""
    problem, scene, effect = _problem("single:sensor_lag", "arm7", 26, tmp_path)
    lag = SensorLag(effect["at"], {"time_constant": effect["time_constant"]})
    fitted = unbiased_fit(problem, Model(scene.priors.mean, (lag,)))
    own = unbiased_fit(problem.rewhitened(fitted.model), fitted.model)
    assert own.chi_square / problem.rows == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / problem.rows))


def test_what_a_lag_writes_of_a_curved_motion() -> None:
    time = np.cumsum(0.002 * (1.0 + 0.2 * np.random.default_rng(0).uniform(-1.0, 1.0, 1500)))
    w = 2.0 * np.pi * 5.0
    for tau in (5e-4, 3e-3, 0.02):
        settled = time > time[0] + 12.0 * tau
        exact = (np.sin(w * time) - w * tau * np.cos(w * time)) / (1.0 + (w * tau) ** 2)
        written = SensorLag("q.a", {"time_constant": tau}).measured(time, np.sin(w * time)[:, None])[:, 0]
        np.testing.assert_allclose(written[settled], exact[settled], atol=1e-5)


@pytest.mark.long
def test_the_true_lag_leaves_noise_as_stated(tmp_path: Path) -> None:
    problem, scene, effect = _problem("single:sensor_lag", "arm6", 0x35BBFDA3DC83D82D5A1C8DA3801BEA30, tmp_path)
    model = Model(scene.priors.mean, (SensorLag(effect["at"], {"time_constant": effect["time_constant"]}),))
    fitted = unbiased_fit(problem, model)
    # the row in which the lagging position faces its velocity
    joint = scene.tree.joint_index(effect["at"].split(".")[1])
    rows = fitted.residual[: problem.rows].reshape(-1, problem.runs[0].weak.rows_per_window)[:, joint]
    assert float(np.mean(rows**2)) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / len(rows)))
    found, std = fitted.model.effects[0].values["time_constant"], float(np.sqrt(fitted.covariance[-1, -1]))
    assert found == pytest.approx(effect["time_constant"], abs=4.0 * std)
    assert std < 0.01 * effect["time_constant"]


@pytest.mark.long
@pytest.mark.parametrize(("seed", "at"), [(3, "v.shoulder"), (8, "v.axis_1")])
def test_how_far_a_sensor_was_behind_at_first_is_not_known(seed: int, at: str, tmp_path: Path) -> None:
    """Of recordings that begin in the middle of a motion; were lags taken as settled, 200 and 3.7 would be left."""
    scene, read = written(simulate("single:sensor_lag", "arm2", seed), tmp_path)
    late = [
        replace(
            recording,
            time=recording.time[500:],
            columns={name: values[500:] for name, values in recording.columns.items()},
        )
        for recording in read
    ]
    prepared = prepare(scene, late)
    assert isinstance(prepared, Prepared)
    problem = prepared.problem()
    fitted = unbiased_fit(problem, Model(scene.priors.mean, (SensorLag(at, {"time_constant": 0.02}),)))
    problem = problem.rewhitened(fitted.model)
    fitted = unbiased_fit(problem, fitted.model)
    rows = fitted.residual[: problem.rows].reshape(3, -1, problem.runs[0].weak.rows_per_window)
    first = rows[:, :8, scene.tree.joint_index(at.partition(".")[2])]
    assert float(np.mean(first**2)) < 2.5


def test_a_lag_is_reckoned_once_while_other_numbers_change(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An encoder's bias moves the whole motion, but not the lag's filter; of an estimate no noise is smoothed."""
    problem, scene, effect = _problem("single:sensor_lag", "arm2", 4, tmp_path)
    asked: list[str] = []
    for owner, name in ((SensorLag, "kinematic_correction"), (KinematicRows, "_variance")):
        own = getattr(owner, name)
        monkeypatch.setattr(owner, name, lambda *args, own=own, name=name: asked.append(name) or own(*args))
    lag, joint = SensorLag(effect["at"], {"time_constant": 0.01}), scene.tree.joint_names[-1]
    biased = SensorBias(f"q.{joint}", {"bias": 0.01})
    rows = [problem.rows_of(Model(scene.priors.mean, effects)) for effects in ((lag,), (lag, biased))]
    assert not np.allclose(*rows) and "_variance" not in asked
    asked.clear()
    samples = problem.runs[0].weak.samples
    kinematic = KinematicRows(samples)
    read = [kinematic.compared([lag], scene.tree.joint_names, samples.q + bias, samples.v) for bias in (0.0, 0.01)]
    assert asked == ["kinematic_correction"]
    assert not np.allclose(read[0][0], read[1][0]) and np.array_equal(read[0][2], read[1][2])


def test_the_matrix_of_a_lag_is_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a time grid and a time constant, whatever it filters; another grid and another constant have their own."""
    time, lag = 0.0173 * np.arange(40.0), SensorLag("q.a", {"time_constant": 0.0211})
    first = lag.measured(time, np.sin(time)[:, None])
    monkeypatch.setattr("scipy.sparse.diags_array", lambda *args, **names: pytest.fail("made again"))
    assert not np.allclose(lag.measured(time, np.cos(time)[:, None]), first)
    assert np.array_equal(lag.measured(time, np.sin(time)[:, None]), first)
    monkeypatch.undo()
    assert not np.allclose(SensorLag("q.a", {"time_constant": 0.05}).measured(time, np.sin(time)[:, None]), first)
    assert not np.allclose(lag.measured(0.5 * time, np.sin(time)[:, None]), first)
