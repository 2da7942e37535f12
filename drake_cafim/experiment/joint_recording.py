"""Recordings of the experiments of a run: joints, wrench and pose at the plant's step, forces at the planner's."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from drake_cafim.dynamics.contact import WrenchSensor
from drake_cafim.dynamics.motion import mass_matrix, motion
from drake_cafim.experiment.closed_loop import ExperimentResult, RunResult
from drake_cafim.experiment.world import World
from drake_cafim.numerics.streams import stream
from drake_cafim.recordings.recording import POSE_COMPONENTS, WRENCH_COMPONENTS, Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

LEVER = 0.05
"""m; the std of a wrench's torque over that of its force, where the scenario does not state them."""


def recordings_of(result: RunResult, scene: Scene, joints: Sequence[str], world: World) -> list[Recording]:
    """The recordings of a run's experiments in `world`, with the noise that `scene` states.

    A wrench of which it states no noise has that of the planner's force sensor.
    """
    columns = [f"{kind}.{joint}" for kind in "qvu" for joint in joints]
    std = {column: scene.std(column) or 0.0 for column in columns}
    recordings = []
    for number, experiment in enumerate(result.experiments):
        recording = joint_recording(
            experiment,
            f"experiment_{number + 1}.parquet",
            joints,
            step=world.recording_period,
            std=std,
            random=stream("joint noise", result.options.seed, number),
            held=_held(experiment, scene, joints, world.recording_period),
        )
        random = stream("wrench and pose noise", result.options.seed, number)
        felt = _wrench_columns(experiment, scene, joints, world.touching, float(result.task.model.noise_std[0]), random)
        seen = _pose_columns(experiment, scene, world.tracked, random)
        recordings.append(replace(recording, columns={**recording.columns, **felt, **seen}))
    return recordings


def joint_recording(
    experiment: ExperimentResult,
    name: str,
    joints: Sequence[str],
    *,
    step: float,
    std: Mapping[str, float],
    random: np.random.Generator,
    held: Array | float = 0.0,
) -> Recording:
    """The recording of an experiment: q, v, u of `joints`, and the planner's commands and forces.

    `std` is the std of white noise by column, SI; `step` h s is the plant's, q_{k+1} = q_k + h v_{k+1}:
    its v_k is the mean velocity between q_{k-1} and q_k, and its effort u_k takes v_k to v_{k+1}. As samples of one
    continuous motion, to second order in h, v_k and the beginning of u_k therefore belong half a step before q_k, where
    the position is q_k − h v_k / 2 − h² a / 12. Row k holds this position, v_k and u_k.

    `held` (N, n) is the acceleration a by all but the efforts, which the plant holds over a step as it holds these: its
    velocity is linear there, that of the continuous motion is not, and goes less far by h³ ȧ / 12.
    """
    n = len(joints)
    state, effort = experiment.recorded["joint_state"][:-1], experiment.recorded["joint_effort"][1:, :n]
    v = state[:, n:]
    q = state[:, :n] - 0.5 * step * v - step**2 / 12.0 * held
    time: Array = step * np.arange(len(state), dtype=float)
    columns: dict[str, Array] = {}
    for kind, values in (("q", q), ("v", v), ("u", effort)):
        for index, joint in enumerate(joints):
            column = f"{kind}.{joint}"
            columns[column] = values[:, index] + std.get(column, 0.0) * random.standard_normal(len(time))
    return Recording(name, time, columns | _planner_columns(experiment, time))


def _held(experiment: ExperimentResult, scene: Scene, joints: Sequence[str], step: float) -> Array:
    """The acceleration (N, n) of `joints` by all but their efforts, in the scene's model; 0 for those that it locks."""
    state, effort = experiment.recorded["joint_state"], experiment.recorded["joint_effort"]
    moved = [list(joints).index(name) for name in scene.tree.joint_names]
    q, v = state[:, : len(joints)][:, moved], state[:, len(joints) :][:, moved]
    inertia = mass_matrix(motion(scene.tree, q[:-1], v[:-1])) + np.diag(scene.physics.rotor_inertias)
    by_effort = np.linalg.solve(inertia, effort[1:, moved, None])[..., 0]
    of_step = np.diff(v, axis=0) / step - by_effort
    held = np.zeros((len(of_step), len(joints)))
    held[:, moved] = 0.5 * (of_step + np.concatenate([of_step[:1], of_step[:-1]]))
    return held


def _wrench_columns(
    experiment: ExperimentResult,
    scene: Scene,
    joints: Sequence[str],
    body: str,
    force_std: float,
    random: np.random.Generator,
) -> dict[str, Array]:
    """The wrench on `body` in each row, of the scenario's sensor there or else in the body's frame.

    A row's time lies between two steps of the plant: half of the wrench of each.
    """
    state, acting = experiment.recorded["joint_state"][:-1], experiment.recorded["contact_wrench"]
    place, half = scene.tree.body(body), state.shape[1] // 2
    moved = [list(joints).index(name) for name in scene.tree.joint_names]
    own = WrenchSensor(body, place.joint, place.R_JB, place.p_JB)
    sensor = next((each for each in scene.wrench_sensors if each.joint == place.joint), own)
    moving = motion(scene.tree, state[:, moved], state[:, half:][:, moved])
    reading = sensor.reading(moving, 0.5 * (acting[:-1] + acting[1:]))
    found = {}
    for axis, component in enumerate(WRENCH_COMPONENTS):
        column = f"wrench.{sensor.name}.{component}"
        stated = scene.std(column)
        std = force_std * (LEVER if axis >= 3 else 1.0) if stated is None else stated
        found[column] = reading[:, axis] + std * random.standard_normal(len(reading))
    return found


def _pose_columns(
    experiment: ExperimentResult, scene: Scene, body: str, random: np.random.Generator
) -> dict[str, Array]:
    """X_WB of `body` in each row, half a step of the plant earlier as the joints' positions are."""
    pose = experiment.recorded["tracked_pose"][:-1]
    names = [f"pose.{body}.{component}" for component in POSE_COMPONENTS]
    before = np.concatenate([pose[:1], pose[:-1]])
    place = 0.5 * (before[:, :3] + pose[:, :3])
    place = place + (scene.std(names[0]) or 0.0) * random.standard_normal(place.shape)
    turn_before, turn = (Rotation.from_quat(each[:, [4, 5, 6, 3]]) for each in (before, pose))
    halfway = Rotation.from_rotvec(0.5 * (turn * turn_before.inv()).as_rotvec()) * turn_before
    shaken = Rotation.from_rotvec((scene.std(names[3]) or 0.0) * random.standard_normal(place.shape)) * halfway
    return dict(zip(names, np.concatenate([place, shaken.as_quat()[:, [3, 0, 1, 2]]], axis=1).T, strict=True))


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
