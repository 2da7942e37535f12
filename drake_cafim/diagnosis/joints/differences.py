"""Derivatives of whitened rows by central differences: by unknowns, and by strengths without an analytic derivative."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.rows.initial_uncertainty import has_unknown_start
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.effects.effect import Effect
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Differences:
    """Differentiates the whitened rows (R,) of all `runs` and the prior rows (n,), `prior_rows` of a model."""

    scene: Scene
    runs: Sequence[Run]
    prior_rows: Callable[[Model], Array]
    _unknown_columns: dict[int, tuple[Any, Array]] = field(default_factory=dict, repr=False, compare=False)

    def by_unknown(self, model: Model, i: int) -> Array:
        """(R + n,) derivative by the unknown with index `i`."""
        if self._bent_by_unknowns:
            # the rows are not linear in a delay or a gap: each model has its own slopes
            return self._difference(model, i, 1e-2 * self.scene.priors.std[i])
        if self.scene.unknown[i].kind == "contact" and any(effect.of_contact for effect in model.effects):
            # effects of contact change when a surface is touched, and so all derivatives by contact parameters
            return self._contact_difference(model, i, 1e-2 * self.scene.priors.std[i])
        # rows are linear in masses and nearly so in the rest: one derivative per whitening serves every later step; but
        # it contains the channels' noise, which a delay or lag of a sensor moves to another time, and numbers of servos
        # act only where their efforts are not bounded
        bending = tuple(
            (effect.key, *(float(f"{value:.2g}") for value in effect.values.values()))
            for effect in model.effects
            if effect.late or effect.bounds_effort
        )
        kind = bending, model.free
        if self._unknown_columns.get(i, (None,))[0] != kind:
            # without effects that impact, since the smallest change of a mass moves an impact in time
            smooth = replace(model, effects=tuple(effect for effect in model.effects if not effect.impacts))
            found = self._difference(smooth, i, 1e-2 * self.scene.priors.std[i])
            if not np.all(np.isfinite(found)) or not np.any(found):
                # next to a model that cannot be simulated there is no derivative; next to others there is
                return np.nan_to_num(found, nan=0.0, posinf=0.0, neginf=0.0)
            self._unknown_columns[i] = kind, found
        return self._unknown_columns[i][1]

    @cached_property
    def _bent_by_unknowns(self) -> bool:
        """Whether a number of an effect is unknown in which the rows are not nearly linear."""
        nearly = {effect.key for effect in self.scene.physics.sensors if not effect.late}
        return any(u.kind == "effect" and (u.effect, u.at) not in nearly for u in self.scene.unknown)

    def by_strength(self, model: Model, position: int, k: int) -> Array:
        """(R + n,) derivative by strength `k` of the effect at `position`."""
        index, step = _step_of(model, position, k)
        if model.effects[position].of_contact:
            return self._contact_difference(model, index, step)
        return self._difference(model, index, step)

    def beside(self, model: Model, position: int, k: int) -> tuple[Model, Model, float]:
        """The model with strength `k` of the effect at `position` a step larger and smaller, and their difference."""
        return _either_side(self.scene, model, *_step_of(model, position, k))

    def _difference(self, model: Model, index: int, step: float) -> Array:
        up, down, taken = _either_side(self.scene, model, index, step)
        if not has_unknown_start(up.physics(self.scene)):
            return self._change_of(up, down, _change_of_rows) / taken
        # the likelihood is maximal in the widths, so that its derivative is the one at constant widths
        here = model.physics(self.scene)
        widths = [run.marginalise_start(here).widths for run in self.runs]
        ahead, behind = self._residual(up, widths), self._residual(down, widths)
        # next to a model that cannot be simulated there is no derivative
        possible = np.all(np.isfinite(ahead)) and np.all(np.isfinite(behind))
        return (ahead - behind) / taken if possible else np.zeros(len(ahead))

    def _change_of(self, up: Model, down: Model, change_of: Callable[[WeakForm, Physics, Physics], Array]) -> Array:
        """(R + n,) difference between two models of each recording's rows (M, r), whitened, and of prior rows."""
        ahead, behind = up.physics(self.scene), down.physics(self.scene)
        parts = []
        for run in self.runs:
            change = change_of(run.weak, ahead, behind)
            # most changes affect only some of the recordings, and whitening zeros takes time
            parts.append(run.whitened(change) if np.any(change) else np.zeros(run.rows))
        return np.concatenate([*parts, self.prior_rows(up) - self.prior_rows(down)])

    def _residual(self, model: Model, widths: Sequence[Array]) -> Array:
        """(R + n,) residual with initial states marginalised, with these `widths`."""
        physics = model.physics(self.scene)
        rows = [run.marginalise_start(physics, own).rows for run, own in zip(self.runs, widths, strict=True)]
        return np.concatenate([*rows, self.prior_rows(model)])

    def _contact_difference(self, model: Model, index: int, step: float) -> Array:
        """(R + n,) derivative by a parameter that enters the contact rows only."""
        up, down, taken = _either_side(self.scene, model, index, step)
        return self._change_of(up, down, _change_of_contacts) / taken


def _change_of_contacts(weak: WeakForm, ahead: Physics, behind: Physics) -> Array:
    """(M, r) the difference of the terms of contacts."""
    return weak.contact_rows(ahead) - weak.contact_rows(behind)


def _change_of_rows(weak: WeakForm, ahead: Physics, behind: Physics) -> Array:
    """(M, r) the difference of the residual; the terms of contacts take most of the time, and often are the same."""
    change = weak.rows_beside_contacts(ahead) - weak.rows_beside_contacts(behind)
    return change if _touch_alike(weak, ahead, behind) else change + _change_of_contacts(weak, ahead, behind)


def _touch_alike(weak: WeakForm, ahead: Physics, behind: Physics) -> bool:
    """Whether contacts are known to push, and wrench sensors to read, the same under both."""
    return (
        weak.terms(ahead).moving is weak.terms(behind).moving
        and np.array_equal(ahead.effort_gains, behind.effort_gains)
        and _numbers_of(ahead.sensors) == _numbers_of(behind.sensors)
        and len(ahead.contacts) == len(behind.contacts)
        and all(_is_same_contact(*both) for both in zip(ahead.contacts, behind.contacts, strict=True))
    )


def _is_same_contact(first: SphereContact, second: SphereContact) -> bool:
    """Whether both have the same numbers; of what was made anew, as a surface that was moved, this is not known."""
    if first is second or type(first) is not type(second):
        return first is second
    names = (field.name for field in fields(first) if field.name != "changes")
    return first.changes == second.changes and all(getattr(first, name) is getattr(second, name) for name in names)


def _numbers_of(effects: Sequence[Effect]) -> list[Any]:
    return [(effect.key, dict(effect.values)) for effect in effects]


def _step_of(model: Model, position: int, k: int) -> tuple[int, float]:
    """The index of strength `k` of the effect at `position`, and the step by which its differences are taken."""
    effect: Effect = model.effects[position]
    index = len(model.unknown) + sum(len(e.strengths) for e in model.effects[:position]) + k
    strength, value = effect.strengths[k], float(effect.vector[k])
    # a strength that vanishes at infinity, as a stiffness, has no scale but its value
    return index, effect.difference_step * (abs(value) if strength.inverse else strength.typical)


def _either_side(scene: Scene, model: Model, index: int, step: float) -> tuple[Model, Model, float]:
    """The model with a parameter `step` larger and smaller, and the difference between the two within its bounds.

    Of an unknown beyond a bound, as to first order it may be, they are those of the model at the bound.
    """
    vector, n = model.vector, len(model.unknown)
    vector[:n] = scene.priors.clip(vector[:n])
    ahead, behind = vector.copy(), vector.copy()
    ahead[index] += step
    behind[index] -= step
    ahead[:n], behind[:n] = scene.priors.clip(ahead[:n]), scene.priors.clip(behind[:n])
    up, down = model.at(ahead), model.at(behind)
    return up, down, float(up.vector[index] - down.vector[index])
