"""Whether a model's inertia is so different that the noise of the rows is another, and with it the likelihood.

The noise of a velocity enters the equations of motion times the inertia. Where a model's inertia is a thousandth of the
robot's, its rows are whitened by a thousandth of their noise: an effect that cancels the efforts then fits better than
the missing rotor, whose right residual looks like millions of standard deviations. Such models are compared each
under its own noise, −2 ln L = χ² + ln det C.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import OTHER_INERTIA_RATIO
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.dynamics.motion import mass_matrix, motion
from drake_cafim.effects.effect import Effect
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

OF_INERTIA = ("tree", "load")
"""The kinds of effects that change inertia."""
INSTANTS = 50
"""Instants of a recording at which inertias are compared."""


class Whitened(Protocol):
    """Recordings whitened under some model."""

    @property
    def runs(self) -> Sequence[Run]: ...
    def rows_of(self, model: Model) -> Array: ...


def is_other_inertia(scene: Scene, weak: WeakForm, model: Model, under: Model) -> bool:
    """Whether in any joint the inertia of `model` and that of `under` differ by more than `OTHER_INERTIA_RATIO`."""
    if _of_inertia(model.effects) == _of_inertia(under.effects):
        return False
    first, second = (_joint_inertias(weak, item.physics(scene)) for item in (model, under))
    ratio = np.maximum(first, 1e-300) / np.maximum(second, 1e-300)
    return bool(np.any((ratio > OTHER_INERTIA_RATIO) | (ratio < 1.0 / OTHER_INERTIA_RATIO)))


def noise_cost(problem: Whitened, own: Whitened, model: Model) -> float:
    """−2 ln L of `model` under its `own` whitening, less its χ² under that of `problem`, but for a constant.

    It is own χ² − χ² + the change of ln det C, so that χ² and this cost together compare models under their own noise.
    """
    left, under_own = problem.rows_of(model), own.rows_of(model)
    return float(under_own @ under_own - left @ left) + _log_determinant(own) - _log_determinant(problem)


def _log_determinant(problem: Whitened) -> float:
    return sum(run.whiten.log_determinant for run in problem.runs)


def _of_inertia(effects: tuple[Effect, ...]) -> list[tuple[object, ...]]:
    return [(effect.key, *effect.values.items()) for effect in effects if effect.kind in OF_INERTIA]


def _joint_inertias(weak: WeakForm, physics: Physics) -> Array:
    """(n,) the mean diagonal of the mass matrix, rotors included."""
    moving = weak.motion(physics)
    some = np.linspace(0, len(moving.q) - 1, INSTANTS).astype(int)
    M = mass_matrix(motion(physics.tree, moving.q[some], moving.v[some]))
    return np.asarray(np.mean(np.diagonal(M, axis1=1, axis2=2), axis=0) + physics.rotor_inertias)
