"""Degenerate recordings give a result or one sentence, and no effect is named where nothing moves."""

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from drake_cafim import InputError, Recording, Scene, write
from drake_cafim.cli import main
from drake_cafim.diagnosis.assembly import NOTHING_MOVES
from drake_cafim.diagnosis.diagnose import diagnose, estimate, examine
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.predict.forecast import window_starts
from drake_cafim.diagnosis.predict.innovations import _before_gap, _starts
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagrams.tutorials.stand_in import ARM, NOISE
from drake_cafim.effects.link import Payload
from drake_cafim.numerics.local_polynomial import local_polynomial
from drake_cafim.report.artifacts import write_artifacts
from drake_cafim.typing import Array
from tests.tosses import SCENARIO, thrown, thrown_scene

JOINTS = ("shoulder", "elbow")
TIME = np.arange(0.0, 1.0, 0.004)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene.from_model(ARM, channels=NOISE, weld=["base"])


def recorded(q: float = 0.0, v: float = 0.0, u: float = 0.0) -> tuple[Array, dict[str, Array]]:
    columns = {
        f"{kind}.{name}": np.full(len(TIME), value)
        for kind, value in zip("qvu", (q, v, u), strict=True)
        for name in JOINTS
    }
    return TIME.copy(), columns


def swinging() -> tuple[Array, dict[str, Array]]:
    """The shoulder swings under exact numbers, the elbow stands still."""
    time, columns = recorded()
    columns["q.shoulder"], columns["v.shoulder"] = 0.3 * np.sin(6.0 * time), 1.8 * np.cos(6.0 * time)
    columns["u.shoulder"] = 0.5 * np.sin(6.0 * time)
    return time, columns


@pytest.mark.parametrize(("q", "u"), [(0.0, 0.0), (0.3, 0.1), (0.0, 1.0), (1e-300, 1e-300)])
def test_nothing_is_named_where_nothing_moves(scene: Scene, q: float, u: float) -> None:
    verdict = diagnose(scene, [Recording("still.csv", *recorded(q, 0.0, u))])
    assert verdict.explanation == () and verdict.kind != "explained"
    assert NOTHING_MOVES in verdict.notes


def test_columns_that_never_change_are_read_without_a_warning(scene: Scene) -> None:
    whole = np.arange(0.0, 4.0, 0.004)  # long enough for a spectrum
    columns = {name: np.zeros(len(whole)) for name in recorded()[1]}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        prepare(scene, [Recording("still.csv", whole, columns)])


def test_velocities_that_not_every_file_has_are_read_from_none(scene: Scene) -> None:
    whole, other = (Recording(name, *swinging()) for name in ("a.csv", "b.csv"))
    fewer = replace(other, columns={name: values for name, values in other.columns.items() if name != "v.elbow"})
    for files, held_out in (([whole, fewer], []), ([fewer], [whole])):
        prepared = prepare(scene, files, held_out)
        assert isinstance(prepared, Prepared)
        assert not any(form.kinematic_rows for form in (*prepared.weak, *prepared.held_out))
        assert any("since v.elbow is not in b.csv" in note for note in prepared.notes)
        assert np.all(np.isfinite(prepared.problem().rows_of(Model(prepared.scene.priors.mean))))
    prepared = prepare(scene, [whole], [fewer])
    assert isinstance(prepared, Prepared) and prepared.weak[0].kinematic_rows
    assert not any("v.elbow" in note for note in prepared.notes)


def test_a_body_so_heavy_that_nothing_moves_explains_nothing(scene: Scene) -> None:
    prepared = prepare(scene, [Recording("a.csv", *swinging())])
    heavy = Payload("upper", {"mass": 1e160, "x": 0.0, "y": 0.0, "z": -0.1})
    assert prepared.problem().penalty(Model(prepared.scene.priors.mean, (heavy,))) == np.inf


@pytest.mark.long
def test_what_moves_a_little_moves(scene: Scene) -> None:
    time, columns = recorded()
    columns["q.elbow"] = columns["q.elbow"] + 6.0 * NOISE["q"] * np.sin(6.0 * time)
    assert NOTHING_MOVES not in diagnose(scene, [Recording("creeping.csv", time, columns)]).notes


def _one_row(time: Array, columns: dict[str, Array]) -> tuple[Array, dict[str, Array]]:
    return time[:1], {name: values[:1] for name, values in columns.items()}


def _jump(seconds: float) -> Callable[[Array, dict[str, Array]], tuple[Array, dict[str, Array]]]:
    return lambda time, columns: (np.where(time < 0.5, time, time + seconds), columns)


def _with(column: str, value: float) -> Callable[[Array, dict[str, Array]], tuple[Array, dict[str, Array]]]:
    def changed(time: Array, columns: dict[str, Array]) -> tuple[Array, dict[str, Array]]:
        return time, {**columns, column: np.where(np.arange(len(time)) == 100, value, columns[column])}

    return changed


def _few(kept: int) -> Callable[[Array, dict[str, Array]], tuple[Array, dict[str, Array]]]:
    def changed(time: Array, columns: dict[str, Array]) -> tuple[Array, dict[str, Array]]:
        return time, {**columns, "q.shoulder": np.where(np.arange(len(time)) < kept, columns["q.shoulder"], np.nan)}

    return changed


REFUSED = {
    "one row": (_one_row, r"bad\.csv: only 1 sample, expected at least 8"),
    "a gap of 1e6 s": (_jump(1e6), r"bad\.csv: column time jumps by 1e\+06 s at sample 126 of 250, expected gaps"),
    "a position of 1e300": (
        _with("q.elbow", 1e300),
        r"bad\.csv: column q\.elbow holds 1e\+300 at 0\.4 s, expected SI units",
    ),
    "an effort of -1e12": (_with("u.shoulder", -1e12), r"bad\.csv: column u\.shoulder holds -1e\+12 at 0\.4 s"),
    "a clock in ms": (
        lambda time, columns: (1e3 * time, columns),
        r"bad\.csv: column time has steps of 4 s, as milliseconds or nanoseconds would; expected seconds",
    ),
    "a clock in ns": (lambda time, columns: (1e9 * time, columns), r"bad\.csv: column time has steps of 4e\+06 s"),
    "all NaN but three": (_few(3), r"bad\.csv: q\.shoulder and q\.elbow have values together in only 3 of 250 rows"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_of_no_use_is_refused_in_one_sentence(case: str, scene: Scene) -> None:
    change, sentence = REFUSED[case]
    recording = Recording("bad.csv", *change(*swinging()))
    with pytest.raises(InputError, match=sentence):
        diagnose(scene, [recording])
    with pytest.raises(InputError, match=sentence):
        estimate(scene, [recording])


def test_estimates_of_odd_recordings_have_figures_or_say_why_not(scene: Scene) -> None:
    for change in (_with("q.elbow", 1e6), _with("v.shoulder", 1e6), _with("u.elbow", 1e6), _jump(100.0)):
        found = estimate(scene, [Recording("odd.csv", *change(*swinging()))])
        nll = found.train.nominal.nll
        assert np.isfinite(nll) or any(note.startswith("fit.train.nominal.nll cannot") for note in found.notes)


def test_predictions_start_anew_after_a_gap_and_do_not_cross_it() -> None:
    time = np.concatenate([np.arange(0.0, 1.2, 0.01), 1e5 + np.arange(0.0, 1.2, 0.01)])
    for starts in (_starts(time), window_starts(time, 0.5)):
        assert np.all(np.diff(starts) > 0) and len(starts) < 8
    assert _before_gap(time, 105, 130) == 119
    assert _before_gap(time, 5, 55) == 55
    even = np.arange(0.0, 3.3, 0.004)
    assert window_starts(even, 1.0) == [int(np.searchsorted(even, 0.05 + k - 1e-9)) for k in range(3)]


def test_a_polynomial_over_a_long_gap_is_finite() -> None:
    time = np.concatenate([np.arange(10) * 0.002, 1e9 + np.arange(10) * 0.002])
    assert np.all(np.isfinite(local_polynomial(time, 0.0, 5, 1, at_least=5).toarray()))


def test_a_body_that_lies_still_lacks_nothing(tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path, scenario=SCENARIO)
    (recording,) = thrown(scene.physics, 1, count=1)
    still = {name: np.full_like(values, values[0]) for name, values in recording.columns.items()}
    still["pose.body.z"] = np.full_like(recording.time, 0.04 - 0.3 * 9.81 / 3000.0)
    verdict = diagnose(scene, [Recording("still.csv", recording.time, still)])
    assert verdict.explanation == () and NOTHING_MOVES in verdict.notes
    far = {**recording.columns, "pose.body.x": recording.columns["pose.body.x"] + 1e300}
    with pytest.raises(InputError, match=r"far\.csv: column pose\.body\.x holds 1e\+300"):
        diagnose(scene, [Recording("far.csv", recording.time, far)])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.urdf").write_text(ARM.read_text())
    (tmp_path / "s.yaml").write_text(
        "model: arm.urdf\nweld: [{body: base}]\nchannels: {q: {std: 2e-4}, v: {std: 2e-3}, u: {std: 0.0}}\n"
    )
    for name in ("a.csv", "b.csv"):
        write(Recording(name, *recorded()), tmp_path / name)
    return tmp_path


def _cafim(*arguments: str) -> Any:
    return CliRunner().invoke(main, arguments, catch_exceptions=False)


def test_what_cannot_be_replayed_or_followed_is_one_sentence(folder: Path) -> None:
    time, columns = recorded()
    write(Recording("short", time[:1], {name: values[:1] for name, values in columns.items()}), folder / "short.csv")
    columns["u.elbow"] = np.where(time < 0.6, np.nan, 0.0)
    write(Recording("late", 2.0 * time, columns), folder / "late.csv")
    for arguments, words in (
        (["replay", "s.yaml", "short.csv", "--out", "out.html"], "short.csv: only 1 sample, expected at least 8"),
        (
            ["export", "s.yaml", "--to", "urdf", "--recording", "late.csv", "--out", "out"],
            "late.csv: no row of its first 1 s has the effort",
        ),
    ):
        result = _cafim(*arguments)
        assert result.exit_code == 2 and words in result.stderr, result.stderr
        assert len([line for line in result.stderr.splitlines() if not line.endswith(" ...")]) == 1


def test_one_file_by_two_spellings_is_one_file(folder: Path) -> None:
    (folder / "loop.csv").symlink_to("loop.csv")
    twice, again = "more than once (a.csv is the same file)", ["--held-out", "a.csv", "--held-out", "./a.csv"]
    for arguments, words in (
        (["diagnose", "s.yaml", "--recording", "a.csv", "--recording", "./a.csv"], twice),
        (["diagnose", "s.yaml", "--recording", "a.csv", "--held-out", str(folder / "a.csv")], "and as --held-out"),
        (["diagnose", "s.yaml", "--recording", "b.csv", *again], twice),
        (["estimate", "s.yaml", "a.csv", "./a.csv"], twice),
        (["estimate", "s.yaml", "loop.csv"], "loop.csv: there is no such file"),
    ):
        result = _cafim(*arguments, "--out", "out")
        assert result.exit_code == 2 and words in result.stderr and len(result.stderr.strip().splitlines()) == 1


def test_a_finished_diagnosis_is_not_made_again(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = ["diagnose", "s.yaml", "--recording", "a.csv", "--no-replay", "--out", "out"]
    assert _cafim(*command).exit_code == 0
    before = (folder / "out" / "report.json").stat().st_mtime_ns
    again = _cafim(*command, "--resume")
    assert again.exit_code == 0 and "Nothing is missing" in again.stdout
    assert (folder / "out" / "report.json").stat().st_mtime_ns == before
    other = _cafim("diagnose", "s.yaml", "--recording", "b.csv", "--no-replay", "--out", "out", "--resume")
    assert other.exit_code == 2 and "expected the same command" in other.stderr
    # what was killed on the way is not finished
    (folder / "out" / "diagnosis.json").unlink()
    assert _cafim(*command, "--resume").exit_code == 0
    assert (folder / "out" / "report.json").stat().st_mtime_ns != before


@pytest.mark.parametrize("samples", [12, 13, 20])
def test_a_throw_that_is_too_short_to_be_simulated_is_a_result(samples: int, tmp_path: Path) -> None:
    """It ends within the 50 ms that a simulation starts from, or just after."""
    scene = thrown_scene(tmp_path, scenario=SCENARIO)
    (first,) = thrown(scene.physics, 3, count=1)
    short = first.window(0.0, float(first.time[samples - 1]) + 1e-9)
    verdict, outcome = examine(scene, [short])
    assert len(short) == samples and verdict.kind == "none"
    report = write_artifacts(tmp_path, verdict, outcome, [short], [], ["a command"], replay=False)
    told = "fit.train.nominal.rmse cannot be computed: there is no sample after the 50 ms" in " ".join(report["notes"])
    assert told == (samples < 14) and (report["fit"]["train"]["nominal"]["rmse"] is None) == told


def test_a_throw_keeps_its_figures_beside_one_that_is_too_short(tmp_path: Path) -> None:
    scene = thrown_scene(tmp_path, scenario=SCENARIO)
    first, second = thrown(scene.physics, 3, count=2)
    runs = [first.window(0.0, 0.045), second.window(0.0, 0.4)]
    verdict, outcome = examine(scene, runs, settings=Settings(most_effects=0))
    report = write_artifacts(tmp_path, verdict, outcome, runs, [], ["a command"], replay=False)
    assert report["fit"]["train"]["nominal"]["rmse"]["pose.body.x"] > 0.0
    assert "the simulation cannot be drawn: toss_0 is too short" in report["notes"]
