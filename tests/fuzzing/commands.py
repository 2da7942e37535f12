"""Hostile command lines: every command with odd options, files of the wrong kind, and damaged reports."""

import contextlib
import io
import json
import sys
import tempfile
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from drake_cafim import recordings
from drake_cafim.cli import run_cli
from drake_cafim.recordings.recording import Recording
from tests.fuzzing.models import PLAIN_URDF
from tests.fuzzing.mutate import damage_bytes, damage_tree
from tests.fuzzing.verdict import REFUSED, RESULT, judge, judge_message

COMMANDS = ("run", "diagnose", "discriminate", "why", "estimate", "study", "import", "replay", "export", "nonsense", "")
OPTIONS = ("--out", "--seed", "--json", "--jobs", "--resume", "--overwrite", "--recording", "--held-out", "--no-replay")
OPTIONS += (
    "--experiments",
    "--period",
    "--prior-scale",
    "--conceal",
    "--between",
    "--duration",
    "--report",
    "--package",
)
OPTIONS += (
    "--scenario",
    "--policy",
    "--planner",
    "--criterion",
    "--fleet",
    "--world",
    "--until-std",
    "--nonsense",
    "-x",
)
WORDS = (
    "arm.urdf",
    "arm.yaml",
    "a.csv",
    "a.parquet",
    "report.json",
    "bad.csv",
    "bad.yaml",
    "bad.json",
    ".",
    "nowhere",
    "",
)
WORDS += (
    "-1",
    "0",
    "1",
    "1e-12",
    "nan",
    "1e400",
    "9" * 30,
    "x" * 5000,
    "x\ny",
    "é",
    "NAME=.",
    "joint_spring@elbow",
    "a=b",
)
WORDS += (
    "hefting",
    "claims",
    "out",
    "/dev/null",
    "/proc/self/mem",
    "/nowhere/x",
    "--",
    "\udcff",
    "joint_spring@shoulder",
)
REPORT: dict[str, Any] = {
    "schema": "drake_cafim.report/1",
    "verdict": "explained",
    "sentence": "A spring.",
    "mismatch": {"detected": True, "p_value": 0.0, "locations": [{"kind": "joint", "name": "shoulder", "share": 0.9}]},
    "explanation": [
        {"effect": "joint_spring", "at": "shoulder", "probability": 1.0}
        | {"parameters": {"stiffness": {"value": 1.0, "std": 0.1}, "rest": {"value": 0.1, "std": 0.1}}}
    ],
    "rivals": [{"effect": "payload", "at": "upper", "probability": 0.01, "why_alike": "x"}],
    "parameters": [{"parameter": "mass", "at": "upper", "value": 1.2, "std": 0.1, "unit": "kg"}],
    "noise": {"q.shoulder": {"std": 1e-4, "unit": "rad", "correlation_time": 0.0, "stated": True}},
    "trace": [
        {"step": "admit", "asked": "joint_spring@shoulder", "statistic": 9.0, "threshold": 4.0, "passed": True}
        | {"words": "x", "others": []},
        {"step": "verdict", "asked": "x", "statistic": None, "threshold": None, "passed": True, "words": "x"},
    ],
    "files": {"corrected_scenario": "arm.yaml"},
}
SCENARIO = """model: arm.urdf
lock: [elbow]
channels: {q: {std: 1.0e-4}, v: {std: 1.0e-3}, u: {std: 0.0}}
unknown: [{parameter: mass, body: upper, mean: 1.2, std: 0.1}]
"""


class CommandCases:
    """Command lines; each is a number, and the same number is the same line in a folder of the same files."""

    def run(self, number: int, folder: Path) -> str:
        """What becomes of command line `number`, run in `folder`."""
        rng = np.random.default_rng(number)
        _fill(folder, rng)
        arguments = _arguments(rng)
        (folder / "arguments.json").write_text(json.dumps(arguments))
        out, err = io.StringIO(), io.StringIO()
        status: list[Any] = []

        def call() -> None:
            try:
                run_cli()
            except SystemExit as end:
                status.append(end.code)

        with (
            contextlib.chdir(folder),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            patch.object(sys, "argv", ["cafim", *arguments]),
        ):
            verdict = judge(call, [])
        if verdict != RESULT:
            return verdict
        if status and status[0] == 2:
            said = [line for line in err.getvalue().splitlines() if not line.endswith(" ...")]
            if len(said) > 1 and said[0].startswith("Usage: "):  # the help of a bare `cafim`
                return RESULT
            return judge_message("\n".join(said), ["cafim: "]) if said else "status 2 without a word"
        if status and status[0] not in (0, None):
            return f"status {status[0]}: {err.getvalue()[-80:]}"
        return REFUSED if "Traceback" in err.getvalue() else RESULT


def compile_once() -> None:
    """Estimate once, so that no input is blamed for the seconds in which what it calls is compiled."""
    with (
        tempfile.TemporaryDirectory() as folder,
        contextlib.chdir(folder),
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()),
        contextlib.suppress(SystemExit),
        patch.object(sys, "argv", ["cafim", "estimate", "arm.yaml", "a.csv"]),
    ):
        _fill(Path(folder), np.random.default_rng(0))
        run_cli()


def _arguments(rng: np.random.Generator) -> list[str]:
    def word() -> str:
        return WORDS[int(rng.integers(len(WORDS)))]

    def likely() -> list[str]:
        """A line that gets past the options, so that what it names is read."""
        scenario = str(rng.choice(["arm.yaml", "arm.urdf", "bad.yaml"], p=[0.6, 0.1, 0.3]))
        recording, report = str(rng.choice(["a.csv", "bad.csv"])), str(rng.choice(["report.json", "bad.json"]))
        effect = str(rng.choice(["joint_spring@shoulder", "payload@upper", "x@y"]))
        lines = [
            ["import", recording, "--period", word()],
            ["why", report, effect],
            ["why", report],
            ["replay", scenario, recording, "--report", report, "--out", "x.mcap"],
            ["discriminate", scenario, report, "--duration", word(), "--no-replay"],
            ["estimate", scenario, recording],
            ["export", scenario, "--to", str(rng.choice(["urdf", "sdf", "mjcf", word()])), "--out", "x"],
            ["diagnose", scenario, "--fleet", ".", "--held-out", word(), "--jobs", "1", "--shard", "1/1", "--out", "x"],
            [
                "diagnose",
                scenario,
                "--recording",
                recording,
                "--no-replay",
                *(["--held-out", "a.csv"] * int(rng.integers(2))),
            ],
            ["run", word(), "--experiments", "1", "--conceal", effect, word()],
        ]
        return lines[int(rng.integers(len(lines)))]

    if rng.random() < 0.5:
        return likely()
    arguments = [COMMANDS[int(rng.integers(len(COMMANDS)))]] if rng.random() < 0.95 else []
    for _ in range(int(rng.integers(0, 6))):
        if rng.random() < 0.5:
            arguments.append(OPTIONS[int(rng.integers(len(OPTIONS)))])
        arguments.append(word())
    if arguments[:1] == ["study"] or (arguments[:1] == ["run"] and "hefting" in arguments):
        arguments.append("--nonsense")  # what would take hours is only parsed
    return arguments


def _fill(folder: Path, rng: np.random.Generator) -> None:
    (folder / "arm.urdf").write_text(PLAIN_URDF)
    (folder / "arm.yaml").write_text(SCENARIO)
    (folder / "bad.yaml").write_bytes(damage_bytes(SCENARIO.encode(), rng))
    time = 0.01 * np.arange(60)
    columns = {"q.shoulder": 0.3 * np.sin(5 * time), "v.shoulder": 1.5 * np.cos(5 * time), "u.shoulder": np.sin(time)}
    recordings.write(Recording("a", time, columns), folder / "a.csv")
    (folder / "bad.csv").write_bytes(damage_bytes((folder / "a.csv").read_bytes(), rng))
    (folder / "report.json").write_text(json.dumps(REPORT))
    (folder / "bad.json").write_text(json.dumps(damage_tree(REPORT, rng), default=str, skipkeys=True))
