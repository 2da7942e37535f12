"""What stands out of the noise without a name: the intervals of what is named allow for it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.assembly import _explanations
from drake_cafim.diagnosis.fit.fitting import unbiased_fit
from drake_cafim.diagnosis.fit.intervals import changes_beside, standard_deviations
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.search.search import Outcome
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.joint import JointCoulombFriction
from drake_cafim.scene.scene import Scene
from tests.test_left_out import VISCOUS, recording, scene

DRY = JointCoulombFriction("rail", {"torque": 0.1})


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, Judgement]:
    """The judgement that a sliding mass has dry friction; it is viscous."""
    given = scene(tmp_path_factory.mktemp("slider"))
    problem = prepare(given, [recording(f"run{k}", k, 4.0, 0.0) for k in range(2)]).problem()
    nominal = unbiased_fit(problem, problem.nominal())
    best = unbiased_fit(problem, Model(given.priors.mean, (DRY,)))
    outcome = Outcome(problem, problem, nominal, best, (best,), 10, (), 0.0, {})
    return given, Judgement(outcome, best, "unexplained")


def _std(given: Scene, judgement: Judgement) -> tuple[float | None, tuple[str, ...]]:
    [named], notes = _explanations(given, judgement, None)
    return named.values["torque"].std, notes


@pytest.mark.parametrize("by", ["unsupported", "withheld"])
def test_the_std_allows_for_what_stands_out_and_is_not_named(told: tuple[Scene, Judgement], by: str) -> None:
    given, alone = told
    outcome = replace(alone.outcome, unsupported=(VISCOUS,)) if by == "unsupported" else alone.outcome
    judgement = replace(alone, outcome=outcome, withheld=(VISCOUS,) if by == "withheld" else ())
    problem, best = outcome.problem, alone.best
    [change] = changes_beside(problem, best, [VISCOUS])
    beside = unbiased_fit(problem, best.model.with_effects([VISCOUS]))
    assert change == pytest.approx(abs(beside.model.vector[0] - best.model.vector[0]))
    [own] = standard_deviations(problem, best, outcome.scale)
    std, notes = _std(given, judgement)
    assert std == pytest.approx(float(np.hypot(own, change))) and change > own
    assert notes == (
        "the std of what is named allows for effects that stand out and are not named: joint viscous friction at rail",
    )
    assert std is not None and 5.0 * own < best.model.vector[0] < 2.0 * std, "there is no dry friction"


def test_nothing_is_allowed_for_that_is_named_or_that_the_rows_do_not_tell(told: tuple[Scene, Judgement]) -> None:
    given, alone = told
    [own] = standard_deviations(alone.outcome.problem, alone.best, alone.outcome.scale)
    named = replace(alone, outcome=replace(alone.outcome, unsupported=(DRY,)))
    assert _std(given, named) == (pytest.approx(own), ())
    other = effect_named("joint_stribeck_friction")("rail")
    assert other.excludes(DRY), "of two laws of one friction only one is there"
    assert _std(given, replace(alone, withheld=(other,))) == (pytest.approx(own), ())
    simulated = replace(alone, withheld=(VISCOUS,), std=np.array([0.3]))
    assert _std(given, simulated) == (0.3, ())


def test_effects_beside_which_nothing_fits_better_change_nothing(
    told: tuple[Scene, Judgement], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, alone = told
    problem, best = alone.outcome.problem, alone.best
    worse = replace(
        best, model=Model(best.model.unknown, (replace(DRY, values={**DRY.values, "torque": 9.0}), VISCOUS))
    )
    for fit in (replace(worse, penalty=1e9), replace(worse, residual=0.5 * best.residual, echo=True)):
        monkeypatch.setattr("drake_cafim.diagnosis.fit.intervals.unbiased_fit", lambda *of, fit=fit: fit)
        np.testing.assert_array_equal(changes_beside(problem, best, [VISCOUS]), [0.0])
