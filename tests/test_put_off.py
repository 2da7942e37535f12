"""When a search for few effects is put off for one for many, and that it goes on where that one finds nothing."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis import diagnose
from drake_cafim.diagnosis.fit.fitting import Fit, fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.screening import Candidate, screen
from drake_cafim.diagnosis.search import growth, judgement, search, state
from drake_cafim.diagnosis.search.search_under_unknown_force import UNKNOWN_FORCES, search_again
from drake_cafim.diagnosis.trace import Record, Trace
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.joint import JointCoulombFriction
from tests.test_growth_by_place import arm_that_rubs

WINDOWS, KINDS = 100, 8
LEFT = 50.0
"""Mean square of the rows that are far from noise."""


def _fit(far: int, effects: int = 0) -> Fit:
    rows = np.ones((WINDOWS, KINDS))
    rows[:, :far] = np.sqrt(LEFT)
    names = [JointCoulombFriction(f"j{k}", {"torque": 1.0}) for k in range(effects)]
    size = WINDOWS * KINDS
    return Fit(Model(np.zeros(0), tuple(names)), rows.ravel(), np.zeros((size, effects)), np.eye(effects), size)


def _state(gains: list[float], places: list[str] | None = None, rows: list[int] | None = None) -> Any:
    """A search whose candidates have these `gains`, each in its own of the `rows` or, without, in the first seven."""
    problem: Any = SimpleNamespace(
        rows=WINDOWS * KINDS,
        runs=[SimpleNamespace(shape=(WINDOWS, KINDS))],
        residual=lambda model: np.ones(WINDOWS * KINDS),
    )
    under_way = state.State(problem, state.Settings(), (), 10, lambda text: None)
    places = places or [f"j{k}" for k in range(len(gains))]
    by_row = [np.eye(KINDS)[row] for row in rows] if rows else [(np.arange(KINDS) < 7) / 7.0] * len(gains)
    candidates = [
        Candidate(JointCoulombFriction(place, {"torque": 1.0}), gain, 1, 1, gains=gain * shares)
        for gain, place, shares in zip(gains, places, by_row, strict=True)
    ]
    under_way.screen = lambda parent: candidates  # type: ignore[method-assign]
    return under_way


@pytest.fixture(autouse=True)
def _together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Candidates that explain different things."""
    monkeypatch.setattr(search, "_explained", lambda problem, best, added: sum((found.gains for found in added), 0.0))


EXCESS = 7 * WINDOWS * (LEFT - 1.0)


@pytest.mark.parametrize(
    ("far", "effects", "gains", "hopeless"),
    [
        (7, 0, [0.15 * EXCESS] * 7, True),
        (3, 0, [0.01 * EXCESS] * 7, False),  # as many rows as effects
        (7, 0, [0.6 * EXCESS], False),  # one thing may be behind all rows
        (7, 0, [0.2 * EXCESS] * 7, False),  # three explain more than half
        (7, 2, [0.2 * EXCESS] * 7, True),  # one may still be added
        (7, 3, [0.9 * EXCESS], True),  # none
        (7, 0, [], True),
    ],
)
def test_many_rows_that_few_effects_hardly_explain(far: int, effects: int, gains: list[float], hopeless: bool) -> None:
    assert search.lacks_more_effects(_state(gains), _fit(far, effects)) == hopeless


def test_effects_at_one_place_explain_the_same() -> None:
    assert search.lacks_more_effects(_state([0.2 * EXCESS] * 7, places=["j1"] * 7), _fit(7, 0))


def test_effects_at_several_places_may_explain_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    gains = [0.3 * EXCESS] * 3
    assert not search.lacks_more_effects(_state(gains), _fit(7, 0))
    monkeypatch.setattr(search, "_explained", lambda problem, best, added: added[0].gains)
    assert search.lacks_more_effects(_state(gains), _fit(7, 0))


def test_what_effects_explain_together_is_counted_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    growth = arm_that_rubs(tmp_path, lambda v: 0.3 * v)
    joints = growth.problem.scene.tree.joint_names
    laws = [effect_named("joint_viscous_friction")(joints[0]), effect_named("joint_coulomb_friction")(joints[0])]
    first, second = screen(growth.problem, growth.best, laws)
    alone, both = (search._explained(growth.problem, growth.best, added) for added in ([first], [first, second]))
    assert np.sum(alone) == pytest.approx(first.gain, rel=0.02)
    assert np.sum(both) < first.gain + 0.2 * second.gain
    assert second.gain > 0.3 * first.gain


def test_rows_that_are_further_from_noise_do_not_hide_the_others() -> None:
    # three joints have nearly all of the misfit, and four others are far from noise as well
    gains = [0.3 * EXCESS, 0.3 * EXCESS, 0.3 * EXCESS]
    assert search.lacks_more_effects(_state(gains, rows=[0, 1, 2]), _fit(7, 0))
    assert not search.lacks_more_effects(_state(gains), _fit(7, 0))


def test_once_one_was_found_each_row_has_to_be_explained_by_the_others() -> None:
    # two effects explain nearly all that is left, and halve six of seven rows that are far from noise
    gains = [0.45 * EXCESS] * 2
    spread = [(np.arange(KINDS) < 3) / 3.0, ((np.arange(KINDS) >= 3) & (np.arange(KINDS) < 6)) / 3.0]
    under_way = _state(gains)
    looks = [replace(look, gains=0.45 * EXCESS * own) for look, own in zip(under_way.screen(None), spread, strict=True)]
    under_way.screen = lambda parent: looks
    assert search.lacks_more_effects(under_way, _fit(7, 1))
    assert not search.lacks_more_effects(under_way, _fit(7, 0))
    assert not search.lacks_more_effects(under_way, _fit(6, 1))


def test_small_inaccuracies_of_what_was_found_are_no_sign_of_more() -> None:
    under_way = _state([])
    under_way.problem.residual = lambda model: 1e6 * np.ones(WINDOWS * KINDS)
    assert not search.lacks_more_effects(under_way, _fit(7, 3))


@pytest.mark.parametrize("many_found", [True, False])
def test_a_search_that_was_put_off_goes_on_where_the_other_finds_nothing(
    monkeypatch: pytest.MonkeyPatch, many_found: bool
) -> None:
    nominal, few = _fit(7), _fit(3, 1)
    finished: list[str] = []

    def compared() -> search.Outcome:
        finished.append("few")
        return search.Outcome(Any, Any, nominal, few, (few,), 10, (), 1e-9, {})  # type: ignore[arg-type]

    first = search.Outcome(Any, Any, nominal, nominal, (), 10, (), 1e-9, {}, compared)  # type: ignore[arg-type]
    many = judgement.Judgement(first, _fit(1, 3), "unexplained")
    monkeypatch.setattr(judgement, "search", lambda *given, **options: first)
    monkeypatch.setattr(judgement, "_under_unknown_forces", lambda *given: many if many_found else None)
    monkeypatch.setattr(
        judgement,
        "_of_search",
        lambda outcome, settings, trace: judgement.Judgement(outcome, outcome.best, "unexplained"),
    )
    problem: Any = None
    found = judgement._judge_searches(problem, state.Settings(), lambda text: None, Trace())
    if many_found:
        assert found is many and not finished
    else:
        assert finished == ["few"] and found.best is few


def test_a_search_for_many_effects_begins_with_those_that_were_found_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    growth = arm_that_rubs(tmp_path, lambda v: 0.3 * v)
    problem, nominal = growth.nominal, fit(growth.nominal, growth.nominal.nominal())
    outcome = search.Outcome(problem, problem, nominal, nominal, (), 100, (), 1e-9, {})
    few = state.Settings(most_effects=1)
    assert search_again(outcome, few) is None, "whoever asks for few effects gets no search for many"
    joint = problem.scene.tree.joint_names[0]
    found = search_again(outcome, few, begin=[effect_named("joint_viscous_friction")(joint, {"coefficient": 0.1})])
    assert found is not None
    [effect] = found.best.model.effects
    assert effect.values["coefficient"] == pytest.approx(0.3, rel=0.02)


def test_what_was_found_is_fitted_before_its_noise_is_taken_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    problem = arm_that_rubs(tmp_path, lambda v: 0.3 * v).nominal
    viscous = effect_named("joint_viscous_friction")(problem.scene.tree.joint_names[0], {"coefficient": 0.1})
    found: Any = SimpleNamespace(model=problem.nominal().with_effects([viscous]))
    before: Any = SimpleNamespace(best=found, outcome=SimpleNamespace(unsupported=()))
    [effect] = judgement.fit_again(problem, before).effects
    assert effect.values["coefficient"] == pytest.approx(0.3, rel=0.02)


@pytest.mark.parametrize(("name", "effects"), [(UNKNOWN_FORCES, 4), (UNKNOWN_FORCES, 2), ("", 2)])
def test_many_effects_are_not_looked_for_again_under_less_noise(
    monkeypatch: pytest.MonkeyPatch, name: str, effects: int
) -> None:
    given: list[tuple[str, tuple[object, ...]]] = []
    for asked in ("judge", "judge_again"):
        monkeypatch.setattr(diagnose, asked, lambda *arguments, asked=asked: given.append((asked, arguments)) or asked)
    finest = SimpleNamespace(mistakes=(), problem=lambda: "finest")
    finer = SimpleNamespace(mistakes=(), problem=lambda: "finer", with_noise_beside={"refitted": finest}.get)
    prepared: Any = SimpleNamespace(with_noise_beside=lambda model: finer)
    monkeypatch.setattr(diagnose, "fit_again", lambda problem, before: "refitted" if problem == "finer" else None)
    judged: Any = SimpleNamespace(best=_fit(7, effects), search=name)
    before = Trace()
    before.add(Record("detect", "", 0.0, 0.01, True, ""))
    again = diagnose._with_less_noise(prepared, judged, state.Settings(), lambda text: None, before)
    assert again is not None
    [(asked, arguments)] = given
    assert again[1] == asked
    if effects > state.Settings().most_effects:
        # what was found is compared with others once, under the noise that it leaves when fitted again
        assert asked == "judge_again" and arguments[:2] == ("finest", judged) and again[0] is finest
        assert again[2].records == before.records
        monkeypatch.setattr(diagnose, "judge_again", lambda *arguments: None)
        none = diagnose._with_less_noise(prepared, judged, state.Settings(), lambda text: None, before)
        assert none is None, "the judgement under more noise stays"
    else:
        assert asked == "judge" and arguments[0] == "finer" and not again[2].records
        assert arguments[-1] == (judged.best.model.effects if name else ())


@pytest.mark.long
def test_effects_are_fitted_again_and_no_more_are_added(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    growth = arm_that_rubs(tmp_path, lambda v: 0.3 * v + 0.05 * np.tanh(v / 0.005))
    problem, nominal = growth.nominal, fit(growth.nominal, growth.nominal.nominal())
    joint = problem.scene.tree.joint_names[0]
    begun = nominal.model.with_effects([effect_named("joint_viscous_friction")(joint, {"coefficient": 0.1})])
    outcome = search.Outcome(problem, problem, nominal, fit(problem, begun), (), 100, (), 1e-9, {})
    before = judgement.Judgement(outcome, outcome.best, "unexplained", search=UNKNOWN_FORCES)
    again = judgement.judge_again(problem, before, state.Settings(), lambda text: None, Trace())
    assert again is not None and again.search == UNKNOWN_FORCES
    assert [effect.name for effect in again.best.model.effects] == ["joint_viscous_friction"]
    assert again.best.model.effects[0].values["coefficient"] > 0.3
    # what explained less than was left may stand under less noise
    dry = effect_named("joint_coulomb_friction")(joint, {"torque": 0.1})
    before = replace(before, outcome=replace(outcome, unsupported=(dry,)))
    again = judgement.judge_again(problem, before, state.Settings(), lambda text: None, Trace())
    assert again is not None
    assert {effect.name for effect in again.best.model.effects} == {"joint_viscous_friction", dry.name}
    monkeypatch.setattr(judgement, "search_again", lambda *given: None)
    assert judgement.judge_again(problem, before, state.Settings(), lambda text: None, Trace()) is None


@pytest.mark.parametrize("sees", [True, False])
def test_a_search_for_few_grows_no_further_once_it_sees_that_few_will_not_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sees: bool
) -> None:
    monkeypatch.undo()
    problem = arm_that_rubs(tmp_path, lambda v: 0.3 * v).nominal
    asked: list[int] = []

    def asks(under_way: Any, best: Fit) -> bool:
        asked.append(len(best.model.effects))
        return not best.model.effects

    monkeypatch.setattr(growth, "_is_worth_more", asks)
    monkeypatch.setattr(search, "_explain", lambda under_way, best: best)
    monkeypatch.setattr(search, "lacks_more_effects", lambda under_way, best: sees and bool(best.model.effects))
    found = search.search(problem, state.Settings(), put_off=True)
    assert len(found.best.model.effects) == 1 and (found.compare is not None) == sees
    assert asked == ([0] if sees else [0, 1])
    if sees:
        # it goes on where it was halted, with all that competed there
        assert found.compare is not None
        (under_way,) = (it for it in found.compare.args if isinstance(it, state.State))  # type: ignore[attr-defined]
        assert under_way.halted
        met = under_way.frontier = [*under_way.frontier, under_way.pool.fits.get(frozenset(), _fit(1))]
        monkeypatch.setattr(growth, "_is_worth_more", lambda it, best: asked.append(len(it.frontier)) or False)
        found.compare()
        assert asked[-1] == len(met) and not under_way.halted
        assert all(was is now for was, now in zip(met, under_way.frontier, strict=True))


@pytest.mark.long
def test_a_search_for_few_is_put_off_at_once_where_many_were_found_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    problem = arm_that_rubs(tmp_path, lambda v: 0.3 * v).nominal
    asked: list[str] = []
    monkeypatch.setattr(search, "grow", lambda under_way, best, *of: asked.append("few") or best)
    monkeypatch.setattr(search, "_explain", lambda under_way, best: best)
    assert search.search(problem, state.Settings(), put_off=True).compare is None and asked == ["few"]
    assert search.search(problem, state.Settings(), put_off=True, many=True).compare is not None and asked == ["few"]
