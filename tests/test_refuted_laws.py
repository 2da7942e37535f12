"""A law is refuted by strengths that vary, and by what is left at its place where other equations hold to the noise."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import drake_cafim
from drake_cafim.diagnosis.fit.constancy import constancy_of
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.search import shared_evidence
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.diagnosis.verdict import Kind
from drake_cafim.effects.body import ExternalDisturbance
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointViscousFriction
from drake_cafim.effects.normal_contact import ContactViscoelasticRelaxation
from drake_cafim.effects.surface import SurfaceOffset
from drake_cafim.parameters import Parameter
from drake_cafim.scenario.unknown import UnknownParameter
from drake_cafim.typing import Array
from tests.concealed.make import make

WINDOWS, ROWS = 400, 2
NOTHING_UNKNOWN = SimpleNamespace(unknown=(), priors=SimpleNamespace(mean=np.zeros(0), std=np.ones(0)))
"""What a scene without unknown parameters shows of them."""
VISCOUS = JointViscousFriction("elbow", {"coefficient": 1.0})


def _judgement(
    monkeypatch: pytest.MonkeyPatch,
    strengths: Array,
    kind: Kind,
    left: float = 1.0,
    seed: int = 1,
    forced: tuple[str, ...] = (),
) -> Judgement:
    """A viscous friction of other true `strengths` (2, 2) by recording and half; `left` times the noise is left.

    Unknown forces at the joints `forced` are a large part of it.
    """
    rng = np.random.default_rng(seed)
    slope = rng.normal(size=(2, WINDOWS, ROWS))
    true = np.repeat(strengths, WINDOWS // 2, axis=1)[:, :, None]
    rows = np.sqrt(left) * rng.normal(size=slope.shape) - true * slope

    def fitted(problem: Any, model: Model) -> Fit:
        jacobian = slope.reshape(-1, len(model.vector)) if model.effects else np.zeros((rows.size, 0))
        step = np.linalg.lstsq(jacobian, -rows.ravel(), rcond=None)[0]
        covariance = np.linalg.inv(jacobian.T @ jacobian) if model.effects else np.eye(0)
        return Fit(model.at(step), rows.ravel() + jacobian @ step, jacobian, covariance, rows.size, unbiased=True)

    problem: Any = SimpleNamespace(
        rows=rows.size,
        runs=[SimpleNamespace(name=name, shape=(WINDOWS, ROWS)) for name in "ab"],
        residual=lambda model: fitted(None, model).residual,
        equations=slice(None),
        realised_noise=None,
        forced_joints=forced,
        scene=NOTHING_UNKNOWN,
        with_reading=lambda model: None,
    )
    monkeypatch.setattr(shared_evidence, "unbiased_fit", fitted)
    monkeypatch.setattr(shared_evidence, "mean_square", lambda *of: 2.0)
    monkeypatch.setattr(shared_evidence, "misfit_by_row", lambda problem, model: np.ones(2))
    monkeypatch.setattr(shared_evidence, "misfits_by_row", lambda of, model, others: np.ones((1 + len(others), 2)))
    nothing = Model(np.zeros(0))
    nominal = fitted(problem, nothing)
    outcome: Any = SimpleNamespace(problem=problem, nominal_problem=problem, nominal=nominal, hypotheses=1000)
    return Judgement(outcome, fitted(problem, nothing.with_effects([VISCOUS])), kind)


def test_noise_alone_varies_as_the_test_says(monkeypatch: pytest.MonkeyPatch) -> None:
    p_values = []
    for seed in range(200):
        judgement = _judgement(monkeypatch, np.ones((2, 2)), "explained", seed=seed)
        (tested,) = constancy_of(judgement.outcome.problem, judgement.best)
        assert tested.common > 1000.0 and tested.share > 0.98
        p_values.append(tested.p_value)
    assert 0.02 < np.mean(np.array(p_values) < 0.05) < 0.09


@pytest.mark.parametrize("strengths", [[[1.0, 1.0], [1.0, 1.3]], [[0.8, 0.8], [1.2, 1.2]]])
def test_a_law_that_varies_beside_noise_alone_is_not_named(
    monkeypatch: pytest.MonkeyPatch, strengths: list[list[float]]
) -> None:
    trace = Trace()
    judgement = _judgement(monkeypatch, np.array(strengths), "explained")
    found = shared_evidence.withhold_refuted(judgement, Settings(), trace)
    assert found.kind == "unexplained" and found.best is found.outcome.nominal
    assert not found.withheld and found.left == 2.0
    (record,) = trace.records
    assert not record.passed and "half of each recording" in record.words


@pytest.mark.parametrize(
    ("forced", "more", "named"), [((), 0.24, False), (("elbow",), 0.24, True), (("elbow",), 1.0, False)]
)
def test_beside_unknown_forces_it_varies_by_more_than_faint_effects_make_it(
    monkeypatch: pytest.MonkeyPatch, forced: tuple[str, ...], more: float, named: bool
) -> None:
    judgement = _judgement(monkeypatch, np.array([[1.0, 1.0], [1.0, 1.0 + more]]), "explained", forced=forced)
    (tested,) = constancy_of(judgement.outcome.problem, judgement.best)
    assert tested.p_value < Settings().adequacy_level and tested.share < 1.0
    found = shared_evidence.withhold_refuted(judgement, Settings(), Trace())
    assert bool(found.best.model.effects) == named


@pytest.mark.parametrize(("more", "named"), [(6.0, True), (60.0, False)])
def test_beside_unknown_forces_a_law_that_varies_by_less_than_a_tenth_is_named(
    monkeypatch: pytest.MonkeyPatch, more: float, named: bool
) -> None:
    strengths = np.array([[100.0, 100.0], [100.0, 100.0 + more]])
    judgement = _judgement(monkeypatch, strengths, "explained", forced=("elbow",))
    found = shared_evidence.withhold_refuted(judgement, Settings(), Trace())
    assert bool(found.best.model.effects) == named


def test_the_same_strength_throughout_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    trace = Trace()
    judgement = _judgement(monkeypatch, np.ones((2, 2)), "explained")
    assert shared_evidence.withhold_refuted(judgement, Settings(), trace) is judgement
    assert [record.passed for record in trace.records] == [True]


@pytest.mark.parametrize(("more", "named"), [(0.6, True), (6.0, False)])
def test_a_law_that_shows_so_well_that_it_varies_by_less_than_a_hundredth_is_named(
    monkeypatch: pytest.MonkeyPatch, more: float, named: bool
) -> None:
    trace = Trace()
    judgement = _judgement(monkeypatch, np.array([[100.0, 100.0], [100.0, 100.0 + more]]), "explained")
    found = shared_evidence.withhold_refuted(judgement, Settings(), trace)
    assert bool(found.best.model.effects) == named
    (record,) = trace.records
    assert record.statistic is not None and record.threshold is not None and record.statistic < record.threshold
    assert ("too little to refute it, so it is named" in record.words) == named == record.passed


@pytest.mark.parametrize(("strengths", "named"), [([[1.0, 1.0], [0.6, 0.6]], True), ([[1.0, 1.0], [-0.9, 0.9]], False)])
def test_where_more_is_left_the_common_strength_has_to_explain_most(
    monkeypatch: pytest.MonkeyPatch, strengths: list[list[float]], named: bool
) -> None:
    judgement = _judgement(monkeypatch, np.array(strengths), "unexplained", left=1.5)
    found = shared_evidence.withhold_refuted(judgement, Settings(), Trace())
    assert bool(found.best.model.effects) == named and found.kind == "unexplained"


@pytest.mark.parametrize(
    ("strengths", "kind", "refuted"),
    [
        ([[1.0, 1.0], [-0.3, -0.3]], "unexplained", True),
        ([[1.0, 1.0], [0.6, 0.6]], "unexplained", False),
        ([[1.0, 1.0], [-0.3, -0.3]], "explained", False),
    ],
)
def test_where_more_is_left_a_law_has_to_help_most_recordings(
    monkeypatch: pytest.MonkeyPatch, strengths: list[list[float]], kind: Kind, refuted: bool
) -> None:
    trace = Trace()
    judgement = _judgement(monkeypatch, np.array(strengths), kind, left=1.5)
    found = shared_evidence._helping_some(judgement, Settings(), trace)
    assert [effect.key for effect in found] == ([VISCOUS.key] if refuted else [])
    assert [record.passed for record in trace.records] == ([not refuted] if kind == "unexplained" else [])


@pytest.mark.parametrize(
    ("stiffness", "kind", "refuted"),
    [(5000.0, "unexplained", True), (3500.0, "unexplained", False), (5000.0, "explained", False)],
)
def test_a_law_of_a_contact_that_needs_an_implausible_stiffness_and_leaves_much_is_not_named(
    stiffness: float, kind: Kind, refuted: bool
) -> None:
    """Known as 2500 N/m with a standard deviation of 500."""
    scene: Any = SimpleNamespace(
        unknown=(
            UnknownParameter("stiffness", "contact", "tool/wall", Parameter("stiffness", 2500.0, 500.0)),
            UnknownParameter("damping", "joint", VISCOUS.at, Parameter("damping", 1.0, 0.1)),
        ),
        priors=SimpleNamespace(mean=np.array([2500.0, 1.0]), std=np.array([500.0, 0.1])),
    )
    relaxation = ContactViscoelasticRelaxation("tool/wall", {"stiffness": 600.0, "time_constant": 0.1})
    surface = SurfaceOffset("wall", {"offset": -1e-4})
    # a joint's law beside a damping that is as far stays, and another surface's
    other = SurfaceOffset("table", {"offset": -1e-4})
    best: Any = SimpleNamespace(model=Model(np.array([stiffness, 2.0]), (relaxation, VISCOUS, surface, other)))
    outcome: Any = SimpleNamespace(problem=SimpleNamespace(scene=scene))
    trace = Trace()
    judgement = Judgement(outcome, best, kind)
    found = shared_evidence._of_implausible_contacts(judgement, Settings(), trace)
    assert found == ([relaxation, surface] if refuted else [])
    assert ["stiffness of tool/wall" in record.words for record in trace.records] == [True, True] * refuted
    # where noise alone is left, the parameter alone is the mismatch
    assert not shared_evidence._of_implausible_contacts(replace(judgement, adequate=True), Settings(), Trace())


def test_each_way_to_refute_a_law_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    ways = ("_of_forces_that_are_read", "_refuted_at_place", "_of_implausible_contacts", "_varying", "_helping_some")
    for way in ways:
        monkeypatch.setattr(shared_evidence, way, lambda *of, way=way: asked.append(way) or [])
    judgement = _judgement(monkeypatch, np.ones((2, 2)), "unexplained", left=1.5)
    assert shared_evidence.withhold_refuted(judgement, Settings(), Trace()) is judgement
    assert asked == list(ways)
    # what one of them cannot tell, the others may
    monkeypatch.setattr(shared_evidence, ways[1], lambda *of: np.linalg.cholesky(-np.eye(2)))
    found = shared_evidence.withhold_refuted(judgement, Settings(), Trace())
    assert asked[5:] == [ways[0], *ways[2:]] and found.best is judgement.best
    assert "matrix is not positive definite" in found.notes[0]
    # and what they withhold stays so where a later one has no result
    law = judgement.best.model.effects[0]
    monkeypatch.setattr(shared_evidence, ways[1], lambda of, *_: [law] if law in of.best.model.effects else [])
    monkeypatch.setattr(shared_evidence, "_unconfirmed", lambda *of: np.linalg.cholesky(-np.eye(2)))
    found = shared_evidence.withhold_refuted(judgement, Settings(), Trace())
    assert law not in found.best.model.effects and "matrix is not positive definite" in found.notes[0]


@pytest.mark.parametrize(
    ("search", "adequate", "left_out"), [("", False, True), ("unknown forces", False, False), ("", True, False)]
)
def test_the_law_that_helps_the_fewest_recordings_goes_first(
    monkeypatch: pytest.MonkeyPatch, search: str, adequate: bool, left_out: bool
) -> None:
    judgement = _judgement(monkeypatch, np.ones((2, 2)), "unexplained", left=1.5)
    model = Model(np.zeros(0), (SHOULDER, VISCOUS))
    best = replace(judgement.best, model=model)
    shares = {SHOULDER.key: 0.5, VISCOUS.key: 0.0}

    def share(problem: Any, before: Fit, after: Fit) -> float:
        (gone,) = after.model.keys - before.model.keys
        return shares[gone]

    monkeypatch.setattr(shared_evidence, "share_improved", share)
    monkeypatch.setattr(shared_evidence, "unbiased_fit", lambda problem, model: replace(best, model=model))
    judged = replace(judgement, best=best, search=search, adequate=adequate)
    assert shared_evidence._helping_some(judged, Settings(), Trace()) == ([VISCOUS] if left_out else [])


def test_a_push_is_no_law_that_lasts(monkeypatch: pytest.MonkeyPatch) -> None:
    judgement = _judgement(monkeypatch, np.ones((2, 2)), "explained")
    push: Effect = ExternalDisturbance("hand", {"x": 1.0, "y": 0.0, "z": 0.0, "start": 1.0, "stop": 2.0}, "a")
    jacobian = np.repeat(judgement.best.jacobian, len(push.strengths), axis=1)
    alone = Fit(Model(np.zeros(0), (push,)), judgement.best.residual, jacobian, np.eye(3), jacobian.shape[0])
    assert constancy_of(judgement.outcome.problem, alone) == []


SHOULDER, ELBOW = JointViscousFriction("shoulder", {"coefficient": 1.0}), VISCOUS
LEFT = {
    "elbow alone": [1.0, 70.0],
    # the shoulder's rows seem to hold by far until the elbow's force is counted as noise
    "disturbed by the elbow": [0.3, 70.0],
    "hardly any": [1.0, 5.0],
    # no force at a joint tells what is exact
    "as little of a throw": [1.0, 70.0],
    "much of a throw": [1.0, 700.0],
    "both": [9.0, 70.0],
    "noise": [1.0, 1.2],
    # the stated noise is not that of the recordings, and hides whether the shoulder's equations are exact
    "less than noise": [0.5, 70.0],
}
BESIDE_FORCES = {name: [0.5 if name == "less than noise" else 1.0, 1.0] for name in LEFT}


@pytest.mark.parametrize("kind", ["unexplained", "explained"])
@pytest.mark.parametrize(
    ("left", "forced", "named"),
    [
        ("elbow alone", ("elbow",), False),
        # the shoulder's force is smaller than its sensors' noise, and yet stands out
        ("elbow alone", ("shoulder", "elbow"), True),
        ("disturbed by the elbow", ("elbow",), False),
        ("hardly any", ("elbow",), True),
        ("as little of a throw", (), True),
        ("much of a throw", (), False),
        ("both", ("shoulder", "elbow"), True),
        ("noise", (), True),
        ("less than noise", ("elbow",), True),
    ],
)
def test_what_is_left_at_one_place_refutes_its_law(
    monkeypatch: pytest.MonkeyPatch, left: str, forced: tuple[str, ...], named: bool, kind: Kind
) -> None:
    """The shoulder's friction explains all there, the elbow's takes the misfit there from 10⁴ to what is left."""
    nothing = Model(np.zeros(0))

    def misfits(problem: Any, model: Model) -> Array:
        lacking = [SHOULDER.key not in model.keys, ELBOW.key not in model.keys]
        return np.where(lacking, 1e4, (BESIDE_FORCES if problem is forces else LEFT)[left])

    def fitted(problem: Any, model: Model) -> Fit:
        width = len(model.vector)
        return Fit(model, np.ones(40), np.ones((40, width)), np.eye(width), 40, unbiased=True)

    monkeypatch.setattr(shared_evidence, "misfit_by_row", misfits)
    together = lambda of, model, others: np.stack([misfits(of, each) for each in (model, *others)])  # noqa: E731
    monkeypatch.setattr(shared_evidence, "misfits_by_row", together)
    monkeypatch.setattr(shared_evidence, "_unconfirmed", lambda *of: [])
    monkeypatch.setattr(shared_evidence, "_replacements", lambda *of: {})
    monkeypatch.setattr(shared_evidence, "_helping_some", lambda *of: [])
    monkeypatch.setattr(shared_evidence, "unbiased_fit", fitted)
    monkeypatch.setattr(shared_evidence, "fit", lambda problem, model, tolerance: fitted(problem, model))
    monkeypatch.setattr(shared_evidence, "mean_square", lambda *of: 3.0)
    monkeypatch.setattr(shared_evidence, "constancy_of", lambda *of: [])
    exact = tuple(name for name in ("shoulder", "elbow") if name not in forced)
    forces: Any = SimpleNamespace(equations=slice(None), exact_joints=exact)
    problem: Any = SimpleNamespace(
        equations=slice(None),
        likeliest_force=lambda model: None if "throw" in left else np.ones(2),
        with_unknown_force=lambda *of: forces,
        with_reading=lambda model: None,
    )
    nominal = fitted(problem, nothing)
    searched: Any = SimpleNamespace(forced_joints=("elbow",), scene=NOTHING_UNKNOWN)
    outcome: Any = SimpleNamespace(problem=searched, nominal_problem=problem, nominal=nominal, hypotheses=1000)
    judgement = Judgement(outcome, fitted(problem, nothing.with_effects([SHOULDER, ELBOW])), kind)
    trace = Trace()
    found = shared_evidence.withhold_refuted(judgement, Settings(), trace)
    assert [effect.at for effect in found.best.model.effects] == (["shoulder", "elbow"] if named else ["shoulder"])
    assert found.kind == (kind if named else "unexplained")
    assert all("other equations" in record.words for record in trace.records)
    assert bool(trace.records) == (not named or left in ("hardly any", "as little of a throw"))


@pytest.mark.long
def test_a_drive_that_feeds_energy_in_has_no_name(tmp_path: Path) -> None:
    """Its shoulder is driven at low speeds and braked at high ones; laws take a part of that."""
    make("odd:odd_negative_damping", "arm2", 9300).write(tmp_path)
    recordings = [drake_cafim.read(tmp_path / f"train_{k}.parquet") for k in (1, 2, 3)]
    verdict = drake_cafim.diagnose(drake_cafim.Scene.load(tmp_path / "scenario.yaml"), recordings)
    assert verdict.kind == "unexplained" and not verdict.explanation
    assert verdict.mismatch.locations[0].name == "shoulder"
