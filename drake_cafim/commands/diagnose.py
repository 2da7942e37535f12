"""`cafim diagnose`: reads recordings, diagnoses them, and writes report, page, corrected scenario and replay."""

import json
import os
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

from drake_cafim.commands.cuts import CutOptions, CutWork, named_by_cuts
from drake_cafim.commands.inputs import refuse_repeats
from drake_cafim.commands.levels import USUAL, Levels
from drake_cafim.commands.long_inputs import LongInputs, open_inputs
from drake_cafim.commands.reports import read_record, read_report
from drake_cafim.diagnosis.diagnose import examine
from drake_cafim.diagnosis.long.budget import DEFAULT_MEMORY, GIB
from drake_cafim.diagnosis.long.examine import examine_parts
from drake_cafim.diagnosis.search.cuts import with_cuts
from drake_cafim.errors import InputError
from drake_cafim.kept import NOTHING_KEPT, Kept
from drake_cafim.output import write_text
from drake_cafim.report.artifacts import write_artifacts
from drake_cafim.scene.scene import Scene

FINISHED = "diagnosis.json"
"""Written last, with the command line: where it exists, all other files are complete."""

HERE = Path()
"""The working folder."""
KEPT = "parts"
"""Folder of what a diagnosis in parts has finished, until all of it is."""
UNCUT = "recordings that are diagnosed in parts are not cut in other ways: --cuts has no effect"
"""The note on cuts of long recordings."""


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
    cuts: CutOptions | None = None,
    memory: float = DEFAULT_MEMORY,
    jobs: int = 1,
    base: Path = HERE,
) -> dict[str, Any]:
    """The report, written into `out` with its page, the corrected scenario, and replay and MCAP files if wanted.

    Recordings and the command line that is kept are as from the folder `base`, by default the working folder.
    Recordings that take more than `memory` bytes to diagnose at once are diagnosed in parts, see `diagnosis.long`.
    `jobs` processes look at parts, compare laws and simulate.

    With `cuts` the recordings are also cut and each cut is diagnosed, see `diagnosis.search.cuts`. With `resume`, a
    finished diagnosis by the same command is read from `out` instead of being repeated, and one in parts goes on where
    it was ended. Raises `InputError` where `out`
    holds one by another command, and for a scenario or recordings that cannot be used.
    """
    command = ["cafim", "diagnose", _seen_from(base, address), "--recording", *recordings]
    command += ["--held-out", *held_out] if held_out else []
    command += [f"--package={name}={place}" for name, place in (packages or {}).items()]
    command += levels.words
    command += [f"--memory={memory / GIB:g}"] if memory != DEFAULT_MEMORY else []
    command += ["--cuts", "--seed", str(cuts.seed)] if cuts else []
    if resume and _is_finished(out, command):
        # what was kept for it remains where it was killed after its last file
        Kept(out / KEPT).close()
        return read_report(out / "report.json", str(out / "report.json"))
    scene = Scene.load(address, packages=packages)
    refuse_repeats(recordings, held_out)
    (out / FINISHED).unlink(missing_ok=True)
    kept = NOTHING_KEPT
    with open_inputs(scene, recordings, held_out, memory, base) as inputs:
        if isinstance(inputs, LongInputs):
            kept = Kept.open(out / KEPT, _about(command, scene, base, [*recordings, *held_out]), resume)
            settings = levels.settings()
            found = examine_parts(
                scene, inputs.recordings, inputs.held_out, inputs.budget, settings, progress, jobs, kept
            )
            verdict, outcome, train, held = found.verdict, found.outcome, list(found.searched), list(found.held_out)
        else:
            train, held = inputs
            settings = replace(levels.settings(), jobs=jobs)
            verdict, outcome = examine(scene, train, held_out=held, settings=settings, progress=progress)
    if cuts and isinstance(inputs, LongInputs):
        verdict = replace(verdict, notes=(*verdict.notes, UNCUT))
    elif cuts:
        work = CutWork(address, tuple(recordings), tuple((packages or {}).items()), cuts, levels)
        verdict = with_cuts(verdict, *named_by_cuts(work, scene, train, out, progress, resume))
    report = write_artifacts(out, verdict, outcome, train, held, command, replay=replay, mcap=mcap, progress=progress)
    write_text(out / FINISHED, json.dumps({"command": command}, indent=1) + "\n")
    kept.close()
    return report


def _seen_from(base: Path, address: str) -> str:
    """The scenario's address in a command that is given in the folder `base`."""
    return address if base == HERE or not Path(address).is_file() else os.path.relpath(address, base)


def _about(command: Sequence[str], scene: Scene, base: Path, recordings: Sequence[str]) -> dict[str, Any]:
    """What a diagnosis in parts is of: the command, this version, the scenario, the model's and the recordings' files.

    Long files are told by size and time of change: to read an hour twice takes long.
    """
    files = {name: (base / name).stat() for name in recordings}
    model = scene.folder / scene.scenario.model
    return {
        "command": list(command),
        "version": version("drake_cafim"),
        "scenario": repr(scene.scenario),
        "model": sha256(model.read_bytes()).hexdigest() if model.is_file() else None,
        "recordings": {name: [found.st_size, found.st_mtime_ns] for name, found in files.items()},
    }


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
