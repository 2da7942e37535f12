"""Writes a recording as MCAP, with the residuals of the models' simulations, for Foxglove and PlotJuggler."""

from pathlib import Path

import numpy as np

from drake_cafim.diagnosis.predict.forecast import forecast
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.output import replacing
from drake_cafim.recordings.mcap_out import write_mcap
from drake_cafim.report.recording_replay import RecordingReplay
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


def write_recording_mcap(path: Path, replay: RecordingReplay) -> None:
    """Write the recording and its residuals to `path`, whole or not at all.

    Topics /residual/nominal/q.elbow and /residual/corrected/q.elbow, and so on for every column that is simulated.
    """
    models = {"nominal": replay.nominal, "corrected": replay.corrected}
    channels = {
        f"{name}/{column}": values
        for name, physics in models.items()
        if physics is not None
        for column, values in residuals(replay.weak, physics).items()
    }
    with replacing(path) as temporary:
        write_mcap(replay.weak.samples.recording, temporary, channels)


def residuals(weak: WeakForm, physics: Physics) -> dict[str, Array]:
    """By column (N,): measured − simulated, for simulations over 1 s that each start from the measured state.

    NaN where nothing is simulated: before the first start, after the last whole window, and where a simulation has
    diverged.
    """
    simulated = forecast(weak, physics)
    time = weak.samples.recording.time
    result = {}
    for column, predicted in simulated.predicted.items():
        values = np.full(time.shape, np.nan)
        # where one window ends and the next starts, the last assignment must be the end's, where the error has grown
        rows = np.searchsorted(time, simulated.time)[::-1]
        values[rows] = np.where(simulated.counted, simulated.measured[column] - predicted, np.nan)[::-1]
        result[column] = values
    return result
