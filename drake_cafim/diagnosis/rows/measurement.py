"""The recorded samples of one recording, corrected for sensor effects, and where force laws are evaluated."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.rows.samples import Samples
from drake_cafim.dynamics.contact import WrenchSensor
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.recordings.recording import WRENCH_COMPONENTS
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Measurement:
    """The samples, corrected for sensor effects: `q`, `v`, `u` (N, n), and `wrenches` (N, 6) for each sensor.

    `q_hat`, `v_hat` (N, n) are smoothed; `v_kinked` (N, n) is the velocity at which force laws that may have a kink at
    rest are evaluated.
    """

    q: Array
    v: Array
    u: Array
    q_hat: Array
    v_hat: Array
    v_kinked: Array
    wrenches: tuple[Array, ...]


def corrected_measurement(samples: Samples, sensors: Sequence[WrenchSensor], physics: Physics) -> Measurement:
    """The samples of motion and effort corrected for the sensor effects of `physics`; wrenches as recorded."""
    s = samples
    names = physics.tree.joint_names
    columns = {
        f"{kind}.{name}": values[:, j]
        for kind, values in (("q", s.q), ("v", s.v), ("u", s.u))
        for j, name in enumerate(names)
    }
    columns |= {
        f"wrench.{sensor.name}.{axis}": s.wrenches[i][:, k]
        for i, sensor in enumerate(sensors)
        for k, axis in enumerate(WRENCH_COMPONENTS)
    }
    for effect in physics.sensors:
        on = tuple(name for name in effect.channels(tuple(columns)) if not name.startswith("wrench."))
        if not on:
            continue
        true = effect.true(s.time, np.stack([columns[name] for name in on], axis=1))
        columns |= {name: true[:, k] for k, name in enumerate(on)}
    q = np.stack([columns[f"q.{name}"] for name in names], axis=1)
    u = np.stack([columns[f"u.{name}"] for name in names], axis=1)
    v = (
        s.differentiate @ q
        if s.differentiate is not None
        else np.stack([columns[f"v.{name}"] for name in names], axis=1)
    )
    wrenches = tuple(
        np.stack([columns[f"wrench.{sensor.name}.{a}"] for a in WRENCH_COMPONENTS], axis=1) for sensor in sensors
    )
    if s.estimated is not None:
        q, v = q + s.estimated.missed_q, v + s.estimated.missed_v
        v = v if s.estimated.beyond is None else v + s.estimated.beyond
        return Measurement(q, v, u, q, v, v, wrenches)
    v_hat, v_kinked = (
        np.stack([smoother.of(q[:, j], v[:, j]) for j, smoother in enumerate(smoothers)], axis=1)
        for smoothers in (s.smooth_v, s.kinked_v)
    )
    return Measurement(q, v, u, s.smooth_q @ q, v_hat, v_kinked, wrenches)


def joint_samples_of(samples: Samples, measured: Measurement, v_std: Array) -> tuple[JointSamples, ...]:
    """The samples at which the force laws of joint effects are evaluated, for each joint.

    `v_std` (N, n) is the standard deviation of the velocities of `measured`. A held effort has two values at a sample;
    with their mean, the trapezoid rule integrates it as a staircase. A ramped effort has the recorded value.
    A sample represents an interval in which v changes by D: the mean of sign(v) over it has the slope 2/D at v = 0, as
    if v had an error of standard deviation D/√(2π), which is added to `v_std`.
    """
    mean = 0.5 * (measured.u + np.concatenate([measured.u[:1], measured.u[:-1]]))
    u = np.where(samples.ramped, measured.u, mean)
    v_std = np.sqrt(v_std**2 + np.gradient(measured.v_kinked, axis=0) ** 2 / (2.0 * np.pi))
    q_reach = 0.5 * np.abs(np.gradient(measured.q_hat, axis=0))
    columns = (measured.q_hat, measured.v_kinked, u, v_std, q_reach)
    own = ([np.ascontiguousarray(c[:, j]) for c in columns] for j in range(samples.q.shape[1]))
    return tuple(JointSamples(q, v, effort, std, reach, in_order=True) for q, v, effort, std, reach in own)
