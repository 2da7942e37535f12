"""The trace of a verdict: every decision with its statistic, threshold and outcome."""

import json
import math
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from drake_cafim import Scene, Verdict
from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.fit.adequacy import adequacy, misfits
from drake_cafim.diagnosis.fit.screening import Candidate
from drake_cafim.diagnosis.search.candidate_decisions import GoOn
from drake_cafim.diagnosis.trace import NOMINAL, OTHERS, Record, Trace, names_of, spoken
from drake_cafim.diagrams.tutorials.stand_in import ARM, NOISE, record, stiff_grease
from drake_cafim.numerics.tail import Tail
from drake_cafim.report.report_json import as_text, report_of

RUNS: Any = SimpleNamespace(
    runs=[SimpleNamespace(name=name, shape=(200, 2)) for name in "ab"], rows=800, realised_noise=None
)
"""Two recordings of 200 windows and two rows each, whose noise is Gaussian."""


@dataclass
class _Noise:
    """Noise of which any statistic has this tail."""

    its: Tail

    def tail(self, statistic: Any) -> Tail:
        return self.its


NAMED = "joint_viscous_friction@elbow"
ADMIT = Record("admit", NAMED, 41.2, 17.9, True, "admitted", "gain")


@pytest.fixture(scope="module")
def verdict() -> Verdict:
    """Of an arm of two joints with stiff grease in its elbow."""
    scene = Scene.from_model(ARM, channels=NOISE, weld=["base"])
    return diagnose(scene, [record(stiff_grease, 1)])


def of_step(verdict: Verdict, step: str) -> list[Record]:
    return [decision for decision in verdict.trace if decision.step == step]


def test_records_stay_in_order_and_say_which_search_they_are_of() -> None:
    trace = Trace()
    trace.add(ADMIT)
    trace.of_search("windows of 0.24 s").add(replace(ADMIT, passed=False), ADMIT)
    assert [decision.search for decision in trace.records] == ["", "windows of 0.24 s", "windows of 0.24 s"]
    assert [decision.passed for decision in trace.records] == [True, False, True]


def test_a_record_comes_back_from_json_and_what_is_empty_is_left_out() -> None:
    entry = ADMIT.as_json()
    assert list(entry) == ["step", "asked", "statistic", "threshold", "passed", "words", "test"]
    full = replace(ADMIT, beside="payload@link3", search="windows of 0.24 s", others=("payload@link2",))
    for decision in (ADMIT, full):
        assert Record.from_json(json.loads(json.dumps(decision.as_json()))) == decision
    assert replace(ADMIT, statistic=math.inf).as_json()["statistic"] is None
    with pytest.raises(KeyError, match="passed"):
        Record.from_json({"step": "admit", "asked": NAMED, "statistic": 1.0, "threshold": 2.0})


def test_explanations_are_named_in_alphabetical_order() -> None:
    assert names_of([("payload", "link3"), ("joint_spring", "elbow")]) == "joint_spring@elbow + payload@link3"
    assert names_of([]) == NOMINAL
    assert spoken("joint_spring@left_elbow + payload@link3") == "joint spring at left_elbow and payload at link3"
    assert replace(ADMIT, asked="joint_spring@elbow + payload@link3").effects == ("joint_spring@elbow", "payload@link3")


def test_what_was_named_was_admitted_by_every_test(verdict: Verdict) -> None:
    assert verdict.kind == "explained"
    tests = [decision for decision in of_step(verdict, "test") if decision.asked == NAMED]
    (admit,) = (decision for decision in of_step(verdict, "admit") if decision.asked == NAMED)
    assert {decision.test for decision in tests} >= {"gain", "gain for its parameters", "Wald statistic"}
    for decision in (*tests, admit):
        assert decision.passed and decision.statistic is not None and decision.threshold is not None
        assert decision.statistic > decision.threshold
    assert admit.test in {decision.test for decision in tests}


def test_rivals_that_were_fitted_are_refused_by_the_criterion(verdict: Verdict) -> None:
    refused = [decision for decision in of_step(verdict, "choose") if not decision.passed]
    assert {decision.asked for decision in refused} & {
        "joint_coulomb_friction@elbow",
        "joint_asymmetric_coulomb_friction@elbow",
    }
    for decision in refused:
        assert (
            decision.statistic is not None
            and decision.threshold is not None
            and decision.statistic < decision.threshold
        )
    (chosen,) = (decision for decision in of_step(verdict, "choose") if decision.passed)
    assert chosen.asked == NAMED and chosen.beside == refused[0].asked


def test_what_is_left_is_on_record(verdict: Verdict) -> None:
    adequate = of_step(verdict, "adequacy")[-1]
    assert adequate.asked == NAMED and adequate.passed
    assert adequate.statistic is not None and adequate.statistic > 0.01 == adequate.threshold
    assert {decision.test for decision in of_step(verdict, "remains")} == {"stretch", "neighbours", "row"}
    for decision in of_step(verdict, "remains"):
        assert (
            decision.statistic is not None
            and decision.threshold is not None
            and decision.statistic < decision.threshold
        )
    assert verdict.trace[-1].step == "verdict" and verdict.trace[-1].asked == "explained"


def test_every_hypothesis_is_on_record_once_a_look_and_few_at_length(verdict: Verdict) -> None:
    first = [decision for decision in of_step(verdict, "screen") if not decision.beside]
    asked = [name for decision in first for name in (decision.others if decision.asked == OTHERS else decision.effects)]
    assert len(asked) == len(set(asked)) > 30
    assert "actuator_delay@shoulder" in asked and "sensor_bias@q.elbow" in asked
    assert len(first) < 12 and len(verdict.trace) < 120


def test_the_search_ends_where_nothing_more_is_beyond_luck(verdict: Verdict) -> None:
    *_, last = of_step(verdict, "another")
    assert (last.asked, last.beside, last.passed) == ("effect number 2", NAMED, False)
    assert last.statistic is not None and last.threshold is not None and last.statistic < last.threshold


def test_the_report_holds_it_and_the_same_bytes_again(verdict: Verdict) -> None:
    scene = Scene.from_model(ARM, channels=NOISE, weld=["base"])
    again = diagnose(scene, [record(stiff_grease, 1)])
    texts = [as_text(report_of(item, (), None, {})) for item in (verdict, again)]
    assert texts[0] == texts[1]
    entries = json.loads(texts[0])["trace"]
    assert tuple(Record.from_json(item) for item in entries) == verdict.trace


@pytest.mark.parametrize("louder", [1.0, 4.0])
def test_the_worst_of_what_is_left_decides_as_the_p_value_does(louder: float) -> None:
    rows = np.random.default_rng(5).standard_normal(800)
    rows[160:176] *= louder  # eight windows of two rows in the first recording
    passes = adequacy(RUNS, rows, 0).p_value > 0.01
    parts = misfits(RUNS, rows, 0, 0.01)
    assert passes == (louder == 1.0) == all(decision.statistic < decision.threshold for decision in parts)
    if not passes:
        (stretch,) = (decision for decision in parts if decision.kind == "stretch")
        assert (stretch.run, stretch.windows) == (0, (80, 87)) and stretch.failing >= 1


def test_what_noise_that_is_not_gaussian_leaves_is_no_misfit() -> None:
    rows = np.random.default_rng(5).standard_normal(800)
    rows[160:176] *= 2.0
    gaussian = adequacy(RUNS, rows, 0).p_value
    assert gaussian < 0.01 and any(part.failing for part in misfits(RUNS, rows, 0, 0.01))
    surprise = -np.log(gaussian)
    often, rarely = (
        SimpleNamespace(**vars(RUNS) | {"realised_noise": _Noise(Tail(beside * surprise, 0.1 * surprise))})
        for beside in (1.0, 0.5)
    )
    assert adequacy(often, rows, 0).p_value == pytest.approx(0.1)
    assert not any(part.failing for part in misfits(often, rows, 0, 0.01))
    # no tail makes a misfit likelier to be one than Gaussian noise does
    assert gaussian <= adequacy(rarely, rows, 0).p_value < 0.01
    assert any(part.failing for part in misfits(rarely, rows, 0, 0.01))


@pytest.mark.parametrize(("gains", "fitted"), [((9.0, 8.0, 7.0, 6.0, 5.0), 4), ((9.0, 0.8), 1), ((9.0,) * 6, 6)])
def test_what_gains_as_much_as_the_best_candidate_is_fitted_too(gains: tuple[float, ...], fitted: int) -> None:
    candidates = [cast(Candidate, SimpleNamespace(gain=gain)) for gain in gains]
    assert len(GoOn(4, 0.1).fitted(candidates)) == fitted
