"""`cafim diagnose`: reads recordings, diagnoses them, and writes report, page, corrected scenario and replay."""

import json
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from drake_cafim.commands.inputs import read_all, refuse_repeats
from drake_cafim.commands.reports import read_record, read_report
from drake_cafim.diagnosis.diagnose import examine
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.errors import InputError
from drake_cafim.output import write_text
from drake_cafim.report.artifacts import write_artifacts
from drake_cafim.scene.scene import Scene

FINISHED = "diagnosis.json"
"""Written last, with the command line: where it exists, all other files are complete."""


@dataclass(frozen=True)
class Levels:
    """The options of the command that are levels of tests; None for the usual one. Checked as soon as they are given.

    Raises `InputError` for one that is not between 0 and 1.
    """

    false_alarm_rate: float | None = None
    adequacy_level: float | None = None

    def __post_init__(self) -> None:
        self.settings()

    @property
    def given(self) -> dict[str, float]:
        """Those that are not the usual ones, by name."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    @property
    def words(self) -> list[str]:
        """Those that are not the usual ones, as on the command line."""
        return [f"--{name.replace('_', '-')}={value:g}" for name, value in self.given.items()]

    def settings(self) -> Settings:
        """The options of the search with these levels."""
        return Settings(**self.given)  # type: ignore[arg-type]


USUAL = Levels()


def diagnose_command(
    address: str,
    recordings: Sequence[str],
    held_out: Sequence[str],
    out: Path,
    progress: Callable[[str], None],
    *,
    replay: bool = True,
    mcap: bool = False,
    packages: Mapping[str, str] | None = None,
    resume: bool = False,
    levels: Levels = USUAL,
) -> dict[str, Any]:
    """The report, written into `out` with its page, the corrected scenario, and replay and MCAP files if wanted.

    With `resume`, a finished diagnosis by the same command is read from `out` instead of being repeated. Raises
    `InputError` where `out` holds one by another command, and for a scenario or recordings that cannot be used.
    """
    command = ["cafim", "diagnose", address, "--recording", *recordings]
    command += ["--held-out", *held_out] if held_out else []
    command += [f"--package={name}={place}" for name, place in (packages or {}).items()]
    command += levels.words
    if resume and _is_finished(out, command):
        return read_report(out / "report.json", str(out / "report.json"))
    scene = Scene.load(address, packages=packages)
    refuse_repeats(recordings, held_out)
    train, held = read_all(scene, recordings), read_all(scene, held_out)
    (out / FINISHED).unlink(missing_ok=True)
    verdict, outcome = examine(scene, train, held_out=held, settings=levels.settings(), progress=progress)
    report = write_artifacts(out, verdict, outcome, train, held, command, replay=replay, mcap=mcap, progress=progress)
    write_text(out / FINISHED, json.dumps({"command": command}, indent=1) + "\n")
    return report


def _is_finished(out: Path, command: Sequence[str]) -> bool:
    """Whether `out` holds a finished diagnosis. Raises `InputError` where another command than `command` made it."""
    if not ((out / FINISHED).is_file() and (out / "report.json").is_file()):
        return False
    record = read_record(out / FINISHED, "what an earlier diagnosis left; give --overwrite")
    made_by = record.get("command")
    if not isinstance(made_by, list) or made_by != list(command):
        made_by = [str(word) for word in made_by] if isinstance(made_by, list) else ["?"]
        raise InputError(
            f"--out {out}: it holds the results of `{shlex.join(made_by)}`, expected the same command with --resume; "
            "give --overwrite, or another folder"
        )
    return True
