"""The bench of efficiency: its bound against closed forms, its figures, and a tiny run that resumes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.benchmarks.efficiency.bound import Bound, bound_of
from tests.benchmarks.efficiency.catalogue import BLOCK, CELLS
from tests.benchmarks.efficiency.cell import Cell, Motion, Noise, moved
from tests.benchmarks.efficiency.machines import Effect, slider
from tests.benchmarks.efficiency.measure import Draw, line_of, measured

FRICTION = Effect("joint_viscous_friction", "rail", {"coefficient": 0.5})
TINY = Cell("tiny", slider, Motion((1.0, 2.0), 0.4, (0.0,)), 0.01, 1.5, Noise(1e-3, 1e-2), FRICTION, BLOCK)


def closed_form(cell: Cell) -> np.ndarray:
    """The covariance by the exact solution of m dv/dt = u − c v under a held effort, all of it dense."""
    u, h, N = moved(cell)[0].u[0, :, 0], cell.step, cell.samples

    def outputs(x: np.ndarray, efforts: np.ndarray) -> np.ndarray:
        m, c, q, v = x
        rate, found = c / m, []
        for effort in efforts:
            found.append([q, v])
            decay, toward = np.exp(-rate * h), effort / c
            q, v = q + toward * h + (v - toward) * (1.0 - decay) / rate, toward + (v - toward) * decay
        return np.array(found)[:, : 1 if cell.noise.v is None else 2].T.ravel()

    clean = moved(cell)[0]
    x = np.array([*cell.true, clean.q[0, 0, 0], clean.v[0, 0, 0]])
    J = np.stack([(outputs(x + 1e-5 * e, u) - outputs(x - 1e-5 * e, u)) / 2e-5 for e in np.eye(4)], axis=1)
    R = np.repeat([cell.noise.q**2, *([] if cell.noise.v is None else [cell.noise.v**2])], N)
    G = np.stack([outputs(x, u + e) - outputs(x, u) for e in np.eye(N)], axis=1) if cell.noise.u else np.zeros((1, N))
    information = J.T @ np.linalg.solve(np.diag(R) + cell.noise.u**2 * G @ G.T, J)
    information[0, 0] += cell.unknown[0].prior_std ** -2
    return np.linalg.inv(information)[:2, :2]


@pytest.mark.parametrize("noise", [Noise(1e-3, 1e-2), Noise(1e-4), Noise(1e-4, 1e-3, u=0.3)], ids=str)
def test_the_bound_is_theclosed_form(noise: Noise) -> None:
    cell = replace(TINY, noise=noise)
    found = bound_of(cell, moved(cell)[0], 1)
    np.testing.assert_allclose(found.covariance, closed_form(cell), rtol=2e-4)
    assert found.segments == 1


def test_an_efficient_and_honest_estimator_is_called_so() -> None:
    cell, rng = TINY, np.random.default_rng(0)
    covariance = np.diag([1e-2, 4e-2])
    errors = 0.2 * rng.normal(size=400)
    draws = [Draw(k, [2.2, 0.5 + e], [0.1, 0.2], 1.0, 0.0) for k, e in enumerate(errors)]
    line = line_of(cell, Bound(covariance, 1, 0.0), draws)
    assert line.efficiency_interval[0] < 1.0 < line.efficiency_interval[1]
    assert line.honesty_interval[0] < 1.0 < line.honesty_interval[1]
    twice = [Draw(d.number, [2.2, 0.5 + 2.0 * e], [0.1, 0.1], 1.0, 0.0) for d, e in zip(draws, errors, strict=True)]
    worse = line_of(cell, Bound(covariance, 1, 0.0), twice)
    assert worse.efficiency == pytest.approx(line.efficiency / 4.0)
    assert worse.honesty == pytest.approx(line.honesty / 4.0)


@pytest.mark.parametrize("fed_back", [False, True])
def test_a_tiny_run_resumes(fed_back: bool, tmp_path: Path) -> None:
    cell = replace(TINY, fed_back=fed_back)
    measured(cell, 2, tmp_path)
    (kept,) = tmp_path.glob("*/draws.jsonl")
    before = kept.read_text()
    bound, draws = measured(cell, 3, tmp_path)
    assert kept.read_text().startswith(before)
    assert [draw.number for draw in draws] == [0, 1, 2]
    assert all(draw.values is not None for draw in draws)
    # a fit that is off by more than that has lost the truth, not information
    assert all(abs(draw.values[1] - 0.5) < 10.0 * draw.std[1] for draw in draws if draw.values and draw.std)
    assert bound.std[1] < 0.1


def test_the_table_spans_what_it_should() -> None:
    assert len(CELLS) >= 12
    assert len({cell.name for cell in CELLS}) == len(CELLS)
    assert {cell.step for cell in CELLS} >= {0.001, 0.01}
    assert min(cell.noise.q for cell in CELLS) == 1e-5 and max(cell.noise.q for cell in CELLS) == 2e-3
    assert any(cell.gaps for cell in CELLS) and any(cell.fed_back for cell in CELLS)
