"""`cafim diagnose --fleet`: a report for each folder, the strengths over time, one table and one page."""

import json
import shlex
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import yaml

from drake_cafim.commands.diagnose import diagnose_command
from drake_cafim.commands.levels import USUAL, Levels
from drake_cafim.effects.catalogue import EFFECTS
from drake_cafim.errors import InputError
from drake_cafim.fleet.findings import WEEK, Fleet, Followed, date_of, findings_of
from drake_cafim.fleet.layout import RESULTS, Folder, folders_of, share, time_of_stamps
from drake_cafim.fleet.page import write_fleet_page
from drake_cafim.fleet.refit import refit
from drake_cafim.fleet.summary import Measured, Named, Summary, effects_to_follow
from drake_cafim.fleet.table import Row, rows_of, write_table
from drake_cafim.numerics.computation import NotComputable
from drake_cafim.output import write_text
from drake_cafim.parallel.distribute import distribute
from drake_cafim.parallel.task import Task
from drake_cafim.recordings import read
from drake_cafim.report.artifacts import CORRECTED
from drake_cafim.scenario.known_effects import known_effect
from drake_cafim.scenario.schema import EffectEntry
from drake_cafim.scene.scene import Scene

SUMMARY, STRENGTHS, ABOUT = "summary.json", "strengths.json", RESULTS
TABLE_EVERY = 30.0
"""s between two writings of the table while results come."""
BRIEF = {kind.name for kind in EFFECTS if kind.brief}
GROUPS = {kind.name: kind.group for kind in EFFECTS}


@dataclass(frozen=True)
class FleetRequest:
    """The command's arguments: `fleet` the folder, `shard` (number, of) or None for all of it."""

    fleet: Path
    scenario: str | None
    held_out: tuple[str, ...] = ()
    packages: tuple[tuple[str, str], ...] = ()
    shard: tuple[int, int] | None = None
    levels: Levels = USUAL

    def command(self) -> list[str]:
        """The command line, without what does not change results."""
        words = ["cafim", "diagnose", *([self.scenario] if self.scenario else []), "--fleet", str(self.fleet)]
        words += [word for pattern in self.held_out for word in ("--held-out", pattern)]
        words += [f"--package={name}={place}" for name, place in self.packages]
        return words + self.levels.words


def diagnose_fleet(
    request: FleetRequest,
    out: Path,
    jobs: int,
    scheduler: str | None,
    progress: Callable[[str], None],
    *,
    resume: bool,
) -> Fleet:
    """Diagnose the folders, fit the strengths of what was named in every recording, and write table and page.

    `out` gets a folder for each of the fleet's, `fleet.parquet` and `fleet.html`; with a shard, the table of its own
    rows alone. With `resume`, what is finished in `out` is not repeated. Raises `InputError` for a fleet that cannot be
    used; a folder that cannot be is a row of the table.
    """
    folders = folders_of(request.fleet.resolve(), request.scenario, request.held_out)
    _check_same(request, out, resume)
    own = share(folders, *request.shard) if request.shard else folders
    state = _State(request, folders, own, out.resolve(), resume)
    table = out / (
        "fleet.parquet" if request.shard is None else f"fleet.{request.shard[0]}-of-{request.shard[1]}.parquet"
    )
    written = time.monotonic()
    for phase, tasks in (("diagnosed", state.diagnoses), ("strengths fitted in", state.fits)):
        todo = tasks()
        progress(f"{phase} 0 of {len(todo)} folders")
        for count, result in enumerate(distribute([task for _, task in todo], jobs, scheduler), start=1):
            state.take(todo[result.index][0], result.value, result.failure, phase)
            progress(f"{phase} {count} of {len(todo)} folders")
            if time.monotonic() - written > TABLE_EVERY:
                write_table(table, state.rows())
                written = time.monotonic()
    rows = state.rows()
    write_table(table, rows)
    found = findings_of(sorted_rows(rows))
    if request.shard is None:
        progress("drawing the fleet's page")
        write_fleet_page(out / "fleet.html", found, request.command())
    return found


def sorted_rows(rows: Sequence[Row]) -> list[Row]:
    """The rows with all columns, in an order that does not depend on which came first."""
    names = ("robot", "recording", "time", "effect", "place", "strength", "std", "probability", "verdict", "parameter",
             "unit", "kind", "folder", "why")  # fmt: skip
    whole = [{name: row.get(name) for name in names} for row in rows]
    return sorted(
        whole,
        key=lambda row: [str(row[name]) for name in ("robot", "folder", "recording", "effect", "place", "parameter")],
    )


class _State:
    """What is known of each folder, from this run and from earlier ones in the same output folder."""

    def __init__(
        self, request: FleetRequest, folders: Sequence[Folder], own: Sequence[Folder], out: Path, resume: bool
    ) -> None:
        self.request, self.folders, self.own, self.out, self.resume = request, folders, own, out, resume
        self.summaries: dict[str, Summary] = {}
        self.measured: dict[str, list[Measured]] = {}

    def diagnoses(self) -> list[tuple[Folder, Task]]:
        arguments = (dict(self.request.packages), self.resume, self.request.levels)
        return [
            (folder, Task(folder.name, diagnose_folder, (folder, self.out / folder.name, *arguments)))
            for folder in self.own
        ]

    def fits(self) -> list[tuple[Folder, Task]]:
        """The fits of strengths in those folders of which all of the robot's kind are diagnosed."""
        for folder in self.folders if self.request.shard else ():
            if folder.name not in self.summaries:
                known = _read_json(self.out / folder.name / SUMMARY)
                if known is not None:
                    self.summaries[folder.name] = Summary.from_json(known)
        if len(self.summaries) < len(self.folders):
            return []  # another shard's folders are not diagnosed yet: the run that gathers them fits the strengths
        robots = {folder.name: folder.robot for folder in self.folders}
        followed = effects_to_follow([self.summaries[folder.name] for folder in self.folders], robots, GROUPS)
        tasks = []
        for folder in self.own:
            effects = followed[folder.robot]
            undated = any(folder.when(recording) is None for recording in folder.recordings)
            if not self.summaries[folder.name].failure and (effects or undated):
                arguments = (folder, self.out / folder.name, effects, dict(self.request.packages), self.resume)
                tasks.append((folder, Task(folder.name, measure_folder, arguments)))
        return tasks

    def take(self, folder: Folder, value: Any, failure: str, phase: str) -> None:
        """Keep a task's result; one whose process died leaves its failure in the folder's stead."""
        if phase == "diagnosed":
            self.summaries[folder.name] = value or Summary(folder.name, failure=failure)
            if value is None:
                _keep(self.out / folder.name / SUMMARY, asdict(self.summaries[folder.name]))
            return
        self.measured[folder.name] = value or [
            Measured(recording, folder.when(recording), failure=failure) for recording in folder.recordings
        ]

    def rows(self) -> list[Row]:
        """The rows of the own folders that are diagnosed."""
        return [
            row
            for folder in self.own
            if folder.name in self.summaries
            for row in rows_of(folder, self.summaries[folder.name], self.measured.get(folder.name, []))
        ]


def diagnose_folder(
    folder: Folder, out: Path, packages: Mapping[str, str], resume: bool, levels: Levels = USUAL
) -> Summary:
    """The folder's diagnosis, written into `out`; one that cannot be used is a summary with the reason."""
    if resume:
        known = _read_json(out / SUMMARY)
        if known is not None and not known["failure"]:
            return Summary.from_json(known)
    try:
        summary = _diagnosed(folder, out, packages, resume, levels)
    except InputError as error:
        summary = Summary(folder.name, failure=str(error))
    write_text(out / SUMMARY, json.dumps(asdict(summary), indent=1, ensure_ascii=False) + "\n")
    return summary


def _diagnosed(folder: Folder, out: Path, packages: Mapping[str, str], resume: bool, levels: Levels) -> Summary:
    if not folder.recordings:
        raise InputError(f"{folder.name}: all of its recordings are held out, expected one to fit to")
    out.mkdir(parents=True, exist_ok=True)
    train, held = ([str(folder.path / name) for name in names] for names in (folder.recordings, folder.held_out))
    report = diagnose_command(
        folder.scenario,
        train,
        held,
        out,
        lambda text: None,
        replay=False,
        packages=packages,
        resume=resume,
        levels=levels,
    )
    stated = yaml.safe_load((out / CORRECTED).read_text(encoding="utf-8")).get("effects", [])
    values = {(entry["effect"], entry["at"]): entry for entry in stated}
    named = tuple(
        Named(
            item["effect"],
            item["at"],
            item["probability"],
            {
                name: value
                for name, value in values[item["effect"], item["at"]].items()
                if isinstance(value, int | float)
            },
            item["parameters"],
            item["effect"] in BRIEF,
        )
        for item in report["explanation"]
    )
    return Summary(folder.name, report["verdict"], _kind(folder.scenario, packages), named)


def measure_folder(
    folder: Folder, out: Path, effects: Sequence[Named], packages: Mapping[str, str], resume: bool
) -> list[Measured]:
    """The strengths of `effects` in each of the folder's recordings, written into `out`."""
    asked = [asdict(item) for item in effects]
    known = _read_json(out / STRENGTHS) if resume else None
    if known is not None and known["effects"] == asked:
        return [Measured.from_json(raw) for raw in known["recordings"]]
    scene = _scene(folder.scenario, tuple(sorted(packages.items())))
    found = [_measured(folder, recording, scene, effects) for recording in folder.recordings]
    content = {"effects": asked, "recordings": [item.as_json() for item in found]}
    write_text(out / STRENGTHS, json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    return found


def _measured(folder: Folder, name: str, scene: Scene, effects: Sequence[Named]) -> Measured:
    recording = read(folder.path / name, scene.scenario.topics)
    moment = folder.when(name) or (time_of_stamps(float(recording.time[0])) if len(recording) else None)
    if not effects:
        return Measured(name, moment)
    channels = [key for key in scene.scenario.channels if key.startswith(("wrench.", "pose."))]
    try:
        stated = [
            known_effect(
                EffectEntry(item.effect, item.at, dict(item.values)),
                scene.bare,
                scene.vocabulary,
                channels,
                folder.name,
            )
            for item in effects
            if scene.bare is not None
        ]
        found = refit(scene, recording, stated)
    except InputError as error:
        return Measured(name, moment, failure=str(error))
    if isinstance(found, NotComputable):
        return Measured(name, moment, failure=f"the strengths cannot be computed: {found.reason}")
    return Measured(name, moment, found)


@lru_cache(maxsize=8)
def _scene(scenario: str, packages: tuple[tuple[str, str], ...]) -> Scene:
    return Scene.load(scenario, packages=dict(packages))


def _kind(scenario: str, packages: Mapping[str, str]) -> str:
    """The model's name, and a digest of its joints and bodies."""
    scene = _scene(scenario, tuple(sorted(packages.items())))
    model = Path(scene.scenario.model).name.split(".")[0] or "directives"
    parts = [*scene.joint_names, *(body.name for body in scene.tree.bodies)]
    return f"{model} {sha256(chr(0).join(parts).encode()).hexdigest()[:8]}"


def _check_same(request: FleetRequest, out: Path, resume: bool) -> None:
    """Raises `InputError` where `out` is resumed and holds the results of another command."""
    known = _read_json(out / ABOUT) if resume else None
    if known is not None and known["command"] != request.command():
        raise InputError(
            f"--out {out}: it holds the results of `{shlex.join(known['command'])}`, expected the same command with "
            "--resume; give --overwrite, or another folder"
        )
    write_text(out / ABOUT, json.dumps({"command": request.command()}, indent=1) + "\n")


def _keep(path: Path, content: Mapping[str, Any]) -> None:
    """Write `content` where it can be written; what cannot is in the table all the same."""
    try:
        write_text(path, json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    except OSError:
        return


def _read_json(path: Path) -> Any:
    """The contents of a JSON file of an earlier run; None without one."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def in_json(fleet: Fleet) -> dict[str, Any]:
    """The findings as plain values."""
    return {
        "schema": "drake_cafim.fleet/1",
        "accused": fleet.accused,
        "changed": [_told(item) for item in fleet.changed],
        "unlike": [_told(item) for item in fleet.unlike],
        "constant": [_told(item) for item in fleet.constant],
        "failed": [{"folder": row["folder"], "why": row["why"]} for row in fleet.failed],
    }


def _told(item: Followed) -> dict[str, Any]:
    since = [date_of(day).isoformat() for day in item.trend.since or ()]
    slope = item.trend.slope
    return {
        "robot": item.robot,
        "effect": item.effect,
        "at": item.at,
        "parameter": item.parameter,
        "unit": item.unit,
        "course": item.trend.course,
        "p_value": item.trend.p_value,
        "since": since or None,
        "onset": None if item.trend.onset is None else date_of(item.trend.onset).isoformat(),
        "before": {"value": item.trend.before[0], "std": item.trend.before[1]},
        "now": {"value": item.trend.now[0], "std": item.trend.now[1]},
        "drift_per_week": None if slope is None else {"value": WEEK * slope[0], "interval": WEEK * slope[1]},
        "unlike": item.unlike,
    }
