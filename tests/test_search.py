"""The steps of the search for effects, on stand-in problems with prescribed answers."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis.assembly import _rivals
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search import competition, search, state
from drake_cafim.diagnosis.search.judgement import _of_search
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.friction import JointStribeckFriction
from drake_cafim.effects.joint import JointCoulombFriction, JointSpring
from tests import two_links


class _Moving:
    """A problem whose unknown is found at the next of `places`, prior standard deviations, and how it was whitened."""

    def __init__(self, places: list[float]) -> None:
        self.places, self.whitened_at = iter(places), list[float]()
        self.scene = SimpleNamespace(
            unknown=(SimpleNamespace(typical=np.inf),), priors=SimpleNamespace(mean=np.zeros(1), std=np.full(1, 2.0))
        )

    def nominal(self) -> Model:
        return Model(np.zeros(1))

    def forget(self) -> None:
        pass

    def rewhitened(self, model: Model) -> "_Moving":
        self.whitened_at.append(float(model.unknown[0]))
        return self

    def hypotheses(self) -> tuple[Effect, ...]:
        return ()


@pytest.mark.parametrize(
    ("places", "whitened_at"),
    [([0.1], []), ([1.0, 1.1], [2.0]), ([1.0, 2.0, 2.1], [2.0, 4.0]), ([1.0, 2.0, 3.0, 4.0], [2.0, 4.0, 6.0])],
)
def test_the_noise_is_reckoned_anew_while_the_unknowns_move(
    monkeypatch: pytest.MonkeyPatch, places: list[float], whitened_at: list[float]
) -> None:
    def found(problem: Any, model: Model) -> Any:
        model = Model(2.0 * np.array([next(problem.places)]))
        return Fit(model, np.zeros(1), np.zeros((1, 1)), np.eye(1), 0, unbiased=True)

    monkeypatch.setattr(search, "unbiased_fit", found)
    monkeypatch.setattr(search, "screen", lambda *looked_at, jobs: [])
    monkeypatch.setattr(search, "detection_p_value", lambda *looked_at: 1.0)
    problem: Any = _Moving(places)
    outcome = search.search(problem, state.Settings())
    assert problem.whitened_at == whitened_at
    assert float(outcome.nominal.model.unknown[0]) == 2.0 * places[-1]


COULOMB = JointCoulombFriction("j1", {"torque": 1.0})
STRIBECK = JointStribeckFriction("j1", {"coulomb": 1.0, "static": 1.2, "velocity": 0.1})


def _found(effect: Effect, chi_square: float, echo: bool = False) -> Fit:
    """A fit of `effect` to a thousand rows."""
    model = Model(np.zeros(0), (effect,))
    rows, k = np.full(1000, np.sqrt(chi_square / 1000)), len(effect.strengths)
    return Fit(model, rows, np.zeros((1000, k)), np.eye(k), 1000, unbiased=True, echo=echo)


def _under_way(monkeypatch: pytest.MonkeyPatch, answers: dict[str, Fit]) -> Any:
    """A search whose fits come out as `answers` has them by the effect's name."""
    scene = SimpleNamespace(unknown=(), priors=SimpleNamespace(std=np.zeros(0)))
    problem: Any = SimpleNamespace(scene=scene)
    problem.rewhitened = lambda model: SimpleNamespace(scene=scene)
    monkeypatch.setattr(state, "fit", lambda problem, model, **_: SimpleNamespace(model=model))
    monkeypatch.setattr(state, "fit_shapes", lambda problem, fitted_model, *_: fitted_model)
    monkeypatch.setattr(state, "unbiased_fit", lambda problem, model: answers[model.effects[0].name])
    return state.State(problem, state.Settings(), (), 10, lambda text: None)


def test_an_echo_that_competes_under_new_whitening_is_no_explanation(monkeypatch: pytest.MonkeyPatch) -> None:
    """It fits better than what is there: that is how noise is taken for friction that falls with speed."""
    real, echo = _found(COULOMB, 1000.0), _found(STRIBECK, 700.0, echo=True)
    under_way = _under_way(monkeypatch, {COULOMB.name: real, STRIBECK.name: echo})
    under_way.frontier = [_found(COULOMB, 1000.0), _found(STRIBECK, 950.0)]
    best = under_way.rewhiten(under_way.frontier[0])
    assert best is not None
    assert competition._most_probable(under_way, best) is real
    assert list(under_way.pool.fits.values()) == under_way.frontier == [real]


def test_what_is_an_echo_under_its_own_noise_is_not_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    echo = _found(STRIBECK, 700.0, echo=True)
    under_way = _under_way(monkeypatch, {STRIBECK.name: echo})
    problem, frontier = under_way.problem, [_found(STRIBECK, 950.0)]
    under_way.frontier = frontier
    assert under_way.rewhiten(frontier[0]) is None
    assert under_way.problem is problem and under_way.frontier is frontier


def test_an_explanation_that_leaves_more_than_none_does_is_not_named() -> None:
    """Under the noise that it lets through, 4.29 times the noise variance is left, and 2.85 without it."""
    nominal = Fit(Model(np.zeros(0)), np.full(1000, np.sqrt(2.85)), np.zeros((1000, 0)), np.zeros((0, 0)), 1000)
    best = _found(COULOMB, 4290.0)
    problem: Any = _TwoRows()
    outcome = search.Outcome(problem, problem, nominal, best, (best,), 10, (), 1e-9, {COULOMB.key: 1.0})
    trace = Trace()
    judgement = _of_search(outcome, state.Settings(), trace)
    assert judgement.kind == "unexplained" and judgement.best is nominal
    refusal = trace.records[-1]
    assert refusal.step == "support" and not refusal.passed and "without it 2.85" in refusal.words


class _TwoRows:
    """A recording of 500 windows, two rows each."""

    rows = 1000
    runs = (SimpleNamespace(name="run", rows=1000, shape=(500, 2), time=np.arange(500.0)),)
    pictures = SimpleNamespace(row_labels=("j1: q against v", "j1: forces"))

    def residual(self, model: Model) -> np.ndarray:
        return np.full(1000, np.sqrt(2.85))


def test_what_a_rival_needs_not_is_no_rival() -> None:
    """Stribeck's friction is as good; beside it a spring that stands for nothing does not become a rival as well."""
    spring = JointSpring("j2", {"stiffness": 1.0, "rest": 0.0})
    best, rival = _found(COULOMB, 1000.0), _found(STRIBECK, 1001.0)
    both = Fit(Model(np.zeros(0), (STRIBECK, spring)), rival.residual, np.zeros((1000, 5)), np.eye(5), 1000)
    probability = {COULOMB.key: 0.9, STRIBECK.key: 0.1, spring.key: 0.0}
    outcome: Any = SimpleNamespace(competing=(best, rival, both), probability=probability, scale=1.0)
    scene: Any = SimpleNamespace(unknown=())
    judgement: Any = SimpleNamespace(outcome=outcome, best=best, withheld=(), rivals={})
    (found,) = _rivals(scene, judgement)
    assert found.key == STRIBECK.key and found.probability == 0.1


@pytest.mark.parametrize(("best", "told"), [(COULOMB, 0.999), (STRIBECK, 0.499)])
def test_what_speaks_for_a_law_speaks_for_a_simpler_one(
    monkeypatch: pytest.MonkeyPatch, best: JointCoulombFriction | JointStribeckFriction, told: float
) -> None:
    """Nested laws that are as probable as each other do not withhold each other's name."""
    under_way, found = _under_way(monkeypatch, {}), _found(best, 1000.0)
    under_way.effects = (COULOMB, STRIBECK)
    elsewhere = JointStribeckFriction("j2", STRIBECK.values)
    monkeypatch.setattr(
        search,
        "inclusion_probabilities",
        lambda *of: {COULOMB.key: 0.5, STRIBECK.key: 0.499, elsewhere.key: 0.3},
    )
    begun = search.Outcome(under_way.problem, under_way.problem, found, found, (), 10, (), 1e-9, {})
    assert search._concluded(under_way, begun, found).probability[best.key] == pytest.approx(told)


def test_the_noise_is_that_under_the_unknowns_as_fitted(tmp_path: Path) -> None:
    """A mass that is wrong within its prior is a force that the model lacks, where the motion is estimated under it."""
    unknown = "unknown: [{parameter: mass, body: lower, mean: 1.02, std: 0.1}]"
    problem = prepare(two_links.scene(tmp_path, unknown=unknown), [two_links.recording("run", 1)]).problem()
    outcome = search.search(problem, state.Settings())
    under = outcome.nominal_problem.under  # type: ignore[attr-defined]
    assert under.unknown[0] == pytest.approx(1.0, abs=1e-3)
    assert outcome.nominal.model.unknown[0] == pytest.approx(1.0, abs=4.0 * outcome.nominal.std[0])
