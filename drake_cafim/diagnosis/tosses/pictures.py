"""Residual maps and simulated poses of tosses, for a report's figures."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.pictures import Channel, Evidence, Pictures, ResidualMap, WindowMeans
from drake_cafim.diagnosis.predict.forecast import Forecast
from drake_cafim.diagnosis.tosses.arc_rows import ArcRows, TossRun
from drake_cafim.diagnosis.tosses.initial_states import fit_initial_states
from drake_cafim.diagnosis.tosses.poses import track_of
from drake_cafim.diagnosis.tosses.quality import toss_forecasts
from drake_cafim.effects.effect import Effect
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
        return list(ROWS[: self.problem.noise.rows])

    def maps(self, before: Model, after: Model) -> list[ResidualMap]:
        """The root mean square of the innovations over each `TOGETHER` samples, under both models."""
        problem = self.problem
        pieces = [_cells(problem, problem.residual(model)[: problem.rows]) for model in (before, after)]
        maps = []
        for index, run in enumerate(problem.runs):
            time = _times(run, len(pieces[0][index]))
            before_it, after_it = (np.sqrt(np.mean(cells[index] ** 2, axis=1)) for cells in pieces)
            maps.append(ResidualMap(run.name, time.mean(axis=1), _width(time), before_it, after_it))
        return maps

    def forecast(self, recording: Recording, physics: Physics) -> Forecast:
        tracks = [track_of(recording, self.problem.body, turns=self.problem.noise.turns_measured)]
        return toss_forecasts(tracks, self.problem.noise, physics, self.problem.body)[0]

    def evidence(self, effect: Effect, without: Physics, with_it: Physics) -> Evidence:
        """Innovations measured less predicted, averaged over cells, in units of their noise: no forces are known."""
        problem, rows, means = self.problem, [], []
        for physics in (without, with_it):
            fitted = fit_initial_states(problem.arcs, problem.noise, physics, problem.base.shot.start)
            predicted_less_measured = problem.innovations(fitted.shot.rows[..., None])[:, 0]
            # a mean of n values of unit variance has the standard deviation 1/√n
            rows.append([-cells.mean(axis=1) * np.sqrt(TOGETHER) for cells in _cells(problem, predicted_less_measured)])
        width = 0.0
        for run, values in zip(problem.runs, rows[0], strict=True):
            time = _times(run, len(values))
            width = max(width, _width(time))
            nothing = np.zeros((len(values), 0))
            means.append(WindowMeans(time.mean(axis=1), nothing, nothing, nothing, nothing))
        channels = [Channel(f"innovation of {row}", "std of the noise") for row in self.row_labels]
        std = [np.ones_like(values) for values in rows[0]]
        return Evidence(effect, problem.scene.tree, channels, 0, width, means, rows[0], rows[1], std)


def _times(run: TossRun, count: int) -> Array:
    """(count, TOGETHER) s of the samples of so many cells."""
    return run.time[: count * TOGETHER].reshape(count, TOGETHER)


def _width(time: Array) -> float:
    """s that a cell lasts."""
    return float(np.median(time[:, -1] - time[:, 0])) if len(time) else 0.0


def _cells(problem: ArcRows, rows: Array) -> list[Array]:
    """Each recording's whitened rows, (cells, TOGETHER, rows a sample); a rest that fills no cell is left out."""
    found, start = [], 0
    for run in problem.runs:
        z = rows[start : start + run.rows].reshape(run.shape)
        start += run.rows
        count = len(z) // TOGETHER
        found.append(z[: count * TOGETHER].reshape(count, TOGETHER, run.rows_per_window))
    return found
