"""`cafim diagnose --fleet`: the options of diagnose that concern a folder of robots, and its call."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from drake_cafim.command_line.output import open_folder, print_result, progress_line
from drake_cafim.errors import InputError

if TYPE_CHECKING:
    from drake_cafim.commands.levels import Levels


@dataclass(frozen=True)
class FleetArguments:
    """What the command line says of a fleet."""

    scenario: str | None
    fleet: Path
    shard: tuple[int, int] | None
    recordings: tuple[str, ...]
    held_out: tuple[str, ...]
    packages: dict[str, str]
    levels: "Levels"


def diagnose_as_fleet(
    given: FleetArguments,
    out: Path | None,
    as_json: bool,
    jobs: int,
    scheduler: str | None,
    *,
    resume: bool,
    overwrite: bool,
) -> None:
    """Diagnoses the folder, or a share of it, and prints the result. Raises `InputError`."""
    from drake_cafim.commands.fleet import FleetRequest, diagnose_fleet, in_json
    from drake_cafim.fleet.page import sentence_of

    if given.recordings:
        raise InputError("diagnose: --recording and --fleet were both given, expected one of them")
    if given.shard is not None and out is None:
        raise InputError("--shard: all shares write to one folder, expected it as --out DIR")
    packages = tuple(sorted(given.packages.items()))
    request = FleetRequest(given.fleet, given.scenario, given.held_out, packages, given.shard, given.levels)
    resume = resume or given.shard is not None
    folder = open_folder(out, "fleet", resume=resume, overwrite=overwrite, shared=given.shard is not None)
    with progress_line() as progress:
        found = diagnose_fleet(request, folder, jobs, scheduler, progress, resume=resume)
    page = folder / "fleet.html" if given.shard is None else folder
    print_result(in_json(found), as_json, f"{sentence_of(found)}\n{page}")
