"""Fits whose unknowns end at the bounds of their priors: what moves together with them is not left behind."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from drake_cafim.diagnosis.fit.beside import Beside
from drake_cafim.diagnosis.fit.bounds import bounds, minimise_within, solve_within
from drake_cafim.diagnosis.fit.fitting import Fit, fit, fit_at_first_order
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.effects.catalogue import effect_named
from tests import two_links

TOO_LIGHT = """unknown: [{parameter: mass, body: lower, mean: 0.8, std: 0.01},
  {parameter: mass, body: upper, mean: 1.8, std: 0.01}]"""


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> SearchProblem:
    """An arm whose shoulder rubs, and whose masses (1 and 2 kg) are further from their means than they may go."""
    scene = two_links.scene(tmp_path_factory.mktemp("arm"), unknown=TOO_LIGHT)
    return prepare(scene, [two_links.recording("run", 1, friction=(0.5, 0.0))]).problem()


@pytest.fixture(scope="module")
def best(problem: SearchProblem) -> Fit:
    viscous = effect_named("joint_viscous_friction")("shoulder", {"coefficient": 0.1})
    found = fit(problem, problem.nominal().with_effects([viscous]))
    np.testing.assert_allclose(found.model.unknown, bounds(problem, problem.nominal())[1])
    return found


@pytest.mark.parametrize("name", ["joint_coulomb_friction", "joint_asymmetric_coulomb_friction", "joint_spring"])
def test_a_law_fits_as_well_in_every_way_that_it_is_fitted(problem: SearchProblem, best: Fit, name: str) -> None:
    """Friction takes one of the two masses off its bound, which a step that is cut off there does not find."""
    law = effect_named(name)("shoulder")
    law = law.with_values(law.vector)
    added = best.model.with_effects([law])
    exact = fit(problem, added, tolerance=0.1)
    first = fit_at_first_order(problem, best, added, [problem.effect_columns(added, 1)])
    assert first.chi_square == pytest.approx(exact.chi_square, rel=1e-5)
    start = best.model.without(best.model.effects[0]).with_effects([law])
    beside = replace(Beside.of(problem, best, 0), position=0).fit(start, 0.1)
    assert beside.chi_square == pytest.approx(fit(problem, start, tolerance=0.1).chi_square, rel=1e-5)


def test_a_fit_is_the_minimum_within_its_bounds(problem: SearchProblem, best: Fit) -> None:
    """There no parameter within its bounds has a slope, and at a bound it leads outward."""
    law = effect_named("joint_asymmetric_coulomb_friction")("shoulder")
    found = fit(problem, best.model.with_effects([law.with_values(law.vector)]))
    lower, upper = bounds(problem, found.model)
    slope = found.jacobian.T @ found.residual / np.linalg.norm(found.jacobian, axis=0)
    at_upper = found.model.vector > upper - 1e-9
    free = ~at_upper & (found.model.vector > lower + 1e-9)
    assert list(at_upper[:2]) == [True, False]
    assert np.all(np.abs(slope[free]) < 1e-3 * np.linalg.norm(found.residual)) and np.all(slope[at_upper] < 0.0)


def test_a_step_within_bounds_is_the_best_one() -> None:
    rng = np.random.default_rng(3)
    slopes, residual = rng.standard_normal((40, 6)), 5.0 * rng.standard_normal(40)
    slopes[:, 1] = slopes[:, 0] + 0.1 * slopes[:, 1]
    basis, triangle = np.linalg.qr(slopes)
    lower, upper = np.array([-0.1, -9.0, 0.0, 0.0, -0.2, -9.0]), np.array([0.1, 9.0, 0.0, 0.3, 9.0, 9.0])
    step, half = solve_within(triangle, basis.T @ residual, lower, upper)
    assert np.all(step >= lower) and np.all(step <= upper) and step[2] == 0.0
    left = residual + slopes @ step
    assert 2.0 * half + residual @ residual - residual @ basis @ basis.T @ residual == pytest.approx(left @ left)
    same = minimise_within(slopes.T @ slopes, slopes.T @ residual, lower, upper)
    np.testing.assert_allclose(same, step, atol=1e-8)
    for _ in range(2000):
        other = np.clip(step + 0.2 * rng.standard_normal(6), lower, upper)
        assert np.linalg.norm(residual + slopes @ other) >= np.linalg.norm(left) - 1e-9
    nowhere = np.zeros(6)
    assert solve_within(triangle, basis.T @ residual, nowhere, nowhere)[0].tolist() == [0.0] * 6


@pytest.mark.parametrize("seed", range(40))
def test_a_step_with_many_parameters_at_bounds_is_as_good_as_an_active_set_finds_it(seed: int) -> None:
    """Columns of very different size that point nearly the same way; of every fourth problem some tell nothing."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(2, 40))
    slopes = rng.standard_normal((3 * m, m)) * np.exp(2.0 * rng.standard_normal(m)) + 3.0 * rng.standard_normal(
        (3 * m, 1)
    )
    triangle, seen = np.linalg.qr(slopes)[1], rng.standard_normal(m)
    if seed % 4 == 0:
        triangle[-2:] = 0.0
    reach = float(np.quantile(np.abs(np.linalg.lstsq(triangle, seen, rcond=None)[0]), rng.uniform()))
    lower, upper = -reach * rng.uniform(0.1, 1.0, m), reach * rng.uniform(0.1, 1.0, m)
    step, half = solve_within(triangle, seen, lower, upper)
    assert np.all(step >= lower) and np.all(step <= upper)
    assert half == pytest.approx(lsq_linear(triangle, -seen, (lower, upper), method="bvls").cost, rel=1e-8, abs=1e-12)
