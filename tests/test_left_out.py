"""What goes into the corrected scene: it predicts parts of the training recordings that were left out."""

from collections.abc import Callable
from dataclasses import dataclass, replace
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

from drake_cafim.diagnosis.diagnose import _Predictions
from drake_cafim.diagnosis.fit.fitting import fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.left_out import decisions
from drake_cafim.diagnosis.left_out.law_terms import with_steps_in_one_term
from drake_cafim.diagnosis.left_out.law_words import words_of
from drake_cafim.diagnosis.left_out.learned import learn
from drake_cafim.diagnosis.left_out.parts import Part, parts_of
from drake_cafim.diagnosis.left_out.refits import UNKNOWNS, Items, Refits
from drake_cafim.diagnosis.left_out.selection import Selection, _Elimination, select
from drake_cafim.diagnosis.preparation import PreparedRecordings, prepare
from drake_cafim.diagnosis.search.given_effects import fit_given
from drake_cafim.diagnosis.trace import Record
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointSpring, JointViscousFriction
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.effects.learned_force import SIDED, SPEED, LearnedForce, Term, table_name
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.report.artifacts import write_scene
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array, Flags

MODEL = """<robot name="slider"><link name="base"/>
  <link name="block"><inertial><mass value="2.0"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="rail" type="prismatic"><parent link="base"/><child link="block"/><axis xyz="1 0 0"/>
    <limit lower="-9" upper="9" effort="90" velocity="90"/></joint>
</robot>"""
STEP, FINER, NOISE = 0.004, 8, (1e-4, 2e-3)
FRICTION, SPRING = 1.5, 0.8


def scene(folder: Path, unknown: str = "") -> Scene:
    """A sliding mass of 2 kg."""
    (folder / "slider.urdf").write_text(MODEL)
    text = "model: slider.urdf\nweld: [{body: base}]\nchannels: {q: {std: 1.0e-4}, v: {std: 2.0e-3}, u: {std: 0.0}}\n"
    (folder / "scenario.yaml").write_text(text + unknown)
    return Scene.load(folder / "scenario.yaml")


def recording(name: str, seed: int, duration: float, spring: float, *, mass: float = 2.0) -> Recording:
    """The mass with viscous friction and a `spring`, N/m, whose value the caller lets drift between recordings."""
    rng = np.random.default_rng(seed)
    time = STEP * np.arange(round(duration / STEP))
    u = 4.0 * np.sin(2 * np.pi * 0.9 * time + rng.uniform(0, 6)) + 3.0 * np.sin(2 * np.pi * 2.3 * time)
    state, states = np.zeros(2), []
    for effort in u:
        states.append(state)
        for _ in range(FINER):
            middle = state + 0.5 * STEP / FINER * _rate(state, effort, spring, mass)
            state = state + STEP / FINER * _rate(middle, effort, spring, mass)
    q, v = np.array(states).T
    q, v = q + NOISE[0] * rng.normal(size=len(q)), v + NOISE[1] * rng.normal(size=len(v))
    return Recording(name, time, {"q.rail": q, "v.rail": v, "u.rail": u})


def _rate(state: Array, effort: float, spring: float, mass: float) -> Array:
    return np.array([state[1], (effort - FRICTION * state[1] - spring * state[0]) / mass])


def chosen(given: Scene, recordings: list[Recording], effects: tuple[Effect, ...], *, simulated: bool) -> Selection:
    """The selection from a fit of these effects, as if a search had named them all."""
    prepared: PreparedRecordings = prepare(given, recordings)
    problem, fitted = fit_given(prepared.problem(), Model(prepared.scene.priors.mean, effects))
    return select(problem, fitted, _Predictions(prepared, fitted, 1) if simulated else None)


def names(selection: Selection) -> set[str]:
    return {effect.name for effect in selection.fitted.model.effects}


VISCOUS = JointViscousFriction("rail", {"coefficient": 1.0})
STIFF = JointSpring("rail", {"stiffness": 1.0, "rest": 0.0})


@pytest.mark.parametrize("simulated", [False, True])
def test_a_force_that_drifts_is_named_for_its_fit_and_not_put_into_the_scene(simulated: bool, tmp_path: Path) -> None:
    drifting = [recording("long", 1, 4.0, SPRING), recording("short", 2, 3.0, -SPRING)]
    found = chosen(scene(tmp_path), drifting, (VISCOUS, STIFF), simulated=simulated)
    assert names(found) == {"joint_viscous_friction"}
    [(effect, why)] = found.left_out
    assert effect.name == "joint_spring" and "left-out parts" in why
    assert any(r.step == "correct" and r.asked == "joint_spring@rail" and not r.passed for r in found.records)


@pytest.mark.parametrize("simulated", [False, True])
def test_a_force_that_stays_is_put_into_the_scene(simulated: bool, tmp_path: Path) -> None:
    lasting = [recording("long", 1, 4.0, SPRING), recording("short", 2, 3.0, SPRING)]
    found = chosen(scene(tmp_path), lasting, (VISCOUS, STIFF), simulated=simulated)
    assert names(found) == {"joint_viscous_friction", "joint_spring"}
    assert found.left_out == () and not found.as_given


@pytest.mark.parametrize("simulated", [False, True])
def test_where_nothing_predicts_better_the_scene_is_the_one_given(simulated: bool, tmp_path: Path) -> None:
    given = scene(tmp_path, "effects: [{effect: joint_viscous_friction, at: rail, coefficient: 1.5}]\n")
    drifting = [recording("long", 1, 4.0, SPRING), recording("short", 2, 3.0, -SPRING)]
    found = chosen(given, drifting, (STIFF,), simulated=simulated)
    assert found.as_given and [effect.name for effect, _ in found.left_out] == ["joint_spring"]


@pytest.mark.parametrize("less_likely, kept", [(-1.0, frozenset({0})), (1.0, frozenset({0, UNKNOWNS}))])
def test_what_is_kept_is_the_best_that_is_better_by_both_measures(
    monkeypatch: pytest.MonkeyPatch, less_likely: float, kept: Items
) -> None:
    """With the unknowns as given errors are smallest; the likelihood of what has larger ones than that is not asked."""
    everything, given, alone = frozenset({0, UNKNOWNS}), frozenset({0}), frozenset({UNKNOWNS})
    errors, asked = {everything: -1.0, given: -2.0, alone: 0.0}, list[Items]()
    refits = SimpleNamespace(items=everything, shown=lambda item: np.ones(2, dtype=bool))
    choice = _Elimination(cast(Any, refits), (), cast(Any, "predictions"), everything)

    def likelihood(own: _Elimination, tried: Items, judging: Flags) -> float:
        asked.append(tried)
        return less_likely if tried == given else -1.0

    monkeypatch.setattr(_Elimination, "_worse_than_given", lambda own, tried, judging: errors[tried])
    monkeypatch.setattr(_Elimination, "_less_likely_than_given", likelihood)
    choice.against_given()
    assert choice.kept == kept and asked == [everything, given]
    assert choice.reasons == ({} if kept == everything else {UNKNOWNS: decisions.BEATEN})


def test_a_force_that_drifts_within_a_recording_is_seen_by_its_quarters(tmp_path: Path) -> None:
    pieces = [recording(str(k), k, 1.5, SPRING if k % 2 else -SPRING) for k in range(4)]
    # pauses between them, so that no window extends over the jump from one to the next
    time = np.concatenate([piece.time + 2.0 * k for k, piece in enumerate(pieces)])
    columns = {name: np.concatenate([piece.columns[name] for piece in pieces]) for name in pieces[0].columns}
    alone = [Recording("alone", time, columns)]
    assert len(parts_of(prepare(scene(tmp_path), alone).problem().runs)) == 4
    assert names(chosen(scene(tmp_path), alone, (VISCOUS, STIFF), simulated=False)) == {"joint_viscous_friction"}


def test_unknowns_that_compensate_for_what_drifts_stay_as_given(tmp_path: Path) -> None:
    unknown = "unknown: [{parameter: mass, body: block, mean: 2.0, std: 0.3}]\n"
    masses = [recording("heavy", 1, 4.0, 0.0, mass=2.3), recording("light", 2, 3.0, 0.0, mass=1.7)]
    found = chosen(scene(tmp_path, unknown), masses, (VISCOUS,), simulated=False)
    assert found.fitted.model.held and found.unknowns_held
    assert found.fitted.model.unknown.tolist() == [2.0]
    heavy = [recording("a", 1, 4.0, 0.0, mass=2.3), recording("b", 2, 3.0, 0.0, mass=2.3)]
    found = chosen(scene(tmp_path, unknown), heavy, (VISCOUS,), simulated=False)
    assert not found.fitted.model.held
    np.testing.assert_allclose(found.fitted.model.unknown, [2.3], rtol=0.01)


@dataclass(frozen=True)
class _Run:
    """Rows of one recording, one a window."""

    name: str
    time: Array

    @property
    def shape(self) -> tuple[int, int]:
        return (len(self.time), 1)

    @property
    def rows(self) -> int:
        return len(self.time)


class _Line(Problem):
    """Rows y − X θ that are linear in the strengths of two springs and in an unknown mass."""

    def __init__(self, given: Scene, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.scene = given
        self.runs = [_Run(str(k), np.arange(30.0 + 10 * k)) for k in range(3)]
        self.X = rng.normal(size=(self.rows, 3))
        self.y = self.X @ np.array([2.4, 0.7, 0.4]) + rng.normal(size=self.rows)

    def _numbers(self, model: Model) -> Array:
        values = {effect.at: effect.vector[0] for effect in model.effects}
        return np.array([model.unknown[0], values.get("a", 0.0), values.get("b", 0.0)])

    def rows_of(self, model: Model) -> Array:
        return self.y - self.X @ self._numbers(model)

    def jacobian(self, model: Model) -> Array:
        columns = [0, *(1 + "ab".index(effect.at) for effect in model.effects)]
        return np.concatenate([-self.X[:, columns], np.eye(1, len(columns)) / self.prior_std(model)[0]])

    def rewhitened(self, model: Model) -> "_Line":
        return self

    def plausible(self, model: Model) -> bool:
        return True


def test_refits_without_a_part_are_those_by_least_squares(tmp_path: Path) -> None:
    unknown = "unknown: [{parameter: mass, body: block, mean: 2.0, std: 0.3}]\n"
    problem = _Line(scene(tmp_path, unknown), seed=4)
    both = tuple(JointViscousFriction(at, {"coefficient": 0.5}) for at in "ab")
    refits = Refits.of(problem, fit(problem, Model(np.array([2.0]), both)), parts_of(problem.runs))
    masks = [part.rows(problem.runs) for part in parts_of(problem.runs)]
    for kept in ({UNKNOWNS, 0, 1}, {UNKNOWNS, 1}, {0}, set()):
        found = refits.chi_square(frozenset(kept))
        for k, left in enumerate(masks):
            columns = [0] * (UNKNOWNS in kept) + [1 + item for item in sorted(kept - {UNKNOWNS})]
            fixed = np.array([0.0 if UNKNOWNS in kept else 2.0, 0.0, 0.0])
            A, b = problem.X[~left][:, columns], (problem.y - problem.X @ fixed)[~left]
            if UNKNOWNS in kept:
                A = np.vstack([A, np.eye(1, len(columns)) / 0.3])
                b = np.append(b, 2.0 / 0.3)
            numbers = fixed.copy()
            if columns:
                numbers[columns] = np.linalg.lstsq(A, b, rcond=None)[0]
            assert found[k] == pytest.approx(float(np.sum((problem.y - problem.X @ numbers)[left] ** 2)), rel=1e-3)


def test_what_only_one_part_shows_cannot_be_refuted_by_it(tmp_path: Path) -> None:
    # the spring is there in one recording; in the other the mass hardly leaves the place where it has no force
    still = recording("still", 2, 3.0, 0.0)
    noise = {name: values - np.convolve(values, np.ones(9) / 9, "same") for name, values in still.columns.items()}
    still = Recording("still", still.time, noise | {"u.rail": np.zeros(len(still.time))})
    prepared = prepare(scene(tmp_path), [recording("long", 1, 4.0, SPRING), still])
    problem, fitted = fit_given(prepared.problem(), Model(np.zeros(0), (VISCOUS, STIFF)))
    refits = Refits.of(problem, fitted, parts_of(problem.runs))
    assert refits.shown(1).tolist() == [False, False]
    assert names(select(problem, fitted, None)) == {"joint_viscous_friction", "joint_spring"}


def test_what_acts_in_one_part_alone_stays_where_that_is_left_out(tmp_path: Path) -> None:
    """The gradient that a fit ended with is that part's, too: shared by rows it moved the strength without end."""
    unknown = "unknown: [{parameter: mass, body: block, mean: 2.0, std: 0.3}]\n"
    problem = _Line(scene(tmp_path, unknown), seed=4)
    first, *_ = (part.rows(problem.runs) for part in parts_of(problem.runs))
    problem.X[~first, -1] = 0.0
    both = tuple(JointViscousFriction(at, {"coefficient": 0.5}) for at in "ab")
    fitted = fit(problem, Model(np.array([2.0]), both))
    # as a fit ends that is corrected for noise in its regressors
    moved = fitted.model.at(fitted.model.vector + 2.0 * np.sqrt(np.diag(fitted.covariance)))
    ended = replace(fitted, model=moved, residual=problem.residual(moved))
    step = Refits.of(problem, ended, parts_of(problem.runs)).step(frozenset({UNKNOWNS, 0, 1}), 0)
    assert abs(step[-1]) < np.sqrt(fitted.covariance[-1, -1])


def test_a_part_holds_the_rows_of_its_recordings() -> None:
    runs = [_Run("a", np.arange(3.0)), _Run("b", np.arange(2.0))]
    assert Part((1,)).rows(runs).tolist() == [False, False, False, True, True]
    assert Part((0,), 1.0, 2.0).rows(runs).tolist() == [False, True, False, False, False]


Learning = tuple[Scene, tuple[LearnedForce, ...], list[Record]]


def learning_from(folder: Path, *forces: Callable[[Array], float]) -> Learning:
    """What is learned from a recording of the mass under each of the `forces` of its state, N, that no effect names."""
    prepared = prepare(scene(folder), [pushed(str(seed), seed, force) for seed, force in enumerate(forces)])
    problem, fitted = fit_given(prepared.problem(), Model(np.zeros(0)))
    return (prepared.scene, *learn(problem, fitted.model, _Predictions(prepared, fitted, 1)))


def pushed(name: str, seed: int, force: Callable[[Array], float]) -> Recording:
    """The mass under sines of effort and a `force`."""
    rng = np.random.default_rng(seed)
    time = STEP * np.arange(1500)
    # an effort that begins and ends a swing at rest, so that all recordings keep to about the same range
    phase = 2.0 * np.pi * rng.integers(0, 2) / 2.0
    u = 6.0 * np.cos(2 * np.pi * 0.9 * time + phase) + 3.0 * np.cos(2 * np.pi * 0.5 * time + phase)
    state, states = np.zeros(2), []
    for effort in u:
        states.append(state)
        for _ in range(FINER):
            middle = state + 0.5 * STEP / FINER * np.array([state[1], 0.5 * (effort + force(state))])
            state = state + STEP / FINER * np.array([middle[1], 0.5 * (effort + force(middle))])
    q, v = np.array(states).T
    q, v = q + NOISE[0] * rng.normal(size=len(q)), v + NOISE[1] * rng.normal(size=len(v))
    return Recording(name, time, {"q.rail": q, "v.rail": v, "u.rail": u})


def odd_friction(state: Array) -> float:
    """Friction that depends on the place."""
    return float(-1.5 * (1.0 + 0.5 * np.cos(5.0 * state[0])) * np.tanh(state[1] / 0.05))


def test_what_has_no_name_is_learned_as_a_table(tmp_path: Path) -> None:
    given, laws, records = learning_from(tmp_path, *[odd_friction] * 3)
    [law] = laws
    moved = pushed("another", 5, odd_friction).columns
    q, v = moved["q.rail"], moved["v.rail"]
    true = np.array([odd_friction(state) for state in np.stack([q, v], axis=1)])
    found = law.force(JointSamples(q, v, 0.0 * q)).value
    # on a motion that it was not learned from, the starting swing included
    assert np.sqrt(np.mean((found - true) ** 2)) < 0.2 * np.sqrt(np.mean(true**2))
    assert "rail" in words_of(law, given.tree) and "N" in words_of(law, given.tree)
    assert records[-1].step == "learn" and records[-1].passed


def test_where_nothing_remains_nothing_is_learned(tmp_path: Path) -> None:
    assert learning_from(tmp_path, *[lambda state: 0.0] * 3)[1] == ()


def test_a_law_that_drifts_is_not_learned(tmp_path: Path) -> None:
    forces = (lambda state: -0.4 * float(state[1]), lambda state: 0.4 * float(state[1]))
    assert learning_from(tmp_path, *forces, *forces)[1] == ()


def test_the_slopes_of_a_table_are_those_of_its_values() -> None:
    x = tuple(float(value) for value in np.linspace(-1.0, 1.0, 41))
    wave = tuple(float(np.sin(3.0 * value)) for value in x)
    law = LearnedForce("rail", {}, (Term("q", x, wave), Term("v", x, wave), Term("q, sign v", x, wave, 0.1)))
    q, v, small = np.array([-0.31, 0.12, 2.0]), np.array([0.21, -0.33, 0.52]), 1e-7
    force = law.force(JointSamples(q, v, 0.0 * q))
    by_q = (law.force(JointSamples(q + small, v, q)).value - force.value) / small
    by_v = (law.force(JointSamples(q, v + small, q)).value - force.value) / small
    np.testing.assert_allclose(force.d_q, by_q, atol=1e-5)
    np.testing.assert_allclose(force.d_v, by_v, atol=1e-5)


def test_a_learned_force_is_written_and_read_back_and_simulates_in_drake(tmp_path: Path) -> None:
    x = tuple(float(value) for value in np.linspace(-1.0, 1.0, 41))
    law = LearnedForce("rail", {}, (Term("q", x, tuple(-2.0 * value for value in x)),), table_name("rail"))
    out = tmp_path / "out"
    write_scene(scene(tmp_path).corrected(np.zeros(0), (law,)), out)
    read = Scene.load(out / "scenario.corrected.yaml")
    assert read.known == (law,)
    write_scene(read, tmp_path / "again")
    assert Scene.load(tmp_path / "again" / "scenario.corrected.yaml").known == (law,)
    builder = DiagramBuilder()
    corrected = read.add_to(builder, MultibodyPlantConfig(time_step=0.0))
    simulator = Simulator(builder.Build())
    context = corrected.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    corrected.plant.SetPositions(context, [0.5])
    simulator.AdvanceTo(1.0)
    # 2 kg on a spring of 2 N/m, as the table says within its range
    assert corrected.plant.GetPositions(context)[0] == pytest.approx(0.5 * np.cos(1.0), abs=1e-3)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"variables": ["q", "q"], "x": [0.0, 1.0]}, "lacks the columns force, width"),
        ({"variables": ["u", "u"], "x": [0.0, 1.0], "force": [0.0, 1.0], "width": [0.0, 0.0]}, "expected one of q, v"),
        ({"variables": ["q", "q"], "x": [1.0, 0.0], "force": [0.0, 1.0], "width": [0.0, 0.0]}, "must increase"),
        ({"variables": ["q"], "x": [None], "force": [0.0], "width": [0.0]}, "be finite"),
    ],
)
def test_a_table_that_cannot_be_used_is_told(columns: dict[str, list[Any]], said: str, tmp_path: Path) -> None:
    pq.write_table(pa.table(columns), tmp_path / "law.parquet")
    with pytest.raises(InputError, match=said):
        scene(tmp_path, "effects: [{effect: learned_force, at: rail, table: law.parquet}]\n")


def test_a_table_that_is_missing_or_not_wanted_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"effects\[0\].table is none.parquet: there is no file"):
        scene(tmp_path, "effects: [{effect: learned_force, at: rail, table: none.parquet}]\n")
    with pytest.raises(InputError, match=r"effects\[0\] has a table"):
        scene(tmp_path, "effects: [{effect: joint_viscous_friction, at: rail, coefficient: 1, table: a}]\n")
    with pytest.raises(InputError, match="learned_force has no table"):
        scene(tmp_path, "effects: [{effect: learned_force, at: rail}]\n")


def test_a_step_at_rest_stands_in_one_term_only() -> None:
    x = np.linspace(-1.0, 1.0, 4001)
    speed = Term(SPEED, tuple(x), tuple(5.0 * np.tanh(x / 0.1) - 0.3 * x))
    sided = Term(SIDED, tuple(x), tuple(-5.0 + 0.2 * np.sin(3.0 * x)), 0.1)
    before, after = LearnedForce("rail", {}, (speed, sided)), with_steps_in_one_term([speed, sided])
    motion = JointSamples(np.linspace(-0.9, 0.9, 50), np.linspace(0.8, -0.8, 50), np.zeros(50))
    moved = LearnedForce("rail", {}, tuple(after))
    np.testing.assert_allclose(moved.force(motion).value, before.force(motion).value, atol=1e-3)
    assert abs(np.mean(after[1].force)) < 1e-3
    assert np.ptp(after[0].force) < 1.0
