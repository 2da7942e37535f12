"""The folders of a fleet: which robot each is of, when it was recorded, which scenario holds for it.

    DIR/scenario.yaml              for all robots that have none of their own
    DIR/arm_07/scenario.yaml       this robot's
    DIR/arm_07/2026-W12/a.parquet  its recordings of that week: one folder, one report

A folder is any folder below DIR, at any depth, that holds recordings; the first part of its path is the robot. The
nearest `scenario.yaml` above it, up to DIR, holds for it.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from fnmatch import fnmatch
from hashlib import sha256
from pathlib import Path

from drake_cafim.errors import InputError
from drake_cafim.scene.address import split_address

SUFFIXES = (".parquet", ".csv", ".npz", ".mcap", ".bag", ".db3", ".lcm", ".lcmlog")
SCENARIO = "scenario.yaml"
RESULTS = "fleet.json"
"""A file of the command's own results: where these are below the fleet's folder, they are no recordings."""
YEARS = (datetime(2000, 1, 1, tzinfo=UTC), datetime(2100, 1, 1, tzinfo=UTC))
"""A `time` column is one of seconds since 1970 where it lies between these."""
_DATE = re.compile(r"(?<!\d)(\d{4})-?(?:W(\d{2})(?:-?([1-7]))?|(\d{2})-?(\d{2}))(?![\d])")
_CLOCK = re.compile(r"^[T_ -](\d{2})[:\-_h]?(\d{2})(?:[:\-_m]?(\d{2}))?(?!\d)")


@dataclass(frozen=True)
class Folder:
    """A folder of recordings of one robot, which is diagnosed as one.

    `name` is its path below the fleet's folder, with `/`; `recordings` and `held_out` are names of files in it.
    `scenario` is the file that holds for it, or what the command line named.
    """

    name: str
    path: Path
    robot: str
    scenario: str
    recordings: tuple[str, ...]
    held_out: tuple[str, ...] = ()

    def when(self, recording: str = "") -> datetime | None:
        """The time in the recording's name, or else in the nearest folder's; None where there is none."""
        for part in (recording, *reversed(self.name.split("/"))):
            found = time_in(part)
            if found is not None:
                return found
        return None


def folders_of(fleet: Path, scenario: str | None, held_out: Sequence[str]) -> list[Folder]:
    """The fleet's folders by name; `held_out` are patterns of file names or of paths below `fleet`.

    `scenario`, where given, holds for the folders without a scenario.yaml of their own. Raises `InputError` where it
    is not there, no folder holds recordings, a pattern fits none, or a folder has no scenario.
    """
    if scenario is not None:
        split_address(scenario)
    found: list[Folder] = []
    unused = set(held_out)
    for path in sorted(place for place in fleet.rglob("*") if place.is_dir()):
        if any((place / RESULTS).is_file() for place in (path, *path.parents) if place.is_relative_to(fleet)):
            continue
        name = path.relative_to(fleet).as_posix()
        files = sorted(file.name for file in path.iterdir() if file.suffix in SUFFIXES and file.name[0] != ".")
        if not files or any(part.startswith(".") for part in name.split("/")):
            continue
        held = {file: [p for p in held_out if fnmatch(file, p) or fnmatch(f"{name}/{file}", p)] for file in files}
        unused -= {pattern for patterns in held.values() for pattern in patterns}
        own = _scenario(path, fleet) or scenario
        if own is None:
            raise InputError(
                f"--fleet {fleet}: no {SCENARIO} above {name}, expected one there or in the fleet's folder, or a "
                "SCENARIO on the command line"
            )
        train = tuple(file for file in files if not held[file])
        found.append(Folder(name, path, name.split("/")[0], own, train, tuple(f for f in files if held[f])))
    if not found:
        raise InputError(
            f"--fleet {fleet}: found no folder with recordings ({', '.join(SUFFIXES)}), expected ROBOT/DATE/FILE"
        )
    if unused:
        raise InputError(f"--held-out {' '.join(sorted(unused))}: no recording in {fleet} has such a name")
    return found


def _scenario(path: Path, fleet: Path) -> str | None:
    """The nearest scenario.yaml at or above `path`, no higher than `fleet`."""
    while True:
        if (path / SCENARIO).is_file():
            return str(path / SCENARIO)
        if path == fleet:
            return None
        path = path.parent


def share(folders: Sequence[Folder], number: int, of: int) -> list[Folder]:
    """Share `number`, 1 to `of`, of the folders: by a hash of their names, so that new folders move no other one."""
    return [folder for folder in folders if int(sha256(folder.name.encode()).hexdigest(), 16) % of == number - 1]


def time_in(text: str) -> datetime | None:
    """The time that a name states by ISO 8601, UTC: 2026-W12, 2026-03-16, 20260316T091500; None without one."""
    for match in _DATE.finditer(text):
        year, week, day, month, of_month = (int(part) if part else 0 for part in match.groups())
        try:
            start = date.fromisocalendar(year, week, day or 1) if week else date(year, month, of_month)
        except ValueError:
            continue
        clock = _CLOCK.match(text[match.end() :])
        hours, minutes, seconds = (int(part or 0) for part in clock.groups()) if clock else (0, 0, 0)
        moment = datetime(start.year, start.month, start.day, tzinfo=UTC)
        if hours < 24 and minutes < 60 and seconds < 60:
            moment += timedelta(hours=hours, minutes=minutes, seconds=seconds)
        if YEARS[0] <= moment < YEARS[1]:
            return moment
    return None


def time_of_stamps(first: float) -> datetime | None:
    """The time of a recording whose stamps are seconds since 1970, by its `first`; None where they are not."""
    if YEARS[0].timestamp() <= first < YEARS[1].timestamp():
        return datetime.fromtimestamp(first, tz=UTC).replace(microsecond=0)
    return None
