"""What a model leaves unexplained in recordings, window by window: in units of the noise, and as forces."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.location import places_of, standardised
from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.diagnosis.weak_problem import WeakProblem
from drake_cafim.diagnosis.weak_run import Run
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


@dataclass(frozen=True)
class ResidualMap:
    """One recording's residual over time × channel, in standard deviations of the noise."""

    recording: str
    time: Array
    """(M,) s, the windows' middles."""
    width: float
    before: Array
    """(M, r) under the model without the effects."""
    after: Array
    """(M, r) with them."""


@dataclass(frozen=True)
class WindowMeans:
    """The motion of one recording averaged over each window: `time` (M,); `q`, `v`, `a`, `u` (M, n)."""

    time: Array
    q: Array
    v: Array
    a: Array
    u: Array


def residual_maps(problem: WeakProblem, before: Physics, after: Physics) -> list[ResidualMap]:
    """The maps of all recordings under two models, whitened alike."""
    return [
        ResidualMap(
            run.weak.samples.recording.name,
            run.weak.samples.windows.centers,
            run.weak.samples.windows.width,
            standardised(run, run.weak.residual(before)),
            standardised(run, run.weak.residual(after)),
        )
        for run in problem.runs
    ]


def row_labels(problem: WeakProblem) -> list[str]:
    """What each row of a window is about, in words."""
    labels = []
    for kind, name in places_of(problem):
        if kind == "sensor" and name.startswith("v."):
            labels.append(f"{name.removeprefix('v.')}: q against v")
        elif kind == "joint":
            labels.append(f"{name}: forces")
        else:
            labels.append(name.removeprefix("wrench."))
    return labels


def row_units(problem: WeakProblem) -> list[str]:
    """The unit of each row's mean over a window."""
    joints = {joint.name: joint for joint in problem.scene.tree.joints}
    units = []
    for kind, name in places_of(problem):
        if kind == "joint":
            units.append(joints[name].effort_unit)
        elif name.startswith("v."):
            units.append(f"{joints[name.removeprefix('v.')].position_unit}/s")
        else:
            units.append("N m" if name.rsplit(".", 1)[-1].startswith("t") else "N")
    return units


def missing(weak: WeakForm, physics: Physics) -> Array:
    """(M, r) means over each window of what the physics lacks: a force at a joint, or a sensor's excess.

    The dynamic rows are those that a force at the joint would have to make up: ṗ less everything that acts.
    """
    rows = weak.residual(physics) / weight(weak)[:, None]
    rows[:, weak.dynamic] *= physics.effort_gains
    return np.asarray(rows, dtype=float)


def missing_std(run: Run) -> Array:
    """(M, r) standard deviation of `missing` by the noise alone."""
    covariance = run.covariance
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return np.asarray(std / weight(run.weak)[:, None], dtype=float)


def weight(weak: WeakForm) -> Array:
    """∫ w dt of each window, (M,) s."""
    return np.asarray(weak.samples.windows.value @ np.ones(len(weak.samples.time)), dtype=float)


def window_means(weak: WeakForm, physics: Physics) -> WindowMeans:
    """Position, velocity, acceleration and effort as the windows see them."""
    windows, measured = weak.samples.windows, weak.measurement(physics)
    area = weight(weak)[:, None]
    return WindowMeans(
        windows.centers,
        windows.value @ measured.q_hat / area,
        windows.value @ measured.v_hat / area,
        -(windows.rate @ measured.v) / area,
        weak.samples.windows.held(weak.samples.time) @ measured.u / area,
    )
