"""What a search by simulations admits: recordings that are left out must be predicted better."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.output_error import growth, search
from drake_cafim.diagnosis.output_error.candidates import Candidate
from drake_cafim.diagnosis.output_error.errors import left_out_parts
from drake_cafim.diagnosis.output_error.growth import Growth
from drake_cafim.diagnosis.output_error.laws import acts_as_named
from drake_cafim.diagnosis.output_error.moves import Move
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointCoulombFriction, JointSpring, JointViscousFriction
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.effects.transmission import JointHardStop

LAWS = ["joint_coulomb_friction", "joint_spring", "servo_dead_band", "joint_viscous_friction", "supply_sag"]
FRICTION, VISCOUS = JointCoulombFriction("pan", {"torque": 0.3}), JointViscousFriction("pan", {"coefficient": 0.1})
SPRING = JointSpring("pan", {"stiffness": 1.0, "rest": 0.1})


def test_whole_recordings_are_left_out_and_quarters_of_few() -> None:
    quarters = np.repeat(np.arange(16), 3)
    np.testing.assert_array_equal(left_out_parts(quarters), np.repeat(np.arange(4), 12))
    np.testing.assert_array_equal(left_out_parts(quarters[:36]), quarters[:36])


@pytest.mark.parametrize(
    ("rises", "passes"),
    [
        ([-0.5, -0.4, -0.6, -0.5], True),
        ([-1.0, 0.1, 0.1, 0.1], True),
        ([-0.2, 0.1, 0.1, 0.1], False),
    ],
)
def test_an_effect_predicts_what_is_left_out_better(rises: list[float], passes: bool) -> None:
    own = Growth(_moves(), trace := Trace())  # type: ignore[arg-type]
    before, after = _fitted(100.0, np.zeros(4)), _fitted(50.0, np.array(rises))
    assert own._passes(before, after, [((), FRICTION)]) == [passes]
    assert [record.passed for record in trace.records] == [passes]


def test_a_law_that_fits_no_better_is_not_admitted() -> None:
    own = Growth(_moves(), Trace())  # type: ignore[arg-type]
    before, after = _fitted(100.0, np.zeros(4)), _fitted(101.0, np.full(4, -0.5))
    assert own._passes(before, after, [((), FRICTION)]) == [False]


def test_where_the_best_change_does_not_pass_the_next_one_is_tried() -> None:
    """The first predicts what is left out worse; a third, which fits no better in a quick fit, is not tried."""
    best = _fitted(100.0, np.zeros(4))
    fits = {FRICTION.name: (40.0, 0.5), VISCOUS.name: (60.0, -0.5), SPRING.name: (120.0, -0.5)}

    def fit(effects: tuple[Effect, ...], steps: int = 0) -> Any:
        [effect] = effects
        cost, rise = fits[effect.name]
        return SimpleNamespace(**{**vars(_fitted(cost, np.full(4, rise))), "model": Model(np.zeros(0), effects)})

    problem = SimpleNamespace(fit=fit, for_each=lambda function, items: [function(item) for item in items])
    moves = _moves(
        problem=problem,
        chord=lambda base, own: fit((own[0][1],)),
        changed=lambda model, taken: (taken[0][1],),
    )
    tried = [[((), FRICTION), ((), SPRING), ((), VISCOUS)]]
    found = Growth(moves, trace := Trace())._accept(best, tried)  # type: ignore[arg-type]
    assert found is not None and found.model.effects == (VISCOUS,)
    assert [(record.asked, record.passed) for record in trace.records] == [
        ("joint_coulomb_friction@pan", False),
        ("joint_viscous_friction@pan", True),
    ]
    assert Growth(moves, Trace())._accept(best, [tried[0][:2]]) is None  # type: ignore[arg-type]


def test_the_best_change_is_fitted_though_a_quick_fit_shows_nothing() -> None:
    """A quick fit keeps its slopes; the second best is not fitted."""
    best, fitted = _fitted(100.0, np.zeros(4)), list[str]()

    def fit(effects: tuple[Effect, ...], steps: int = 0) -> Any:
        fitted.append(effects[0].name)
        rise = -0.5 if effects[0] is VISCOUS else 0.5
        return SimpleNamespace(**{**vars(_fitted(60.0, np.full(4, rise))), "model": Model(np.zeros(0), (effects[0],))})

    quick = {VISCOUS.name: 101.0, SPRING.name: 120.0}
    problem = SimpleNamespace(fit=fit, for_each=lambda function, items: [function(item) for item in items])
    moves = _moves(
        problem=problem,
        chord=lambda base, own: SimpleNamespace(
            costs=np.array([quick[own[0][1].name]]), model=Model(np.zeros(0), (own[0][1],))
        ),
        changed=lambda model, taken: (taken[0][1],),
    )
    found = Growth(moves, Trace())._accept(best, [[((), SPRING), ((), VISCOUS)]])  # type: ignore[arg-type]
    assert found is not None and found.model.effects == (VISCOUS,)
    assert fitted == [VISCOUS.name]
    assert Growth(moves, Trace())._accept(best, [[((), SPRING)]]) is None  # type: ignore[arg-type]


def test_where_changes_pass_at_some_joints_the_others_wait_for_the_next_round() -> None:
    """A second try of all joints would cost as much again."""
    fits: list[tuple[Effect | None, ...]] = []

    def fit(effects: tuple[Effect | None, ...], steps: int = 0) -> Any:
        fits.append(effects)
        rises = [np.full(4, 0.5 if effect is FRICTION else -0.5) for effect in effects]
        return SimpleNamespace(
            costs=np.array([100.0 if effect is None else 50.0 for effect in effects]),
            equations=tuple(SimpleNamespace(left_out=lambda rise=rise: rise) for rise in rises),
            model=Model(np.zeros(0), tuple(effect for effect in effects if effect is not None)),
        )

    moves = _moves(
        problem=SimpleNamespace(fit=fit, for_each=lambda function, items: [function(item) for item in items]),
        chord=lambda base, own: fit(tuple(move and move[1] for move in own)),
        changed=lambda model, taken, values=None: tuple(move and move[1] for move in taken),
    )
    nothing = SimpleNamespace(left_out=lambda: np.zeros(4))
    best = SimpleNamespace(costs=np.full(2, 100.0), equations=(nothing, nothing), model=Model(np.zeros(0)))
    found = Growth(moves, Trace())._accept(best, [[((), FRICTION), ((), SPRING)], [((), VISCOUS)]])  # type: ignore[arg-type]
    assert found is not None and found.model.effects == (VISCOUS,)
    # two quick fits, the one of both joints' best, and the one without what did not pass
    assert fits[2:] == [(FRICTION, VISCOUS), (None, VISCOUS)]


@pytest.mark.parametrize(("coefficient", "acts"), [(0.1, True), (0.0, False)])
def test_a_law_that_does_nothing_is_not_admitted(coefficient: float, acts: bool) -> None:
    viscous = JointViscousFriction("pan", {"coefficient": coefficient})
    samples = JointSamples(np.linspace(-1.0, 1.0, 50), np.ones(50), np.zeros(50))
    form = SimpleNamespace(joint_samples=lambda own: (samples,))
    scene = SimpleNamespace(tree=SimpleNamespace(joint_index=lambda name: 0))
    problem: Any = SimpleNamespace(scene=scene, errors=SimpleNamespace(forms=(form,)))
    model: Any = SimpleNamespace(effects=(viscous,), physics_before=lambda own, law: None)
    assert acts_as_named(problem, model, viscous) is acts
    own = Growth(_moves(), Trace())  # type: ignore[arg-type]
    before, after = _fitted(100.0, np.zeros(4)), _fitted(50.0, np.full(4, -0.5))
    after.model = Model(np.zeros(0), (viscous,))
    assert own._passes(before, after, [((), VISCOUS)]) == [acts]


@pytest.mark.parametrize("passes", [None, 1, 4])
def test_all_candidates_are_tried_before_a_search_ends(monkeypatch: pytest.MonkeyPatch, passes: int | None) -> None:
    """Three at a time, the best to first order first, as long as none passes."""
    laws = [effect_named(name)("pan") for name in LAWS]
    candidates = [Candidate(law, 0.0, -float(k)) for k, law in enumerate(laws)]
    monkeypatch.setattr(growth, "screen", lambda *given: [candidates])
    problem = SimpleNamespace(joints=("pan",))
    moves = _moves(problem=problem, hypotheses=(tuple(laws),), excludes=lambda a, b: False, price=None)
    own, tried = Growth(moves, trace := Trace()), []

    def accept(best: object, moves: Sequence[Sequence[Move]]) -> str | None:
        tried.append([move[1].name for move in moves[0]])
        return "grown" if passes is not None and laws[passes].name in tried[-1] else None

    for name, instead in (("_accept", accept), ("_replacing", lambda best: [[]])):
        monkeypatch.setattr(Growth, name, lambda self, *given, instead=instead: instead(*given))
    best: Any = SimpleNamespace(model=Model(np.zeros(0)), slopes_without=lambda effects: ())
    grown = own.grow(best)
    assert grown == (None if passes is None else "grown")
    assert tried == ([LAWS[:3]] if passes == 1 else [LAWS[:3], LAWS[3:]])
    # a record of each that was fitted, and of the best one that was not
    fitted = [record.asked.split("@")[0] for record in trace.records if record.passed]
    assert fitted == (LAWS[:3] if passes == 1 else LAWS)
    assert [record.asked.split("@")[0] for record in trace.records if not record.passed] == LAWS[3:4] * (passes == 1)


@pytest.mark.parametrize("stiffness", [0.0, 30.0])
def test_a_stop_without_stiffness_is_taken_out(stiffness: float) -> None:
    """Without it all is worse, but it does not act as its name says."""
    stop = JointHardStop("pan", {"position": 0.5, "stiffness": stiffness, "damping": 0.1})
    with_it, without = (
        SimpleNamespace(**{**vars(_fitted(cost, rise)), "model": Model(np.zeros(0), effects)})
        for cost, rise, effects in ((50.0, np.zeros(4), (stop,)), (100.0, np.full(4, 0.5), ()))
    )
    problem = SimpleNamespace(joints=("pan",), fit=lambda model, steps=0: without)
    moves = _moves(problem=problem, model_without=lambda model, effects: Model(np.zeros(0)))
    assert Growth(moves, Trace()).prune(with_it) is (without if stiffness == 0.0 else with_it)


@pytest.mark.parametrize(
    ("position", "stiffness", "acts"), [(0.5, 30.0, True), (0.5, 0.0, False), (2.0, 30.0, False), (-2.0, 30.0, False)]
)
def test_a_stop_acts_where_it_is_met_and_left(position: float, stiffness: float, acts: bool) -> None:
    samples = JointSamples(np.linspace(-1.0, 1.0, 50), np.ones(50), np.zeros(50))
    physics = SimpleNamespace(bounds_servo=lambda law: False)
    form = SimpleNamespace(joint_samples=lambda own: (samples,) if own is physics else ())
    scene = SimpleNamespace(tree=SimpleNamespace(joint_index=lambda name: 0))
    problem: Any = SimpleNamespace(scene=scene, errors=SimpleNamespace(forms=(form,)))
    stop = JointHardStop("pan", {"position": position, "stiffness": stiffness, "damping": 0.1})
    model: Any = SimpleNamespace(physics_before=lambda own, law: physics)
    assert acts_as_named(problem, model, stop) is acts


@pytest.mark.parametrize("taken_out", [False, True])
def test_a_search_goes_on_after_effects_were_taken_out(monkeypatch: pytest.MonkeyPatch, taken_out: bool) -> None:
    """With a late command in the model no sag was found, and without it one is."""
    monkeypatch.setattr(search, "fit_shapes", lambda problem, fitted: fitted)
    asked: list[str] = []
    grown, pruned = {"begun": "late", "pruned": "sag"}, {"late": "pruned"} if taken_out else {}

    def grow(best: str) -> str | None:
        asked.append(best)
        return grown.get(best)

    own: Any = object.__new__(search.Search)
    own.problem, own.progress = SimpleNamespace(counted=lambda fitted: fitted), lambda text: None
    own.growth = SimpleNamespace(grow=grow, prune=lambda best: pruned.get(best, best))
    assert own._grown("begun") == ("sag" if taken_out else "late")
    assert asked == (["begun", "late", "pruned", "sag"] if taken_out else ["begun", "late"])


def _moves(**more: Any) -> Any:
    return SimpleNamespace(costs=lambda fitted: fitted.costs, acts=lambda model, effect: not effect.is_absent, **more)


def _fitted(cost: float, left_out: np.ndarray[Any, np.dtype[np.float64]]) -> Any:
    equations = (SimpleNamespace(left_out=lambda: left_out),)
    return SimpleNamespace(costs=np.array([cost]), equations=equations, model=Model(np.zeros(0), (FRICTION,)))
