"""What a search keeps of problems that are whitened anew, and what it forgets."""

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest

from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from tests.test_growth_by_place import VISCOUS, arm_that_rubs, viscous


@pytest.fixture(scope="module")
def growth(tmp_path_factory: pytest.TempPathFactory) -> GrowthByPlace:
    return arm_that_rubs(tmp_path_factory.mktemp("arm"), lambda v: VISCOUS * v)


def test_of_problems_that_are_whitened_again_one_is_kept(growth: GrowthByPlace) -> None:
    """The first problem lives as long as a search; it must not keep all those that came after it."""
    first = growth.problem
    models = [replace(first.nominal()) for _ in range(3)]
    gc.disable()
    try:
        second = first.rewhitened(models[0])
        assert first.rewhitened(models[0]) is second
        third = second.rewhitened(models[1])
        assert second.rewhitened(models[1]) is third
        gone = weakref.ref(second)
        del second
        assert gone() is None
        gone = weakref.ref(third)
        fourth = third.rewhitened(models[2])
        del third
        assert gone() is None
        assert first.rewhitened(models[2]) is fourth
    finally:
        gc.enable()


def test_what_was_forgotten_is_computed_again_alike(growth: GrowthByPlace) -> None:
    problem, model = growth.nominal, growth.best.model.with_effects([viscous(growth, 0.1)])
    assert isinstance(problem, WeakProblem)
    rows, columns = problem.residual(model), problem.jacobian(model)
    weak = problem.runs[0].weak
    kept = weakref.ref(weak.terms(model.physics(problem.scene)))
    problem.forget()
    gc.collect()
    assert kept() is None
    # by another path, with or without the regressor of the links' inertias
    np.testing.assert_allclose(problem.residual(model), rows, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(problem.jacobian(model), columns, rtol=1e-9, atol=1e-9)
