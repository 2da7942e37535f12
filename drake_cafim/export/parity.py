"""Checks an exported model: the same motion in Drake as the corrected scene, and for an MJCF in MuJoCo."""

from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.multibody.tree import RevoluteJoint
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_cafim.corrected.inertia import joint_named
from drake_cafim.dynamics.motion import bias_force, mass_matrix, motion
from drake_cafim.errors import InputError
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

DURATION = 1.0
"""s of the motion."""
STEP = 1e-3
"""s between the samples that are compared."""
SWING = 0.3
"""rad (m): about how far the joints move without a recording."""
SETTLING = 200
"""Steps towards the position at which the robot hangs."""
ACCURACY = 1e-6
LOOK_BACK = 0.05
"""s of a recording from which the state at the start is taken, by a cubic."""


@dataclass(frozen=True)
class Motion:
    """Efforts `u` (N, n) N m or N, held from each of `time` (N,) s on, from positions `q` and velocities `v` (n,)."""

    time: Array
    u: Array
    q: Array
    v: Array


@dataclass(frozen=True)
class Parity:
    """Largest differences of positions over `DURATION`, over the largest motion of the joints of that unit.

    `drake`: the exported scene's from the corrected one's; `mujoco`: the exported file's in MuJoCo, None where it was
    not simulated there, for the reason `why`; `uncorrected`: that of the model as given, for comparison.
    """

    drake: float
    uncorrected: float
    mujoco: float | None
    why: str = ""


def motion_of(scene: Scene, recording: Recording | None) -> Motion:
    """The motion of the check: the recording's efforts from its start, or efforts that swing every joint."""
    joints = scene.tree.joints
    if not joints:
        raise InputError(f"{scene.name}: the model has no joints, expected a robot")
    if recording is not None:
        return _recorded(scene, recording)
    time = np.arange(0.0, DURATION, 0.002)
    q = _hanging(scene)
    inertia, bias = _at_rest(scene, q)
    rate = 2.0 * np.pi * np.linspace(0.6, 1.2, len(q))
    u = bias - SWING * inertia * rate**2 * np.sin(rate * time[:, None])
    return Motion(time, _within_limits(scene, u), q, SWING * rate)


def _hanging(scene: Scene) -> Array:
    """(n,) positions within the limits at which weight pulls little, so that small differences do not grow."""
    limits = np.clip([joint.position_limits for joint in scene.tree.joints], -2.0 * np.pi, 2.0 * np.pi)
    margin = np.minimum(2.0 * SWING, 0.4 * (limits[:, 1] - limits[:, 0]))
    low, high = limits[:, 0] + margin, limits[:, 1] - margin
    q = np.clip(np.full(len(low), SWING), low, high)
    for _ in range(SETTLING):
        inertia, bias = _at_rest(scene, q)
        q = np.clip(q - np.clip(0.02 * bias / inertia, -0.1, 0.1), low, high)
    return np.asarray(q)


def _at_rest(scene: Scene, q: Array) -> tuple[Array, Array]:
    """The inertia that each joint has alone (n,), and the effort (n,) that holds it against gravity."""
    moving = motion(scene.tree, q[None], np.zeros((1, len(q))))
    rotors = np.array([joint.rotor_inertia for joint in scene.tree.joints])
    inertia = np.diag(mass_matrix(moving)[0]) + rotors
    return inertia, bias_force(moving, np.array(scene.scenario.gravity, dtype=float))[0]


def _within_limits(scene: Scene, u: Array) -> Array:
    """The efforts (N, n), no larger than the model's limits, which Drake enforces and a recording need not keep."""
    limits = np.array([joint.effort_limit if joint.effort_limit > 0.0 else np.inf for joint in scene.tree.joints])
    return np.clip(u, -limits, limits)


def _recorded(scene: Scene, recording: Recording) -> Motion:
    names = scene.tree.joint_names
    since = recording.time - recording.time[0]
    q, u = recording.matrix("q", names), recording.matrix("u", names)
    first = (since <= LOOK_BACK) & np.all(np.isfinite(q), axis=1)
    known = np.all(np.isfinite(u), axis=1) & (since < DURATION)
    for rows, kind, until in ((first, "position", LOOK_BACK), (known, "effort", DURATION)):
        if not np.any(rows):
            raise InputError(
                f"{recording.name}: no row of its first {until:g} s has the {kind} of every joint, expected one"
            )
    fit = np.polynomial.polynomial.polyfit(since[first], q[first], min(3, int(np.sum(first)) - 1))
    return Motion(
        since[known],
        _within_limits(scene, u[known]),
        np.asarray(fit[0]),
        np.asarray(fit[1] if len(fit) > 1 else 0.0 * fit[0]),
    )


def in_drake(scene: Scene, moved: Motion) -> Array:
    """(N, n) positions every `STEP` s of the scene in Drake, a continuous plant."""
    builder = DiagramBuilder()
    corrected = scene.add_to(builder, MultibodyPlantConfig(time_step=0.0))
    breaks = np.append(moved.time, max(DURATION, float(moved.time[-1]) + STEP) + 1.0)
    efforts = PiecewisePolynomial.ZeroOrderHold(breaks, np.vstack([moved.u, moved.u[-1:]]).T)
    source = builder.AddSystem(TrajectorySource(efforts))
    builder.Connect(source.get_output_port(), corrected.effort)
    log = LogVectorOutput(corrected.plant.get_state_output_port(), builder, STEP)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    config = SimulatorConfig(integration_scheme="runge_kutta3", accuracy=ACCURACY, max_step_size=STEP)
    ApplySimulatorConfig(config, simulator)
    plant = corrected.plant
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    starts = [plant.GetJointByName(name).position_start() for name in corrected.joints]
    for name, q, v in zip(corrected.joints, moved.q, moved.v, strict=True):
        joint = joint_named(plant, name)
        if isinstance(joint, RevoluteJoint):
            joint.set_angle(context, float(q))
            joint.set_angular_rate(context, float(v))
        else:
            joint.set_translation(context, float(q))
            joint.set_translation_rate(context, float(v))
    simulator.AdvanceTo(DURATION)
    return np.asarray(log.FindLog(simulator.get_context()).data()[starts].T, dtype=float)


def difference(scene: Scene, found: Array, reference: Array) -> float:
    """The largest difference over the largest motion, among joints of one unit; the larger of the two units'."""
    worst = 0.0
    for prismatic in (False, True):
        own = [k for k, joint in enumerate(scene.tree.joints) if joint.prismatic is prismatic]
        if own:
            count = min(len(found), len(reference))
            moved = float(np.max(np.ptp(reference[:count, own], axis=0)))
            apart = float(np.max(np.abs(found[:count, own] - reference[:count, own])))
            worst = max(worst, apart / moved if moved > 0.0 else np.inf)
    return worst
