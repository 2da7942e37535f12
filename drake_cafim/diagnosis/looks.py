"""What joints' recordings may lack, and linear looks at it: how an effect would move their whitened rows."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from drake_cafim.diagnosis.contact_looks import contact_looks
from drake_cafim.diagnosis.fitting import Fit
from drake_cafim.diagnosis.plane_looks import plane_looks
from drake_cafim.diagnosis.pulses import Push, strongest_pushes
from drake_cafim.diagnosis.weak_problem import WeakProblem
from drake_cafim.diagnosis.weak_run import Run
from drake_cafim.effects.actuator import (
    ActuatorDeadZone,
    ActuatorEffect,
    ActuatorSaturation,
)
from drake_cafim.effects.body import AerodynamicDrag, ExternalDisturbance, pulse
from drake_cafim.effects.contact import ContactEffect
from drake_cafim.effects.coupling import JointCoupling, RotorDrive
from drake_cafim.effects.effect import Effect, JointSamples, joined
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.link import TreeEffect
from drake_cafim.effects.plane import UnmodeledContact
from drake_cafim.effects.sensor import SensorEffect, SensorGainError
from drake_cafim.effects.surface import SurfaceEffect
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

LEAST_SIGNAL = 10.0
"""Standard deviations of a sample's noise that a channel's own must be for its gain to be looked for."""
KEPT = 30_000
"""Rows of all recordings up to which looks at joints' laws are kept for the next model they are asked of."""
OF_COMMANDS = (ActuatorSaturation, ActuatorDeadZone)
Look = tuple[Array, Callable[[Array], Effect | None]]


def hypotheses(problem: WeakProblem) -> tuple[Effect, ...]:
    """Every effect of the vocabulary at every place of the scene where it can be."""
    found: list[Effect] = []
    channels = _channels(problem)
    for effect in problem.scene.vocabulary:
        if issubclass(effect, SensorEffect):
            found.extend(effect(place) for place in effect.sites(channels))
        elif issubclass(effect, ContactEffect | SurfaceEffect):
            contacts = problem.scene.physics.contacts
            found.extend(effect(at) for at in dict.fromkeys(effect.site(contact) for contact in contacts))
        elif effect in OF_COMMANDS:
            # an effort that was measured behind the drive has been through its limits and its dead zone
            found.extend(effect(at) for at in effect.places(problem.scene.tree) if f"u.{at}" not in channels)
        else:
            found.extend(effect(place) for place in effect.places(problem.scene.tree))
    return tuple(found)


def _channels(problem: WeakProblem) -> tuple[str, ...]:
    """Columns with noise."""
    return tuple(name for name, _ in problem.runs[0].labels)


def looks(problem: WeakProblem, at: Fit, effect: Effect) -> Iterator[Look]:
    """Whitened columns (R, c) along which the effect moves the rows, and the effect that coefficients stand for."""
    physics = at.model.physics(problem.scene)
    if isinstance(effect, JointForce):
        yield from _force_looks(problem, physics, effect)
    elif isinstance(effect, ActuatorEffect):
        yield from _drive_looks(problem, physics, effect)
    elif isinstance(effect, JointCoupling):
        yield from _coupling_looks(problem, physics, effect)
    elif isinstance(effect, ExternalDisturbance):
        yield from _push_looks(problem, physics, effect, at)
    elif isinstance(effect, UnmodeledContact):
        yield from plane_looks(problem, at, effect)
    elif isinstance(effect, AerodynamicDrag):
        unit = effect.with_values({"coefficient": 1.0})
        yield _drag_columns(problem, physics, unit), effect.from_directions
    elif isinstance(effect, ContactEffect | SurfaceEffect):
        yield from contact_looks(problem, at, effect)
    elif isinstance(effect, SensorGainError) and not _moves(problem, effect.at):
        return
    elif isinstance(effect, SensorEffect):
        yield problem.sensor_columns(effect), effect.from_directions
    elif isinstance(effect, TreeEffect):
        here = at.residual[: problem.rows]
        columns = []
        for direction in effect.directions():
            ahead = problem.data_rows(physics.with_effects([effect.with_values(direction.ahead)]))
            behind = (
                here
                if direction.behind is None
                else problem.data_rows(physics.with_effects([effect.with_values(direction.behind)]))
            )
            columns.append((ahead - behind) / direction.size)
        yield np.stack(columns, axis=1), effect.from_directions


def _moves(problem: WeakProblem, column: str) -> bool:
    """Whether a channel has far more signal than noise: else a larger gain would explain noise by shrinking it.

    Of a wrench it is the prediction that a gain scales.
    """
    if column.startswith("wrench."):
        return True
    pieces = [run.weak.samples.recording[column] for run in problem.runs]
    spread = max(float(np.nanstd(piece)) for piece in pieces)
    return spread > LEAST_SIGNAL * problem.runs[0].weak.samples.std[column]


def _force_looks(problem: WeakProblem, physics: Physics, effect: JointForce) -> Iterator[Look]:
    """The joint law's starts; they see all recordings at once, so that a grid is the same in each."""
    joint = problem.scene.tree.joint_index(effect.at)
    samples = tuple(run.weak.joint_samples(physics)[joint] for run in problem.runs)
    known = problem.force_looks.get(effect.key)
    if known is None or any(one is not other for one, other in zip(known[0], samples, strict=True)):
        known = samples, _force_rows(problem, joint, effect, samples)
        if problem.rows < KEPT:
            problem.force_looks[effect.key] = known
    for rows, shape in known[1]:
        yield rows, partial(effect.from_coefficients, shape=shape)


def _force_rows(
    problem: WeakProblem, joint: int, effect: JointForce, samples: Sequence[JointSamples]
) -> list[tuple[Array, Mapping[str, float]]]:
    """Whitened rows (R, c) of each start, and its shape."""
    starts = list(effect.starts(joined(samples)))
    if not starts:
        return []
    ends = np.cumsum([len(one.q) for one in samples])[:-1]
    all_columns = np.concatenate([start.columns for start in starts], axis=1)
    rows = problem.joint_columns(joint, np.split(all_columns, ends))
    widths = np.cumsum([start.columns.shape[1] for start in starts])[:-1]
    return [(part, start.shape) for part, start in zip(np.split(rows, widths, axis=1), starts, strict=True)]


def _drive_looks(problem: WeakProblem, physics: Physics, effect: ActuatorEffect) -> Iterator[Look]:
    """The actuator's looks, of which only the joint's own rows know."""
    joint = problem.scene.tree.joint_index(effect.at)
    gain = float(physics.effort_gains[joint])
    efforts = [run.weak.effort(physics, joint, run.weak.measurement(physics).u) for run in problem.runs]
    for look in effect.looks(np.concatenate([effort.values for effort in efforts])):
        parts = []
        for run, effort in zip(problem.runs, efforts, strict=True):
            weak, windows = run.weak, run.weak.samples.windows
            here = windows.held(effort.times) @ effort.values
            rows = np.zeros((len(windows), weak.rows_per_window, len(look)))
            for k, step in enumerate(look):
                driven = effect.with_values(step.ahead).drive(effort)
                ahead = windows.held(driven.times) @ driven.values
                behind = here
                if step.behind is not None:
                    driven = effect.with_values(step.behind).drive(effort)
                    behind = windows.held(driven.times) @ driven.values
                rows[:, weak.dynamic.start + joint, k] = -(ahead - behind) / (step.size * gain)
            parts.append(run.whitened(rows))
        yield np.concatenate(parts), partial(effect.from_look, look)


def _coupling_looks(problem: WeakProblem, physics: Physics, effect: JointCoupling) -> Iterator[Look]:
    """The coupling's trials: the rotor simulated with each, which no coefficient can stand for."""
    joint = problem.scene.tree.joint_index(effect.at)
    gain = float(physics.effort_gains[joint])
    drives = [run.weak.rotor_drives(physics)[joint] for run in problem.runs]
    time, push, mobility = (
        np.concatenate([getattr(drive, name) for drive in drives]) for name in ("time", "push", "mobility")
    )
    together = RotorDrive(time, push, mobility, drives[0].inertia)
    trials = list(effect.trials(together, problem.scene.tree.joints[joint].prismatic))
    parts = []
    for run in problem.runs:
        weak = run.weak
        rows = np.zeros((len(weak.samples.windows), weak.rows_per_window, len(trials)))
        for k, values in enumerate(trials):
            rows[:, weak.dynamic.start + joint, k] = weak.trial_rows(physics, effect.with_values(values)) / gain
        parts.append(run.whitened(rows))
    columns = np.concatenate(parts)
    for k, values in enumerate(trials):
        yield columns[:, k : k + 1], partial(_scaled, effect, values)


def _scaled(effect: JointCoupling, values: Mapping[str, float], coefficients: Array) -> Effect | None:
    return effect.scaled(values, float(coefficients[0]))


def _drag_columns(problem: WeakProblem, physics: Physics, unit: AerodynamicDrag) -> Array:
    """Whitened rows (R, 1) of the drag."""
    parts = []
    for run in problem.runs:
        weak = run.weak
        moving = weak.motion(physics)
        force = moving.project(replace(physics, body_forces=(unit,)).body_wrenches(moving))
        parts.append(run.whitened(_pushed_rows(run, physics, force[..., None])))
    return np.concatenate(parts)


def _pushed_rows(run: Run, physics: Physics, force: Array) -> Array:
    """Rows (M, r, k) of generalized forces (N, n, k)."""
    windows, weak = run.weak.samples.windows, run.weak
    rows = np.zeros((len(windows), weak.rows_per_window, force.shape[2]))
    weighed = (windows.value @ force.reshape(len(force), -1)).reshape(len(windows), *force.shape[1:])
    rows[:, weak.dynamic] = -weighed / physics.effort_gains[:, None]
    return rows


def pushes(problem: WeakProblem, at: Fit) -> tuple[list[Push], int]:
    """The strongest pushes of the residual, found once for all bodies."""
    known = problem.found_pushes
    if not known or known[0] is not at.residual:
        known[:] = [at.residual, *strongest_pushes(problem, at.residual)]
    return known[1], known[2]


def _push_looks(problem: WeakProblem, physics: Physics, effect: ExternalDisturbance, at: Fit) -> Iterator[Look]:
    """A pulse along each axis, at the strongest pushes and a little beside them."""
    body = physics.tree.body(effect.at)
    for push in pushes(problem, at)[0][:2]:
        run = problem.runs[push.run]
        time, name, moving = run.weak.samples.time, run.weak.samples.recording.name, run.weak.motion(physics)
        along = moving.force_at(body.joint, body.p_JB + body.R_JB @ effect.point(body))
        start = sum(one.rows for one in problem.runs[: push.run])
        duration = push.stop - push.start
        for center in (-0.15, 0.0, 0.15):
            for width in (0.8, 1.0, 1.25):
                middle = 0.5 * (push.start + push.stop) + center * duration
                interval = {"start": middle - 0.5 * width * duration, "stop": middle + 0.5 * width * duration}
                force = along * pulse(time, interval["start"], interval["stop"])[:, None, None]
                columns = np.zeros((problem.rows, 3))
                columns[start : start + run.rows] = run.whitened(_pushed_rows(run, physics, force))
                yield columns, partial(_pushed, effect.at, interval, name)


def _pushed(at: str, interval: Mapping[str, float], recording: str, peak: Array) -> Effect:
    x, y, z = (float(component) for component in peak)
    return ExternalDisturbance(at, {"x": x, "y": y, "z": z, **interval}, recording)
