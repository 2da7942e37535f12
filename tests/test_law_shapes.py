"""How far the shapes of laws are refined."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.evidence import scale_of
from drake_cafim.diagnosis.fit.fitting import CONVERGED, Fit, fit
from drake_cafim.diagnosis.search import law_shapes
from drake_cafim.effects.joint import JointCoulombFriction
from tests.test_fitting import sliding_mass


def test_a_width_is_refined_only_as_long_as_that_matters_beside_what_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Dry friction stands in for viscous friction, and leaves far more than noise whatever its width."""
    problem = sliding_mass(tmp_path, mass=2.0, friction=1.5, seed=1)
    start = fit(problem, problem.nominal().with_effects([JointCoulombFriction("rail", {"torque": 0.3})]))
    assert scale_of(start) > 100.0
    tried: list[Fit] = []

    def slightly_better(shapes: object, best: Fit, others: object) -> tuple[Fit, float]:
        assert len(tried) < 20
        tried.append(replace(best, residual=np.sqrt(1.0 - 2.0 / best.chi_square) * best.residual))
        return tried[-1], 2.0 * start.chi_square

    monkeypatch.setattr(law_shapes._Shapes, "_best_of", slightly_better)
    # the last one tried is of ways over which friction builds up: without one it is no better
    assert law_shapes.fit_shapes(problem, start, None, CONVERGED) is tried[-2]
