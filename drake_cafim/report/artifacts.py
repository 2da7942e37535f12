"""Writes the files of a diagnosis: report.json, report.html, scenario.corrected.yaml, replay.html, and MCAP."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path, PurePath
from typing import Any

from drake_cafim.diagnosis.search.search import Outcome
from drake_cafim.diagnosis.verdict import Verdict
from drake_cafim.effects.learned_force import table_name
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.output import write_text
from drake_cafim.recordings.recording import Recording
from drake_cafim.report.recording_mcap import write_recording_mcap
from drake_cafim.report.recording_replay import RecordingReplay, write_recording_replay
from drake_cafim.report.report_html import write_report_page
from drake_cafim.report.report_json import as_text, report_of
from drake_cafim.scenario.law_table import write_law
from drake_cafim.scenario.scenario_yaml import as_yaml
from drake_cafim.scene.scene import Scene

REPORT, PAGE, REPLAY = "report.json", "report.html", "replay.html"
CORRECTED = "scenario.corrected.yaml"


def write_artifacts(
    out: Path,
    verdict: Verdict,
    outcome: Outcome,
    recordings: Sequence[Recording],
    held_out: Sequence[Recording],
    command: Sequence[str],
    *,
    replay: bool = True,
    mcap: bool = False,
    progress: Callable[[str], None] = lambda text: None,
) -> dict[str, Any]:
    """Write the report, its page and the corrected scenario into `out`; returns the report as a mapping.

    `command` is the command line that reproduces it, shown on the page. The replay shows the first held-out recording,
    or the first one where none was held out. With `mcap` every recording is written as MCAP too, with its residuals as
    channels. What cannot be drawn or written is a sentence in the report's notes.
    """
    progress("writing the report")
    notes: list[str] = []
    files = {"corrected_scenario": CORRECTED, "html": PAGE}
    write_scene(verdict.corrected, out)
    # the report is written before the pictures, so that a failure to draw them cannot lose the verdict
    write_text(out / REPORT, as_text(report_of(verdict, (), None, files)))
    shown = compute(lambda: replay_of(verdict, outcome, [*held_out, *recordings][0])) if replay or mcap else None
    if isinstance(shown, NotComputable):
        notes.append(f"{REPLAY} cannot be drawn: {shown.reason}")
        shown = None
    # a thrown body has no joints to draw a replay from
    replay, mcap = replay and shown is not None, mcap and shown is not None
    notes += write_report_page(out / PAGE, verdict, outcome, held_out, command)
    if replay and shown is not None:
        progress("drawing the replay")
        drawn = compute(partial(write_recording_replay, out / REPLAY, shown))
        if isinstance(drawn, NotComputable):
            notes.append(f"{REPLAY} cannot be drawn: {drawn.reason}")
        else:
            files |= {"replay": REPLAY}
    if mcap:
        for number, recording in enumerate((*recordings, *held_out), start=1):
            own = compute(partial(replay_of, verdict, outcome, recording))
            if isinstance(own, NotComputable):
                notes.append(f"{recording.name} is not written as MCAP: {own.reason}")
                continue
            if own is None:
                continue
            progress(f"writing {recording.name} as MCAP")
            name = f"{number}_{PurePath(recording.name).stem}.residuals.mcap"  # folders may hold files of one name
            write_recording_mcap(out / name, own)
    report = report_of(verdict, (), None, files, notes=notes)
    write_text(out / REPORT, as_text(report))
    return report


def write_scene(scene: Scene, out: Path) -> None:
    """Writes the scene's scenario into `out`, with the tables of its learned forces."""
    entries = []
    for entry, effect in zip(scene.scenario.effects, scene.known, strict=True):
        if effect.law_table:
            entry = replace(entry, table=table_name(effect.at))
            write_law(out / table_name(effect.at), effect.law_table)
        entries.append(entry)
    write_text(out / CORRECTED, as_yaml(replace(scene.scenario, effects=entries), scene.folder, out))


def replay_of(verdict: Verdict, outcome: Outcome, recording: Recording) -> RecordingReplay | None:
    """The recording, the model with its unknowns as fitted, and that model with the accepted effects, for a replay.

    None where the recording has no joints to draw, as of a thrown body.
    """
    scene, weak = outcome.problem.scene, outcome.problem.pictures.laid_out(recording)
    if weak is None:
        return None
    nominal = scene.physics_at(scene.vector_of(verdict.unknown_values))
    corrected = verdict.corrected.physics if verdict.changed else None
    shares: dict[str, float] = {}
    for location in verdict.mismatch.standing:
        shares[location.name] = shares.get(location.name, 0.0) + location.share
    return RecordingReplay(scene, weak, nominal, corrected, shares, str(verdict))
