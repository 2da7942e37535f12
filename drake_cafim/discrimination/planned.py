"""Planned motions as the recordings that the nominal model predicts, with their whitened rows."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.noise.coloured import stated_memories
from drake_cafim.diagnosis.rows.samples import Samples, samples_of, with_recording
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import LAW_ACCURACY
from drake_cafim.discrimination.motions import Motion
from drake_cafim.dynamics.motion import motion
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import WRENCH_COMPONENTS, Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


def noise_of(scene: Scene) -> dict[str, float]:
    """The noise std of each channel of a future recording, SI units.

    Raises `InputError` where the scenario does not state it, since the design needs the noise level.
    """
    names = scene.tree.joint_names
    columns = [f"q.{name}" for name in names]
    if all(scene.std(f"v.{name}") is not None for name in names):
        columns += [f"v.{name}" for name in names]
    columns += [f"wrench.{sensor.name}.{axis}" for sensor in scene.wrench_sensors for axis in WRENCH_COMPONENTS]
    found: dict[str, float] = {}
    for column in columns:
        std = scene.std(column)
        if std is None or not std > 0.0:
            raise InputError(
                f"{scene.name}: channel {column} has no std, and a design needs the noise; state it under channels, or "
                "give the report.json of a diagnosis, which estimates it"
            )
        found[column] = std
    return found | {f"u.{name}": scene.std(f"u.{name}") or 0.0 for name in names}


def recording_of(scene: Scene, planned: Motion, std: Mapping[str, float], name: str) -> Recording:
    """The noiseless recording of the planned motion that the nominal model predicts."""
    names = scene.tree.joint_names
    columns = {f"q.{joint}": planned.q[:, j] for j, joint in enumerate(names)}
    if f"v.{names[0]}" in std:
        columns |= {f"v.{joint}": planned.v[:, j] for j, joint in enumerate(names)}
    columns |= driving_columns(scene, planned)
    if scene.wrench_sensors:
        moving = motion(scene.tree, planned.q, planned.v)
        physics = scene.physics
        wrench = physics.contact_wrenches(moving, physics.contact_memory(planned.time, moving, moving))
        for sensor in scene.wrench_sensors:
            reading = sensor.reading(moving, wrench[:, sensor.joint])
            columns |= {f"wrench.{sensor.name}.{axis}": reading[:, k] for k, axis in enumerate(WRENCH_COMPONENTS)}
    return Recording(name, planned.time, columns)


def driving_columns(scene: Scene, run: Motion) -> dict[str, Array]:
    """The commands of the joints that a servo drives, and the efforts of the others."""
    driven = {servo.joint for servo in scene.physics.servos} if run.cmd is not None else set()
    names = scene.tree.joint_names
    return {
        f"cmd.{name}" if name in driven else f"u.{name}": (
            run.cmd[:, j] if run.cmd is not None and name in driven else run.u[:, j]
        )
        for j, name in enumerate(names)
    }


@dataclass(frozen=True)
class Bench:
    """Windows, smoothing matrices and effort weights, which all motions on the same time grid share."""

    scene: Scene
    samples: Samples

    @classmethod
    def of(cls, scene: Scene, planned: Motion) -> "Bench":
        """The bench for motions on the time grid of `planned`."""
        std = noise_of(scene)
        return cls(scene, _samples(scene, recording_of(scene, planned, std, "planned"), std))

    def problem(self, planned: Motion, like: WeakProblem | None = None) -> WeakProblem:
        """The planned motion's rows, whitened under the nominal model.

        With `like`, the whitening of another motion on this bench is reused, which saves most of the computation and is
        nearly exact without contacts. The rows' derivatives in the samples are then that motion's as well.
        """
        return self.reading(recording_of(self.scene, planned, self.samples.std, "planned"), like)

    def reading(self, recording: Recording, like: WeakProblem | None = None) -> WeakProblem:
        """The whitened rows of a recording on this bench's time grid; `like` as for `problem`."""
        scene = self.scene
        weak = WeakForm(with_recording(self.samples, scene, recording), scene.wrench_sensors)
        if like is not None:
            return WeakProblem(scene, (replace(like.runs[0], weak=weak),), like.under)
        return _whitened(scene, [weak])


def problem_of(scene: Scene, runs: list[Recording]) -> WeakProblem:
    """The recordings' rows, whitened under the nominal model and the stated noise."""
    std = noise_of(scene)
    return _whitened(scene, [WeakForm(_samples(scene, run, std), scene.wrench_sensors) for run in runs])


def _whitened(scene: Scene, weak: list[WeakForm]) -> WeakProblem:
    """The rows whitened under the nominal model; forces that are as large as its laws are accurate count as noise.

    A diagnosis counts as many of them as a recording shows, up to this size. A run of either explanation would show the
    effect that the nominal model lacks, and a plan, which is noiseless, nothing: of both it is the size here.
    """
    efforts = np.mean([np.mean(form.mean_effort(scene.physics) ** 2, axis=0) for form in weak], axis=0)
    spacing = float(np.mean([form.samples.windows.spacing for form in weak]))
    return WeakProblem.of(scene, weak, Model(scene.priors.mean), LAW_ACCURACY**2 * efforts * spacing)


def _samples(scene: Scene, recording: Recording, std: dict[str, float]) -> Samples:
    return samples_of(scene, recording, std, memories=stated_memories(scene, list(std)))
