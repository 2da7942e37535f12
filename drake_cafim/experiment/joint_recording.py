"""Recordings of the experiments of a run: joints at the plant's step, forces at the planner's."""

from collections.abc import Mapping, Sequence

import numpy as np

from drake_cafim.experiment.closed_loop import ExperimentResult, RunResult
from drake_cafim.numerics.streams import stream
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


def recordings_of(result: RunResult, scene: Scene, joints: Sequence[str], *, step: float) -> list[Recording]:
    """The recordings of a run's experiments, with the noise that `scene` states; `step` s is the plant's."""
    columns = [f"{kind}.{joint}" for kind in "qvu" for joint in joints]
    std = {column: scene.std(column) or 0.0 for column in columns}
    return [
        joint_recording(
            experiment,
            f"experiment_{number + 1}.parquet",
            joints,
            step=step,
            std=std,
            random=stream("joint noise", result.options.seed, number),
        )
        for number, experiment in enumerate(result.experiments)
    ]


def joint_recording(
    experiment: ExperimentResult,
    name: str,
    joints: Sequence[str],
    *,
    step: float,
    std: Mapping[str, float],
    random: np.random.Generator,
) -> Recording:
    """The recording of an experiment: q, v, u of `joints`, and the planner's commands and forces.

    `std` is the std of white noise by column, SI; `step` h s is the plant's, q_{k+1} = q_k + h v_{k+1}:
    its v_k is the mean velocity between q_{k-1} and q_k, and its effort u_k takes v_k to v_{k+1}. As samples of one
    continuous motion, to second order in h, v_k and the beginning of u_k therefore belong half a step before q_k, where
    the position is q_k − h v_k / 2. Row k holds this position, v_k and u_k.
    """
    n = len(joints)
    state, effort = experiment.recorded["joint_state"][:-1], experiment.recorded["joint_effort"][1:, :n]
    v = state[:, n:]
    q = state[:, :n] - 0.5 * step * v
    time: Array = step * np.arange(len(state), dtype=float)
    columns: dict[str, Array] = {}
    for kind, values in (("q", q), ("v", v), ("u", effort)):
        for index, joint in enumerate(joints):
            column = f"{kind}.{joint}"
            columns[column] = values[:, index] + std.get(column, 0.0) * random.standard_normal(len(time))
    return Recording(name, time, columns | _planner_columns(experiment, time))


def _planner_columns(experiment: ExperimentResult, time: Array) -> dict[str, Array]:
    """Commands, each in all rows of its period, and measured forces in the rows of their samples, NaN in the others."""
    period = float(experiment.time[1])
    index = np.minimum((time / period + 1e-9).astype(int), len(experiment.commands) - 1)
    columns = {f"command.{axis}": values[index] for axis, values in enumerate(experiment.commands.T)}
    for axis, values in enumerate(experiment.measured_force.T):
        column = np.full(len(time), np.nan)
        nearest = np.rint(experiment.time[1:] / time[1]).astype(int)
        inside = nearest < len(time)
        column[nearest[inside]] = values[inside]
        columns[f"force.{axis}"] = column
    return columns
