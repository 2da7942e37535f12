"""The search problem of recordings of joints: weak-form rows with hypotheses, looks, locations and pictures."""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.pictures import Pictures
from drake_cafim.diagnosis.fit.realised_noise import RealisedNoise
from drake_cafim.diagnosis.fit.search_problem import Looks, SearchProblem
from drake_cafim.diagnosis.joints.contact_consistency import with_reading
from drake_cafim.diagnosis.joints.linearised_effects import hypotheses, looks
from drake_cafim.diagnosis.joints.location import locate
from drake_cafim.diagnosis.joints.pictures import JointPictures
from drake_cafim.diagnosis.joints.unknown_force import exact_joints, force_density, forced_joints, remarks
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.diagnosis.rows.samples import over_wider_windows
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import WIDEST_WINDOW
from drake_cafim.diagnosis.verdict import Location
from drake_cafim.diagnosis.whitening.covariance import unknown_force_factors
from drake_cafim.diagnosis.whitening.noise_realisations import noise_realisations, rounds
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint_samples import JointSamples
from drake_cafim.typing import Array

REALISATIONS = (100, 400)
"""Fewest and most realisations of noise, from which what it may do to tests and to strengths is taken."""
REALISED_NUMBERS = 1_000_000
"""Numbers that all of them together take, where they are not the fewest."""


@dataclass(frozen=True)
class WeakProblem(WeakFormRows, SearchProblem):
    """Recordings of one scene's joints, their equations of motion in weak form."""

    def hypotheses(self) -> tuple[Effect, ...]:
        return hypotheses(self)

    def looks(self, at: Fit, effect: Effect) -> Looks:
        return looks(self, at, effect)

    def locate(self, lacking: Model) -> tuple[Location, ...]:
        return locate(self, lacking)

    def apart(self, rows: Array) -> Array:
        ends = np.cumsum([run.rows for run in self.runs])[:-1]
        own = zip(self.runs, np.split(rows, ends), strict=True)
        return np.concatenate([run.whiten.unwhiten(part) / run.whiten.std for run, part in own])

    @cached_property
    def noise_share(self) -> Array:
        if not np.any(self.unknown_force):
            return super().noise_share
        physics, shares = self.under.physics(self.scene), []
        for run in self.runs:
            forces = zip(self.unknown_force, unknown_force_factors(run.weak, physics), strict=True)
            by_forces = np.sum([density * np.ravel(factor.power(2).sum(axis=1)) for density, factor in forces], axis=0)
            shares.append(1.0 - by_forces / run.whiten.std**2)
        return np.concatenate(shares)

    @property
    def equations(self) -> slice:
        # the first rows of a window compare positions with velocities
        return slice(self.runs[0].weak.kinematic_rows, None)

    def forget(self) -> None:
        known = self.whitened_forces.known
        for cache in (self.found_pushes, self.tried_pulses, self.force_looks, self.force_information, known):
            cache.clear()
        for name in ("noisier", "noise_share", "realised_noise", "_by_unknowns", "_by_sensors"):
            vars(self).pop(name, None)
        self._latest.model = self._latest.problem = None
        for run in self.runs:
            run.forget()

    @cached_property
    def realised_noise(self) -> RealisedNoise | None:
        if not any(map(rounds, self.runs)):
            return None
        rng, count = np.random.default_rng(0), int(np.clip(REALISED_NUMBERS / self.rows, *REALISATIONS))
        realised = [noise_realisations(run, rng, count) for run in self.runs]
        known = [rows for rows in realised if rows is not None]
        return RealisedNoise(np.concatenate(known)) if len(known) == len(realised) else None

    @cached_property
    def pictures(self) -> Pictures:
        return JointPictures(self)

    def law_samples(self, model: Model) -> list[list[JointSamples]]:
        """By recording and joint, the motion at the points over which laws are integrated."""
        physics = model.physics(self.scene)
        return [list(run.weak.law_samples(physics)) for run in self.runs]

    def likeliest_force(self, model: Model, near: Self | None = None) -> Array:
        return force_density(self, model, None if near is None else near.unknown_force)

    def with_unknown_force(self, force: Array, model: Model | None = None) -> Self:
        return self.of(self.scene, self.forms, model or self.under, force)

    @property
    def forced_joints(self) -> tuple[str, ...]:
        return tuple(joint.name for joint, _ in forced_joints(self))

    @property
    def exact_joints(self) -> tuple[str, ...]:
        return exact_joints(self)

    @property
    def force_remarks(self) -> tuple[str, ...]:
        return remarks(self)

    def with_reading(self, model: Model) -> tuple[Array, Array] | None:
        return with_reading(self, model.physics(self.scene))

    def over_wider_windows(self, times: float) -> tuple[Self, float] | None:
        forms = [_under_windows(form, times) for form in self.forms]
        widths = [
            (new.samples.windows.width, old.samples.windows.width) for new, old in zip(forms, self.forms, strict=True)
        ]
        if all(wide < times * usual for wide, usual in widths):
            return None
        return self.of(self.scene, forms, self.under), float(max(wide for wide, _ in widths))


def _under_windows(form: WeakForm, times: float) -> WeakForm:
    """The recording with windows `times` as wide, halved while these are too wide or too few of them fit."""
    while times > 1.0:
        short = times * form.samples.windows.width <= WIDEST_WINDOW
        wide = over_wider_windows(form.samples, times) if short else None
        if wide is not None:
            return WeakForm(wide, form.sensors)
        times *= 0.5
    return form
