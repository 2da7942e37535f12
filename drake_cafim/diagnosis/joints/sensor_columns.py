"""Derivatives of whitened rows by the strengths of sensor effects: those by the channels' samples, chained."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.noise.fed_back import fed_back_motion, feedback_gains
from drake_cafim.diagnosis.whitening.servo_noise import read_by_servos
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.effects.sensor import SensorEffect
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


@dataclass(frozen=True)
class SensorColumns:
    """The columns of all `runs`, linearised about the model `under` which these are whitened; cached by effect."""

    scene: Scene
    runs: Sequence[Run]
    under: Model
    cached: dict[Key, Array] = field(default_factory=dict, repr=False, compare=False)
    _fed_back: list[dict[str, Array]] = field(default_factory=list, repr=False, compare=False)
    """Cache: `fed_back` of each run."""

    def of(self, effect: SensorEffect) -> Array:
        """Whitened rows (R, k) by the strengths of `effect`."""
        if effect.key not in self.cached:
            result, physics = [], self.under.physics(self.scene)
            own = next((acting for acting in physics.sensors if acting.key == effect.key), None)
            if not self._fed_back:
                self._fed_back.extend(fed_back(run, physics) for run in self.runs)
            for run, fed in zip(self.runs, self._fed_back, strict=True):
                on = effect.channels(list(run.jacobian))
                moved_by_noise = np.stack([fed[name] for name in on], axis=1) if fed.keys() >= set(on) else None
                change = run.weak.sensor_slopes.of(own or effect, on, own is not None, moved_by_noise)
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


def fed_back(run: Run, physics: Physics) -> dict[str, Array]:
    """By column of positions and velocities, the motion (N,) that the controller makes of their noise in a recording.

    Empty where the motion is not estimated, velocities are not measured (what damps the response is not known then), no
    effort follows the noise, or the response cannot be simulated: it would be twice as large as what a joint moves.
    """
    estimated = run.weak.samples.estimated
    if estimated is None or run.measured is None or not run.measured.samples.velocity_measured:
        return {}
    measured = run.measured.samples
    gains = feedback_gains(measured.u, measured.q, measured.v)
    if not np.any(gains):
        return {}
    noise = measured.q - estimated.q, measured.v - estimated.v
    mobility = run.weak.terms(physics).mobility.of(physics)
    found = fed_back_motion(measured.time, gains, noise, mobility)
    if not np.all(np.isfinite(found)) or np.any(np.std(found[1], axis=0) > 2.0 * np.std(estimated.v, axis=0)):
        return {}
    names = physics.tree.joint_names
    return {f"{kind}.{name}": own[:, j] for kind, own in zip("qv", found, strict=True) for j, name in enumerate(names)}
