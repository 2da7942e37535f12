"""What encoders round: the rows of right models are judged as noise, also where their joints move by whole steps."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from drake_cafim import recordings
from drake_cafim.diagnosis.fit.adequacy import adequacy, by_run
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.realised_noise import RealisedNoise
from drake_cafim.diagnosis.fit.robust_covariance import realised_std, wald_statistics
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.effects.joint import JointCoulombFriction
from drake_cafim.numerics.tail import Tail
from drake_cafim.scene.scene import Scene
from tests.concealed.make import make


def _of_truth(folder: Path, kind: str, seed: int) -> WeakProblem:
    """The training recordings of a case of the proof, under a scene that states what is concealed."""
    case: Any = make(kind, f"served{2 + seed % 2}", seed)
    case.write(folder)
    stated = yaml.safe_load((folder / "scenario.yaml").read_text())
    for item in case.truth["effects"]:
        values = {name: value for name, (value, _) in item["parameters"].items()}
        stated.setdefault("effects", []).append({"effect": item["effect"], "at": item["at"], **values})
    (folder / "scenario.yaml").write_text(yaml.safe_dump(stated))
    own = [recordings.read(path) for path in sorted(folder.glob("train*"))]
    problem = prepare(Scene.load(folder / "scenario.yaml"), own).problem()
    assert isinstance(problem, WeakProblem)
    return problem


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        ("null", 912),
        # its joint moves for most of the time by one step of its encoder from one sample to the next
        ("single:command_rate_limit", 930),
        # half a minute
        pytest.param("single:servo_gain_error", 923, marks=pytest.mark.long),
    ],
)
def test_a_right_model_leaves_noise(kind: str, seed: int, tmp_path: Path) -> None:
    problem = _of_truth(tmp_path, kind, seed)
    residual = problem.residual(problem.nominal())
    assert adequacy(problem, residual, 0).p_value > 0.01
    # and not what is half a standard deviation larger
    assert adequacy(problem, residual + 0.5 * np.sign(residual), 0).p_value < 0.01


@pytest.mark.long
def test_realised_noise_is_as_large_as_its_covariance_says(tmp_path: Path) -> None:
    problem = _of_truth(tmp_path, "null", 901)
    assert problem.realised_noise is not None
    rows = problem.realised_noise.rows
    squares = np.mean([np.mean(z**2, axis=0) for column in rows.T for _, z in by_run(problem, column)], axis=0)
    assert np.all((squares > 0.8) & (squares < 1.25)), squares
    # one in a hundred, which Gaussian noise would make of one in twenty or more
    assert np.mean([adequacy(problem, column, 0).p_value < 0.01 for column in rows.T]) < 0.05


def test_the_tail_of_what_is_exponential() -> None:
    draws = np.random.default_rng(2).exponential(3.0, 4000)
    tail = Tail.of(draws)
    assert tail.scale == pytest.approx(3.0, rel=0.15)
    assert tail.probability(15.0) == pytest.approx(np.exp(-5.0), rel=0.5)
    assert tail.level(tail.probability(15.0)) == pytest.approx(15.0)
    assert tail.probability(-100.0) == 1.0


@pytest.mark.long
def test_slow_encoders_make_more_large_misfits_than_gaussian_noise(tmp_path: Path) -> None:
    """Of a joint that mostly moves by less than a step between samples: a tenth of all, where a hundredth is asked."""
    problem = _of_truth(tmp_path, "single:servo_gain_error", 923)
    assert problem.realised_noise is not None
    gaussian: Any = SimpleNamespace(runs=problem.runs, rows=problem.rows, realised_noise=None)
    columns = problem.realised_noise.rows.T
    rejected = [np.mean([adequacy(of, rows, 0).p_value < 0.01 for rows in columns]) for of in (gaussian, problem)]
    assert rejected[0] > 0.05 and rejected[1] < 0.03, rejected


@pytest.mark.long
def test_forces_that_count_as_noise_are_realised_too(tmp_path: Path) -> None:
    """Ten times as large as the noise of all readings."""
    problem = _of_truth(tmp_path, "null", 901)
    forced = problem.with_unknown_force(np.full(len(problem.scene.tree.joints), 1.0))
    assert forced.realised_noise is not None
    assert np.mean(forced.realised_noise.rows**2) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("louder", [0.5, 2.0])
def test_strengths_scatter_as_realised_noise_makes_them(louder: float) -> None:
    """And no less than the noise's covariance says."""
    rng = np.random.default_rng(3)
    friction = JointCoulombFriction("j1", {"torque": 1.0})
    residual, jacobian = rng.standard_normal(600), rng.standard_normal((600, 1))
    fitted = Fit(Model(np.zeros(0), (friction,)), residual, jacobian, 1.0 / (jacobian.T @ jacobian), 600)
    run = SimpleNamespace(name="run", shape=(600, 1), rows=600)
    louder_noise = louder * rng.standard_normal((600, 4000))
    problem: Any = SimpleNamespace(runs=(run,), rows=600, realised_noise=RealisedNoise(louder_noise))
    gaussian: Any = SimpleNamespace(runs=(run,), rows=600, realised_noise=None)
    assert realised_std(problem, fitted)[0] == pytest.approx(louder * fitted.std[0], rel=0.05)
    assert realised_std(gaussian, fitted)[0] == 0.0
    by_noise = [wald_statistics(of, fitted, friction.key)[0] for of in (problem, gaussian)]
    assert by_noise[0] == pytest.approx(by_noise[1] / max(louder, 1.0) ** 2, rel=0.1)
