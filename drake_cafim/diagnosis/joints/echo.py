"""Corrects a coupling's first-order gain for noise that a controller carries into the drive as well as the residual."""

from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.diagnosis.thresholds import ECHO_GAIN_WORTH_ASKING
from drake_cafim.effects.coupling import JointCoupling
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.kinds import ByKind
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


def gain_without_echo(problem: WeakFormRows, at: Fit, effect: Effect, gain: float, basis: Array) -> float:
    """The `gain` of a coupling less the part by noise that its drive, a controller's effort, shares with the residual.

    As in `unbiased_fit`, the shared part is estimated by adding noise once more. Other effects keep their gain. The
    gain of a coupling stays that of its look, since a look at the spring that it makes likely may point elsewhere.
    """
    return _WithoutEcho(problem, at, gain, basis)(effect)


@dataclass(frozen=True)
class _WithoutEcho(ByKind[float]):
    problem: WeakFormRows
    at: Fit
    gain: float
    basis: Array

    def other(self, effect: Effect) -> float:
        return self.gain

    def coupling(self, effect: JointCoupling) -> float:
        if self.problem.runs[0].measured is not None or self.gain <= ECHO_GAIN_WORTH_ASKING:
            return self.gain
        return _of_coupling(self.problem, self.at, effect, self.gain, self.basis)


def _of_coupling(problem: WeakFormRows, at: Fit, effect: JointCoupling, gain: float, basis: Array) -> float:
    physics = at.model.physics(problem.scene)
    column = _coupling_column(problem, physics, effect)
    louder = _coupling_column(problem.noisier_in_loop, physics, effect)
    noise = problem.noisier.residual(at.model) - at.residual
    noise = noise - basis @ (basis.T @ noise)
    rows = len(column)
    along = basis[:rows].T @ column
    left = max(float(column @ column - along @ along), 0.0)
    score = float(np.sqrt(gain * left)) + float((louder - column) @ noise[:rows])
    # a diverged drive has no information; `score**2` would raise OverflowError where the product is infinite
    square = score * score
    return square / left if score > 0.0 and 0.0 < left < np.inf and square < np.inf else 0.0


def _coupling_column(problem: WeakFormRows, physics: Physics, effect: JointCoupling) -> Array:
    """Change of the whitened rows (R,) by a coupling with its values."""
    joint = problem.scene.tree.joint_index(effect.at)
    gain = float(physics.effort_gains[joint])
    parts = []
    for run in problem.runs:
        rows = np.zeros((len(run.weak.samples.windows), run.weak.rows_per_window))
        rows[:, run.weak.dynamic.start + joint] = run.weak.couplings.rows(physics, effect) / gain
        parts.append(run.whitened(rows))
    return np.concatenate(parts)
