"""Whether a model's inertias or efforts are so different that the rows' noise is another, and with it the likelihood.

The noise of a velocity enters the equations of motion times the inertia. Where a model's inertia is a thousandth of the
robot's, its rows are whitened by a thousandth of their noise: an effect that cancels the efforts then fits better than
the missing rotor, whose right residual looks like millions of standard deviations. And forces within the laws' accuracy
are noise in proportion to the effort: a saturation that leaves a thousandth of it would fit within the inaccuracy of an
effort that it says does not act. Such models are compared each under its own noise, −2 ln L = χ² + ln det C.
"""

from collections.abc import Iterable, Sequence
from operator import attrgetter
from typing import Protocol

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.rows.weak_form import WeakForm, acting_effort
from drake_cafim.diagnosis.thresholds import OTHER_NOISE_RATIO
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.dynamics.motion import mass_matrix, motion
from drake_cafim.effects.effect import Effect, Place
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

INSTANTS = 50
"""Instants of a recording at which inertias are compared."""


class Whitened(Protocol):
    """Recordings whitened under some model."""

    @property
    def runs(self) -> Sequence[Run]: ...
    def rows_of(self, model: Model) -> Array: ...


def is_other_noise(scene: Scene, weak: WeakForm, model: Model, under: Model) -> bool:
    """Whether at any joint the inertia, or the effort that acts, differs between `model` and `under`.

    By more than a factor of `OTHER_NOISE_RATIO`.
    """
    for changes, size_of in ((attrgetter("changes_inertia"), _joint_inertias), (_changes_effort, _joint_efforts)):
        if _numbers_of(filter(changes, model.effects)) == _numbers_of(filter(changes, under.effects)):
            continue
        first, second = (np.maximum(size_of(weak, item.physics(scene)), 1e-300) for item in (model, under))
        ratio = first / second
        if np.any((ratio > OTHER_NOISE_RATIO) | (ratio < 1.0 / OTHER_NOISE_RATIO)):
            return True
    return False


def noise_cost(problem: Whitened, own: Whitened, model: Model) -> float:
    """−2 ln L of `model` under its `own` whitening, less its χ² under that of `problem`, but for a constant.

    It is own χ² − χ² + the change of ln det C, so that χ² and this cost together compare models under their own noise.
    """
    left, under_own = problem.rows_of(model), own.rows_of(model)
    return float(under_own @ under_own - left @ left) + _log_determinant(own) - _log_determinant(problem)


def _log_determinant(problem: Whitened) -> float:
    return sum(run.whiten.log_determinant for run in problem.runs)


def _changes_effort(effect: Effect) -> bool:
    return effect.place is Place.ACTUATOR or effect.kind == "servo"


def _numbers_of(effects: Iterable[Effect]) -> list[tuple[object, ...]]:
    return [(effect.key, *effect.values.items()) for effect in effects]


def _joint_inertias(weak: WeakForm, physics: Physics) -> Array:
    """(n,) the mean diagonal of the mass matrix, rotors included."""
    moving = weak.motion(physics)
    some = np.linspace(0, len(moving.q) - 1, INSTANTS).astype(int)
    M = mass_matrix(motion(physics.tree, moving.q[some], moving.v[some]))
    return np.asarray(np.mean(np.diagonal(M, axis1=1, axis2=2), axis=0) + physics.rotor_inertias)


def _joint_efforts(weak: WeakForm, physics: Physics) -> Array:
    """(n,) root mean squares of the efforts that act, over their gains, by which the rows are divided."""
    return np.asarray(np.sqrt(np.mean(acting_effort(weak, physics) ** 2, axis=0)) / np.abs(physics.effort_gains))
