"""A lagging sensor in the diagnosis: undoing the lag must not pass for noise, nor noise for a misfit."""

from pathlib import Path

import numpy as np
import pytest
from concealed.make import make

from drake_cafim import recordings
from drake_cafim.diagnosis.diagnose import prepare
from drake_cafim.diagnosis.fitting import unbiased_fit
from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.weak_problem import WeakProblem
from drake_cafim.effects.timing import SensorLag
from drake_cafim.scenario.scene import Scene


@pytest.mark.ci
def test_the_true_lag_leaves_noise_as_stated(tmp_path: Path) -> None:
    case = make("single:sensor_lag", "arm6", 0x35BBFDA3DC83D82D5A1C8DA3801BEA30)
    case.write(tmp_path)
    scene = Scene.load(tmp_path / "scenario.yaml")
    prepared = prepare(scene, [recordings.read(tmp_path / f"train_{k}.parquet") for k in (1, 2, 3)])
    [effect] = case.truth["effects"]
    values = {name: value for name, (value, _) in effect["parameters"].items()}
    model = Model(scene.priors.mean, (SensorLag(effect["at"], values),))
    problem = WeakProblem.of(prepared.scene, prepared.weak, model)
    fitted = unbiased_fit(problem, model)
    # the row in which the lagging position faces its velocity
    joint = scene.tree.joint_index(effect["at"].split(".")[1])
    rows = fitted.residual[: problem.rows].reshape(-1, prepared.weak[0].rows_per_window)[:, joint]
    assert float(np.mean(rows**2)) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / len(rows)))
    found, std = fitted.model.effects[0].values["time_constant"], float(np.sqrt(fitted.covariance[-1, -1]))
    assert found == pytest.approx(values["time_constant"], abs=4.0 * std)
    assert std < 0.01 * values["time_constant"]
