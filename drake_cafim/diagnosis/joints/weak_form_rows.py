"""Recordings of joints against a scene: equations of motion in their weak form, whitened, as fits ask for them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.joints.differences import Differences
from drake_cafim.diagnosis.joints.more_noise import closed, doses, noisy_numbers, with_more_noise
from drake_cafim.diagnosis.joints.noise_of_reading import Smoothing, as_late
from drake_cafim.diagnosis.rows.initial_uncertainty import has_unknown_start
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import MISFIT_REDUCED_CHI_SQUARE
from drake_cafim.diagnosis.whitening.covariance import NONE, whitening
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.effects.effect import Effect, concatenate
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.kinds import ByKind
from drake_cafim.effects.plane import UnmodeledContact
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


@dataclass(frozen=True)
class WeakFormRows(Problem):
    """Recordings of one scene in weak form: what a fit asks of them."""

    scene: Scene
    runs: tuple[Run, ...]
    under: Model
    """What the rows are whitened under."""
    unknown_force: Array = field(default_factory=lambda: np.zeros(0))
    """(n,) or empty: the density of white forces at the joints that nobody knows, (N m)² s or N² s."""
    found_pushes: list[Any] = field(default_factory=list, repr=False, compare=False)
    """The last residual that was searched for pushes, and what was found."""
    tried_pulses: dict[int, list[Any]] = field(default_factory=dict, repr=False, compare=False)
    """The pulses that are tried, by recording."""
    force_looks: dict[tuple[str, str], Any] = field(default_factory=dict, repr=False, compare=False)
    """The last looks at each joint law, with the samples that they saw."""
    _sensor_columns: dict[tuple[str, str], Array] = field(default_factory=dict, repr=False, compare=False)
    _more_doses: dict[int, tuple[Self, Self]] = field(default_factory=dict, repr=False, compare=False)
    _last_rewhitened: list[tuple[Model, Self]] = field(default_factory=list, repr=False, compare=False)

    @classmethod
    def of(cls, scene: Scene, weak: Sequence[WeakForm], model: Model, unknown_force: Array = NONE) -> Self:
        """The problem whitened under `model`."""
        physics = model.physics(scene)
        runs = []
        for form in weak:
            whiten, jacobian, labels = whitening(form, physics, unknown_force)
            runs.append(Run(form, whiten, jacobian, tuple(labels)))
        return cls(scene, tuple(runs), model, unknown_force)

    def rewhitened(self, model: Model) -> Self:
        """The same recordings under another model's covariance; the last one is kept."""
        if not self._last_rewhitened or self._last_rewhitened[0][0] is not model:
            self._last_rewhitened[:] = [(model, self.of(self.scene, self.forms, model, self.unknown_force))]
        return self._last_rewhitened[0][1]

    @cached_property
    def noisier(self) -> Self:
        """The same recordings with their noise once more on top, under the same whitening."""
        return self._with_more_noise(fed_back=False)

    @cached_property
    def noisier_in_loop(self) -> Self:
        """`noisier` with the efforts that the controller would have made of it.

        The motion that those make obeys the equations, so residuals do not see them; regressors do.
        """
        return self._with_more_noise(fed_back=True) if closed(self.runs) else self.noisier

    def _with_more_noise(self, fed_back: bool, dose: int = 0) -> Self:
        return type(self)(self.scene, with_more_noise(self.runs, fed_back, dose), self.under, self.unknown_force)

    def plausible(self, model: Model) -> bool:
        """Whether every joint effect of the model still is what its name says, over all recordings."""
        asked = _Plausible(self, model)
        return all(effect.plausible() and asked(effect) for effect in model.effects)

    def rows_of(self, model: Model) -> Array:
        return self.data_rows(model.physics(self.scene))

    def data_rows(self, physics: Physics) -> Array:
        """Whitened rows of all recordings."""
        return np.concatenate([run.residual(physics) for run in self.runs])

    def shared_noise(self, model: Model, residual: Array, jacobian: Array) -> tuple[Array, Array]:
        """The first with what a controller makes of the noise, which slopes share with it; the second without.

        Efforts that noise has made are real, and so is what they shake: such slopes are no error, and they inform.
        """
        change = self.noisier.residual(model) - residual
        noisy = noisy_numbers(model)
        error = (self.noisier.jacobian(model) - jacobian) * noisy
        if self.noisier_in_loop is self.noisier:
            return error.T @ change, error.T @ error
        shared = (self.noisier_in_loop.jacobian(model) - jacobian) * noisy
        offsets = [shared.T @ change]
        for dose in range(1, doses(shared, jacobian)):
            quiet, closed = self._dose(dose)
            offsets.append(((closed.jacobian(model) - jacobian) * noisy).T @ (quiet.residual(model) - residual))
        return np.asarray(np.mean(offsets, axis=0)), error.T @ error

    def _dose(self, dose: int) -> tuple[Self, Self]:
        """`noisier` and `noisier_in_loop` with other noise."""
        if dose not in self._more_doses:
            self._more_doses[dose] = (self._with_more_noise(False, dose), self._with_more_noise(True, dose))
        return self._more_doses[dose]

    def penalty(self, model: Model) -> float:
        physics = model.physics(self.scene)
        begun = sum(run.marginalise_start(physics).paid for run in self.runs) if has_unknown_start(physics) else 0.0
        return begun + self._noise_cost(model)

    def _noise_cost(self, model: Model) -> float:
        """What χ² is too small by where the model's lags let less noise through than those of the whitening.

        Undoing a lag raises a channel's noise: explanations with and without one are compared each under its own.
        """
        if as_late(model, self.under):
            return self._smoothing.gained(model)
        rows, own = (one.rows_of(model) for one in (self, self.rewhitened(model)))
        return float(own @ own - rows @ rows)

    @cached_property
    def _smoothing(self) -> Smoothing:
        return Smoothing(self.scene, self.runs, self.under)

    @cached_property
    def _differences(self) -> Differences:
        return Differences(self.scene, self.runs, self.prior_rows)

    @property
    def forms(self) -> list[WeakForm]:
        return [run.weak for run in self.runs]

    def jacobian(self, model: Model) -> Array:
        columns = [self._differences.by_unknown(model, i)[:, None] for i in range(len(model.unknown))]
        columns += [self.effect_columns(model, position) for position in range(len(model.effects))]
        return np.concatenate([np.zeros((self.rows + len(model.unknown), 0)), *columns], axis=1)

    def effect_columns(self, model: Model, position: int) -> Array:
        """Whitened rows and prior rows (R + n, k) by the strengths of one of the model's effects."""
        effect, physics = model.effects[position], model.physics(self.scene)
        found = _KnownColumns(self, physics)(effect)
        if found is None:
            return np.stack(
                [self._differences.by_strength(model, position, k) for k in range(len(effect.strengths))], axis=1
            )
        if has_unknown_start(physics):
            parts = np.split(found, np.cumsum([run.rows for run in self.runs])[:-1])
            found = np.concatenate(
                [run.marginalise_start(physics).without(own) for run, own in zip(self.runs, parts, strict=True)]
            )
        return np.concatenate([found, np.zeros((len(model.unknown), found.shape[1]))])

    def joint_columns(self, joint: int, columns: Sequence[Array]) -> Array:
        """Whitened rows (R, k) of forces at a joint, one (N, k) array a recording."""
        result = []
        for run, column in zip(self.runs, columns, strict=True):
            weak = run.weak
            rows = np.zeros((len(weak.samples.windows), weak.rows_per_window, column.shape[1]))
            rows[:, weak.dynamic.start + joint] = -(weak.samples.windows.value @ column)
            result.append(run.whitened(rows))
        return np.concatenate(result)

    def sensor_columns(self, effect: SensorEffect) -> Array:
        """Whitened rows (R, k) by an effect's strengths, through the rows' slopes in its channels' samples."""
        if effect.key not in self._sensor_columns:
            result = []
            for run in self.runs:
                on = effect.channels([name for name, _ in run.labels])
                change = run.weak.sensor_slopes.of(effect, on)
                result.append(-sum(run.sensed(name, change[:, k]) for k, name in enumerate(on)))
            self._sensor_columns[effect.key] = np.concatenate(result)
        return self._sensor_columns[effect.key]

    def plane_columns(self, effect: UnmodeledContact, physics: Physics, slopes: bool = True) -> Array:
        """Whitened rows (R, k) by the strengths of a plane in the way; without `slopes` of its force itself, (R, 1)."""
        body = physics.tree.body(effect.at)
        result = []
        for run in self.runs:
            moving = run.weak.motion(physics)
            p_WP, v_WP = moving.point(body.joint, body.p_JB)
            if slopes:
                force = effect.slopes(p_WP, v_WP, moving.lasting)
            else:
                force = effect.force(p_WP, v_WP, None, None, moving.lasting)[..., None]
            felt = np.einsum("nja,nak->njk", moving.force_at(body.joint, body.p_JB), force)
            result.append(run.whitened(run.pushed(felt, physics.effort_gains)))
        return np.concatenate(result)


@dataclass(frozen=True)
class _Plausible(ByKind[bool]):
    """Whether an effect of `model` is what its name says over all recordings of `problem`."""

    problem: WeakFormRows
    model: Model

    @property
    def _leaves_more_than_noise(self) -> bool:
        """Whether no noise explains what the model leaves."""
        rows = self.problem.rows_of(self.model)
        return float(rows @ rows) > MISFIT_REDUCED_CHI_SQUARE * len(rows)

    def other(self, effect: Effect) -> bool:
        return True

    def joint_force(self, effect: JointForce) -> bool:
        physics, joint = self.model.physics(self.problem.scene), self.problem.scene.tree.joint_index(effect.at)
        together = concatenate([run.weak.joint_samples(physics)[joint] for run in self.problem.runs])
        if not effect.plausible_over(together):
            return False
        return effect.stands_out(together) or not self._leaves_more_than_noise

    def obstacle(self, effect: UnmodeledContact) -> bool:
        return touched_and_left(self.problem.runs, effect, self.model.physics(self.problem.scene))


@dataclass(frozen=True)
class _KnownColumns(ByKind[Array | None]):
    """Whitened rows (R, k) by an effect's strengths where they are known; None where differences give them."""

    problem: WeakFormRows
    physics: Physics

    def other(self, effect: Effect) -> None:
        return None

    def joint_force(self, effect: JointForce) -> Array:
        joint = self.problem.scene.tree.joint_index(effect.at)
        laws = [effect.force(form.joint_samples(self.physics)[joint]) for form in self.problem.forms]
        return self.problem.joint_columns(joint, [law.d_strengths for law in laws])

    def sensor(self, effect: SensorEffect) -> Array:
        return self.problem.sensor_columns(effect)

    def obstacle(self, effect: UnmodeledContact) -> Array:
        return self.problem.plane_columns(effect, self.physics)


def touched_and_left(runs: Sequence[Run], effect: UnmodeledContact, physics: Physics) -> bool:
    """Whether a plane in the way is one over all recordings."""
    body = physics.tree.body(effect.at)
    paths = [run.weak.motion(physics).point(body.joint, body.p_JB)[0] for run in runs]
    return effect.touched_and_left(np.concatenate(paths))
