"""Derivatives of whitened rows by the strengths of sensor effects: those by the channels' samples, chained."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.whitening.servo_noise import read_by_servos
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


@dataclass(frozen=True)
class SensorColumns:
    """The columns of all `runs`, linearised about the model `under` which these are whitened; cached by effect."""

    scene: Scene
    runs: Sequence[Run]
    under: Model
    cached: dict[Key, Array] = field(default_factory=dict, repr=False, compare=False)

    def of(self, effect: SensorEffect) -> Array:
        """Whitened rows (R, k) by the strengths of `effect`."""
        if effect.key not in self.cached:
            result, physics = [], self.under.physics(self.scene)
            own = next((acting for acting in physics.sensors if acting.key == effect.key), None)
            for run in self.runs:
                on = effect.channels(list(run.jacobian))
                change = run.weak.sensor_slopes.of(own or effect, on, acts=own is not None)
                moved = sum(run.sensed(name, change[:, k]) for k, name in enumerate(on))
                if not effect.late:
                    moved = moved - read_by_servos(run, physics, on, change)
                result.append(-moved)
            self.cached[effect.key] = np.concatenate(result)
        return self.cached[effect.key]

    def by_unknown(self, i: int) -> Array | None:
        """(R,) derivative by the unknown with index `i`; None unless it is a strength of a sensor that is not late."""
        unknown = self.scene.unknown[i]
        for effect in self.scene.physics.sensors:
            if unknown.of(effect) and not effect.late:
                names = [strength.name for strength in effect.strengths]
                if unknown.parameter in names:
                    return self.of(effect)[:, names.index(unknown.parameter)]
        return None
