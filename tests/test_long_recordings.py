"""Recordings that are longer than the memory allows: read, looked at, searched and fitted to in parts."""

import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from drake_cafim import recordings
from drake_cafim.commands.long_inputs import LongInputs, open_inputs
from drake_cafim.diagnosis.fit.fitting import unbiased_fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.long import scan as scan_module
from drake_cafim.diagnosis.long.budget import Budget
from drake_cafim.diagnosis.long.choice import choose
from drake_cafim.diagnosis.long.examine import _joined, _restored, _Search, examine_parts
from drake_cafim.diagnosis.long.fit_of_all import fit_all
from drake_cafim.diagnosis.long.parts import Parts
from drake_cafim.diagnosis.long.scan import Seen, scan
from drake_cafim.diagnosis.long.stretches import cut_at_changes, stretches_of
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.verdict import Kind
from drake_cafim.effects.joint import JointViscousFriction
from drake_cafim.errors import InputError
from drake_cafim.kept import Kept
from drake_cafim.parallel.forked import map_forked
from drake_cafim.recordings.long import LongRecording, in_parts
from drake_cafim.recordings.pieces import pieces_of
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from tests import long_recording, two_links
from tests.long_recording import Long


def joined(long: LongRecording) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    parts = [long.part(k) for k in range(len(long))]
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0].columns}
    return np.concatenate([part.time for part in parts]), columns


def imperfect() -> Recording:
    """A recording with a gap, with missing samples and with a column that nothing uses."""
    plain = two_links.recording("log", 3, duration=4.0)
    keep = (plain.time < 1.0) | (plain.time > 1.5)
    columns = {name: values[keep].copy() for name, values in plain.columns.items()}
    columns["q.elbow"][100:120] = np.nan
    columns["temperature"] = np.linspace(20.0, 30.0, int(np.sum(keep)))
    return Recording("log", plain.time[keep], columns)


@pytest.mark.parametrize("suffix", ["parquet", "csv", "mcap", "npz"])
@pytest.mark.parametrize("piece", [37, 65536])
def test_parts_hold_what_the_whole_does(
    tmp_path: Path, suffix: str, piece: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drake_cafim.recordings.pieces.PIECE_ROWS", piece)
    path = tmp_path / f"log.{suffix}"
    if suffix == "npz":
        source = imperfect()
        np.savez(path, time=source.time, **source.columns)
    else:
        recordings.write(imperfect(), path)
    whole = recordings.read(path)
    long = in_parts(pieces_of(path), 200)
    assert len(long) == -(-len(whole) // 200) and max(len(long.part(k)) for k in range(len(long))) <= 200
    time, columns = joined(long)
    assert np.array_equal(time, whole.time)
    assert set(columns) == set(whole.columns)
    assert all(np.array_equal(columns[name], whole[name], equal_nan=True) for name in columns)
    assert set(long.notes) == set(whole.notes) and long.name == whole.name
    assert long.spans[0][0] == whole.time[0] and long.spans[-1][1] == whole.time[-1]
    long.close()


def test_rows_that_repeat_a_stamp_are_left_out_of_parts_too(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    lines = [
        "time,q.a",
        *(f"{0.01 * k:.2f},{k}" for k in range(50)),
        "0.49,7",
        *(f"{0.01 * k:.2f},{k}" for k in range(50, 90)),
    ]
    path.write_text("\n".join(lines) + "\n")
    long, whole = in_parts(pieces_of(path), 40), recordings.read(path)
    time, columns = joined(long)
    assert np.array_equal(time, whole.time) and np.array_equal(columns["q.a"], whole["q.a"])
    assert long.notes == whole.notes and len(time) == 90


def test_a_csv_with_text_or_a_line_cut_short_is_read_as_ever(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time,q.a,mode\n" + "".join(f"{0.01 * k:.2f},{k},run\n" for k in range(60)) + "0.60,6")
    long, whole = in_parts(pieces_of(path), 25), recordings.read(path)
    time, columns = joined(long)
    assert np.array_equal(time, whole.time) and list(columns) == list(whole.columns) and long.notes == whole.notes


def test_time_that_decreases_between_pieces_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time,q.a\n" + "".join(f"{0.01 * (k % 50):.2f},{k}\n" for k in range(100)))
    with pytest.raises(InputError, match=r"column time decreases from 0\.49 s to 0\.0 s"):
        in_parts(pieces_of(path), 25)


@pytest.mark.parametrize("memory", [1e6, 1e12])
def test_only_what_does_not_fit_is_in_parts(tmp_path: Path, memory: float) -> None:
    scene, path = two_links.scene(tmp_path), tmp_path / "log.parquet"
    recordings.write(two_links.recording("log", 1), path)
    with open_inputs(scene, [str(path)], [], memory) as inputs:
        if memory < 1e9:
            assert isinstance(inputs, LongInputs) and len(inputs.recordings) == 1
            return
        assert not isinstance(inputs, LongInputs)
        (found,), held = inputs
        known = recordings.read(path)
        assert held == [] and found.notes == known.notes and np.array_equal(found.time, known.time)
        assert all(np.array_equal(found[name], known[name]) for name in known.columns)


@pytest.mark.parametrize("jobs", [1, 2])
def test_copies_of_the_process_answer_in_order_and_pass_errors_on(jobs: int) -> None:
    held = lambda k: k * k  # noqa: E731, what cannot be sent to another process
    assert list(map_forked(held, 9, jobs)) == [k * k for k in range(9)]

    def refused(k: int) -> int:
        if k == 3:
            raise InputError("part 3: nothing in it")
        return k

    with pytest.raises(InputError, match="part 3: nothing in it"):
        list(map_forked(refused, 9, jobs))

    def local(k: int) -> Callable[[], int]:
        return lambda: k

    assert [found() for found in map_forked(local, 9, jobs)] == list(range(9)), "what cannot be sent is made here"


def test_copies_of_the_process_make_no_copies_of_their_own() -> None:
    def made_by(k: int) -> tuple[int, set[int]]:
        return os.getpid(), set(map_forked(lambda _: os.getpid(), 4, 2))

    found = list(map_forked(made_by, 4, 2))
    assert all(theirs == {own} and own != os.getpid() for own, theirs in found)


def looks(
    excess: Sequence[Sequence[float]], information: Sequence[dict[tuple[str, str], float]] | None = None
) -> list[Seen]:
    told = information or [{} for _ in excess]
    return [Seen(k, 1000, np.array(rows), 0.5, own) for k, (rows, own) in enumerate(zip(excess, told, strict=True))]


def test_parts_are_chosen_by_what_exceeds_noise_and_by_what_they_tell() -> None:
    drag, tilt = ("joint_viscous_friction", "elbow"), ("gravity_misalignment", "world")
    excess = [[0.0, 0.1], [0.0, 5.0], [0.0, 4.0], [0.5, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]
    told = [{drag: 1.0, tilt: 1.0} for _ in excess]
    told[4], told[6] = {drag: 100.0, tilt: 1.0}, {drag: 1.0, tilt: 80.0}
    # the largest excess of each row, then the two that tell most of either hypothesis
    assert choose(looks(excess, told), 4) == [1, 3, 4, 6]
    assert choose(looks(excess, told), 7) == list(range(7))


def test_stretches_are_divided_where_the_excess_steps_and_hardly_ever_by_chance() -> None:
    rng = np.random.default_rng(5)

    def seen(levels: Sequence[float]) -> list[Seen]:
        return looks([[level * rng.chisquare(200) / 200.0 - 1.0, rng.chisquare(200) / 200.0 - 1.0] for level in levels])

    def sizes(levels: Sequence[float]) -> list[int]:
        return [len(stretch.seen) for stretch in stretches_of(seen(levels), 0.01)]

    assert sizes([1.0] * 12 + [9.0] * 8) == [12, 8]
    assert sizes([1.0] * 7 + [5.0] * 6 + [1.0] * 7) == [7, 6, 7]
    assert sum(sizes([3.0] * 20) != [20] for _ in range(200)) <= 5
    # p-values of a step so clear are below 10⁻³⁰⁸ on either side of it
    assert sizes([1.0] * 366 + [1e5] * 367) == [366, 367]
    # less than half of what is there begins
    assert sizes([9.0] * 10 + [12.0] * 10) == [20]


def test_a_change_is_placed_between_the_windows_where_it_is(tmp_path: Path) -> None:
    recordings.write(two_links.recording("log", 1, duration=8.0), tmp_path / "log.parquet")
    parts = Parts.of([in_parts(pieces_of(tmp_path / "log.parquet"), 250)])
    middles = [np.arange(part.begin + 0.05, part.end, 0.03) for part in parts.items]

    def costs(number: int, stretch: int) -> tuple[np.ndarray, np.ndarray]:
        wrong = (middles[number] > 3.41) != bool(stretch)
        return np.where(wrong, 40.0, 2.0), middles[number]

    for first in (3, 4):  # the change lies in the last part of the one stretch, or in the first part of the other
        cut, numbers, (change,) = cut_at_changes(parts, [range(first), range(first, len(parts))], costs)
        assert change.time == pytest.approx(3.41, abs=0.03)
        assert len(cut) == len(parts) + 1 and sorted([*numbers[0], *numbers[1]]) == list(range(len(cut)))
        assert cut.items[numbers[0][-1]].end == change.time == cut.items[numbers[1][0]].begin
        assert sum(len(cut.read(k)) for k in range(len(cut))) == 2000


def test_a_part_in_which_a_sensor_was_off_is_left_out_with_a_note(tmp_path: Path) -> None:
    whole = two_links.recording("log", 4, duration=2.0, friction=(0.8, 0.3))
    columns = dict(whole.columns) | {"q.elbow": np.where(whole.time < 0.67, np.nan, whole["q.elbow"])}
    recordings.write(Recording("log", whole.time, columns), tmp_path / "log.parquet")
    long, scene = in_parts(pieces_of(tmp_path / "log.parquet"), 167), two_links.scene(tmp_path)
    prepared = prepare(scene, [long.part(1)])
    assert isinstance(prepared, Prepared)
    seen, (note,) = scan(Parts.of([long]), prepared, Model(prepared.scene.priors.mean))
    assert [part.number for part in seen] == [1, 2]
    assert note.startswith("0 to 0.664 s of ") and "q.elbow holds nothing but NaN" in note
    told = {effect for part in seen for effect, _ in part.information}
    assert {"joint_viscous_friction", "payload"} & told and "external_disturbance" not in told
    assert all(part.excess.max() > 1.0 for part in seen)  # the friction


def test_of_many_parts_the_information_of_some_is_enough(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scan_module, "MOST_INFORMED", 2)
    recordings.write(two_links.recording("log", 4, duration=2.0), tmp_path / "log.parquet")
    long, scene = in_parts(pieces_of(tmp_path / "log.parquet"), 167), two_links.scene(tmp_path)
    prepared = prepare(scene, [long.part(1)])
    assert isinstance(prepared, Prepared)
    seen, _ = scan(Parts.of([long]), prepared, Model(prepared.scene.priors.mean))
    assert [bool(part.information) for part in seen] == [True, False, True]


def prepared_parts(folder: Path, count: int, effort_std: float = 0.0) -> tuple[Scene, Prepared, list[Recording]]:
    channels = f"channels: {{q: {{std: 2.0e-4}}, v: {{std: 2.0e-3}}, u: {{std: {effort_std}}}}}"
    scene = two_links.scene(folder, channels)
    noise = (2e-4, 2e-3, effort_std)
    parts = [
        two_links.recording(f"part {k}", 10 + k, duration=2.0, friction=(0.8, 0.3), noise=noise) for k in range(count)
    ]
    prepared = prepare(scene, parts)
    assert isinstance(prepared, Prepared)
    return prepared.scene, prepared, parts


@pytest.mark.long
@pytest.mark.parametrize("effort_std", [0.0, 0.05])
def test_steps_over_parts_end_where_a_fit_to_all_at_once_does(tmp_path: Path, effort_std: float) -> None:
    scene, prepared, parts = prepared_parts(tmp_path, 5, effort_std)
    start = Model(scene.priors.mean, (JointViscousFriction("elbow", {"coefficient": 0.05}),))
    acting = [start.keys] * len(parts)

    def lay_out(number: int, model: Model) -> WeakProblem:
        return WeakProblem.of(scene, [prepared.laid_out(parts[number])], model)

    found = {jobs: fit_all(scene, lay_out, acting, start, jobs=jobs) for jobs in (1, 2)}
    assert np.array_equal(found[1].fitted.model.vector, found[2].fitted.model.vector)
    fitted = found[1].fitted
    at_once = unbiased_fit(WeakProblem.of(scene, prepared.weak, fitted.model), fitted.model)
    assert found[1].settled
    # noise that is added once more to measured efforts is drawn for each part, or for all together
    near = 0.1 if not effort_std else 0.5
    assert np.max(np.abs(fitted.model.vector - at_once.model.vector) / at_once.std) < near
    assert fitted.covariance == pytest.approx(at_once.covariance, rel=1e-3 if not effort_std else 0.05)
    assert fitted.chi_square == pytest.approx(at_once.chi_square, rel=1e-3)


def test_an_effect_counts_in_the_parts_in_which_it_is(tmp_path: Path) -> None:
    scene, prepared, parts = prepared_parts(tmp_path, 4)
    without = two_links.recording("without", 30, duration=2.0)
    every = [*parts, without]
    start = Model(scene.priors.mean, (JointViscousFriction("elbow", {"coefficient": 0.05}),))

    def lay_out(number: int, model: Model) -> WeakProblem:
        return WeakProblem.of(scene, [prepared.laid_out(every[number])], model)

    def drag(acting: Sequence[frozenset[tuple[str, str]]]) -> float:
        return float(fit_all(scene, lay_out, acting, start).fitted.model.vector[1])

    alone = drag([start.keys] * 4)
    assert drag([start.keys] * 4 + [frozenset()]) == pytest.approx(alone, rel=0.05)
    assert drag([start.keys] * 5) < 0.95 * alone


def test_stretches_that_name_the_same_are_one() -> None:
    drag, nothing = JointViscousFriction("elbow", {"coefficient": 0.3}), Model(np.zeros(1))
    more = JointViscousFriction("elbow", {"coefficient": 0.4})
    named = [nothing, nothing.with_effects([drag]), nothing.with_effects([more])]
    kinds: tuple[Kind, ...] = ("none", "unexplained", "explained")
    first, second, third = (
        _Search((k, k + 1), f"part {k}", 1, model, kind, {drag.key: 0.1 * k})
        for k, (model, kind) in enumerate(zip(named, kinds, strict=True))
    )
    assert _joined([first, second]) == [first, second]
    before, joined = _joined([first, second, third])
    assert before == first and joined.model is third.model and joined.kind == "unexplained"
    assert joined.numbers == (1, 2, 2, 3) and joined.words == "part 1; part 2" and joined.count == 2
    assert joined.probability == {drag.key: 0.2}


@pytest.mark.long
def test_a_long_log_tells_its_friction_and_when_a_payload_was_taken_up(tmp_path: Path) -> None:
    address = long_recording.write(Long(2, 28.0, rate=500.0, payload=0.5, taken=16.3), tmp_path)
    scene = Scene.load(address)
    long = in_parts(pieces_of(tmp_path / "log.parquet"), 2000)
    said: list[str] = []
    kept = Kept.open(tmp_path / "parts", {}, resume=False)
    found = examine_parts(scene, [long], [], Budget(8000.0, 1.0), progress=said.append, kept=kept)
    by_name = {accepted.effect.name: accepted for accepted in found.verdict.explanation}
    assert found.verdict.kind == "explained" and set(by_name) == {"joint_viscous_friction", "payload"}
    friction, payload = by_name["joint_viscous_friction"].values["coefficient"], by_name["payload"].values["mass"]
    assert abs(friction.value - 0.3) < 4.0 * friction.std < 1e-3
    assert abs(payload.value - 0.5) < 4.0 * payload.std < 1e-2
    since = [location for location in found.verdict.mismatch.locations if location.kind == "body"]
    assert since[0].intervals[0][0] == pytest.approx(16.3, abs=0.1) and since[0].intervals[0][1] == long.spans[-1][1]
    assert "s of" in by_name["payload"].sentence and "from" not in by_name["joint_viscous_friction"].sentence
    assert any("alone say" in text for text in said) and any("which tell most" in note for note in found.verdict.notes)
    first = kept.read("first", lambda raw: _restored(scene, Parts.of([long]), raw))
    search = kept.read("search_0", partial(_Search.from_json, scene))
    assert first is not None and search is not None and search.effects == {("joint_viscous_friction", "elbow")}
