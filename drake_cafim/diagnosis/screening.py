"""Score tests: how much each effect of the catalogue would gain, to first order, with the nuisance projected out."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from drake_cafim.diagnosis.contact_looks import contact_looks
from drake_cafim.diagnosis.fitting import Fit
from drake_cafim.diagnosis.plane_looks import plane_looks
from drake_cafim.diagnosis.problem import Problem, Run
from drake_cafim.diagnosis.pulses import Push, strongest_pushes
from drake_cafim.diagnosis.tosses.looks import hypotheses as toss_hypotheses
from drake_cafim.diagnosis.tosses.looks import looks as toss_looks
from drake_cafim.diagnosis.tosses.problem import TossProblem
from drake_cafim.diagnosis.tosses.pulses import strongest_pushes as strongest_tosses
from drake_cafim.effects.actuator import (
    ActuatorDeadZone,
    ActuatorEffect,
    ActuatorSaturation,
)
from drake_cafim.effects.body import AerodynamicDrag, ExternalDisturbance, pulse
from drake_cafim.effects.contact import ContactEffect
from drake_cafim.effects.coupling import JointCoupling, RotorDrive
from drake_cafim.effects.effect import Effect, joined
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.link import TreeEffect
from drake_cafim.effects.plane import UnmodeledContact
from drake_cafim.effects.sensor import SensorEffect, SensorGainError
from drake_cafim.effects.surface import SurfaceEffect
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Candidate:
    """An effect to start an exact fit from, and what its linear look gains in χ²."""

    effect: Effect
    gain: float
    strengths: int
    trials: int
    """How many shapes were tried to find this one."""


LEAST_SIGNAL = 10.0
"""Standard deviations of a sample's noise that a channel's own must be for its gain to be looked for."""
RAN_AWAY = 1e100
"""A hidden state that was simulated with a value it is not stable for."""
LEAST_ECHO = 8.0
"""Gain of a coupling that is worth asking whether it is an echo of noise."""
OF_COMMANDS = (ActuatorSaturation, ActuatorDeadZone)


def hypotheses(problem: Problem) -> tuple[Effect, ...]:
    """Every effect of the vocabulary at every place of the scene where it can be."""
    if isinstance(problem, TossProblem):
        return toss_hypotheses(problem)
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


def _channels(problem: Problem) -> tuple[str, ...]:
    """Columns with noise."""
    return tuple(name for name, _ in problem.runs[0].labels)


def screen(problem: Problem, at: Fit, effects: Sequence[Effect]) -> list[Candidate]:
    """The candidates by what they gain, largest first, given the fitted model `at`."""
    basis = np.linalg.qr(at.jacobian)[0] if at.jacobian.shape[1] else np.zeros((len(at.residual), 0))
    residual = at.residual - basis @ (basis.T @ at.residual)
    found = []
    for effect in effects:
        candidate = _best_look(problem, at, effect, basis, residual)
        if candidate is not None and isinstance(candidate.effect, JointCoupling) and candidate.gain > LEAST_ECHO:
            candidate = replace(candidate, gain=_without_echo(problem, at, candidate.effect, basis, residual))
        if candidate is not None:
            found.append(candidate)
    return sorted(found, key=lambda candidate: -candidate.gain)


def _best_look(problem: Problem, at: Fit, effect: Effect, basis: Array, residual: Array) -> Candidate | None:
    best: Candidate | None = None
    trials = 0
    for columns, build in looks(problem, at, effect):
        trials += 1
        solved = _projected(columns, basis[: len(columns)], residual[: len(columns)])
        if solved is None:
            continue
        coefficients, gain = solved
        if best is not None and gain <= best.gain:
            continue
        built = build(coefficients)
        # a friction that drives or an inertia below zero is no explanation, however well it fits
        if built is not None and built.plausible():
            best = Candidate(built, gain, len(effect.strengths), 0)
    if isinstance(effect, ExternalDisturbance):
        trials += (strongest_tosses(problem, at) if isinstance(problem, TossProblem) else _pushes(problem, at))[1]
    return None if best is None else Candidate(best.effect, best.gain, best.strengths, trials)


def _without_echo(problem: Problem, at: Fit, effect: JointCoupling, basis: Array, residual: Array) -> float:
    """What the coupling gains beyond what its drive, an effort that a controller made of noise, shares with the noise.

    As in `unbiased_fit`, the shared part is what one more dose of noise changes in both.
    """
    physics = at.model.physics(problem.scene)
    column = _coupling_column(problem, physics, effect)
    louder = _coupling_column(problem.noisier_in_loop, physics, effect)
    noise = problem.noisier.residual(at.model) - at.residual
    noise = noise - basis @ (basis.T @ noise)
    rows = len(column)
    along = basis[:rows].T @ column
    left = float(column @ column - along @ along)
    score = -float(column @ residual[:rows]) + float((louder - column) @ noise[:rows])
    return score**2 / left if score > 0.0 and left > 0.0 else 0.0


def _coupling_column(problem: Problem, physics: Physics, effect: JointCoupling) -> Array:
    """Whitened rows (R,) of a coupling with its values."""
    joint = problem.scene.tree.joint_index(effect.at)
    gain = float(physics.effort_gains[joint])
    parts = []
    for run in problem.runs:
        rows = np.zeros((len(run.weak.samples.windows), run.weak.rows_per_window))
        rows[:, run.weak.dynamic.start + joint] = run.weak.coupling_rows(physics, effect) / gain
        parts.append(run.whitened(rows))
    return np.concatenate(parts)


def _projected(columns: Array, basis: Array, residual: Array) -> tuple[Array, float] | None:
    """Coefficients of `columns` that take most off the residual once the nuisance is projected out, and what they take.

    `residual` is already orthogonal to the nuisance's orthonormal `basis`. None where the nuisance spans the columns.
    """
    if not np.all(np.abs(columns) < RAN_AWAY):
        return None
    full = np.linalg.norm(columns, axis=0)
    unit = columns / np.maximum(full, 1e-300)
    along = basis.T @ unit
    gram = unit.T @ unit - along.T @ along
    left = np.sqrt(np.clip(np.diag(gram), 0.0, None))
    # a direction that the nuisance spans says nothing, nor one that all but rounding leaves alone
    seen = (left > 1e-4) & (full > 1e-8 * np.max(full)) & (full > 0.0)
    if not np.any(seen):
        return None
    scale = left[seen]
    inverse = np.linalg.pinv(gram[np.ix_(seen, seen)] / np.outer(scale, scale), rcond=1e-9, hermitian=True)
    score = unit[:, seen].T @ residual / scale
    solution = -inverse @ score
    coefficients = np.zeros(len(full))
    coefficients[seen] = solution / scale / full[seen]
    return coefficients, float(-score @ solution)


def looks(problem: Problem, at: Fit, effect: Effect) -> Iterator[tuple[Array, Callable[[Array], Effect | None]]]:
    """Whitened columns (R, c) along which the effect moves the rows, and the effect that coefficients stand for."""
    if isinstance(problem, TossProblem):
        yield from toss_looks(problem, at, effect)
        return
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


def _moves(problem: Problem, column: str) -> bool:
    """Whether a channel has far more signal than noise: else a larger gain would explain noise by shrinking it."""
    pieces = [run.weak.samples.recording[column] for run in problem.runs]
    spread = max(float(np.nanstd(piece)) for piece in pieces)
    return spread > LEAST_SIGNAL * problem.runs[0].weak.samples.std[column]


def _force_looks(
    problem: Problem, physics: Physics, effect: JointForce
) -> Iterator[tuple[Array, Callable[[Array], Effect | None]]]:
    """The joint law's starts; they see all recordings at once, so that a grid is the same in each."""
    joint = problem.scene.tree.joint_index(effect.at)
    samples = [run.weak.joint_samples(run.weak.measurement(physics))[joint] for run in problem.runs]
    starts = list(effect.starts(joined(samples)))
    if not starts:
        return
    ends = np.cumsum([len(one.q) for one in samples])[:-1]
    all_columns = np.concatenate([start.columns for start in starts], axis=1)
    rows = problem.joint_columns(joint, np.split(all_columns, ends))
    first = 0
    for start in starts:
        stop = first + start.columns.shape[1]
        yield rows[:, first:stop], partial(effect.from_coefficients, shape=start.shape)
        first = stop


def _drive_looks(
    problem: Problem, physics: Physics, effect: ActuatorEffect
) -> Iterator[tuple[Array, Callable[[Array], Effect | None]]]:
    """The actuator's looks, of which only the joint's own rows know."""
    joint = problem.scene.tree.joint_index(effect.at)
    gain = float(physics.effort_gains[joint])
    efforts = [run.weak.effort(physics, joint, run.weak.measurement(physics).u) for run in problem.runs]
    for look in effect.looks(np.concatenate([effort.values for effort in efforts])):
        parts = []
        for run, effort in zip(problem.runs, efforts, strict=True):
            weak = run.weak
            here = weak.held(effort.times) @ effort.values
            rows = np.zeros((len(weak.samples.windows), weak.rows_per_window, len(look)))
            for k, step in enumerate(look):
                driven = effect.with_values(step.ahead).drive(effort)
                ahead = weak.held(driven.times) @ driven.values
                behind = here
                if step.behind is not None:
                    driven = effect.with_values(step.behind).drive(effort)
                    behind = weak.held(driven.times) @ driven.values
                rows[:, weak.dynamic.start + joint, k] = -(ahead - behind) / (step.size * gain)
            parts.append(run.whitened(rows))
        yield np.concatenate(parts), partial(effect.from_look, look)


def _coupling_looks(
    problem: Problem, physics: Physics, effect: JointCoupling
) -> Iterator[tuple[Array, Callable[[Array], Effect | None]]]:
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


def _drag_columns(problem: Problem, physics: Physics, unit: AerodynamicDrag) -> Array:
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


def _pushes(problem: Problem, at: Fit) -> tuple[list[Push], int]:
    """The strongest pushes of the residual, found once for all bodies."""
    known = problem.found_pushes
    if not known or known[0] is not at.residual:
        known[:] = [at.residual, *strongest_pushes(problem, at.residual)]
    return known[1], known[2]


def _push_looks(
    problem: Problem, physics: Physics, effect: ExternalDisturbance, at: Fit
) -> Iterator[tuple[Array, Callable[[Array], Effect | None]]]:
    """A pulse along each axis, at the strongest pushes and a little beside them."""
    body = physics.tree.body(effect.at)
    for push in _pushes(problem, at)[0][:2]:
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
