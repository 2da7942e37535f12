"""Hypotheses for recordings of joints, and their first-order tests (looks): columns by which effects move the rows."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.pushes import Push, push_over, search_once
from drake_cafim.diagnosis.fit.search_problem import Look, Looks
from drake_cafim.diagnosis.joints.joint_force_columns import JointForceColumns
from drake_cafim.diagnosis.joints.linearised_contact_effects import contact_looks, surface_looks
from drake_cafim.diagnosis.joints.plane_candidates import plane_looks
from drake_cafim.diagnosis.joints.pulses import strongest_pushes
from drake_cafim.diagnosis.joints.servo_looks import driving, servo_looks
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows, change_by_inertias, linear_in_inertias
from drake_cafim.diagnosis.thresholds import GAIN_SIGNAL_IN_NOISE_STDS, RESTING_SCATTER_IN_NOISE_STDS
from drake_cafim.diagnosis.whitening.whitened_run import Run, without_start
from drake_cafim.effects.actuator import ActuatorEffect
from drake_cafim.effects.body import BodyForce, ExternalDisturbance, pulse
from drake_cafim.effects.contact import ContactEffect
from drake_cafim.effects.coupling import JointCoupling, RotorDrive
from drake_cafim.effects.effect import Effect, Start
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.joint_samples import JointSamples, concatenate
from drake_cafim.effects.kinds import ByKind
from drake_cafim.effects.link import TreeEffect
from drake_cafim.effects.plane import UnmodeledContact
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.effects.servo_effect import ServoEffect
from drake_cafim.effects.surface import SurfaceEffect
from drake_cafim.effects.surroundings import Surroundings
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.unknown import inertials
from drake_cafim.typing import Array

CACHED_ROWS = 50_000
"""Largest number of rows of all recordings at which the looks at joint laws are cached, to limit memory."""
AT_ONCE = 32
"""Columns of a joint law that are integrated over the windows at once."""


def hypotheses(problem: WeakFormRows) -> tuple[Effect, ...]:
    """Every effect of the scene's vocabulary at every place where it can act."""
    columns = tuple(problem.runs[0].jacobian)
    scene = problem.scene
    links = tuple(inertials(scene.unknown))
    where = Surroundings(scene.physics.tree, scene.physics.contacts, columns, inertials=links, servos=driving(problem))
    return tuple(effect(at) for effect in scene.vocabulary for at in effect.attachments(where))


def looks(problem: WeakFormRows, at: Fit, effect: Effect) -> Looks:
    """First-order tests of `effect` beyond the fitted model `at`; none where the recordings cannot tell of it."""
    if effect.needs_motion and _rests(problem, effect):
        return Looks(iter(()))
    return _LooksByKind(problem, at)(effect)


@dataclass(frozen=True)
class _LooksByKind(ByKind[Looks]):
    """Builds the looks at an effect of each kind: whitened columns (R, c), and the effect for their coefficients."""

    problem: WeakFormRows
    at: Fit

    @property
    def _physics(self) -> Physics:
        return self.at.model.physics(self.problem.scene)

    def joint_force(self, effect: JointForce) -> Looks:
        return Looks(_force_looks(self.problem, self._physics, effect))

    def actuator(self, effect: ActuatorEffect) -> Looks:
        return Looks(_drive_looks(self.problem, self._physics, effect))

    def coupling(self, effect: JointCoupling) -> Looks:
        return Looks(_coupling_looks(self.problem, self._physics, effect))

    def push(self, effect: ExternalDisturbance) -> Looks:
        tried = pushes(self.problem, self.at)[1]
        return Looks(_push_looks(self.problem, self._physics, effect, self.at), tried)

    def obstacle(self, effect: UnmodeledContact) -> Looks:
        return Looks(plane_looks(self.problem, self.at, effect))

    def body_force(self, effect: BodyForce) -> Looks:
        if effect.linear != tuple(strength.name for strength in effect.strengths):
            return Looks(_difference_looks(self.problem, self._physics, self.at, effect))
        units = (effect.with_values({**dict.fromkeys(effect.linear, 0.0), name: 1.0}) for name in effect.linear)
        columns = [_body_force_columns(self.problem, self._physics, unit) for unit in units]
        return Looks(iter([(np.concatenate(columns, axis=1), effect.from_directions)]))

    def contact(self, effect: ContactEffect) -> Looks:
        return Looks(contact_looks(self.problem, self.at, effect))

    def surface(self, effect: SurfaceEffect) -> Looks:
        return Looks(surface_looks(self.problem, self.at, effect))

    def sensor(self, effect: SensorEffect) -> Looks:
        if effect.needs_signal and not _moves(self.problem, effect.at):
            return Looks(iter(()))
        return Looks(iter([(self.problem.sensor_columns(effect), effect.from_directions)]))

    def servo(self, effect: ServoEffect) -> Looks:
        return Looks(servo_looks(self.problem, self._physics, self.at, effect))

    def tree(self, effect: TreeEffect) -> Looks:
        physics = self._physics
        # friction that follows a load changes with the masses, too
        if linear_in_inertias(effect, physics) and not physics.depends_on_load:
            return Looks(_inertial_looks(self.problem, physics, effect))
        return Looks(_difference_looks(self.problem, physics, self.at, effect))


def _difference_looks(problem: WeakFormRows, physics: Physics, at: Fit, effect: Effect) -> Iterator[Look]:
    """The looks along the effect's directions, by differences of all rows."""
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


def _inertial_looks(problem: WeakFormRows, physics: Physics, effect: TreeEffect) -> Iterator[Look]:
    """The looks at an effect that changes inertias alone, along its directions."""
    columns = []
    for direction in effect.directions():
        ahead, behind = (
            physics if values is None else physics.with_effects([effect.with_values(values)])
            for values in (direction.ahead, direction.behind)
        )
        columns.append(change_by_inertias(problem, ahead, behind) / direction.size)
    yield without_start(problem.runs, physics, np.stack(columns, axis=1)), effect.from_directions


def _moves(problem: WeakFormRows, column: str) -> bool:
    """Whether a channel has far more signal than noise: else a small gain would fit by shrinking the noise.

    True of a wrench, where the gain scales the prediction and not the noisy reading.
    """
    if column.startswith("wrench."):
        return True
    pieces = [run.weak.samples.recording[column] for run in problem.runs]
    spread = max(float(np.nanstd(piece)) for piece in pieces)
    return spread > GAIN_SIGNAL_IN_NOISE_STDS * problem.runs[0].weak.samples.std[column]


def _rests(problem: WeakFormRows, effect: Effect) -> bool:
    """Whether the joint of `effect`, or of its channel, moves by little more than noise in all recordings."""
    kind, _, joint = effect.at.rpartition(".")
    if joint not in problem.scene.tree.joint_names or kind not in ("", "q", "v"):
        return False
    samples = [run.weak.samples if run.measured is None else run.measured.samples for run in problem.runs]
    columns = [f"{kind}.{joint}" for kind in ("qv" if samples[0].velocity_measured else "q")]
    return all(
        float(np.nanstd(own.recording[column])) <= RESTING_SCATTER_IN_NOISE_STDS * own.std[column]
        for own in samples
        for column in columns
    )


def _force_looks(problem: WeakFormRows, physics: Physics, effect: JointForce) -> Iterator[Look]:
    """The looks at a joint law, from all recordings at once so that its grid is the same in each."""
    joint = problem.scene.tree.joint_index(effect.at)
    samples = tuple(run.weak.law_samples(physics)[joint] for run in problem.runs)
    known = problem.force_looks.get(effect.key)
    if known is None or any(sample is not other for sample, other in zip(known[0], samples, strict=True)):
        found = _force_rows(problem, effect, samples)
        # of long recordings the columns of a few starts at a time are held
        known = samples, list(found) if problem.rows < CACHED_ROWS else found
        if problem.rows < CACHED_ROWS:
            problem.force_looks[effect.key] = known
    # not the columns are cached: they refer to the problem, which would stay in memory until cycles are collected
    for forces, products, shape in known[1]:
        yield JointForceColumns(problem, joint, forces, products), partial(effect.from_coefficients, shape=shape)


def _force_rows(
    problem: WeakFormRows, effect: JointForce, samples: Sequence[JointSamples]
) -> Iterator[tuple[Array, list[Array], Mapping[str, float]]]:
    """The integrals (ΣM, c) over the windows of each start of the law, room for their products, and its shape."""
    ends = np.cumsum([len(sample.q) for sample in samples])[:-1]
    for some in _batches(effect.starts(concatenate(samples))):
        pieces = np.split(np.concatenate([start.columns for start in some], axis=1), ends)
        # forces are subtracted in the equations of motion
        integrals = [-(run.weak.samples.law_value @ piece) for run, piece in zip(problem.runs, pieces, strict=True)]
        cuts = np.cumsum([start.columns.shape[1] for start in some])[:-1]
        for start, forces in zip(some, np.split(np.concatenate(integrals), cuts, axis=1), strict=True):
            yield forces, [], start.shape


def _batches(starts: Iterable[Start]) -> Iterator[list[Start]]:
    """The `starts`, as many at a time as have `AT_ONCE` columns together."""
    some: list[Start] = []
    for start in starts:
        some.append(start)
        if sum(other.columns.shape[1] for other in some) >= AT_ONCE:
            yield some
            some = []
    if some:
        yield some


def _drive_looks(problem: WeakFormRows, physics: Physics, effect: ActuatorEffect) -> Iterator[Look]:
    """The looks at an actuator effect, which enters only the rows of its own joint."""
    joint = problem.scene.tree.joint_index(effect.at)
    gain = float(physics.effort_gains[joint])
    efforts = [run.weak.terms(physics).driven.effort(physics, joint) for run in problem.runs]
    for look in effect.looks(np.concatenate([effort.values for effort in efforts])):
        parts = []
        for run, effort in zip(problem.runs, efforts, strict=True):
            windows = run.weak.samples.windows
            here = windows.integrate_held(effort.times, effort.values, effort.ramped)
            forces = np.zeros((len(windows), len(look)))
            for k, step in enumerate(look):
                driven = effect.with_values(step.ahead).drive(effort)
                ahead = windows.integrate_held(driven.times, driven.values, driven.ramped)
                behind = here
                if step.behind is not None:
                    driven = effect.with_values(step.behind).drive(effort)
                    behind = windows.integrate_held(driven.times, driven.values, driven.ramped)
                # efforts are subtracted in the equation of motion
                forces[:, k] = -(ahead - behind) / (step.size * gain)
            parts.append(forces)
        yield JointForceColumns(problem, joint, np.concatenate(parts)), partial(effect.from_look, look)


def _coupling_looks(problem: WeakFormRows, physics: Physics, effect: JointCoupling) -> Iterator[Look]:
    """The looks at a coupling: the rotor is simulated with each trial value, since the rows are not linear in them."""
    joint = problem.scene.tree.joint_index(effect.at)
    gain = float(physics.effort_gains[joint])
    drives = [run.weak.couplings.rotor_drives(physics)[joint] for run in problem.runs]
    time, push, mobility = (
        np.concatenate([getattr(drive, name) for drive in drives]) for name in ("time", "push", "mobility")
    )
    together = RotorDrive(time, push, mobility, drives[0].inertia)
    trials = list(effect.trials(together, problem.scene.tree.joints[joint].prismatic))
    for values in trials:
        tried = effect.with_values(values)
        forces = np.concatenate([run.weak.couplings.trial_rows(physics, tried) for run in problem.runs]) / gain
        yield JointForceColumns(problem, joint, forces[:, None]), partial(_scaled, effect, values)


def _scaled(effect: JointCoupling, values: Mapping[str, float], coefficients: Array) -> Effect | None:
    return effect.from_trial(values, float(coefficients[0]))


def _body_force_columns(problem: WeakFormRows, physics: Physics, unit: BodyForce) -> Array:
    """Whitened column (R, 1) of a force on a body."""
    parts = []
    for run in problem.runs:
        weak = run.weak
        moving = weak.motion(physics)
        force = moving.project(replace(physics, body_forces=(unit,)).body_wrenches(moving))
        parts.append(run.whitened(_force_on_rows(run, physics, force[..., None])))
    return np.concatenate(parts)


def _force_on_rows(run: Run, physics: Physics, force: Array) -> Array:
    """Rows (M, r, k) of generalized forces (N, n, k)."""
    windows, weak = run.weak.samples.windows, run.weak
    rows = np.zeros((len(windows), weak.rows_per_window, force.shape[2]))
    weighed = (windows.value @ force.reshape(len(force), -1)).reshape(len(windows), *force.shape[1:])
    rows[:, weak.dynamic] = -weighed / physics.effort_gains[:, None]
    return rows


def pushes(problem: WeakFormRows, at: Fit) -> tuple[list[Push], int]:
    """The strongest pulses of force at the joints in the residual of `at`, cached, and the number of those tested."""
    return search_once(problem.found_pushes, at.residual, lambda: strongest_pushes(problem, at.residual))


def _push_looks(problem: WeakFormRows, physics: Physics, effect: ExternalDisturbance, at: Fit) -> Iterator[Look]:
    """Looks at a push on a body: pulses along three axes over the strongest pushes' intervals and nearby ones."""
    body = physics.tree.body(effect.at)
    for push in pushes(problem, at)[0][:2]:
        run = problem.runs[push.run]
        time, name, moving = run.weak.samples.time, run.weak.samples.recording.name, run.weak.motion(physics)
        along = moving.force_at(body.joint, body.p_JB + body.R_JB @ effect.point(body))
        start = sum(other.rows for other in problem.runs[: push.run])
        for interval in push.intervals():
            force = along * pulse(time, *interval)[:, None, None]
            columns = np.zeros((problem.rows, 3))
            columns[start : start + run.rows] = run.whitened(_force_on_rows(run, physics, force))
            yield columns, partial(push_over, effect, interval, name)
