"""Where rows have no slope as a fit begins: beside a flat strength it begins anew, where rows diverge it ends."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.fitting import _minimise, fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.effects.link import GravityMisalignment
from drake_cafim.scenario.schema import parse
from drake_cafim.scene.scene import Scene
from tests.test_unknown_effects import PENDULUM, moved, recorded


def test_a_strength_without_a_slope_at_zero_is_found(tmp_path: Path) -> None:
    """Gravity that leans along a pendulum's axis is weaker in its plane, by the cosine of the angle."""
    lean = 0.3
    u = 3.0 * np.sin(2.0 * np.pi * 0.8 * 0.004 * np.arange(500))
    q, v = moved(lambda x, w, f: (f - 0.5 * 9.81 * np.cos(lean) * np.sin(x)) / 0.27, u, 0.0)
    (tmp_path / "pendulum.urdf").write_text(PENDULUM)
    scene = Scene.build(parse({"model": "pendulum.urdf", "weld": [{"body": "base"}]}, "arm.yaml"), tmp_path, "arm.yaml")
    prepared = prepare(scene, [recorded("pivot", q, v, u, (2e-4, 2e-3))])
    assert isinstance(prepared, Prepared)
    problem = prepared.problem()
    level = GravityMisalignment("world", {"roll": 0.0, "pitch": 0.0})
    [found] = fit(problem, problem.nominal().with_effects([level])).model.effects
    assert abs(found.values["roll"]) == pytest.approx(lean, rel=0.02)


def test_a_fit_ends_where_it_begins_if_the_rows_diverge_there() -> None:
    """As where a gap's flanks are so stiff that its simulation diverges; there is no way down from there."""
    problem: Any = SimpleNamespace(
        residual=lambda model: np.full(5, np.inf),
        jacobian=lambda model: np.ones((5, 1)),
        least_damping=0.0,
        slack=0.0,
    )
    model, residual, _ = _minimise(problem, Model(np.array([2.0])), np.zeros(1), 10)
    assert model.vector.tolist() == [2.0] and np.all(np.isinf(residual))


def _with_unknown_rotor(folder: Path, inertia: float) -> SearchProblem:
    """A pendulum with that inertia, kg m², of .27 by its file, and a rotor of .02 ± .02 kg m² beside it."""
    u = 3.0 * np.sin(2.0 * np.pi * 0.8 * 0.004 * np.arange(500))
    q, v = moved(lambda x, w, f: (f - 0.5 * 9.81 * np.sin(x)) / inertia, u, 0.0)
    (folder / "pendulum.urdf").write_text(PENDULUM)
    unknown = [{"parameter": "rotor_inertia", "joint": "pivot", "mean": 0.02, "std": 0.02}]
    raw = {"model": "pendulum.urdf", "weld": [{"body": "base"}], "unknown": unknown}
    scene = Scene.build(parse(raw, "arm.yaml"), folder, "arm.yaml")
    return prepare(scene, [recorded("pivot", q, v, u, (2e-4, 2e-3))]).problem()


def test_a_fit_that_begins_beyond_a_bound_has_slopes_there(tmp_path: Path) -> None:
    """To first order a rotor may come out below zero: there differences within the bounds have no width."""
    problem, beyond, bound = _with_unknown_rotor(tmp_path, 0.27), Model(np.array([-0.01])), Model(np.array([0.0]))
    slopes = problem.jacobian(beyond)
    assert np.any(slopes[:-1])
    assert slopes == pytest.approx(_with_unknown_rotor(tmp_path, 0.27).jacobian(bound), rel=1e-9)
    found = fit(problem, beyond)
    assert 0.0 <= found.model.unknown[0] < 0.02
    assert found.chi_square == pytest.approx(fit(problem, bound).chi_square, abs=0.01)


def test_unknown_forces_hold_what_an_unknown_cannot_explain_within_its_bounds(tmp_path: Path) -> None:
    """A rotor of −0.1 kg m² would explain a pendulum that is lighter than its file says, and there is none."""
    problem = _with_unknown_rotor(tmp_path, 0.17)
    force = problem.likeliest_force(problem.nominal())
    assert force is not None
    found = fit(problem.with_unknown_force(force, problem.nominal()), problem.nominal())
    assert found.model.unknown[0] == 0.0 and found.reduced_chi_square < 2.0
