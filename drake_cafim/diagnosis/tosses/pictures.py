"""Residual maps and simulated poses of tosses, for a report's figures."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.pictures import Pictures, ResidualMap
from drake_cafim.diagnosis.predict.forecast import Forecast
from drake_cafim.diagnosis.tosses.arc_rows import ArcRows
from drake_cafim.diagnosis.tosses.poses import track_of
from drake_cafim.diagnosis.tosses.quality import toss_forecasts
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

TOGETHER = 6
"""Number of samples in a cell of the map."""
ROWS = ("x", "y", "z", "turn about x", "turn about y", "turn about z")


@dataclass(frozen=True)
class TossPictures(Pictures):
    """The figures of the tosses of `problem`."""

    problem: ArcRows

    row_note: ClassVar[str] = "Shown is how far a sample lies from what the model predicts from the samples before it."

    @property
    def recordings(self) -> list[Recording]:
        return [track.recording for track in self.problem.arcs.tracks]

    @property
    def row_labels(self) -> list[str]:
        return list(ROWS)

    def maps(self, before: Model, after: Model) -> list[ResidualMap]:
        """The root mean square of the innovations over each `TOGETHER` samples, under both models."""
        problem = self.problem
        pieces = [_cells(problem, problem.residual(model)[: problem.rows]) for model in (before, after)]
        maps = []
        for index, run in enumerate(problem.runs):
            count = len(pieces[0][index])
            time = run.time[: count * TOGETHER].reshape(count, TOGETHER)
            width = float(np.median(time[:, -1] - time[:, 0])) if count else 0.0
            maps.append(ResidualMap(run.name, time.mean(axis=1), width, pieces[0][index], pieces[1][index]))
        return maps

    def forecast(self, recording: Recording, physics: Physics) -> Forecast:
        tracks = [track_of(recording, self.problem.body)]
        return toss_forecasts(tracks, self.problem.noise, physics, self.problem.body)[0]


def _cells(problem: ArcRows, rows: Array) -> list[Array]:
    """For each recording, the root mean square (cells, 6) of its rows."""
    found, start = [], 0
    for run in problem.runs:
        z = rows[start : start + run.rows].reshape(run.shape)
        start += run.rows
        count = len(z) // TOGETHER
        found.append(np.sqrt(np.mean(z[: count * TOGETHER].reshape(count, TOGETHER, 6) ** 2, axis=1)))
    return found
