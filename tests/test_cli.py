"""The command line from outside: exit status, messages, files."""

import io
import json
import math
import subprocess
import sys
from collections.abc import Callable
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from shutil import copytree
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from click.testing import CliRunner

from drake_cafim import recordings
from drake_cafim.cli import main, run_cli
from drake_cafim.recordings.recording import Recording
from tests.concealed.make import simulate

PENDULUM = """<robot name="pendulum">
  <link name="base"/>
  <link name="rod"><inertial><origin xyz="0 0 -0.5"/><mass value="1.0"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="pivot" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="20" velocity="20"/></joint>
</robot>"""
SCENARIO = """model: pendulum.urdf
weld: [{body: base}]
channels: {q: {std: 2.0e-4}, v: {std: 2.0e-3}, u: {std: 0.0}}
unknown: [{parameter: mass, body: rod, mean: 1.0, std: 0.1}]
"""


def pendulum_recording(name: str, *, damping: float, seed: int) -> Recording:
    """A driven pendulum, integrated far finer than it is sampled, with noise of the scenario's size."""
    rng = np.random.default_rng(seed)
    time = 0.004 * np.arange(1000)
    u = 3.0 * np.sin(2.0 * np.pi * (0.6 + 0.2 * seed) * time) + 2.0 * np.sin(2.0 * np.pi * 1.7 * time + seed)
    inertia, weight = 0.02 + 0.25, 0.5 * 9.81

    def acceleration(q: float, v: float, effort: float) -> float:
        return float((effort - weight * math.sin(q) - damping * v) / inertia)

    q, v, h = np.zeros(1000), np.zeros(1000), 0.0004
    for k in range(999):
        x, w = float(q[k]), float(v[k])
        for _ in range(10):
            middle_x, middle_w = x + 0.5 * h * w, w + 0.5 * h * acceleration(x, w, u[k])
            x, w = x + h * middle_w, w + h * acceleration(middle_x, middle_w, u[k])
        q[k + 1], v[k + 1] = x, w
    columns = {"q.pivot": q + rng.normal(0, 2e-4, 1000), "v.pivot": v + rng.normal(0, 2e-3, 1000), "u.pivot": u}
    return Recording(name, time, columns)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("files")
    (folder / "pendulum.urdf").write_text(PENDULUM)
    (folder / "scenario.yaml").write_text(SCENARIO)
    for seed in (1, 2):
        recordings.write(pendulum_recording("a", damping=0.15, seed=seed), folder / f"damped_{seed}.parquet")
        recordings.write(pendulum_recording("a", damping=0.0, seed=seed), folder / f"free_{seed}.parquet")
    return folder


@pytest.fixture
def folder(files: Path, tmp_path: Path) -> Path:
    return copytree(files, tmp_path, dirs_exist_ok=True)


def cafim(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """The command in this process, which has everything imported."""
    out, err = io.StringIO(), io.StringIO()
    with (
        chdir(folder),
        redirect_stdout(out),
        redirect_stderr(err),
        patch.object(sys, "argv", ["cafim", *arguments]),
        pytest.raises(SystemExit) as ended,
    ):
        run_cli()
    return subprocess.CompletedProcess(sys.argv, int(ended.value.code or 0), out.getvalue(), err.getvalue())


def cafim_process(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own."""
    command = [sys.executable, "-m", "drake_cafim", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def test_diagnose_names_the_friction_and_the_gain_is_held_out(folder: Path) -> None:
    done = cafim(
        "diagnose",
        "scenario.yaml",
        "--recording",
        "damped_1.parquet",
        "--held-out",
        "damped_2.parquet",
        "--mcap",
        "--out",
        "out",
        folder=folder,
    )
    assert done.returncode == 0, done.stderr
    assert "residual_corrected_q.pivot" in recordings.read(folder / "out" / "1_damped_1.residuals.mcap").columns
    report = json.loads((folder / "out" / "report.json").read_text())
    assert report["verdict"] == "explained"
    (explanation,) = report["explanation"]
    assert (explanation["effect"], explanation["at"]) == ("joint_viscous_friction", "pivot")
    found = explanation["parameters"]["coefficient"]
    assert abs(found["value"] - 0.15) < 4.0 * found["std"] and found["unit"] == "N m s/rad"
    held = report["fit"]["held_out"]
    assert held["corrected"]["nll"] < held["nominal"]["nll"]
    assert held["corrected"]["rmse"]["q.pivot"] < 0.2 * held["nominal"]["rmse"]["q.pivot"]
    assert report["mismatch"]["locations"][0]["name"] == "pivot"
    again = cafim("diagnose", "out/scenario.corrected.yaml", "--recording", "damped_2.parquet", "--json", folder=folder)
    assert json.loads(again.stdout)["verdict"] == "none"


@pytest.mark.long
def test_nothing_is_named_where_nothing_is_missing_and_bytes_repeat(folder: Path) -> None:
    run: Callable[..., Any]
    for out, run in (("one", cafim), ("two", cafim_process)):
        done = run(
            "diagnose", "scenario.yaml", "--recording", "free_1.parquet", "free_2.parquet", "--out", out, folder=folder
        )
        assert done.returncode == 0, done.stderr
    report = json.loads((folder / "one" / "report.json").read_text())
    assert report["verdict"] == "none" and report["explanation"] == []
    assert (folder / "one" / "report.json").read_bytes() == (folder / "two" / "report.json").read_bytes()


def test_estimate_gives_the_mass_and_no_verdict(folder: Path) -> None:
    done = cafim("estimate", "scenario.yaml", "free_1.parquet", "--json", folder=folder)
    report = json.loads(done.stdout)
    (mass,) = report["parameters"]
    assert report["verdict"] is None and abs(mass["value"] - 1.0) < 4.0 * mass["std"] < 0.01


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("diagnose", "nowhere.yaml", "--recording", "free_1.parquet"), "nowhere.yaml: there is no such file"),
        (("diagnose", "scenario.yaml", "--recording", "absent.parquet"), "absent.parquet"),
        (("diagnose", "scenario.yaml", "--recording", "nan.csv"), "nan.csv"),
        (("diagnose", "scenario.yaml", "--recording", "short.csv"), "u.pivot"),
        (("diagnose", "scenario.yaml", "--recording", "free_1.parquet", "--out", "."), "the folder is not empty"),
        (("diagnose", "broken.yaml", "--recording", "free_1.parquet"), "chanels"),
        (("diagnose", "pendulum.urdf", "--recording", "free_1.parquet"), "`weld: [{body: base}]` of a scenario"),
    ],
)
def test_unusable_input_is_one_sentence_and_status_two(folder: Path, arguments: tuple[str, ...], said: str) -> None:
    (folder / "nan.csv").write_text("time,q.pivot,v.pivot,u.pivot\n0,0,0,0\nnan,0,0,0\n")
    (folder / "short.csv").write_text("time,q.pivot,v.pivot\n" + "".join(f"{k / 10},{k},\n" for k in range(10)))
    (folder / "broken.yaml").write_text(SCENARIO.replace("channels", "chanels"))
    # one of them as from a shell
    run: Callable[..., Any] = cafim_process if "nowhere.yaml" in arguments else cafim
    done = run(*arguments, folder=folder)
    assert done.returncode == 2
    assert said in done.stderr.strip().splitlines()[-1] and "Traceback" not in done.stderr
    assert not list(folder.glob("cafim-out/*"))


@pytest.mark.long
def test_one_process_and_two_write_the_same_report(tmp_path: Path) -> None:
    """Of an arm that lacks two effects, of which others are fitted in the place."""
    simulate("pair", "arm2", 5).write(tmp_path)
    written = []
    for jobs in ("1", "2"):
        line = ["diagnose", str(tmp_path / "scenario.yaml")]
        for file in sorted(tmp_path.glob("train_*")):
            line += ["--recording", str(file)]
        result = CliRunner().invoke(main, [*line, "--out", str(tmp_path / jobs), "--jobs", jobs])
        assert result.exit_code == 0, result.output
        written.append((tmp_path / jobs / "report.json").read_bytes())
    assert written[0] == written[1]
