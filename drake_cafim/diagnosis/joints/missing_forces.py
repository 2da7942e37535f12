"""The forces that a model lacks in each window of a recording: the residual of its equations as means over windows."""

import numpy as np

from drake_cafim.diagnosis.fit.pictures import Channel, WindowMeans
from drake_cafim.diagnosis.joints.location import places_of
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


def channels(problem: WeakFormRows) -> list[Channel]:
    """Label of each row of a window, and the unit of its mean."""
    joints = {joint.name: joint for joint in problem.scene.tree.joints}
    found = []
    for kind, name in places_of(problem):
        if kind == "joint":
            found.append(Channel(f"{name}: forces", joints[name].effort_unit))
        elif name.startswith("v."):
            joint = name.removeprefix("v.")
            found.append(Channel(f"{joint}: q against v", f"{joints[joint].position_unit}/s"))
        else:
            unit = "N m" if name.rsplit(".", 1)[-1].startswith("t") else "N"
            found.append(Channel(name.removeprefix("wrench."), unit))
    return found


def missing_force(weak: WeakForm, physics: Physics) -> Array:
    """(M, r) means over each window, ∫ w r dt / ∫ w dt: a missing force at a joint, or the error of a sensor.

    In the dynamic rows r is ṗ less everything that acts, which a force at the joint would have to supply.
    """
    rows = weak.residual(physics) / weight(weak)[:, None]
    rows[:, weak.dynamic] *= physics.effort_gains
    return np.asarray(rows, dtype=float)


def missing_force_std(run: Run) -> Array:
    """(M, r) standard deviation of `missing_force` by the noise alone."""
    covariance = run.covariance
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return np.asarray(std / weight(run.weak)[:, None], dtype=float)


def weight(weak: WeakForm) -> Array:
    """(M,) s, ∫ w dt of each window's test function w."""
    return np.asarray(weak.samples.windows.value @ np.ones(len(weak.samples.time)), dtype=float)


def window_means(weak: WeakForm, physics: Physics) -> WindowMeans:
    """Means over each window of position, velocity, acceleration and effort, weighted by the test function."""
    windows, measured = weak.samples.windows, weak.measurement(physics)
    area = weight(weak)[:, None]
    return WindowMeans(
        windows.centers,
        windows.value @ measured.q_hat / area,
        windows.value @ measured.v_hat / area,
        -(windows.rate @ measured.v) / area,
        weak.terms(physics).rows.asked / area,
    )
