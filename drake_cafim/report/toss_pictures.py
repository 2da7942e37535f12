"""What a report on tosses shows where one on robots shows joints."""

from collections.abc import Sequence

import numpy as np

from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.search import Outcome
from drake_cafim.diagnosis.tosses.poses import track_of
from drake_cafim.diagnosis.tosses.problem import TossProblem
from drake_cafim.diagnosis.tosses.quality import toss_forecasts
from drake_cafim.diagnosis.verdict import Verdict
from drake_cafim.diagnosis.weak_problem import WeakProblem
from drake_cafim.recordings.recording import Recording
from drake_cafim.report.forecast_figure import Contest
from drake_cafim.report.missing import ResidualMap
from drake_cafim.typing import Array

TOGETHER = 6
"""Samples of a cell of the map."""
ROWS = ("x", "y", "z", "turn about x", "turn about y", "turn about z")


def toss_maps(problem: TossProblem, before: Model, after: Model) -> list[ResidualMap]:
    """The innovations of all recordings under two models, some samples together; root mean squares."""
    pieces = [_cells(problem, problem.residual(one)[: problem.rows]) for one in (before, after)]
    maps = []
    for index, run in enumerate(problem.runs):
        count = len(pieces[0][index])
        time = run.time[: count * TOGETHER].reshape(count, TOGETHER)
        width = float(np.median(time[:, -1] - time[:, 0])) if count else 0.0
        maps.append(ResidualMap(run.name, time.mean(axis=1), width, pieces[0][index], pieces[1][index]))
    return maps


def _cells(problem: TossProblem, rows: Array) -> list[Array]:
    found, start = [], 0
    for run in problem.runs:
        z = rows[start : start + run.rows].reshape(run.shape)
        start += run.rows
        count = len(z) // TOGETHER
        found.append(np.sqrt(np.mean(z[: count * TOGETHER].reshape(count, TOGETHER, 6) ** 2, axis=1)))
    return found


def recordings_of(outcome: Outcome) -> list[Recording]:
    """The recordings that were fitted to."""
    if isinstance(outcome.problem, TossProblem):
        return [track.recording for track in outcome.problem.arcs.tracks]
    assert isinstance(outcome.problem, WeakProblem)
    return [run.weak.samples.recording for run in outcome.problem.runs]


def toss_contest(problem: TossProblem, verdict: Verdict, nominal: Model, recording: Recording) -> Contest:
    """The recording simulated without and with the effects."""
    tracks = [track_of(recording, problem.body)]
    corrected = None
    if verdict.explanation:
        (corrected,) = toss_forecasts(tracks, problem.noise, verdict.corrected.physics, problem.body)
    (plain,) = toss_forecasts(tracks, problem.noise, nominal.physics(problem.scene), problem.body)
    return Contest(plain, corrected)


def shown_recording(problem: TossProblem, held_out: Sequence[Recording]) -> Recording:
    """The first held-out recording, or the first one where none was held out."""
    return held_out[0] if held_out else problem.arcs.tracks[0].recording
