"""The table of faults finds what is not whole, not the same, or told in other words."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from tests.faults import trials
from tests.faults.commands import IMPORT, Subject
from tests.parametrize import long_after


def _instead(work: Callable[[Path], None]) -> Subject:
    """The subject import, which does other work."""

    def carry_out(files: object, out: Path, **options: object) -> list[object]:
        work(out)
        return []

    return replace(
        IMPORT, before=lambda: patch("drake_cafim.commands.importing.import_command", carry_out).start(), once="*.json"
    )


def _write_slowly(out: Path) -> None:
    with (out / "a.json").open("w") as file:
        file.write("{")
        file.flush()
        time.sleep(0.5)
        file.write("}")


def _write_once(out: Path) -> None:
    """As a command that takes a part for the whole."""
    if not list(out.iterdir()):
        (out / "a.json").write_text("{}")
        time.sleep(0.5)
        (out / "b.json").write_text("{}")


def _stay_silent(out: Path) -> None:
    (out / "a.json").write_text("{}")
    try:
        time.sleep(0.5)
    except KeyboardInterrupt:
        raise SystemExit(1) from None


@pytest.mark.parametrize(
    ("kind", "work", "attempt"),
    long_after(
        1,
        [
            ("lost", _write_once, trials.kill),
            ("half", _write_slowly, trials.kill),
            ("words", _stay_silent, trials.interrupt),
        ],
    ),
)
def test_half_files_lost_ones_and_other_words_are_found(
    kind: str, work: Callable[[Path], None], attempt: Callable[..., trials.Trial], tmp_path: Path
) -> None:
    bench = trials.Bench.of(_instead(work), tmp_path)
    tried = [attempt(bench, number, np.random.default_rng(number)) for number in range(4)]
    assert sum(trial.faults for trial in tried) >= 4
    assert any(getattr(trial, kind) for trial in tried)


def test_a_command_whose_results_differ_from_time_to_time_is_no_subject(tmp_path: Path) -> None:
    subject = _instead(lambda out: (out / "a.json").write_text(f"{time.monotonic()}") and None)
    with pytest.raises(RuntimeError, match="two undisturbed runs differ"):
        trials.Bench.of(subject, tmp_path)
