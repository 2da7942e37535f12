"""No later stage can lose a verdict: a figure that cannot be computed is null, and a note says which and why."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drake_cafim import Recording, Scene
from drake_cafim.diagnosis import assembly, diagnose
from drake_cafim.diagnosis.diagnose import estimate, examine
from drake_cafim.diagnosis.fit.evidence import FINITE_NOISE, checks
from drake_cafim.diagnosis.fit.fitting import fit, unbiased_fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints import quality as prediction
from drake_cafim.diagnosis.predict.innovations import Innovations, _update
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.search import judgement, search
from drake_cafim.diagnosis.search.decisions import record_admission
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagrams.tutorials.stand_in import ARM, NOISE, record, stiff_grease
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.report import report_html
from drake_cafim.report.artifacts import write_artifacts
from drake_cafim.report.law_figures import law_picture
from drake_cafim.report.report_json import report_of

QUICK = Settings(most_effects=0)


def _fail(error: Exception) -> Callable[..., Any]:
    def failing(*_: object, **__: object) -> Any:
        raise error

    return failing


SINGULAR = _fail(np.linalg.LinAlgError("Singular matrix"))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene.from_model(ARM, channels=NOISE, weld=["base"])


@pytest.fixture(scope="module")
def recording() -> Recording:
    return record(stiff_grease, 1, "greased").window(0.0, 2.0)


def test_what_arithmetic_ends_is_a_result_and_a_defect_is_not() -> None:
    singular = compute(lambda: np.linalg.inv(np.zeros((2, 2))))
    assert singular == NotComputable("singular matrix")
    assert compute(lambda: 1.0 / float(np.zeros(1)[0].item())) == NotComputable("division by zero")
    assert compute(lambda: 10.0 ** float("400")) == NotComputable("a number is beyond what floating point holds")
    assert compute(lambda: 3.0) == 3.0
    with pytest.raises(KeyError):
        compute(lambda: dict[str, float]()["a defect"])


def test_an_innovation_whose_covariance_is_singular_is_none(
    scene: Scene, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    P = np.stack([np.eye(4), np.full((4, 4), 1e60), np.full((4, 4), np.inf)])
    with np.errstate(invalid="ignore"):
        mean, _, unlikely = _update(np.zeros((3, 4)), P, np.ones((3, 2)), np.full(2, 1e-6))
    assert np.isfinite(unlikely[0]) and np.all(np.isnan(unlikely[1:])) and np.all(np.isfinite(mean[0]))
    prepared = prepare(scene, [recording])
    [[quality]] = prepared.qualities([(Model(np.zeros(0)), np.zeros((0, 0)))])
    assert np.isfinite(quality.nll) and quality.missing == ()
    lost = Innovations(recording.time[:9], np.zeros(9), 0.25)
    monkeypatch.setattr(prediction, "innovations", lambda *_: [lost])
    [[quality]] = prepared.qualities([(Model(np.zeros(0)), np.zeros((0, 0)))])
    assert np.isnan(quality.nll) and quality.rmse
    assert quality.missing == ("nll cannot be computed: the filter's covariance is singular at 0.25 s of greased",)


def test_places_and_predictions_that_fail_leave_the_verdict(
    scene: Scene, recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(assembly, "locate_named", SINGULAR)
    monkeypatch.setattr(prediction, "innovations", SINGULAR)
    monkeypatch.setattr(prediction, "forecasts", _fail(OverflowError("math range error")))
    monkeypatch.setattr(assembly, "standard_deviations", _fail(FloatingPointError("invalid value")))
    verdict, outcome = examine(scene, [recording])
    assert verdict.kind == "explained" and verdict.explanation[0].effect.name == "joint_viscous_friction"
    report = write_artifacts(tmp_path, verdict, outcome, [recording], [], ["a command"], replay=False)
    assert report == json.loads((tmp_path / "report.json").read_text())
    assert report["mismatch"]["locations"] == []
    corrected = report["fit"]["train"]["corrected"]
    assert corrected["nll"] is None and corrected["rmse"] is None and corrected["effort"]["elbow"]["rms"] > 0.0
    assert report["explanation"][0]["parameters"]["coefficient"]["std"] is None
    for note in (
        "mismatch.locations cannot be computed: singular matrix",
        "fit.train.corrected.nll cannot be computed: singular matrix",
        "fit.train.corrected.rmse cannot be computed: a number is beyond what floating point holds",
        "the std of the named effects' parameters cannot be computed: invalid value",
    ):
        assert note in report["notes"]
        assert note in (tmp_path / "report.html").read_text().replace("&#39;", "'")


def test_a_search_that_fails_leaves_the_unknowns_fitted(
    scene: Scene, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(search, "grow", SINGULAR)
    verdict, _ = examine(scene, [recording])
    assert verdict.kind == "unexplained" and verdict.explanation == ()
    assert "no search for effects can be computed: singular matrix" in verdict.notes


def test_an_effect_under_which_no_noise_can_be_computed_is_not_admitted(
    scene: Scene, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As one may that leaves a link next to nothing of its mass: the others are tried on."""
    problem = prepare(scene, [recording]).problem()
    before = unbiased_fit(problem, problem.nominal())
    after = fit(problem, before.model.with_effects([effect_named("rotor_inertia")("elbow", {"inertia": 0.01})]))
    assert next(checks(problem, before, after, 100, 0.01)).name != FINITE_NOISE
    monkeypatch.setattr(type(problem), "has_other_noise", lambda *_: True)
    monkeypatch.setattr(type(problem), "rewhitened", SINGULAR)
    [failed] = done = list(checks(problem, before, after, 100, 0.01))
    assert failed.name == FINITE_NOISE and not failed.passed
    assert record_admission(before, after, done)[-1].words == (
        "it failed a test: it implies noise of the equations that cannot be computed"
    )


def test_pictures_that_fail_leave_the_report(
    scene: Scene, recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    verdict, outcome = examine(scene, [recording], settings=QUICK)
    for picture in ("residual_figure", "forecast_figure", "remains_figure"):
        monkeypatch.setattr(report_html, picture, SINGULAR)
    report = write_artifacts(tmp_path, verdict, outcome, [recording], [], ["a command"], replay=False)
    for what in ("the map of misfits", "the simulation", "what remains"):
        assert f"{what} cannot be drawn: singular matrix" in report["notes"]
    assert "cannot be drawn" in (tmp_path / "report.html").read_text()
    # a defect is not swallowed, and yet the verdict is on disk
    monkeypatch.setattr(report_html, "residual_figure", _fail(KeyError("a defect")))
    again = tmp_path / "again"
    again.mkdir()
    with pytest.raises(KeyError):
        write_artifacts(again, verdict, outcome, [recording], [], ["a command"], replay=False)
    assert json.loads((again / "report.json").read_text())["verdict"] == verdict.kind


def test_second_searches_that_fail_leave_the_first(
    scene: Scene, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    bare = replace(scene, vocabulary=())
    monkeypatch.setattr(judgement, "search_again", SINGULAR)
    monkeypatch.setattr(judgement, "_over_wider_windows", SINGULAR)
    verdict, _ = examine(bare, [recording])
    assert verdict.kind == "unexplained"
    assert "a search over wider windows cannot be computed: singular matrix" in verdict.notes


@pytest.mark.parametrize("stage", ["withhold_shared", "withhold_refuted", "withhold_refuted_pushes"])
def test_names_that_cannot_be_tested_stand_and_a_note_says_so(
    scene: Scene, recording: Recording, monkeypatch: pytest.MonkeyPatch, stage: str
) -> None:
    monkeypatch.setattr(diagnose, stage, SINGULAR)
    verdict, _ = examine(scene, [recording])
    assert verdict.kind == "explained" and verdict.explanation
    assert "whether the recordings refute what is named cannot be computed: singular matrix" in verdict.notes


def test_searches_and_fits_with_less_noise_that_fail_leave_the_first(
    scene: Scene, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Prepared, "with_noise_beside", SINGULAR)
    verdict, _ = examine(scene, [recording])
    assert verdict.kind == "explained"
    assert "a search with less noise of the efforts cannot be computed: singular matrix" in verdict.notes
    assert (
        "a fit with less noise of the efforts cannot be computed: singular matrix" in estimate(scene, [recording]).notes
    )


def test_servos_whose_fit_to_simulations_fails_are_fitted_to_their_equations(
    scene: Scene, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Prepared, "search_by_simulation", SINGULAR)
    verdict, _ = examine(scene, [recording])
    assert verdict.kind == "explained"
    assert "a fit of the servos' unknowns to simulations cannot be computed: singular matrix" in verdict.notes


def test_the_picture_of_a_law_without_finite_data_is_not_drawn(scene: Scene, recording: Recording) -> None:
    verdict, outcome = examine(scene, [recording])
    (found,) = verdict.explanation
    evidence = outcome.problem.pictures.evidence(found.effect, scene.physics, verdict.corrected.physics)
    assert evidence is not None and law_picture(evidence).svg
    lost = replace(evidence, with_it=[np.full_like(rows, np.nan) for rows in evidence.with_it])
    assert compute(lambda: law_picture(lost)) == NotComputable("no finite number is left of the data")


def test_a_number_that_is_none_is_null_and_named(scene: Scene, recording: Recording) -> None:
    verdict, _ = examine(scene, [recording], settings=QUICK)
    odd = replace(verdict, mismatch=replace(verdict.mismatch, p_value=float("nan")), reduced_chi_square=(np.inf, 1.0))
    report = report_of(odd, (), None, {})
    assert report["mismatch"]["p_value"] is None and report["reduced_chi_square"]["nominal"] is None
    assert "mismatch.p_value cannot be computed: no finite number comes out" in report["notes"]
    assert "reduced_chi_square.nominal cannot be computed: no finite number comes out" in report["notes"]


def test_an_estimate_says_what_it_lacks(scene: Scene, recording: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prediction, "innovations", SINGULAR)
    found = estimate(scene, [recording])
    assert "fit.train.nominal.nll cannot be computed: singular matrix" in found.notes
