"""Recordings of joints as whitened weak-form equations of motion: their residual, Jacobian and noise, for fits."""

import weakref
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, Self

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.problem import Problem, prior_rows, prior_std
from drake_cafim.diagnosis.joints.differences import Differences
from drake_cafim.diagnosis.joints.more_noise import noisy_parameters, with_more_effort_noise
from drake_cafim.diagnosis.joints.other_noise import is_other_noise, noise_cost
from drake_cafim.diagnosis.joints.sensor_columns import SensorColumns
from drake_cafim.diagnosis.joints.servo_columns import ServoColumns
from drake_cafim.diagnosis.joints.unknown_columns import UnknownColumns
from drake_cafim.diagnosis.rows.adjustment import adjust
from drake_cafim.diagnosis.rows.initial_uncertainty import has_unknown_start
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import BOUNDED_TIME_SHARE, MISFIT_REDUCED_CHI_SQUARE
from drake_cafim.diagnosis.whitening.covariance import NONE, whitening
from drake_cafim.diagnosis.whitening.force_information import ForceInformation
from drake_cafim.diagnosis.whitening.joint_forces import Forces, WhitenedForces
from drake_cafim.diagnosis.whitening.sampled_noise import KeptJacobian
from drake_cafim.diagnosis.whitening.unmodelled_force import with_unmodelled_force
from drake_cafim.diagnosis.whitening.whitened_run import Run, without_start
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.joint_samples import concatenate
from drake_cafim.effects.kinds import ByKind
from drake_cafim.effects.link import TreeEffect
from drake_cafim.effects.plane import UnmodeledContact
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


@dataclass
class _Latest:
    """The last `problem` that was whitened again, and the `model` by which it was."""

    model: Model | None = None
    problem: "WeakFormRows | None" = None


@dataclass(frozen=True)
class WeakFormRows(Problem):
    """The whitened weak-form rows of a scene's recordings."""

    scene: Scene
    runs: tuple[Run, ...]
    under: Model
    """The model whose noise covariance whitens the rows."""
    unknown_force: Array = field(default_factory=lambda: np.zeros(0))
    """Empty, or (n,) density of unknown white forces at the joints that count as noise, (N m)² s or N² s."""
    found_pushes: list[Any] = field(default_factory=list, repr=False, compare=False)
    """Cache: the last residual that was searched for pushes, and the result."""
    tried_pulses: dict[int, list[Any]] = field(default_factory=dict, repr=False, compare=False)
    """Cache: the pulses that are tested, by recording."""
    force_looks: dict[tuple[str, str], Any] = field(default_factory=dict, repr=False, compare=False)
    """Cache: the last looks at each joint law, with the samples that they are of."""
    force_information: dict[int, ForceInformation] = field(default_factory=dict, repr=False, compare=False)
    """Cache: what the rows tell of forces at the joints, by recording."""
    whitened_forces: WhitenedForces = field(default_factory=WhitenedForces, repr=False, compare=False)
    """Cache: the whitened rows of forces at the joints."""
    _latest: "_Latest" = field(default_factory=lambda: _Latest(), repr=False, compare=False)
    _latest_of_first: "weakref.ref[_Latest] | None" = field(default=None, repr=False, compare=False)

    @classmethod
    def of(cls, scene: Scene, weak: Sequence[WeakForm], model: Model, unknown_force: Array = NONE) -> Self:
        """The problem whitened under `model`."""
        physics = model.physics(scene)
        runs = []
        for form in weak:
            estimated = adjust(form, physics)
            whiten, jacobian = whitening(estimated, physics, unknown_force)
            run = Run(estimated, whiten, jacobian, form, _noise(form, estimated, jacobian))
            # unknown forces are all the forces that count as noise
            runs.append(run if np.any(unknown_force) else with_unmodelled_force(run, physics))
            # what the rows of the estimated motion are made of is computed of that
            form.forget()
        return cls(scene, tuple(runs), model, unknown_force)

    @classmethod
    def as_measured(cls, scene: Scene, weak: Sequence[WeakForm], model: Model, accuracy: float) -> Self:
        """The problem on the samples themselves, no motion estimated: of recordings that may hold mistakes.

        White forces as large as the share `accuracy` of each joint's effort, anew in each test function, are noise.
        """
        runs = []
        for form in weak:
            size = accuracy**2 * np.mean(form.samples.u**2, axis=0)
            whiten, jacobian = whitening(form, model.physics(scene), size * form.samples.windows.spacing)
            runs.append(Run(form, whiten, jacobian))
        return cls(scene, tuple(runs), model)

    def rewhitened(self, model: Model) -> Self:
        """The same recordings, whitened under `model`.

        The last result is cached, of this problem and of all that were rewhitened from it together: if each kept its
        own, the first one would keep them all.
        """
        latest = (self._latest_of_first() if self._latest_of_first else None) or self._latest
        if latest.model is not model:
            latest.model, latest.problem = None, None
            found = self.of(self.scene, self.forms, model, self.unknown_force)
            # weak, since a problem that refers to itself stays in memory until cycles are collected
            latest.model, latest.problem = model, replace(found, _latest_of_first=weakref.ref(latest))
        cached = latest.problem
        assert isinstance(cached, type(self))
        return cached

    @property
    def regressors_noisy(self) -> bool:
        """Whether efforts are measured: their noise is the only one that is left in the Jacobian."""
        labels = ((run, name) for run in self.runs for name in run.jacobian if name.startswith("u."))
        return any(run.weak.samples.std[name] > 0.0 for run, name in labels)

    @cached_property
    def noisier(self) -> Self:
        """The same recordings with the noise of measured efforts added once more, under the same whitening."""
        return type(self)(self.scene, with_more_effort_noise(self.runs), self.under, self.unknown_force)

    def plausible(self, model: Model) -> bool:
        """Whether every effect of `model` acts as its name says, by its values and over all recordings."""
        is_plausible = _Plausible(self, model)
        return all(effect.plausible() and is_plausible(effect) for effect in model.effects)

    @property
    def log_determinant(self) -> float:
        return sum(run.whiten.log_determinant for run in self.runs)

    def rows_of(self, model: Model) -> Array:
        return self.data_rows(model.physics(self.scene))

    def data_rows(self, physics: Physics) -> Array:
        """Whitened rows (R,) of all recordings under `physics`."""
        return np.concatenate([run.residual(physics) for run in self.runs])

    def shared_noise(self, model: Model, residual: Array, jacobian: Array) -> tuple[Array, Array]:
        """ΔJᵀΔz (n,) and ΔJᵀΔJ (n, n) by the noise of measured efforts; motion is estimated, with hardly any noise."""
        if not self.regressors_noisy:
            return super().shared_noise(model, residual, jacobian)
        change = self.noisier.residual(model) - residual
        error = (self.noisier.jacobian(model) - jacobian) * noisy_parameters(model)
        return error.T @ change, error.T @ error

    def penalty(self, model: Model, own_noise: bool = True) -> float:
        physics = model.physics(self.scene)
        start = sum(run.marginalise_start(physics).paid for run in self.runs) if has_unknown_start(physics) else 0.0
        if own_noise and self.has_other_noise(model):
            cost = compute(lambda: noise_cost(self, self.rewhitened(model), model))
            # a body so heavy that a joint's rows vanish, and their noise with them, explains nothing
            return np.inf if isinstance(cost, NotComputable) else start + cost
        return start

    def has_other_noise(self, model: Model) -> bool:
        return is_other_noise(self.scene, self.runs[0].weak, model, self.under)

    @cached_property
    def _by_unknowns(self) -> UnknownColumns:
        # not the own methods: a problem that refers to itself stays in memory until cycles are collected
        differences = Differences(self.scene, self.runs, partial(prior_rows, self.scene))
        servos = ServoColumns(self.scene, self.runs)
        std = partial(prior_std, self.scene)
        return UnknownColumns(differences, std, self._by_sensors, servos, self.whitened_forces)

    @cached_property
    def _by_sensors(self) -> SensorColumns:
        return SensorColumns(self.scene, self.runs, self.under)

    @property
    def forms(self) -> list[WeakForm]:
        """The recordings as measured."""
        return [run.weak if run.measured is None else run.measured for run in self.runs]

    def jacobian(self, model: Model) -> Array:
        columns = self._by_unknowns.of(model)
        slopes = dict(enumerate(map(_ForceSlopes(self, model), model.effects)))
        forces = {position: found for position, found in slopes.items() if found is not None}
        whitened = dict(zip(forces, self.whitened_forces.of(self.runs, list(forces.values())), strict=True))
        columns += [self.effect_columns(model, position, whitened.get(position)) for position in slopes]
        return np.concatenate([np.zeros((self.rows + len(model.unknown), 0)), *columns], axis=1)

    def effect_columns(self, model: Model, position: int, by_force: Array | None = None) -> Array:
        """Whitened rows and prior rows (R + n, k) by the strengths of one of the model's effects.

        Of a force at a joint, `by_force` are its rows (R, k) if they are known, initial states not marginalised.
        """
        effect, physics = model.effects[position], model.physics(self.scene)
        found = _KnownColumns(self, model, position)(effect) if by_force is None else by_force
        if found is None:
            by_strength = self._by_unknowns.differences.by_strength
            return np.stack([by_strength(model, position, k) for k in range(len(effect.strengths))], axis=1)
        found = without_start(self.runs, physics, found)
        return np.concatenate([found, np.zeros((len(model.unknown), found.shape[1]))])

    def joint_columns(self, joint: int, columns: Sequence[Array]) -> Array:
        """Whitened rows (R, k) of forces at a joint at the points of `law_samples`, one (P, k) array a recording."""
        return self.whitened_forces.of(self.runs, [_over_windows(self, joint, columns)])[0]

    def sensor_columns(self, effect: SensorEffect) -> Array:
        """Whitened rows (R, k) by an effect's strengths."""
        return self._by_sensors.of(effect)

    def plane_columns(self, effect: UnmodeledContact, physics: Physics, slopes: bool = True) -> Array:
        """Whitened rows (R, k) by the strengths of a plane; without `slopes`, (R, 1) by its whole force."""
        body = physics.tree.body(effect.at)
        result = []
        for run in self.runs:
            moving = run.weak.motion(physics)
            p_WP, v_WP = moving.point(body.joint, body.p_JB)
            if slopes:
                force = effect.slopes(p_WP, v_WP, moving.lasting)
            else:
                force = effect.force(p_WP, v_WP, None, None, moving.lasting)[..., None]
            # at most times the body does not touch the plane
            touching = np.flatnonzero(np.any(force, axis=(1, 2)))
            along = moving.force_at(body.joint, body.p_JB)
            efforts = np.zeros((*along.shape[:2], force.shape[2]))
            efforts[touching] = along[touching] @ force[touching]
            result.append(run.whitened(run.pushed(efforts, physics.effort_gains)))
        return np.concatenate(result)


def _noise(measured: WeakForm, estimated: WeakForm, jacobian: KeptJacobian) -> Array:
    """J (y − ŷ) (R,), the rows' part by the samples' noise."""
    columns = (measured.samples.recording, estimated.samples.recording)
    # what was not recorded is filled alike in both
    parts = (block @ np.nan_to_num(columns[0][name] - columns[1][name]) for name, block in jacobian.items())
    return np.asarray(sum(parts), dtype=float)


@dataclass(frozen=True)
class _Plausible(ByKind[bool]):
    """Whether an effect of `model` acts as its name says over all recordings of `problem`."""

    problem: WeakFormRows
    model: Model

    @property
    def _leaves_more_than_noise(self) -> bool:
        """Whether the residual is far above noise."""
        rows = self.problem.rows_of(self.model)
        return float(rows @ rows) > MISFIT_REDUCED_CHI_SQUARE * len(rows)

    def other(self, effect: Effect) -> bool:
        return True

    def joint_force(self, effect: JointForce) -> bool:
        scene = self.problem.scene
        served = self.model.physics(scene).bounds_servo(effect)
        physics, joint = self.model.physics_before(scene, effect), scene.tree.joint_index(effect.at)
        together = concatenate([run.weak.joint_samples(physics)[joint] for run in self.problem.runs])
        if not effect.plausible_over(together):
            return False
        if effect.bounds_effort and not served and np.mean(effect.force(together).d_u < 0.0) > BOUNDED_TIME_SHARE:
            return False
        # a law that hardly acts may be real where noise remains, but compensates for something else where more does
        return effect.stands_out(together) or not self._leaves_more_than_noise

    def tree(self, effect: Effect) -> bool:
        return not effect.contradiction_in(self.model.physics(self.problem.scene).tree)

    def obstacle(self, effect: UnmodeledContact) -> bool:
        return touched_and_left(self.problem.runs, effect, self.model.physics(self.problem.scene))


@dataclass(frozen=True)
class _KnownColumns(ByKind[Array | None]):
    """Whitened rows (R, k) by an effect's strengths, analytic; None where finite differences are needed."""

    problem: WeakFormRows
    model: Model
    position: int

    @property
    def physics(self) -> Physics:
        return self.model.physics(self.problem.scene)

    def other(self, effect: Effect) -> None:
        return None

    def tree(self, effect: TreeEffect) -> Array | None:
        if not linear_in_inertias(effect, self.physics):
            return None
        columns, differences = [], self.problem._by_unknowns.differences
        for k in range(len(effect.strengths)):
            up, down, taken = differences.beside(self.model, self.position, k)
            change = change_by_inertias(self.problem, up.physics(self.problem.scene), down.physics(self.problem.scene))
            # a value so large that a step beside it is rounded away has no slope
            columns.append(change / taken if taken else np.zeros(self.problem.rows))
        return np.stack(columns, axis=1)

    def joint_force(self, effect: JointForce) -> Array | None:
        slopes = _ForceSlopes(self.problem, self.model)(effect)
        return None if slopes is None else self.problem.whitened_forces.of(self.problem.runs, [slopes])[0]

    def sensor(self, effect: SensorEffect) -> Array:
        return self.problem.sensor_columns(effect)

    def obstacle(self, effect: UnmodeledContact) -> Array:
        return self.problem.plane_columns(effect, self.physics)


@dataclass(frozen=True)
class _ForceSlopes(ByKind[Forces | None]):
    """The forces at a joint by which an effect changes with its strengths; None where it acts otherwise."""

    problem: WeakFormRows
    model: Model

    def other(self, effect: Effect) -> None:
        return None

    def joint_force(self, effect: JointForce) -> Forces | None:
        physics = self.model.physics(self.problem.scene)
        if physics.bounds_servo(effect):
            return None
        joint = self.problem.scene.tree.joint_index(effect.at)
        laws = [run.weak.terms(physics).acting.force(effect, joint) for run in self.problem.runs]
        return _over_windows(self.problem, joint, [law.d_strengths for law in laws])


def _over_windows(problem: WeakFormRows, joint: int, columns: Sequence[Array]) -> Forces:
    """What forces at a joint at the points of `law_samples`, one (P, k) array a recording, are in the rows."""
    each = zip(problem.runs, columns, strict=True)
    return joint, [-(run.weak.samples.law_value @ column) for run, column in each]


def linear_in_inertias(effect: TreeEffect, physics: Physics) -> bool:
    """Whether `effect` changes inertias alone, and rows are linear in these.

    What a rotor behind an elastic gear does to the rows is not.
    """
    return effect.of_inertia_alone and not physics.couplings


def change_by_inertias(problem: WeakFormRows, ahead: Physics, behind: Physics) -> Array:
    """(R,) change of the whitened rows from `behind` to `ahead`, which differ in inertias alone."""
    return problem._by_unknowns.inertials.change(ahead, behind)


def touched_and_left(runs: Sequence[Run], effect: UnmodeledContact, physics: Physics) -> bool:
    """Whether the body touches the plane and leaves it again over all recordings."""
    body = physics.tree.body(effect.at)
    paths = [run.weak.motion(physics).point(body.joint, body.p_JB)[0] for run in runs]
    return effect.touched_and_left(np.concatenate(paths))
