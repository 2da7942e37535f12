"""Recordings of joints against a scene: equations of motion in their weak form, whitened."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from drake_cafim.diagnosis.beginning import doubtful
from drake_cafim.diagnosis.evidence import MISFIT
from drake_cafim.diagnosis.facing import lags_of
from drake_cafim.diagnosis.feedback import Feedback
from drake_cafim.diagnosis.model import Model
from drake_cafim.diagnosis.problem import Problem
from drake_cafim.diagnosis.reading import Reading, shifts_of
from drake_cafim.diagnosis.samples import noisier, over_wider_windows
from drake_cafim.diagnosis.weak_form import WeakForm
from drake_cafim.diagnosis.weak_run import Run
from drake_cafim.diagnosis.whitening import NONE, whitening
from drake_cafim.effects.contact import ContactEffect
from drake_cafim.effects.coupling import JointBacklash
from drake_cafim.effects.effect import Effect, joined
from drake_cafim.effects.joint import JointForce
from drake_cafim.effects.plane import UnmodeledContact
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.effects.surface import SurfaceEffect
from drake_cafim.effects.timing import TimingEffect
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.scene import Scene
from drake_cafim.typing import Array

OF_CONTACTS = (ContactEffect, SurfaceEffect)
SAME_LAG = 0.2
"""Of a time constant, by which two lags raise a channel's noise alike."""
DOSES, DRAWN = 8, 0.25
"""Of noise, at most; and what is left of chance in the mean of them, of the information."""


@dataclass(frozen=True)
class WeakProblem(Problem):
    """Recordings of one scene in weak form."""

    scene: Scene
    runs: tuple[Run, ...]
    under: Model
    """What the rows are whitened under."""
    unknown_force: Array = field(default_factory=lambda: np.zeros(0))
    """(n,) or empty: the density of white forces at the joints that nobody knows, (N m)² s or N² s."""
    _unknown_columns: dict[int, tuple[Any, Array]] = field(default_factory=dict, repr=False, compare=False)
    found_pushes: list[Any] = field(default_factory=list, repr=False, compare=False)
    """The last residual that was searched for pushes, and what was found."""
    tried_pulses: dict[int, list[Any]] = field(default_factory=dict, repr=False, compare=False)
    """The pulses that are tried, by recording."""
    force_looks: dict[tuple[str, str], Any] = field(default_factory=dict, repr=False, compare=False)
    """The last looks at each joint law, with the samples that they saw."""
    _readings: dict[int, Reading] = field(default_factory=dict, repr=False, compare=False)
    """How channels enter each recording's rows, where an explanation reads them between their samples."""
    _sensor_columns: dict[tuple[str, str], Array] = field(default_factory=dict, repr=False, compare=False)
    _more_doses: dict[int, tuple["WeakProblem", "WeakProblem"]] = field(default_factory=dict, repr=False, compare=False)
    _last_rewhitened: list[tuple[Model, "WeakProblem"]] = field(default_factory=list, repr=False, compare=False)

    @classmethod
    def of(cls, scene: Scene, weak: Sequence[WeakForm], model: Model, unknown_force: Array = NONE) -> "WeakProblem":
        """The problem whitened under `model`."""
        physics = model.physics(scene)
        runs = []
        for form in weak:
            whiten, jacobian, labels = whitening(form, physics, unknown_force)
            runs.append(Run(form, whiten, jacobian, tuple(labels)))
        return cls(scene, tuple(runs), model, unknown_force)

    def rewhitened(self, model: Model) -> "WeakProblem":
        """The same recordings under another model's covariance; the last one is kept."""
        if not self._last_rewhitened or self._last_rewhitened[0][0] is not model:
            self._last_rewhitened[:] = [(model, WeakProblem.of(self.scene, self._forms, model, self.unknown_force))]
        return self._last_rewhitened[0][1]

    def shaken(self, model: Model, unknown_force: Array) -> "WeakProblem":
        """The same recordings, whitened under `model`, with other forces that nobody knows."""
        return WeakProblem.of(self.scene, self._forms, model, unknown_force)

    def over_wider_windows(self, times: float) -> "WeakProblem | None":
        """The same recordings under windows `times` as wide; None where too few of them fit in one."""
        wide = [over_wider_windows(form.samples, times) for form in self._forms]
        forms = [WeakForm(own, form.sensors) for own, form in zip(wide, self._forms, strict=True) if own is not None]
        return WeakProblem.of(self.scene, forms, self.under) if len(forms) == len(wide) else None

    @cached_property
    def noisier(self) -> "WeakProblem":
        """The same recordings with their noise once more on top, under the same whitening."""
        return self._with_more_noise(fed_back=False)

    @cached_property
    def noisier_in_loop(self) -> "WeakProblem":
        """`noisier` with the efforts that the controller would have made of it.

        The motion that those make obeys the equations, so residuals do not see them; regressors do.
        """
        return self._with_more_noise(fed_back=True) if self._closed else self.noisier

    @property
    def _closed(self) -> bool:
        """Whether any recording's efforts are a controller's that hands noise on."""
        every = (run.weak.samples for run in self.runs)
        return any(np.any(Feedback.of(samples.q, samples.v, samples.u).gains) for samples in every)

    def _with_more_noise(self, fed_back: bool, dose: int = 0) -> "WeakProblem":
        runs = []
        for index, run in enumerate(self.runs):
            samples = noisier(run.weak.samples, np.random.default_rng(index + dose * len(self.runs)), fed_back)
            runs.append(replace(run, weak=WeakForm(samples, run.weak.sensors)))
        return WeakProblem(self.scene, tuple(runs), self.under, self.unknown_force)

    @property
    def log_determinant(self) -> float:
        return sum(run.whiten.log_determinant for run in self.runs)

    def plausible(self, model: Model) -> bool:
        """Whether every joint effect of the model still is what its name says, over all recordings."""
        physics = model.physics(self.scene)
        for effect in model.effects:
            if not effect.plausible():
                return False
            if isinstance(effect, JointForce):
                joint = self.scene.tree.joint_index(effect.at)
                samples = [run.weak.joint_samples(physics)[joint] for run in self.runs]
                together = joined(samples)
                if not effect.plausible_over(together):
                    return False
                if not effect.stands_out(together) and self.leaves_more_than_noise(model):
                    return False
            if isinstance(effect, UnmodeledContact) and not self.touched_and_left(effect, physics):
                return False
        return True

    def leaves_more_than_noise(self, model: Model) -> bool:
        """Whether no noise explains what the model leaves."""
        rows = self.rows_of(model)
        return float(rows @ rows) > MISFIT * len(rows)

    def touched_and_left(self, effect: UnmodeledContact, physics: Physics) -> bool:
        """Whether a plane in the way is one over all recordings."""
        body = physics.tree.body(effect.at)
        paths = [run.weak.motion(physics).point(body.joint, body.p_JB)[0] for run in self.runs]
        return effect.touched_and_left(np.concatenate(paths))

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
        noisy = _noisy(model)
        error = (self.noisier.jacobian(model) - jacobian) * noisy
        if self.noisier_in_loop is self.noisier:
            return error.T @ change, error.T @ error
        shared = (self.noisier_in_loop.jacobian(model) - jacobian) * noisy
        offsets = [shared.T @ change]
        for dose in range(1, doses(shared, jacobian)):
            quiet, closed = self._dose(dose)
            offsets.append(((closed.jacobian(model) - jacobian) * noisy).T @ (quiet.residual(model) - residual))
        return np.asarray(np.mean(offsets, axis=0)), error.T @ error

    def _dose(self, dose: int) -> tuple["WeakProblem", "WeakProblem"]:
        """`noisier` and `noisier_in_loop` with other noise."""
        if dose not in self._more_doses:
            self._more_doses[dose] = (self._with_more_noise(False, dose), self._with_more_noise(True, dose))
        return self._more_doses[dose]

    def penalty(self, model: Model) -> float:
        physics = model.physics(self.scene)
        begun = sum(run.begun(physics).paid for run in self.runs) if doubtful(physics) else 0.0
        return begun + self._noise_cost(model)

    def _smoothed(self, model: Model) -> float:
        """What χ² is too small by where channels are read between their samples, against those of the whitening."""
        physics, under = model.physics(self.scene), self.under.physics(self.scene)
        total = 0.0
        for index, run in enumerate(self.runs):
            if shifts_of(run.weak.samples, physics) != shifts_of(run.weak.samples, under):
                reading = self._reading(index)
                total += reading.gained(physics) - reading.gained(under)
        return total

    def _reading(self, index: int) -> Reading:
        """What a recording's rows take from the samples, kept."""
        if index not in self._readings:
            run, under = self.runs[index], self.under.physics(self.scene)
            self._readings[index] = Reading.of(run.weak, under, run.whiten.covariance, (run.jacobian, run.labels))
        return self._readings[index]

    def _noise_cost(self, model: Model) -> float:
        """What χ² is too small by where the model's lags let less noise through than those of the whitening.

        Undoing a lag raises a channel's noise: explanations with and without one are compared each under its own.
        """
        if _as_late(model, self.under):
            return self._smoothed(model)
        rows, own = (one.rows_of(model) for one in (self, self.rewhitened(model)))
        return float(own @ own - rows @ rows)

    @property
    def _forms(self) -> list[WeakForm]:
        return [run.weak for run in self.runs]

    def jacobian(self, model: Model) -> Array:
        columns = [self._by_unknown(model, i)[:, None] for i in range(len(model.unknown))]
        columns += [self.effect_columns(model, position) for position in range(len(model.effects))]
        return np.concatenate([np.zeros((self.rows + len(model.unknown), 0)), *columns], axis=1)

    def effect_columns(self, model: Model, position: int) -> Array:
        """Whitened rows and prior rows (R + n, k) by the strengths of one of the model's effects."""
        effect, physics = model.effects[position], model.physics(self.scene)
        if isinstance(effect, JointForce):
            found = self._force_columns(effect, physics)
        elif isinstance(effect, SensorEffect):
            found = self.sensor_columns(effect)
        elif isinstance(effect, UnmodeledContact):
            found = self.plane_columns(effect, physics)
        else:
            return np.stack([self._by_strength(model, position, k) for k in range(len(effect.strengths))], axis=1)
        if doubtful(physics):
            parts = np.split(found, np.cumsum([run.rows for run in self.runs])[:-1])
            found = np.concatenate([run.begun(physics).without(own) for run, own in zip(self.runs, parts, strict=True)])
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
                change = run.weak.sensor_change(effect, on)
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

    def _force_columns(self, effect: JointForce, physics: Physics) -> Array:
        joint = self.scene.tree.joint_index(effect.at)
        columns = []
        for run in self.runs:
            joints = run.weak.joint_samples(physics)
            columns.append(effect.force(joints[joint]).d_strengths)
        return self.joint_columns(joint, columns)

    def _by_unknown(self, model: Model, i: int) -> Array:
        if self.scene.unknown[i].kind == "contact" and any(isinstance(one, OF_CONTACTS) for one in model.effects):
            # another surface is touched at other times, and another friction has other numbers
            return self._contact_difference(model, i, 1e-2 * self.scene.priors.std[i])
        # rows are linear in masses and all but linear in the rest: one look a whitening serves every later step; but
        # that look holds the channels' noise, which a sensor that is late moves to another time
        late = tuple(
            (effect.key, *(float(f"{value:.2g}") for value in effect.values.values()))
            for effect in model.effects
            if isinstance(effect, TimingEffect)
        )
        if self._unknown_columns.get(i, (None,))[0] != late:
            # nor may the least change of a mass make an impact come earlier
            smooth = Model(model.unknown, tuple(one for one in model.effects if not isinstance(one, JointBacklash)))
            self._unknown_columns[i] = late, self._difference(smooth, i, 1e-2 * self.scene.priors.std[i])
        return self._unknown_columns[i][1]

    def _by_strength(self, model: Model, position: int, k: int) -> Array:
        effect: Effect = model.effects[position]
        index = len(model.unknown) + sum(len(e.strengths) for e in model.effects[:position]) + k
        strength, value = effect.strengths[k], float(effect.vector[k])
        # what is absent at infinity has no scale but its own
        size = abs(value) if strength.inverse else strength.typical
        if isinstance(effect, OF_CONTACTS):
            return self._contact_difference(model, index, effect.difference_step * size)
        return self._difference(model, index, effect.difference_step * size)

    def _difference(self, model: Model, index: int, step: float) -> Array:
        up, down, taken = _either_side(model, index, step)
        if not doubtful(up.physics(self.scene)):
            return self._apart(up, down, WeakForm.residual) / taken
        ahead, widths = self._begun(up, [None] * len(self.runs))
        # the likelihood is at its largest in the widths: it has the slope that it has while they stay as they are
        behind, _ = self._begun(down, widths)
        # beside what is impossible there is no slope to follow
        possible = np.all(np.isfinite(ahead)) and np.all(np.isfinite(behind))
        return (ahead - behind) / taken if possible else np.zeros(len(ahead))

    def _apart(self, up: Model, down: Model, rows: Callable[[WeakForm, Physics], Array]) -> Array:
        """What `rows` (M, r) of each recording, whitened, and prior rows differ by between two models."""
        ahead, behind = up.physics(self.scene), down.physics(self.scene)
        parts = []
        for run in self.runs:
            change = rows(run.weak, ahead) - rows(run.weak, behind)
            # most of what is tried leaves some recordings alone
            parts.append(run.whitened(change) if np.any(change) else np.zeros(run.rows))
        return np.concatenate([*parts, self.prior_rows(up) - self.prior_rows(down)])

    def _begun(self, model: Model, widths: Sequence[Array | None]) -> tuple[Array, list[Array | None]]:
        """Residual with the doubts of each recording's start as wide as `widths` or as is likeliest; and how wide."""
        physics = model.physics(self.scene)
        begun = [run.begun(physics, own) for run, own in zip(self.runs, widths, strict=True)]
        return np.concatenate([*(one.rows for one in begun), self.prior_rows(model)]), [one.widths for one in begun]

    def _contact_difference(self, model: Model, index: int, step: float) -> Array:
        """The same for a number that only contacts know of."""
        up, down, taken = _either_side(model, index, step)
        return self._apart(up, down, WeakForm.contact_rows) / taken


def doses(shared: Array, jacobian: Array) -> int:
    """How many doses of noise it takes, where slopes (R, n) change by `shared` with one of them.

    A joint rings with what a controller made of noise long after rows had their share of it: the product of the two
    then is mostly chance, of variance ΔJᵀΔJ, and a single one may throw a fit as far off as all of the rows' noise.
    """
    chance, known = (np.einsum("ij,ij->j", slopes, slopes) for slopes in (shared, jacobian))
    needed = np.max(chance / np.maximum(DRAWN * known, 1e-300), initial=1.0)
    return int(np.ceil(min(needed, DOSES)))


def _noisy(model: Model) -> Array:
    """(n + k,) 1 for each number whose slopes hold noise of the measurement, 0 for those of gaps.

    The twist in one is integrated, and holds next to none; but with more of it each impact comes at another time,
    which is no small change.
    """
    numbers = [float(not isinstance(effect, JointBacklash)) for effect in model.effects for _ in effect.strengths]
    return np.array([1.0] * len(model.unknown) + numbers)


def _as_late(one: Model, other: Model) -> bool:
    """Whether the two have the same lags of positions and velocities, within a part of their time constants."""
    first, second = ({lag.at: lag.values["time_constant"] for lag in lags_of(model.effects)} for model in (one, other))
    return first.keys() == second.keys() and all(
        abs(first[at] - second[at]) < SAME_LAG * max(first[at], second[at]) for at in first
    )


def _either_side(model: Model, index: int, step: float) -> tuple[Model, Model, float]:
    """The model with one number a step ahead and behind, and the step between them that bounds have left."""
    vector = model.vector
    ahead, behind = vector.copy(), vector.copy()
    ahead[index] += step
    behind[index] -= step
    up, down = model.at(ahead), model.at(behind)
    return up, down, float(up.vector[index] - down.vector[index])
