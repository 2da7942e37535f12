"""Derivatives of whitened rows by the stiffness and the damping of position servos, analytic."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.rows.initial_uncertainty import has_unknown_start
from drake_cafim.diagnosis.rows.weak_form import slope_by_servo
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.servos import FIELDS
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


@dataclass(frozen=True)
class ServoColumns:
    """The columns of all `runs`; the last one by each unknown is cached while what it depends on is the same."""

    scene: Scene
    runs: Sequence[Run]
    _cached: dict[int, tuple[object, Array]] = field(default_factory=dict, repr=False, compare=False)

    def by_unknown(self, model: Model, i: int) -> Array | None:
        """(R,) derivative by the unknown with index `i`; None unless it is a servo's number that has an analytic one.

        A servo with sag has none, nor has one whose effort an actuator effect changes. Where a motor's envelope bounds
        the effort at a joint, what that takes back of the steps of any servo changes, and none has one.
        """
        unknown, physics = self.scene.unknown[i], model.physics(self.scene)
        parameter = FIELDS.get(unknown.parameter)
        if parameter not in ("stiffness", "damping") or has_unknown_start(physics):
            return None
        servo, acting = next(own for own in physics.servos if own.joint == unknown.at), physics.servo_at(unknown.at)
        if any(effect.at == unknown.at for effect in physics.actuators) or acting.sag > 0.0 or servo.stiffness == 0.0:
            return None
        if any(physics.bounded_servo_at(own.joint).has_envelope for own in physics.servos):
            return None
        key = _key(physics)
        if self._cached.get(i, (None,))[0] != key:
            joint = physics.tree.joint_index(unknown.at)
            parts = []
            for run in self.runs:
                rows = slope_by_servo(run.weak, physics, joint, parameter)
                # whitening zeros takes time
                parts.append(run.whitened(rows) if np.any(rows) else np.zeros(run.rows))
            # an error of the gain multiplies the stiffness
            scale = acting.stiffness / servo.stiffness if parameter == "stiffness" else 1.0
            self._cached[i] = key, scale * np.concatenate(parts)
        return self._cached[i][1]


def _key(physics: Physics) -> object:
    """What the columns depend on but little: numbers of servos, of effects on commands and of late sensors."""
    late = (effect for effect in physics.sensors if effect.late)
    effects = tuple((effect.key, *map(_rounded, effect.values.values())) for effect in (*physics.servo_effects, *late))
    return effects, tuple((servo.joint, *map(_rounded, (servo.stiffness, servo.damping))) for servo in physics.servos)


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")
