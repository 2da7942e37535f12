"""`cafim diagnose`: report.json, report.html, the corrected scenario and the replay."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed
from tqdm import tqdm

from drake_cafim.commands.inputs import in_folder, read_all
from drake_cafim.diagnosis.diagnose import examine
from drake_cafim.errors import InputError
from drake_cafim.output import prepare_folder
from drake_cafim.report.artifacts import write_artifacts
from drake_cafim.scenario.scene import Scene


def diagnose_command(
    address: str,
    recordings: Sequence[str],
    held_out: Sequence[str],
    out: Path,
    progress: Callable[[str], None],
    *,
    replay: bool = True,
    mcap: bool = False,
) -> dict[str, Any]:
    """The report, written into `out` with its page, the corrected scenario and what else is wanted."""
    scene = Scene.load(address)
    train, held = read_all(scene, recordings), read_all(scene, held_out)
    shared = sorted(set(recordings) & set(held_out))
    if shared:
        raise InputError(f"{shared[0]}: given as --recording and as --held-out, expected one of them")
    verdict, outcome = examine(scene, train, held_out=held, progress=progress)
    command = ["cafim", "diagnose", address, "--recording", *recordings]
    command += ["--held-out", *held_out] if held_out else []
    return write_artifacts(out, verdict, outcome, train, held, command, replay=replay, mcap=mcap, progress=progress)


def diagnose_fleet(
    address: str, fleet: Path, out: Path | None, jobs: int, *, resume: bool, overwrite: bool
) -> list[dict[str, Any]]:
    """One report for each folder of recordings in `fleet`, in `out` under the folder's name."""
    folders = sorted(folder for folder in fleet.iterdir() if folder.is_dir() and in_folder(folder))
    if not folders:
        raise InputError(f"--fleet {fleet}: found no folder with recordings, expected at least one")
    target = prepare_folder(out, "diagnose", resume=resume, overwrite=overwrite)
    waiting = [f for f in folders if not (resume and (target / f.name / "report.json").is_file())]
    work = (delayed(_one_of_fleet)(address, folder, target / folder.name) for folder in waiting)
    results = Parallel(n_jobs=jobs, return_as="generator")(work)
    return list(tqdm(results, total=len(waiting), desc="diagnosing", unit="folder"))


def _one_of_fleet(address: str, folder: Path, out: Path) -> dict[str, Any]:
    out.mkdir(parents=True, exist_ok=True)
    return diagnose_command(address, in_folder(folder), (), out, lambda text: None, replay=False)
