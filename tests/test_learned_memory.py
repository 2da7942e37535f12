"""Friction that builds up over a displacement after the motion turns round is learned, and simulates so."""

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_cafim.corrected.brakes import brake_levels
from drake_cafim.diagnosis.diagnose import _Predictions
from drake_cafim.diagnosis.fit.fitting import fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.left_out import learned as learned_forces
from drake_cafim.diagnosis.left_out.law_terms import Candidate
from drake_cafim.diagnosis.left_out.law_words import words_of
from drake_cafim.diagnosis.left_out.learned import Learning, _greedy, _is_memory, _Products, _resists, learn
from drake_cafim.diagnosis.left_out.parts import Part
from drake_cafim.diagnosis.likelihood.flow import unsupported
from drake_cafim.diagnosis.predict.forecast import forecast
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.rows.weak_form import memory_of
from drake_cafim.effects.bristle import bristle_after, bristle_along
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.friction import JointLoadDependentFriction
from drake_cafim.effects.joint import JointCoulombFriction
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.effects.learned_force import MEMORY, POSITION, LearnedForce, Term, table_name
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.report.artifacts import write_scene
from drake_cafim.report.learned_figure import learned_figure
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.test_left_out import NOISE, STEP, scene

SLIP, FRICTION, MASS, WIDTH, FINER = 0.01, 2.0, 2.0, 0.005, 16
COULOMB = JointCoulombFriction("rail", {"torque": FRICTION})
LAW = LearnedForce("rail", {}, (Term(MEMORY, (SLIP,), (-FRICTION,), WIDTH),), table_name("rail"))
"""What Coulomb's friction lacks of one that builds up over `SLIP`."""


def effort_at(time: Array) -> Array:
    return np.asarray(6.0 * np.cos(2 * np.pi * 0.9 * time) + 3.0 * np.cos(2 * np.pi * 0.5 * time))


def slid(name: str, seed: int, seconds: float = 5.0) -> tuple[Recording, Array]:
    """The mass whose friction is a bristle, and the bristle's true states (N,)."""
    rng = np.random.default_rng(seed)
    time = STEP * np.arange(round(seconds / STEP))
    u = effort_at(time + 0.3 * seed)

    def rate(state: Array, effort: float) -> Array:
        _, v, z = state
        return np.array([v, (effort - FRICTION * z) / MASS, (v - abs(v) * z) / SLIP])

    state, states, h = np.zeros(3), [], STEP / FINER
    for effort in u:
        states.append(state)
        for _ in range(FINER):
            state = state + h * rate(state + 0.5 * h * rate(state, effort), effort)
    q, v, z = np.array(states).T
    columns = {"q.rail": q + NOISE[0] * rng.normal(size=len(q)), "v.rail": v + NOISE[1] * rng.normal(size=len(v))}
    return Recording(name, time, columns | {"u.rail": u}), z


def prepared_with(folder: Path, recordings: list[Recording], *effects: Effect) -> tuple[Prepared, Model]:
    found = prepare(scene(folder), recordings)
    assert isinstance(found, Prepared)
    return found, Model(np.zeros(0), effects)


def test_the_state_along_a_path_is_that_of_its_steps() -> None:
    rng = np.random.default_rng(0)
    q = np.cumsum(1e-4 * rng.standard_normal(3000) * (rng.random(3000) > 0.2))
    z = np.zeros(len(q))
    for k in range(len(q) - 1):
        z[k + 1] = bristle_after(z[k], q[k + 1] - q[k], 1e-3)
    np.testing.assert_allclose(bristle_along(q, 1e-3), z, atol=1e-12)
    assert np.all(bristle_along(np.ones(5), 1e-3) == 0.0)


def test_it_is_learned_beside_the_friction_that_is_named(tmp_path: Path) -> None:
    recordings = [slid(str(seed), seed)[0] for seed in range(3)]
    found, model = prepared_with(
        tmp_path, recordings, JointCoulombFriction("rail", {"torque": 1.0, "slip_velocity": 0.005})
    )
    problem = found.problem()
    # friction that jumps, which no search would leave so where it builds up
    fitted = fit(problem, model)
    [law], records = learn(problem, fitted.model, _Predictions(found, fitted, 1))
    [built] = [term for term in law.terms if term.variables == MEMORY]
    assert built.x == (SLIP,) and law.slip == SLIP
    # it is of the friction that is named, with whose width its own has to cancel
    assert built.width == fitted.model.effects[0].values["slip_velocity"]
    assert abs(law.built_up - FRICTION) < 0.1
    assert records[-1].passed
    words = words_of(law, found.scene.tree)
    assert "lets friction of 2.0 N build up over 0.010 m after the motion turned round" in words
    assert "way since it turned" in learned_figure(law, found.scene.tree)


def test_simulations_and_rows_follow_it(tmp_path: Path) -> None:
    recording, z = slid("a", 0)
    found, named = prepared_with(tmp_path, [recording], COULOMB)
    whole = named.with_effects((LAW,))
    [weak] = found.weak
    physics, alone = (model.physics(found.scene) for model in (whole, named))
    # the bristle is not known to be bent at the beginning, and is after the first turn
    assert np.max(np.abs(memory_of(weak, physics)[100:, 0] - z[100:])) < 0.05
    assert unsupported(physics) and not unsupported(alone)

    def error(horizon: float, whole: bool) -> float:
        simulated = forecast(weak, physics if whole else alone, horizon)
        return float(np.sqrt(np.mean((simulated.predicted["q.rail"] - simulated.measured["q.rail"]) ** 2)))

    for horizon in (0.1, 1.0):
        assert error(horizon, True) < 0.2 * error(horizon, False)
    left = [float(np.mean(weak.residual(own)[50:] ** 2)) for own in (alone, physics)]
    assert left[1] < 0.02 * left[0]
    rows = [own.rows_of(model) for own in [found.problem()] for model in (named, whole)]
    assert np.mean(rows[1][100:] ** 2) < 0.1 * np.mean(rows[0][100:] ** 2)
    none = np.zeros((0, 0))
    efforts = [own.effort["rail"].relative for [own] in found.qualities([(named, none), (whole, none)])]
    assert efforts[1] < 0.5 * efforts[0]
    surprisal = [found.surprisal(model, np.zeros((0, 0)), (0,), (0.5, 5.0)) for model in (named, whole)]
    assert surprisal[1] < surprisal[0] - 0.1


def test_laws_that_never_stand_are_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    learning = Learning.__new__(Learning)
    learning.chosen, learning.records = {"a": _law(1, MEMORY)}, []
    learning.model, learning.predictions = Model(np.zeros(0)), cast(Any, None)
    monkeypatch.setattr(Learning, "parts", (Part((0,)), Part((1,))))
    monkeypatch.setattr(Learning, "laws", lambda *of: ())
    monkeypatch.setattr(Learning, "_short", lambda *of: [{}, {}])
    monkeypatch.setattr(Learning, "_surprisal", lambda *of: np.zeros(2))
    worse = SimpleNamespace(worse_than=lambda before: np.ones(2))
    monkeypatch.setattr(learned_forces, "both_horizons", lambda *of: worse)
    learning.by_simulation()
    assert learning.chosen == {} and not learning.records[-1].passed
    assert "a (its memory alone)" in learning.records[-1].words


@pytest.mark.parametrize(
    "worse, less_likely, asked, kept",
    [((-1.0, 0.5), -1.0, False, False), ((-1.0, -1.0), 1.0, True, False), ((-1.0, -1.0), -1.0, True, True)],
)
def test_laws_have_to_be_better_by_both_measures(
    monkeypatch: pytest.MonkeyPatch, worse: tuple[float, float], less_likely: float, asked: bool, kept: bool
) -> None:
    """The likelihood, which takes long, is not asked where errors are larger in some part."""
    learning = Learning.__new__(Learning)
    learning.chosen, learning.records = {"a": _law(1, MEMORY)}, []
    base = learning.model = Model(np.zeros(0))
    learning.predictions = cast(Any, None)
    monkeypatch.setattr(Learning, "parts", (Part((0,)), Part((1,))))
    monkeypatch.setattr(Learning, "laws", lambda *of: ())
    monkeypatch.setattr(Learning, "_short", lambda *of: [{}, {}])
    filtered: list[bool] = []

    def surprisal(learning: Learning, models: Sequence[Model]) -> Array:
        filtered.append(models[0] is base)
        return np.full(2, 0.0 if models[0] is base else less_likely)

    monkeypatch.setattr(Learning, "_surprisal", surprisal)
    errors = SimpleNamespace(worse_than=lambda before: np.array(worse))
    monkeypatch.setattr(learned_forces, "both_horizons", lambda *of: errors)
    learning.by_simulation()
    assert (learning.chosen != {}) is kept and learning.records[-1].passed is kept
    assert bool(filtered) is asked and ("ln likelihood" in learning.records[-1].words) is asked


NAMED = JointCoulombFriction("rail", {"torque": FRICTION, "slip": SLIP})
"""The same friction with a name."""


@pytest.mark.parametrize("time_step", [0.0, 1e-3])
@pytest.mark.parametrize("effects", [(COULOMB, LAW), (NAMED,)], ids=["learned", "named"])
def test_it_simulates_in_drake(tmp_path: Path, effects: tuple[Effect, ...], time_step: float) -> None:
    recording, _ = slid("a", 0, 2.0)
    write_scene(scene(tmp_path).corrected(np.zeros(0), effects), tmp_path / "out")
    read = Scene.load(tmp_path / "out" / "scenario.corrected.yaml")
    assert read.known == effects
    builder = DiagramBuilder()
    corrected = read.add_to(builder, MultibodyPlantConfig(time_step=time_step), period=1e-3)
    held = PiecewisePolynomial.ZeroOrderHold(recording.time, recording.columns["u.rail"][None])
    source = builder.AddSystem(TrajectorySource(held))
    builder.Connect(source.get_output_port(), corrected.effort)
    simulator = Simulator(builder.Build())
    context = corrected.plant.GetMyContextFromRoot(simulator.get_context())
    worst = 0.0
    for time, q in zip(recording.time[::25], recording.columns["q.rail"][::25], strict=True):
        simulator.AdvanceTo(time)
        worst = max(worst, abs(float(corrected.plant.GetPositions(context)[0]) - q))
    assert worst < 0.01 * np.ptp(recording.columns["q.rail"])


def test_a_brake_holds_only_what_does_not_build_up() -> None:
    partly = LearnedForce("rail", {}, (Term(MEMORY, (SLIP,), (-0.5,), WIDTH),))
    loaded = JointLoadDependentFriction("rail", {"torque": 1.0, "coefficient": 0.2})
    assert brake_levels([COULOMB]) == pytest.approx([FRICTION])
    assert brake_levels([COULOMB, partly]) == pytest.approx([FRICTION - 0.5, 0.0])
    assert brake_levels([COULOMB, LearnedForce("other", {}, partly.terms)]) == pytest.approx([FRICTION, 0.0])
    assert brake_levels([partly, loaded]) == pytest.approx([0.0, 1.0])


def test_it_is_a_law_of_samples_in_order_unless_the_state_is_given() -> None:
    q, v = 0.1 * np.sin(np.linspace(0.0, 7.0, 300)), 0.1 * np.cos(np.linspace(0.0, 7.0, 300))
    alone = LAW.force(JointSamples(q, v, 0.0 * q, in_order=True))
    given = LAW.force(JointSamples(q, v, 0.0 * q, bristles={SLIP: bristle_along(q, SLIP)}))
    np.testing.assert_array_equal(alone.value, given.value)
    assert np.max(np.abs(given.value)) > FRICTION
    assert not np.any(LAW.force(JointSamples(q, v, 0.0 * q)).value)
    assert LAW.slip == SLIP and LAW.built_up == FRICTION
    assert LearnedForce("rail", {}, (Term(POSITION, (0.0, 1.0), (0.0, 1.0)),)).slip is None


@pytest.mark.parametrize(
    ("x", "width", "said"),
    [
        ([0.01, 0.02], 0.005, r"x of memory is \[0.01, 0.02\], expected one number above 0"),
        ([0.0], 0.005, r"x of memory is \[0.0\], expected one number above 0"),
        ([0.01], 0.0, "the width of memory is 0, expected above 0"),
        ([0.01], 0.005, "the force of memory is 1, expected at most 0"),
    ],
)
def test_a_table_that_cannot_be_used_is_told(x: list[float], width: float, said: str, tmp_path: Path) -> None:
    n = len(x)
    columns = {"variables": ["memory"] * n, "x": x, "force": [1.0] * n, "width": [width] * n}
    pq.write_table(pa.table(columns), tmp_path / "law.parquet")
    with pytest.raises(InputError, match=said):
        scene(tmp_path, "effects: [{effect: learned_force, at: rail, table: law.parquet}]\n")


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_friction_that_builds_up_resists(sign: float) -> None:
    """The one column of a memory explains the force, and as a friction that drives it is none."""
    rng = np.random.default_rng(0)
    X = rng.standard_normal((4, 50, 1))
    columns = np.concatenate([X, sign * 2.0 * X + 0.1 * rng.standard_normal(X.shape)], axis=2)
    memory = (Candidate(MEMORY, SLIP, SLIP, WIDTH),)
    products = _Products(memory, np.einsum("pni,pnj->pij", columns, columns))
    assert _resists(products, [(0, 1.0)]) is (sign > 0.0)
    assert bool(_greedy(products)) is (sign > 0.0)


def _law(terms: int, *variables: str, drives: bool = False) -> tuple[_Products, list[tuple[int, float]]]:
    """A law of the first `terms` of these, each of which resists or, alone, `drives`."""
    own = tuple(Candidate(name, 0.0, 1.0, WIDTH) for name in variables)
    each = np.eye(1 + sum(term.count for term in own))
    each[:-1, -1] = each[-1, :-1] = -1.0 if drives else 1.0
    return _Products(own, np.stack([each, each])), [(k, 1.0) for k in range(terms)]


def test_where_not_all_laws_stand_at_first_the_memory_stays() -> None:
    chosen = {"a": _law(2, "q", MEMORY), "b": _law(2, "v", MEMORY), "c": _law(1, "q"), "d": _law(1, MEMORY)}
    gains = {"a": 0.1, "b": 0.4, "c": 0.3, "d": 0.2}
    learning = Learning.__new__(Learning)
    learning.chosen = chosen
    tried = [{joint: len(terms) for joint, (_, terms) in laws.items()} for laws in learning._fewer(gains)]
    assert tried == [
        {"a": 2, "b": 2, "c": 1, "d": 1},
        {"b": 2, "c": 1, "a": 1, "d": 1},
        {"a": 1, "b": 1, "d": 1},
        {"b": 2, "c": 1},
        {"b": 2},
    ]
    # a memory that alone would drive stays nowhere
    chosen["a"] = _law(2, "q", MEMORY, drives=True)
    assert [set(laws) for laws in learning._fewer(gains)][1:3] == [{"b", "c", "d"}, {"b", "d"}]
    assert _is_memory(*chosen["d"]) and not _is_memory(*chosen["a"])
