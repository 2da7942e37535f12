"""Mistakes of the data that look like physics: a sign turned, joints swapped, an effort without gravity.

A recording that agrees with the model once it is put right needs no missing physics to explain it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.samples import retaken, samples_of
from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.diagnosis.weak_problem import WeakProblem
from drake_cafim.dynamics.motion import bias_force, motion
from drake_cafim.recordings.recording import WRENCH_COMPONENTS, Recording
from drake_cafim.scenario.scene import Scene
from drake_cafim.typing import Array

GLARING = 5.0
"""χ² a row below which no mistake of the data is looked for."""
PUT_RIGHT = 0.2
"""Share of χ² that may be left once a mistake is put right."""
EXCERPT = 600
"""Samples from the middle of a recording that are looked at."""
TRIED = 3


@dataclass(frozen=True)
class Suspicion:
    """What may be wrong with a recording, and its columns put right."""

    sentence: str
    columns: Mapping[str, Array]


def data_mistakes(scene: Scene, recordings: Sequence[Recording], std: dict[str, float]) -> tuple[str, ...]:
    """A sentence for the mistake that all recordings share; empty where there is none."""
    excerpts = [_excerpt(one) for one in recordings]
    given = [_weak(scene, one, std) for one in excerpts]
    problem = WeakProblem.of(scene, given[:1], Model(scene.priors.mean))
    physics = Model(scene.priors.mean).physics(scene)
    rows = problem.data_rows(physics)
    as_given = float(rows @ rows)
    if as_given < GLARING * len(rows):
        return ()
    suspicions = list(_suspicions(scene, excerpts[0], _glaring_joints(scene, given[0], rows)))
    # under the covariance of what was given, for a quick look
    run = problem.runs[0]
    quick = []
    for one in suspicions:
        righted = retaken(given[0].samples, scene, _put_right(excerpts[0], one))
        z = run.whitened(WeakForm(righted, scene.wrench_sensors).residual(physics))
        quick.append(float(z @ z))
    for index in np.argsort(quick)[:TRIED]:
        if quick[index] < as_given and all(
            _explains(scene, std, excerpts[k], given[k], suspicions[index].sentence) for k in range(len(excerpts))
        ):
            return (suspicions[index].sentence,)
    return ()


def _explains(scene: Scene, std: dict[str, float], excerpt: Recording, given: WeakForm, sentence: str) -> bool:
    joints = range(len(scene.tree.joint_names))
    right = next(one for one in _suspicions(scene, excerpt, joints) if one.sentence == sentence)
    before = _chi_square(scene, given)
    return _chi_square(scene, _weak(scene, _put_right(excerpt, right), std)) < PUT_RIGHT * before


def _suspicions(scene: Scene, recording: Recording, joints: Sequence[int]) -> Iterator[Suspicion]:
    names, columns = scene.tree.joint_names, recording.columns
    for j in joints:
        for together in ("u", "v", "q", "qv"):
            turned = [f"{kind}.{names[j]}" for kind in together if f"{kind}.{names[j]}" in columns]
            if len(turned) == len(together):
                yield Suspicion(f"the sign of {' and '.join(turned)} is turned", {c: -columns[c] for c in turned})
    for a in joints:
        for b in joints:
            if a >= b:
                continue
            for together in ("u", "qv", "qvu"):
                present = [kind for kind in together if f"{kind}.{names[a]}" in columns]
                swapped = {f"{kind}.{names[x]}": columns[f"{kind}.{names[y]}"]
                           for kind in present for x, y in ((a, b), (b, a))}  # fmt: skip
                yield Suspicion(f"{' and '.join(present)} of the joints {names[a]} and {names[b]} are swapped", swapped)
    held = _holding_effort(scene, recording)
    lighter = {f"u.{name}": columns[f"u.{name}"] + held[:, j] for j, name in enumerate(names)}
    yield Suspicion("gravity is already taken out of the efforts u", lighter)
    for sensor in scene.wrench_sensors:
        parts = [f"wrench.{sensor.name}.{axis}" for axis in WRENCH_COMPONENTS]
        yield Suspicion(f"the sign of wrench.{sensor.name} is turned", {part: -columns[part] for part in parts})


def _holding_effort(scene: Scene, recording: Recording) -> Array:
    """The efforts (N, n) that hold the nominal robot still against gravity."""
    q = np.nan_to_num(recording.matrix("q", scene.tree.joint_names))
    physics = Model(scene.priors.mean).physics(scene)
    still = motion(physics.tree, q, np.zeros_like(q))
    return bias_force(still, physics.gravity)


def _glaring_joints(scene: Scene, weak: WeakForm, rows: Array) -> list[int]:
    """The joints whose rows are far beyond noise."""
    squares = np.mean(rows.reshape(len(weak.samples.windows), -1) ** 2, axis=0)
    names = scene.tree.joint_names
    dynamic = squares[weak.dynamic]
    kinematic = squares[: weak.kinematic_rows] if weak.kinematic_rows else np.zeros(len(names))
    return [j for j in range(len(names)) if max(dynamic[j], kinematic[j]) > GLARING]


def _excerpt(recording: Recording) -> Recording:
    first = max(0, (len(recording.time) - EXCERPT) // 2)
    part = slice(first, first + EXCERPT)
    columns = {name: values[part] for name, values in recording.columns.items()}
    return replace(recording, time=recording.time[part], columns=columns)


def _put_right(recording: Recording, suspicion: Suspicion) -> Recording:
    return replace(recording, columns={**recording.columns, **suspicion.columns})


def _weak(scene: Scene, recording: Recording, std: dict[str, float]) -> WeakForm:
    return WeakForm(samples_of(scene, recording, std), scene.wrench_sensors)


def _chi_square(scene: Scene, weak: WeakForm) -> float:
    model = Model(scene.priors.mean)
    rows = WeakProblem.of(scene, [weak], model).data_rows(model.physics(scene))
    return float(rows @ rows)
