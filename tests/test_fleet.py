"""Fleets: the layout of a folder, strengths over time, what changed, shares, and bad folders."""

import json
from contextlib import chdir
from datetime import UTC, datetime
from pathlib import Path
from shutil import copytree

import numpy as np
import pandas as pd
import pytest
import yaml
from click.testing import CliRunner

from drake_cafim.cli import main
from drake_cafim.errors import InputError
from drake_cafim.fleet.findings import findings_of
from drake_cafim.fleet.layout import folders_of, share, time_in, time_of_stamps
from drake_cafim.fleet.summary import Named, Summary, effects_to_follow
from drake_cafim.fleet.table import SCHEMA, Row, read_table
from drake_cafim.fleet.trend import Series, trend_of
from tests.concealed.urdf import arm_urdf
from tests.fleets.simulated import Condition, kinds, recorded, scenario

WEEKS = 7.0 * np.arange(10)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("2026-W12", datetime(2026, 3, 16, tzinfo=UTC)),
        ("arm_2026W127", datetime(2026, 3, 22, tzinfo=UTC)),
        ("2026-03-16", datetime(2026, 3, 16, tzinfo=UTC)),
        ("run_20260316T091500.parquet", datetime(2026, 3, 16, 9, 15, tzinfo=UTC)),
        ("2026-03-16_09-15-30.mcap", datetime(2026, 3, 16, 9, 15, 30, tzinfo=UTC)),
        ("rosbag2_2026_03_16-09_15_30", None),
        ("run_12345678", None),
        ("2026-13-40", None),
        ("week_12", None),
    ],
)
def test_names_tell_the_time(text: str, expected: datetime | None) -> None:
    assert time_in(text) == expected


def test_stamps_since_1970_tell_the_time() -> None:
    assert time_of_stamps(1773648000.0) == datetime(2026, 3, 16, 8, 0, tzinfo=UTC)
    assert time_of_stamps(12.5) is None


@pytest.mark.parametrize(
    ("courses", "values", "onset"),
    [
        (("step",), np.where(WEEKS > 38.0, 0.1, 0.0), 38.5),
        (("ramp",), 0.02 * np.maximum(WEEKS - 28.0, 0.0) / 7.0, 28.0),
        (("line", "ramp"), 0.01 * WEEKS / 7.0, 0.0),
    ],
)
def test_a_course_is_told_with_its_start(courses: tuple[str, ...], values: np.ndarray, onset: float) -> None:
    rng = np.random.default_rng(3)
    trend = trend_of(Series(WEEKS, values + rng.normal(0.0, 0.003, 10), np.full(10, 0.003)), 60)
    assert trend.p_value < 1e-3 and trend.course in courses
    assert trend.onset is not None and trend.since is not None and abs(trend.onset - onset) <= 7.0
    assert trend.since[0] <= onset <= trend.since[1]
    if courses == ("ramp",):
        assert trend.slope is not None and abs(7.0 * trend.slope[0] - 0.02) < 7.0 * trend.slope[1]


def test_scatter_that_the_stds_do_not_tell_is_no_change() -> None:
    rng = np.random.default_rng(4)
    constant = [Series(WEEKS, rng.normal(0.3, 0.01, 10), np.full(10, 0.003)) for _ in range(100)]
    assert min(trend_of(series, 100).p_value for series in constant) > 0.01


def rows(robot: str, values: np.ndarray, std: float = 0.01, named: float | None = None) -> list[Row]:
    blank: Row = dict.fromkeys(SCHEMA.names)
    return [
        blank
        | {
            "robot": robot, "recording": f"{k}/a.csv", "folder": f"{robot}/{k}", "kind": "arm 1", "verdict": "none",
            "time": datetime.fromtimestamp(86400.0 * (20000.0 + day), tz=UTC), "effect": "joint_viscous_friction",
            "place": "elbow", "parameter": "coefficient", "unit": "N m s/rad", "strength": float(value), "std": std,
            "probability": named,
        }
        for k, (day, value) in enumerate(zip(WEEKS, values, strict=True))
    ]  # fmt: skip


def test_a_robot_unlike_its_sisters_stands_out_and_what_all_have_does_not() -> None:
    rng = np.random.default_rng(5)
    alike = [rows(f"r{k}", 0.3 + rng.normal(0.0, 0.01, 10), named=1.0) for k in range(6)]
    odd = rows("odd", 0.5 + rng.normal(0.0, 0.01, 10), named=1.0)
    found = findings_of([row for group in (*alike, odd) for row in group])
    assert found.accused == ["odd"] and not found.changed
    assert {item.robot for item in found.constant} == {f"r{k}" for k in range(6)}
    assert not found.seen_once


def test_a_false_alarm_is_listed_apart() -> None:
    rng = np.random.default_rng(6)
    own = [rows(f"r{k}", rng.normal(0.0, 0.01, 10)) for k in range(4)]
    own[0][3]["probability"] = 0.8
    found = findings_of([row for group in own for row in group])
    assert found.accused == [] and found.seen_once == (("r0", "joint_viscous_friction", "elbow", "r0/3"),)


def test_effects_are_followed_in_the_sisters_of_a_robot_that_names_them_twice() -> None:
    def summary(folder: str, *named: str) -> Summary:
        return Summary(folder, "explained", "arm 1", tuple(Named(name, "elbow", 1.0, {}) for name in named))

    coulomb, viscous, spring = "joint_coulomb_friction", "joint_viscous_friction", "joint_spring"
    summaries = [summary("a/1", viscous), summary("a/2", viscous, spring), summary("b/1", coulomb), summary("c/1")]
    robots = {item.folder: item.folder[0] for item in summaries}
    followed = effects_to_follow(summaries, robots, {coulomb: "dry", viscous: None, spring: None})
    assert {name: {item.effect for item in effects} for name, effects in followed.items()} == {
        "a": {viscous, spring},
        "b": {viscous, coulomb},
        "c": {viscous},
    }


def small_fleet(folder: Path, robots: str, weeks: int) -> Path:
    """Arms of one kind: the second one's elbow is worn in the second half of the weeks; one of the last's is text."""
    folder.mkdir()
    rng = np.random.default_rng(2)
    kind = kinds(rng, 1)[0]
    (folder / f"{kind.name}.urdf").write_text(arm_urdf(kind.nominal))
    (folder / "scenario.yaml").write_text(yaml.safe_dump(scenario(kind)))
    for robot in robots:
        for week in range(weeks):
            damping = np.array([0.0, 0.2 if robot == "b" and 2 * week >= weeks else 0.0])
            place = folder / robot / f"2026-W{10 + week}"
            place.mkdir(parents=True)
            recorded(rng, kind, kind.nominal, Condition(damping, np.ones(2)), 1.6).to_parquet(place / "run.parquet")
    (folder / robots[-1] / "2026-W11" / "run.parquet").write_text("no table")
    return folder


def diagnosed(fleet: Path, out: Path, *more: str) -> dict[str, object]:
    line = ["diagnose", "--fleet", str(fleet), "--out", str(out), "--json", "--jobs", "1", *more]
    result = CliRunner().invoke(main, line)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def test_a_fleet_is_told_folder_by_folder(tmp_path: Path) -> None:
    fleet = small_fleet(tmp_path / "fleet", "ba", 2)
    told = diagnosed(fleet, tmp_path / "out")
    assert [item["folder"] for item in told["failed"]] == ["a/2026-W11"]
    named = [row for row in read_table(tmp_path / "out" / "fleet.parquet") if row["effect"] is not None]
    assert {(row["robot"], row["recording"], row["effect"]) for row in named if row["probability"]} == {
        ("b", "2026-W11/run.parquet", "joint_viscous_friction")
    }
    assert "joint viscous friction" in (tmp_path / "out" / "fleet.html").read_text()


@pytest.mark.long
def test_a_fleet_in_one_run_and_in_shares_gives_the_same_table(tmp_path: Path) -> None:
    fleet = small_fleet(tmp_path / "fleet", "abc", 6)
    told = diagnosed(fleet, tmp_path / "whole")
    assert told["accused"] == ["b"]
    assert [(item["effect"], item["course"]) for item in told["changed"]] == [("joint_viscous_friction", "step")]
    assert [item["folder"] for item in told["failed"]] == ["c/2026-W11"]
    table = read_table(tmp_path / "whole" / "fleet.parquet")
    assert len({(row["robot"], row["recording"]) for row in table}) == 18
    page = (tmp_path / "whole" / "fleet.html").read_text()
    assert "joint viscous friction" in page and "c/2026-W11" in page
    for number in (1, 2, 3):
        diagnosed(fleet, tmp_path / "shares", "--shard", f"{number}/3")
    before = {p: p.stat().st_mtime_ns for p in (tmp_path / "shares").rglob("report.json")}
    assert diagnosed(fleet, tmp_path / "shares", "--resume") == told
    assert before == {p: p.stat().st_mtime_ns for p in (tmp_path / "shares").rglob("report.json")}
    assert (tmp_path / "shares" / "fleet.parquet").read_bytes() == (tmp_path / "whole" / "fleet.parquet").read_bytes()
    assert (tmp_path / "shares" / "fleet.html").read_bytes() == (tmp_path / "whole" / "fleet.html").read_bytes()


def test_scenarios_and_held_out_recordings_are_found_by_name(tmp_path: Path) -> None:
    for name in ("scenario.yaml", "b/scenario.yaml", "a/2026-W10/run.csv", "a/2026-W10/held.csv", "b/2026-W10/run.csv"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x")
    for name in ("out/fleet.json", "out/fleet.parquet", "out/a/2026-W10/1_run.residuals.mcap"):  # --out below the fleet
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("{}")
    first, second = folders_of(tmp_path, None, ["held*"])
    assert (first.robot, first.recordings, first.held_out) == ("a", ("run.csv",), ("held.csv",))
    assert [Path(item.scenario).parent.name for item in (first, second)] == [tmp_path.name, "b"]
    shares = [share([first, second], k, 3) for k in (1, 2, 3)]
    assert sorted(item.name for part in shares for item in part) == ["a/2026-W10", "b/2026-W10"]
    with pytest.raises(InputError, match="has such a name"):
        folders_of(tmp_path, None, ["hold*"])


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--shard", "3/2"], "--shard 3/2: expected i/N"),
        (["--shard", "1/2"], "--out DIR"),
        (["--recording", "a.csv"], "expected one of them"),
        ([], "no scenario.yaml above a/2026-W10"),
        (["--scheduler", "tcp://127.0.0.1:1"], "no scenario.yaml above a/2026-W10"),
    ],
)
def test_what_cannot_be_a_fleet_is_said(more: list[str], words: str, tmp_path: Path) -> None:
    (tmp_path / "fleet" / "a" / "2026-W10").mkdir(parents=True)
    pd.DataFrame({"time": [0.0]}).to_csv(tmp_path / "fleet" / "a" / "2026-W10" / "run.csv")
    with chdir(tmp_path):
        result = CliRunner().invoke(main, ["diagnose", "--fleet", str(tmp_path / "fleet"), *more])
    assert result.exit_code == 2 and words in result.output.replace("\n", " "), result.output


def test_a_cluster_is_for_fleets_and_studies(tmp_path: Path) -> None:
    for command in (["run", "hefting"], ["diagnose", "x.yaml", "--recording", "a.csv"]):
        result = CliRunner().invoke(main, [*command, "--scheduler", "tcp://127.0.0.1:1"])
        assert result.exit_code == 2 and "--scheduler" in result.output


def test_a_fleet_without_recordings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="found no folder with recordings"):
        folders_of(copytree(tmp_path, tmp_path.parent / f"{tmp_path.name}-copy"), None, [])
