"""The covariance that is computed for the whitened rows, against the spread of rows with simulated noise."""

from pathlib import Path

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.fit.fitting import fit
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.law_shapes import fit_shapes
from drake_cafim.diagnosis.whitening.kinked_law_noise import _correlation, beyond_slope
from drake_cafim.effects.effect import Effect
from drake_cafim.scene.scene import Scene
from tests.concealed.case import Case
from tests.concealed.make import simulate
from tests.parametrize import long_after
from tests.recoveries.rig import recorded, waves
from tests.test_inertials import arm


@pytest.mark.parametrize(
    ("kind", "rig", "seed"),
    long_after(
        2,
        [
            ("null", "arm2", 1),
            ("single:sensor_misalignment", "press", 2),
            ("null", "press", 0x887801BB6C1B7D7B9EA22237E1168899),
            ("single:joint_coulomb_friction", "arm2", 3),
        ],
    ),
)
def test_rows_of_the_truth_are_as_noisy_as_expected(kind: str, rig: str, seed: int, tmp_path: Path) -> None:
    """White, of unit variance in each row, under the true effects; unknowns are fitted."""
    case = simulate(kind, rig, seed)
    case.write(tmp_path)
    scene = Scene.load(tmp_path / "scenario.yaml")
    names = sorted(tmp_path.glob("train_*.parquet"))
    problem = prepare(scene, [recordings.read(name) for name in names]).problem()
    model = problem.nominal().with_effects(_true_effects(case, problem))
    for _ in range(2):
        problem = problem.rewhitened(model)
        model = fit_shapes(problem, fit(problem, model)).model
    rows = [z for _, z in by_run(problem, problem.rows_of(model))]
    squares = np.mean(np.concatenate(rows) ** 2, axis=0)
    neighbours = np.mean(np.concatenate([z[1:] * z[:-1] for z in rows]), axis=0)
    assert np.all((squares > 0.8) & (squares < 1.25)), squares
    assert np.all(np.abs(neighbours) < 0.15), neighbours


def _true_effects(case: Case, problem: SearchProblem) -> list[Effect]:
    """The concealed effects with their true values."""
    possible = {effect.key: effect for effect in problem.hypotheses()}
    found = []
    for item in case.truth["effects"]:  # type: ignore[attr-defined]
        values = {name: value for name, (value, _) in item["parameters"].items()}
        found.append(possible[item["effect"], item["at"]].with_values(values))
    return found


@pytest.mark.parametrize("width", [1e-4, 0.01, 0.05])
def test_what_a_sign_scatters_beyond_its_mean_slope(width: float) -> None:
    """Against draws of the error."""
    rng, std = np.random.default_rng(3), 0.01
    v = np.linspace(-0.03, 0.03, 13)
    error = std * rng.normal(size=(200_000, 1))
    forces = np.tanh((v + error) / width)
    slope = np.mean(forces * error, axis=0) / std**2
    expected = np.std(forces - slope * error, axis=0)
    found = beyond_slope(lambda off: np.tanh((v + off) / width), np.full_like(v, std))
    assert np.allclose(found, expected, atol=0.07)


def test_the_noise_of_a_smoothed_velocity_is_correlated_as_its_smoother_makes_it(tmp_path: Path) -> None:
    """That of velocities and that of positions, each by its variance: S_v σ_v² S_vᵀ + S_q σ_q² S_qᵀ, scaled."""
    scene = arm(tmp_path)
    recording = recorded(scene, waves((0.0, 0.3, 0.5), (0.5, 0.4, 0.5), 1), 1.5, 0)
    problem = prepare(scene, [recording]).problem()
    assert isinstance(problem, WeakProblem)
    weak = problem.forms[0]
    samples = weak.samples
    at = np.flatnonzero(np.abs(samples.v[:, 1]) < 0.5)
    smoother, total = samples.kinked_v[1], np.zeros((len(at), len(at)))
    for std, part in ((samples.std["v.lift"], smoother.from_v), (samples.std["q.lift"], smoother.from_q)):
        rows = part.toarray()[at]
        assert np.any(rows)
        total += std**2 * rows @ rows.T
    scale = 1.0 / np.sqrt(np.diag(total))
    np.testing.assert_allclose(_correlation(weak, 1, at).toarray(), total * scale * scale[:, None], atol=1e-12)
