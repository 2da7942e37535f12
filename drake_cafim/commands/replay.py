"""`cafim replay`: shows a recording beside simulations by the model and the corrected model, as one page."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.geometry import Meshcat

from drake_cafim.commands.inputs import read_all, refuse_thrown
from drake_cafim.commands.reports import read_report, report_file
from drake_cafim.diagnosis.noise.stated import needed_columns, noise_of
from drake_cafim.diagnosis.notes.limits import without_limits
from drake_cafim.diagnosis.rows.samples import samples_of
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.recordings.usable import check_usable
from drake_cafim.report.recording_mcap import write_recording_mcap
from drake_cafim.report.recording_replay import RecordingReplay, write_recording_replay
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


def replay_command(
    address: str,
    recording: str,
    report: Path | None,
    out: Path,
    meshcat: Meshcat | None = None,
    packages: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Write the page to `out`, an .html, or the recording and its residuals, an .mcap.

    `report` is a report.json or the folder it is in. With `meshcat`, the page is drawn there, which shows it live.
    Raises `InputError` for a file that is no report, and for a report without its corrected scenario.
    """
    if out.suffix not in (".html", ".mcap"):
        raise InputError(f"--out {out}: expected a page, .html, or a recording with its residuals, .mcap")
    scene = Scene.load(address, packages=packages)
    refuse_thrown(scene, "cafim replay")
    (read,) = read_all(scene, [recording])
    scene = scene.for_recordings([read])
    check_usable(read, needed_columns(scene))
    scene = _facing(scene, read)
    std, _ = noise_of(scene, [read])
    weak = WeakForm(samples_of(scene, read, std), scene.wrench_sensors)
    found = RecordingReplay(scene, weak, scene.physics)
    if report is not None:
        found = _corrected(found, report, read)
    if out.suffix == ".mcap":
        write_recording_mcap(out, found)
    else:
        write_recording_replay(out, found, meshcat)
    return {
        "replay": str(out),
        "recording": recording,
        "corrected": found.corrected is not None,
        "shares": found.shares,
    }


def _corrected(bare: RecordingReplay, report: Path, recording: Recording) -> RecordingReplay:
    """The replay with a report's fitted parameters, its corrected model, its sentence, and the shares of the misfit."""
    path = report_file(report)
    content = read_report(path, f"--report {path}")
    scene, weak, corrected = bare.scene, bare.weak, None
    if content.get("explanation"):
        name = content.get("files", {}).get("corrected_scenario", "scenario.corrected.yaml")
        found = Scene.load(path.parent / name).for_recordings([recording])
        corrected = _facing(found, recording).physics
        # what the recordings refuted acts in neither
        scene = _facing(without_limits(scene, found.scenario.unlimited), recording)
    nominal = scene.physics_at(_parameters(scene, content, path))
    shares: dict[str, float] = {}
    for location in (content.get("mismatch") or {}).get("locations", []):
        shares[location["name"]] = shares.get(location["name"], 0.0) + float(location["share"])
    shares = {name: share for name, share in shares.items() if share > 0.0}
    return RecordingReplay(scene, weak, nominal, corrected, shares, str(content.get("sentence", "")))


def _parameters(scene: Scene, content: dict[str, Any], path: Path) -> Array:
    """The fitted values (n,) of the scene's unknowns, from the report."""
    entries = content.get("parameters", [])
    known = {(entry["parameter"], entry["at"], entry.get("effect")): entry["value"] for entry in entries}
    wanted = [unknown.key for unknown in scene.unknown]
    lacking = [f"{parameter} of {at}" for parameter, at, effect in wanted if (parameter, at, effect) not in known]
    if lacking:
        raise InputError(f"--report {path}: parameters lacks {', '.join(lacking)}; is it a report on this scenario?")
    return scene.vector_of(known)


def _facing(scene: Scene, recording: Recording) -> Scene:
    """The scene with its contact planes on the side on which the recording starts."""
    q = recording.matrix("q", scene.tree.joint_names)
    return scene.with_surfaces_at(q[np.flatnonzero(np.all(np.isfinite(q), axis=1))[0]])
