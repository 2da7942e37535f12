"""What a diagnosis leaves in a folder: the report as numbers and as a page, the corrected scenario, the replay."""

from collections.abc import Callable, Sequence
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from drake_cafim.diagnosis.samples import samples_of
from drake_cafim.diagnosis.search import Outcome
from drake_cafim.diagnosis.tosses.problem import TossProblem
from drake_cafim.diagnosis.verdict import Verdict
from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.diagnosis.weak_problem import WeakProblem
from drake_cafim.output import write_text
from drake_cafim.recordings.recording import Recording
from drake_cafim.report.recording_mcap import write_recording_mcap
from drake_cafim.report.recording_replay import RecordingReplay, write_recording_replay
from drake_cafim.report.report_html import write_report_page
from drake_cafim.report.report_json import as_text, report_of
from drake_cafim.scenario.scenario_yaml import as_yaml

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
    """Write the report, its page and the corrected scenario into `out`; the report comes back.

    `command` is the line that makes it again. The replay shows the first held-out recording, or the first one where
    none was held out. With `mcap` every recording is written as MCAP too, its residuals as channels.
    """
    progress("writing the report")
    # a thrown body has no joints to draw a replay from
    thrown = isinstance(outcome.problem, TossProblem)
    replay, mcap = replay and not thrown, mcap and not thrown
    scene = verdict.corrected
    files = {"corrected_scenario": CORRECTED, "html": PAGE}
    report = report_of(verdict, (), None, files | ({"replay": REPLAY} if replay else {}))
    write_text(out / CORRECTED, as_yaml(scene.scenario, scene.folder, out))
    write_report_page(out / PAGE, verdict, outcome, held_out, command)
    write_text(out / REPORT, as_text(report))
    if replay:
        progress("drawing the replay")
        write_recording_replay(out / REPLAY, replay_of(verdict, outcome, [*held_out, *recordings][0]))
    if mcap:
        for number, recording in enumerate((*recordings, *held_out), start=1):
            progress(f"writing {recording.name} as MCAP")
            name = f"{number}_{PurePath(recording.name).stem}.residuals.mcap"  # folders may hold files of one name
            write_recording_mcap(out / name, replay_of(verdict, outcome, recording))
    return report


def replay_of(verdict: Verdict, outcome: Outcome, recording: Recording) -> RecordingReplay:
    """The recording beside the model with its unknowns as fitted, without and with the effects."""
    scene = outcome.problem.scene
    assert isinstance(outcome.problem, WeakProblem)
    std = outcome.problem.runs[0].weak.samples.std
    weak = WeakForm(samples_of(scene, recording, std), scene.wrench_sensors)
    nominal = scene.physics_at(np.array([one.value for one in verdict.parameters]))
    corrected = verdict.corrected.physics if verdict.explanation else None
    shares: dict[str, float] = {}
    for location in verdict.mismatch.standing:
        shares[location.name] = shares.get(location.name, 0.0) + location.share
    return RecordingReplay(scene, weak, nominal, corrected, shares, str(verdict))
