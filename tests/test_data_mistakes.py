"""Mistakes of the data (sign, swapped joints, units, gravity) are reported as such, and missing physics is not."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.tree import MultibodyForces

from drake_cafim import recordings
from drake_cafim.diagnosis.diagnose import diagnose, estimate
from drake_cafim.diagnosis.fit.data_mistakes import Suspicion, correct
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.noise.stated import noise_of
from drake_cafim.diagnosis.notes import data_mistakes as mistakes
from drake_cafim.diagnosis.notes.data_mistakes import data_mistakes
from drake_cafim.diagnosis.notes.suspicions import suspicions
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.rows.samples import with_recording
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import MISTAKES_TRIED_EXACTLY
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests import served_arm, two_links
from tests.concealed.make import simulate

Columns = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, list[Recording]]:
    """Three recordings of a two-joint arm that lacks nothing."""
    folder = tmp_path_factory.mktemp("arm")
    simulate("null", "arm2", 1014).write(folder)
    return Scene.load(folder / "scenario.yaml"), [recordings.read(folder / f"train_{k}.parquet") for k in (1, 2, 3)]


def _changed(arm: tuple[Scene, list[Recording]], change: Callable[[Columns], Columns]) -> list[Recording]:
    return [replace(run, columns={**run.columns, **change(dict(run.columns))}) for run in arm[1]]


def _told(scene: Scene, changed: list[Recording]) -> tuple[str, ...]:
    return data_mistakes(scene, changed, noise_of(scene, changed)[0])


def _files(changed: list[Recording]) -> str:
    return f"{changed[0].name}, {changed[1].name} and {changed[2].name}"


def test_a_turned_effort_is_told(arm: tuple[Scene, list[Recording]]) -> None:
    name = arm[0].tree.joint_names[1]
    changed = _changed(arm, lambda columns: {f"u.{name}": -columns[f"u.{name}"]})
    assert _told(arm[0], changed) == (f"u.{name} of {_files(changed)} has its sign turned",)


def test_a_turned_axis_is_told(arm: tuple[Scene, list[Recording]]) -> None:
    name = arm[0].tree.joint_names[0]
    changed = _changed(arm, lambda columns: {f"{kind}.{name}": -columns[f"{kind}.{name}"] for kind in "qv"})
    assert _told(arm[0], changed) == (f"q.{name} and v.{name} of {_files(changed)} have their signs turned",)


def test_swapped_joints_are_told(arm: tuple[Scene, list[Recording]]) -> None:
    a, b = arm[0].tree.joint_names
    changed = _changed(arm, lambda columns: {f"u.{a}": columns[f"u.{b}"], f"u.{b}": columns[f"u.{a}"]})
    assert _told(arm[0], changed) == (f"u.{a} and u.{b} of {_files(changed)} have the joints {a} and {b} swapped",)


def test_parts_of_one_recording_are_tested_together(
    arm: tuple[Scene, list[Recording]], monkeypatch: pytest.MonkeyPatch
) -> None:
    name = arm[0].tree.joint_names[1]
    whole, other, _ = _changed(arm, lambda columns: {f"u.{name}": -columns[f"u.{name}"]})
    half = 0.5 * (whole.time[0] + whole.time[-1])
    parts = [whole.window(whole.time[0], half), whole.window(half + 1e-6, whole.time[-1])]
    tested = []
    monkeypatch.setattr(mistakes, "correct", lambda named, excerpt: tested.append(named) or correct(named, excerpt))
    assert _told(arm[0], parts) == (f"u.{name} of {whole.name} has its sign turned",)
    assert tested == [whole.name]
    # of one name, but at the same time: two recordings
    _told(arm[0], [whole, replace(other, name=whole.name)])
    assert tested == 3 * [whole.name]


@pytest.mark.parametrize("wrong", ["swapped and turned", "turned", "swapped axes", "twice"])
def test_the_corrections_that_are_tried_exactly_are_the_best_of_all(
    arm: tuple[Scene, list[Recording]], wrong: str
) -> None:
    """Though most are given up before all their squares are summed."""
    scene, runs = arm
    a, b = scene.tree.joint_names
    own = dict(runs[0].columns)
    columns = {
        "swapped and turned": {f"u.{a}": -own[f"u.{b}"], f"u.{b}": 2.0 * own[f"u.{a}"]},
        "turned": {f"u.{a}": -own[f"u.{a}"]},
        "swapped axes": {f"{kind}.{x}": own[f"{kind}.{y}"] for kind in "qv" for x, y in ((a, b), (b, a))},
        "twice": {f"u.{b}": 3.0 * own[f"u.{b}"], f"q.{a}": -own[f"q.{a}"]},
    }[wrong]
    recording = replace(runs[0], columns={**own, **columns})
    excerpt = mistakes._Excerpts.of(scene, [recording], noise_of(scene, [recording])[0])
    physics, joints = Model(scene.priors.mean).physics(scene), excerpt._glaring_joints()
    squares: dict[tuple[str, str], float] = {}
    for run in excerpt.problem.runs:
        samples = run.weak.samples
        for suspicion in suspicions(scene, samples.recording, joints):
            right = WeakForm(with_recording(samples, scene, suspicion.correct(samples.recording)), scene.wrench_sensors)
            left = float(np.sum(run.whitened(right.residual(physics)) ** 2))
            squares[suspicion.key] = squares.get(suspicion.key, 0.0) + left
    had = float(sum(rows @ rows for rows in excerpt.rows))
    best = [key for key in sorted(squares, key=squares.__getitem__) if squares[key] < had][:MISTAKES_TRIED_EXACTLY]
    assert best and [suspected[0].key for suspected in excerpt._most_likely()] == best


def test_a_mistake_leaves_no_room_for_physics(arm: tuple[Scene, list[Recording]]) -> None:
    name = arm[0].tree.joint_names[1]
    changed = _changed(arm, lambda columns: {f"u.{name}": -columns[f"u.{name}"]})
    verdict = diagnose(arm[0], changed)
    assert verdict.kind == "unexplained" and verdict.explanation == ()
    assert str(verdict).startswith(f"The recordings themselves look wrong: u.{name} of ")


def test_friction_and_a_weak_drive_are_no_mistakes(arm: tuple[Scene, list[Recording]]) -> None:
    assert _told(*arm) == ()
    for joint in arm[0].tree.joint_names:
        rubbing = _changed(
            arm, lambda columns, j=joint: {f"u.{j}": columns[f"u.{j}"] + 2.0 * np.sign(columns[f"v.{j}"])}
        )
        assert _told(arm[0], rubbing) == ()
        weak = _changed(arm, lambda columns, j=joint: {f"u.{j}": 2.0 * columns[f"u.{j}"]})
        assert _told(arm[0], weak) == ()


def test_efforts_without_gravity_are_told(arm: tuple[Scene, list[Recording]]) -> None:
    scene, runs = arm
    changed = []
    for run in runs:
        holding = -_gravity(scene, run)
        without = {f"u.{name}": run[f"u.{name}"] - holding[:, j] for j, name in enumerate(scene.tree.joint_names)}
        changed.append(replace(run, columns={**run.columns, **without}))
    efforts = " and ".join(f"u.{name}" for name in scene.tree.joint_names)
    assert _told(scene, changed) == (f"{efforts} of {_files(changed)} have gravity already taken out",)


def test_a_bias_is_not_told_as_gravity_where_an_arm_moves_little(links: tuple[Scene, list[Recording]]) -> None:
    """Hung out to one side, where gravity hardly changes; the other file, in which it does, knows the same bias."""
    scene, _ = links
    name = scene.tree.joint_names
    wide, narrow = two_links.recording("wide.parquet", 1), _held_out_to_one_side(scene)
    bias = 0.9 * _gravity(scene, narrow).mean(axis=0)
    biased = [
        _with(run, {f"u.{joint}": run[f"u.{joint}"] + bias[j] for j, joint in enumerate(name)})
        for run in (wide, narrow)
    ]
    assert _told(scene, biased) == ()


def _held_out_to_one_side(scene: Scene) -> Recording:
    """A recording of a small motion about 1.2 rad."""
    return _swung(scene, "narrow.parquet", np.array([1.2, 0.1]), 0.02, np.array([5.0, 7.0]))


def _swung(scene: Scene, name: str, middle: Array, amplitude: float, rates: Array) -> Recording:
    """A recording of swings about `middle` (2,) at `rates` (2,) rad/s, its efforts by Drake's inverse dynamics."""
    rng, time = np.random.default_rng(7), two_links.STEP * np.arange(750)
    phases = np.outer(time, rates)
    q, v = middle + amplitude * np.sin(phases), amplitude * rates * np.cos(phases)
    a = -(rates**2) * (q - middle)
    plant, context = scene.plant, scene.plant.CreateDefaultContext()
    u = _gravity(scene, Recording("", time, {f"q.{joint}": q[:, j] for j, joint in enumerate(two_links.JOINTS)}))
    for k in range(len(time)):
        plant.SetPositions(context, q[k])
        plant.SetVelocities(context, v[k])
        u[k] = plant.CalcInverseDynamics(context, a[k], MultibodyForces(plant)) - u[k]
    columns: Columns = {}
    for kind, values, std in (("q", q, 2e-4), ("v", v, 2e-3), ("u", u, 0.0)):
        read = values + std * rng.standard_normal(values.shape)
        columns |= {f"{kind}.{joint}": read[:, j] for j, joint in enumerate(two_links.JOINTS)}
    return Recording(name, time, columns)


def _gravity(scene: Scene, run: Recording) -> Array:
    """Drake's own generalized forces of gravity (N, n) at the recorded positions."""
    plant, context = scene.plant, scene.plant.CreateDefaultContext()
    forces = []
    for q in run.matrix("q", scene.tree.joint_names):
        plant.SetPositions(context, q)
        forces.append(plant.CalcGravityGeneralizedForces(context))
    return np.array(forces)


@pytest.fixture(scope="module")
def links(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, list[Recording]]:
    """Two recordings of an arm that lacks nothing."""
    scene = two_links.scene(tmp_path_factory.mktemp("links"))
    return scene, [two_links.recording(f"run_{k}.parquet", k) for k in (1, 2)]


def _with(recording: Recording, changed: Columns) -> Recording:
    return replace(recording, columns={**recording.columns, **changed})


def _opposite(recording: Recording, *columns: str) -> Recording:
    return _with(recording, {name: -recording[name] for name in columns})


MISTAKES: list[tuple[str, Callable[[Recording], Recording]]] = [
    ("u.elbow of run_2.parquet has its sign turned", lambda run: _opposite(run, "u.elbow")),
    ("v.shoulder of run_2.parquet has its sign turned", lambda run: _opposite(run, "v.shoulder")),
    ("q.elbow of run_2.parquet has its sign turned", lambda run: _opposite(run, "q.elbow")),
    (
        "u.shoulder and u.elbow of run_2.parquet have their signs turned",
        lambda run: _opposite(run, "u.shoulder", "u.elbow"),
    ),
    (
        "u.shoulder and u.elbow of run_2.parquet have the joints shoulder and elbow swapped",
        lambda run: _with(run, {"u.shoulder": run["u.elbow"], "u.elbow": run["u.shoulder"]}),
    ),
    (
        "q.shoulder and q.elbow of run_2.parquet have the joints shoulder and elbow swapped",
        lambda run: _with(run, {"q.shoulder": run["q.elbow"], "q.elbow": run["q.shoulder"]}),
    ),
    (
        "v.shoulder and v.elbow of run_2.parquet have the joints shoulder and elbow swapped",
        lambda run: _with(run, {"v.shoulder": run["v.elbow"], "v.elbow": run["v.shoulder"]}),
    ),
    (
        "u.shoulder and u.elbow of run_2.parquet have values in millinewton metres, expected N m",
        lambda run: _with(run, {name: 1e3 * run[name] for name in ("u.shoulder", "u.elbow")}),
    ),
    (
        "u.elbow of run_2.parquet has values in millinewton metres, expected N m",
        lambda run: _with(run, {"u.elbow": 1e3 * run["u.elbow"]}),
    ),
    (
        "q.elbow and v.elbow of run_2.parquet have values in degrees and degrees/s, expected rad and rad/s",
        lambda run: _with(run, {name: np.degrees(run[name]) for name in ("q.elbow", "v.elbow")}),
    ),
    (
        "q.elbow of run_2.parquet is a quarter turn too small",
        lambda run: _with(run, {"q.elbow": run["q.elbow"] - 0.5 * np.pi}),
    ),
    (
        "q.shoulder of run_2.parquet is half a turn off",
        lambda run: _with(run, {"q.shoulder": run["q.shoulder"] + np.pi}),
    ),
    (
        "q.shoulder, q.elbow, v.shoulder and v.elbow of run_2.parquet have values in turns and turns/s, expected rad "
        "and rad/s",
        lambda run: _with(run, {name: 0.5 / np.pi * run[name] for name in run.columns if name[0] in "qv"}),
    ),
]


@pytest.mark.parametrize(("sentence", "changed"), MISTAKES, ids=[sentence for sentence, _ in MISTAKES])
def test_a_mistake_of_one_file_is_told_of_that_file(
    links: tuple[Scene, list[Recording]], sentence: str, changed: Callable[[Recording], Recording]
) -> None:
    scene, (first, second) = links
    assert _told(scene, [first, second]) == ()
    assert _told(scene, [first, changed(second)]) == (sentence,)
    assert _told(scene, [changed(second), first]) == (sentence,)


def test_each_file_may_have_its_own_mistakes(links: tuple[Scene, list[Recording]]) -> None:
    scene, (first, second) = links
    told = _told(scene, [_opposite(first, "u.elbow"), _opposite(second, "u.shoulder", "v.elbow")])
    assert sorted(told) == [
        "u.elbow of run_1.parquet has its sign turned",
        "u.shoulder of run_2.parquet has its sign turned",
        "v.elbow of run_2.parquet has its sign turned",
    ]


def test_a_joint_that_moves_late_is_looked_at_where_it_moves(links: tuple[Scene, list[Recording]]) -> None:
    """The first two thirds at rest, which the middle of a recording would show alone."""
    scene, (first, _) = links
    still, step = 2000, two_links.STEP
    noise = {"q": 2e-4, "v": 2e-3, "u": 0.0}
    rng = np.random.default_rng(5)
    columns = {
        name: np.concatenate([noise[name[0]] * rng.standard_normal(still), values])
        for name, values in first.columns.items()
    }
    time = step * np.arange(still + len(first.time))
    late = Recording("late.parquet", time, columns)
    assert _told(scene, [_opposite(late, "u.elbow")]) == ("u.elbow of late.parquet has its sign turned",)


def test_a_turned_effort_of_one_of_two_files_is_no_physics(links: tuple[Scene, list[Recording]]) -> None:
    scene, (first, second) = links
    verdict = diagnose(scene, [first, _opposite(second, "u.elbow")])
    assert verdict.data_mistakes == ("u.elbow of run_2.parquet has its sign turned",)
    assert verdict.kind == "unexplained" and not verdict.explanation


def test_a_mistake_of_what_is_held_out_is_a_note(links: tuple[Scene, list[Recording]]) -> None:
    scene, (first, second) = links
    prepared = prepare(scene, [first], [_opposite(second, "u.elbow")])
    assert prepared.mistakes == ()
    assert "held out: u.elbow of run_2.parquet has its sign turned" in prepared.notes


def test_an_estimate_from_wrong_data_says_so_first(links: tuple[Scene, list[Recording]]) -> None:
    scene, (first, second) = links
    found = estimate(scene, [_opposite(first, "u.shoulder", "u.elbow"), second])
    assert found.data_mistakes == ("u.shoulder and u.elbow of run_1.parquet have their signs turned",)
    said = str(found).splitlines()
    assert said[0].startswith("The recordings themselves look wrong: u.shoulder and u.elbow of run_1.parquet")
    assert said[1].startswith("Goodness of fit: WARNING, the model does not fit")
    values = [line for line in said if not line.startswith("note: ")]
    assert "no estimate" in values[-2] and values[-1].startswith("mass of lower")


def test_a_model_that_is_too_heavy_is_not_told_as_degrees(tmp_path: Path) -> None:
    scene = two_links.scene(tmp_path)
    heavy = tmp_path / "two_links.urdf"
    heavy.write_text(heavy.read_text().replace('mass value="2.0"', 'mass value="40"').replace("0.04", "0.8"))
    assert _told(Scene.load(tmp_path / "scenario.yaml"), [two_links.recording("run_1.parquet", 1)]) == ()
    assert _told(scene, [two_links.recording("run_1.parquet", 1, friction=(3.0, 1.0))]) == ()


def test_positions_and_commands_may_have_another_zero_together(tmp_path: Path) -> None:
    """As of a servo whose middle is not the model's zero."""
    path = served_arm.written(tmp_path, shoulder=served_arm.POSITION, elbow=served_arm.POSITION)
    scene, run = Scene.from_model(path), served_arm.recorded(path, 1)
    assert _told(scene, [run]) == ()
    shifted = _with(run, {name: run[name] - 0.5 * np.pi for name in ("q.shoulder", "cmd.shoulder")})
    [told] = _told(scene, [shifted])
    assert told.startswith("q.shoulder and cmd.shoulder of ") and told.endswith(" are a quarter turn too small")


@dataclass
class _Excerpt:
    """One that each of the `suspicions` makes ten times better, in turn."""

    suspicions: list[Suspicion]
    chi_square: float = 1e4

    def best_correction(self) -> "tuple[Suspicion, _Excerpt] | None":
        first, *others = self.suspicions
        return first, _Excerpt(others, 0.1 * self.chi_square)

    def scaled_again(self, suspicion: Suspicion) -> float:
        return 1e4


@pytest.mark.parametrize(("second", "told"), [("q.elbow", 1), ("q.shoulder", 2)])
def test_no_column_has_two_units(second: str, told: int) -> None:
    """Degrees and turns together would be a factor of nine, as of no unit."""
    turns = Suspicion("q.elbow", "has values in turns", {"q.elbow": np.zeros(1)}, 0.5 / np.pi)
    again = Suspicion(second, "has values in turns", {second: np.zeros(1)}, 0.5 / np.pi)
    sign = Suspicion(second, "has its sign turned", {second: np.zeros(1)})
    assert len(correct("", _Excerpt([turns, again, again])).mistakes) == told
    assert len(correct("", _Excerpt([turns, sign, sign, sign])).mistakes) == 3
