"""Derivatives of whitened rows by links' inertial parameters, and by what these depend on, by the chain rule.

The dynamic rows are linear in each link's ten inertial parameters φ: their whitened regressor is computed once for a
gravity, the actuators' gains and the sensor effects, and ∂rows/∂θ = (∂rows/∂φ) (∂φ/∂θ) follows for every θ.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.diagnosis.rows.inertial_regressor import INERTIAL
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.dynamics.pseudo_inertia import in_frame, inertial_parameters, pseudo_inertia, slopes
from drake_cafim.dynamics.tree import FIXED
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.numerics.cache import make_room
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array

CACHED = 4
"""Most cached regressors."""


@dataclass(frozen=True)
class InertialColumns:
    """The columns (R, 10) of links' inertials in the whitened rows of all `runs`."""

    runs: Sequence[Run]
    _known: dict[tuple[object, ...], dict[int, Array]] = field(default_factory=dict, repr=False, compare=False)

    def of(self, physics: Physics, model: Physics, link: str, theta: Array) -> Array:
        """(R, 10) ∂rows/∂θ at `theta` (10,) of the body `link` of the `model`, whose inertials θ changes.

        `physics` is what acts, effects included.
        """
        body = model.tree.body(link)
        if body.joint == FIXED:
            return np.zeros((sum(run.rows for run in self.runs), INERTIAL))
        by = in_frame(slopes(pseudo_inertia(body), theta), body.R_JB, body.p_JB)
        return np.asarray(self._regressor(physics, body.joint) @ inertial_parameters(by).T)

    def change(self, ahead: Physics, behind: Physics) -> Array:
        """(R,) change of the rows from `behind` to `ahead`, which differ in inertias and rotors' inertias alone."""
        change = np.zeros(sum(run.rows for run in self.runs))
        moved = ahead.tree.inertial_parameters - behind.tree.inertial_parameters
        for joint in np.flatnonzero(np.any(moved != 0.0, axis=1)):
            change += self._regressor(ahead, int(joint)) @ moved[joint]
        rotors = ahead.rotor_inertias - behind.rotor_inertias
        return change + _of_rotors(self.runs, ahead, rotors) if np.any(rotors) else change

    def _regressor(self, physics: Physics, joint: int) -> Array:
        """(R, 10) whitened ∂rows/∂φ of what is fixed to a joint's moving frame; cached.

        For sensor effects to two digits: they move a motion, and its slopes by a hundredth of what they change.
        """
        sensors = tuple(_to_two_digits(effect) for effect in physics.sensors if not effect.at.startswith("wrench."))
        physics = replace(physics, sensors=sensors)
        moved = tuple((effect.key, *effect.values.values()) for effect in sensors)
        key = physics.gravity.tobytes(), physics.effort_gains.tobytes(), moved
        if key not in self._known:
            make_room(self._known, CACHED)
            self._known[key] = {}
        known = self._known[key]
        if joint not in known:
            known[joint] = np.concatenate([_whitened(run, physics, joint) for run in self.runs])
        return known[joint]


def _to_two_digits(effect: SensorEffect) -> SensorEffect:
    return effect.with_values({name: float(f"{value:.2g}") for name, value in effect.values.items()})


def _whitened(run: Run, physics: Physics, joint: int) -> Array:
    """One recording's rows (R, 10) by the inertial parameters of what is fixed to a joint's moving frame."""
    weak = run.weak
    regressor = weak.terms(physics).regressor
    rows = np.zeros((len(weak.samples.windows), weak.rows_per_window, INERTIAL))
    dynamic = regressor.inertia[:, :, joint].copy()
    dynamic[..., :4] += regressor.weight[:, :, joint] @ physics.gravity
    rows[:, weak.dynamic] = dynamic / physics.effort_gains[:, None]
    return run.whitened(rows)


def _of_rotors(runs: Sequence[Run], physics: Physics, inertias: Array) -> Array:
    """(R,) whitened rows of all recordings by rotors' `inertias` (n,)."""
    parts = []
    for run in runs:
        weak = run.weak
        rows = np.zeros((len(weak.samples.windows), weak.rows_per_window))
        rows[:, weak.dynamic] = -weak.terms(physics).rows.rate_of_velocity * inertias / physics.effort_gains
        parts.append(run.whitened(rows))
    return np.concatenate(parts)
