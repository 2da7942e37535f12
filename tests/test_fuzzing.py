"""The short form of `make fuzz`, and properties that hold of any input; the long form is `tests.fuzzing.table`."""

import contextlib
import io
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from drake_cafim import recordings
from drake_cafim.cli import run_cli
from drake_cafim.errors import LONGEST, InputError, one_line
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.schema import Scenario, parse
from tests.fuzzing.campaign import Tally, try_cases
from tests.fuzzing.commands import CommandCases
from tests.fuzzing.diagnoses import DiagnosisCases
from tests.fuzzing.models import ModelCases
from tests.fuzzing.recordings import RecordingCases
from tests.fuzzing.scenarios import ScenarioCases
from tests.fuzzing.table import table
from tests.fuzzing.verdict import judge

CASES = {"recordings": (RecordingCases, 400), "models": (ModelCases, 60)}
CASES |= {"scenarios": (ScenarioCases, 150), "diagnoses": (DiagnosisCases, 10), "command lines": (CommandCases, 25)}
SHORT = settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
NUMBERS = st.floats(allow_nan=False, allow_infinity=False, width=64)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8) | st.integers(), inner, max_size=3),
    max_leaves=12,
)


@pytest.mark.parametrize("name", CASES)
def test_hostile_inputs_end_in_a_result_or_a_sentence(name: str) -> None:
    make, count = CASES[name]
    tally = Tally()
    try_cases(make(), tally, count, time.monotonic() + 8.0, lambda: None, batch=25)
    assert tally.done > 0 and not tally.faults, table({name: tally})
    assert tally.counts["refused"] > 0 or tally.done < 20  # a busy machine


def test_a_fault_is_seen(tmp_path: Path) -> None:
    class Faulty:
        def run(self, number: int, folder: Path) -> str:
            def act() -> None:
                if number == 1:
                    raise KeyError("defect")
                if number == 2:
                    raise InputError("no name")
                if number == 3:
                    os.kill(os.getpid(), signal.SIGKILL)
                raise InputError("a.csv: it is empty")

            return judge(act, ["a.csv"])

    tally = Tally()
    try_cases(Faulty(), tally, 5, time.monotonic() + 60.0, lambda: None)
    assert tally.done == 5 and sorted(tally.faults.values()) == [1, 2, 3] and tally.counts["refused"] == 2
    assert "crash: SIGKILL" in tally.faults


@SHORT
@given(st.text(max_size=3000))
def test_every_message_is_one_short_line(text: str) -> None:
    said = str(InputError(text))
    assert len(said) <= LONGEST and one_line(said) == said
    said.encode()  # no half of a surrogate pair, which a terminal cannot show
    assert len(said.splitlines()) <= 1


@SHORT
@given(
    steps=st.lists(st.floats(1e-6, 1e3), min_size=1, max_size=30),
    columns=st.dictionaries(st.sampled_from(["q.a", "u.a", "other", "pose.b.qw"]), NUMBERS, min_size=1),
    suffix=st.sampled_from(["csv", "parquet"]),
    seed=st.integers(0, 99),
)
def test_what_is_written_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, steps: list[float], columns: dict[str, float], suffix: str, seed: int
) -> None:
    time = np.cumsum(steps)
    if np.any(np.diff(time) <= 0.0):
        return
    hole = np.random.default_rng(seed).random(time.size) < 0.2
    arrays = {name: np.where(hole, np.nan, value + np.arange(time.size)) for name, value in columns.items()}
    path = tmp_path_factory.getbasetemp() / f"read_back.{suffix}"
    recordings.write(Recording("a", time, arrays), path)
    read = recordings.read(path)
    assert np.array_equal(read.time, time) and list(read.columns) == list(arrays)
    for name, values in arrays.items():
        assert np.array_equal(read.columns[name], values, equal_nan=True)


@SHORT
@given(st.dictionaries(st.sampled_from([*Scenario.__dataclass_fields__, "other"]), VALUES, max_size=4))
def test_any_mapping_is_a_scenario_or_one_sentence(raw: dict[str, Any]) -> None:
    try:
        assert isinstance(parse(raw, "robot.yaml"), Scenario)
    except InputError as error:
        assert "robot.yaml" in str(error)


@SHORT
@given(
    st.lists(
        st.sampled_from(["why", "import", "--out", "--json", "--period", "--seed"]) | st.text(max_size=12), max_size=5
    )
)
def test_any_arguments_are_answered(tmp_path_factory: pytest.TempPathFactory, arguments: list[str]) -> None:
    out, err = io.StringIO(), io.StringIO()
    with (
        contextlib.chdir(tmp_path_factory.mktemp("arguments")),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        patch.object(sys, "argv", ["cafim", *arguments]),
        pytest.raises(SystemExit) as ended,
    ):
        run_cli()
    assert ended.value.code in (0, 2)
    if arguments and ended.value.code == 2:
        assert len(err.getvalue().splitlines()) == 1 and len(err.getvalue()) <= 500
