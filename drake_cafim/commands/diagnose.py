"""`cafim diagnose`: reads recordings, diagnoses them, and writes report, page, corrected scenario and replay."""

import json
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed
from tqdm import tqdm

from drake_cafim.commands.inputs import in_folder, read_all, refuse_repeats
from drake_cafim.commands.reports import read_record, read_report
from drake_cafim.diagnosis.diagnose import examine
from drake_cafim.errors import InputError
from drake_cafim.output import prepare_folder, write_text
from drake_cafim.report.artifacts import write_artifacts
from drake_cafim.scene.scene import Scene

FINISHED = "diagnosis.json"
"""Written last, with the command line: where it exists, all other files are complete."""


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
) -> dict[str, Any]:
    """The report, written into `out` with its page, the corrected scenario, and replay and MCAP files if wanted.

    With `resume`, a finished diagnosis by the same command is read from `out` instead of being repeated. Raises
    `InputError` where `out` holds one by another command, and for a scenario or recordings that cannot be used.
    """
    command = ["cafim", "diagnose", address, "--recording", *recordings]
    command += ["--held-out", *held_out] if held_out else []
    command += [f"--package={name}={place}" for name, place in (packages or {}).items()]
    if resume and _is_finished(out, command):
        return read_report(out / "report.json", str(out / "report.json"))
    scene = Scene.load(address, packages=packages)
    refuse_repeats(recordings, held_out)
    train, held = read_all(scene, recordings), read_all(scene, held_out)
    (out / FINISHED).unlink(missing_ok=True)
    verdict, outcome = examine(scene, train, held_out=held, progress=progress)
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


def diagnose_fleet(
    address: str,
    fleet: Path,
    out: Path | None,
    jobs: int,
    *,
    resume: bool,
    overwrite: bool,
    packages: Mapping[str, str] | None = None,
) -> list[dict[str, Any]]:
    """One report for each folder of recordings in `fleet`, in `out` under the folder's name."""
    folders = sorted(folder for folder in fleet.iterdir() if folder.is_dir() and in_folder(folder))
    if not folders:
        raise InputError(f"--fleet {fleet}: found no folder with recordings, expected at least one")
    target = prepare_folder(out, "diagnose", resume=resume, overwrite=overwrite)
    work = (delayed(_one_of_fleet)(address, folder, target / folder.name, packages, resume) for folder in folders)
    results = Parallel(n_jobs=jobs, return_as="generator")(work)
    return list(tqdm(results, total=len(folders), desc="diagnosing", unit="folder"))


def _one_of_fleet(
    address: str, folder: Path, out: Path, packages: Mapping[str, str] | None, resume: bool
) -> dict[str, Any]:
    out.mkdir(parents=True, exist_ok=True)
    return diagnose_command(
        address, in_folder(folder), (), out, lambda text: None, replay=False, packages=packages, resume=resume
    )
