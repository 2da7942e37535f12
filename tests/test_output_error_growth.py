"""What a search by simulations admits: recordings that are left out must be predicted better."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.output_error.errors import left_out_parts
from drake_cafim.diagnosis.output_error.growth import Growth
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointCoulombFriction, JointSpring, JointViscousFriction

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
    growth = Growth(_moves(), trace := Trace())  # type: ignore[arg-type]
    before, after = _fitted(100.0, np.zeros(4)), _fitted(50.0, np.array(rises))
    assert growth._passes(before, after, [((), FRICTION)]) == [passes]
    assert [record.passed for record in trace.records] == [passes]


def test_a_law_that_fits_no_better_is_not_admitted() -> None:
    growth = Growth(_moves(), Trace())  # type: ignore[arg-type]
    before, after = _fitted(100.0, np.zeros(4)), _fitted(101.0, np.full(4, -0.5))
    assert growth._passes(before, after, [((), FRICTION)]) == [False]


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


def _moves(**more: Any) -> Any:
    return SimpleNamespace(costs=lambda fitted: fitted.costs, acts=lambda model, effect: not effect.is_absent, **more)


def _fitted(cost: float, left_out: np.ndarray[Any, np.dtype[np.float64]]) -> Any:
    equations = (SimpleNamespace(left_out=lambda: left_out),)
    return SimpleNamespace(costs=np.array([cost]), equations=equations, model=Model(np.zeros(0), (FRICTION,)))
