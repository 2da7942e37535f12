"""Corrections of χ² for how a model reads channels: lags that change their noise, and interpolation that smooths it."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.thresholds import EQUAL_LAG_DIFFERENCE
from drake_cafim.diagnosis.whitening.interpolation_noise import Reading, shifts_of
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.effects.effect import Place
from drake_cafim.scene.scene import Scene


@dataclass(frozen=True)
class Smoothing:
    """The noise that interpolation between samples removes from `runs`, which are whitened `under` a model."""

    scene: Scene
    runs: Sequence[Run]
    under: Model
    _readings: dict[int, Reading] = field(default_factory=dict, repr=False, compare=False)
    """Cache: how channels enter each recording's rows, where a model reads them between their samples."""

    def decrease(self, model: Model) -> float:
        """Decrease of χ² by reading channels between samples under `model`, less that under the whitening's model."""
        physics, under = model.physics(self.scene), self.under.physics(self.scene)
        total = 0.0
        if self.runs[0].measured is not None:
            return total
        for index, run in enumerate(self.runs):
            if shifts_of(run.weak.samples, physics) != shifts_of(run.weak.samples, under):
                reading = self._reading(index)
                total += reading.decrease(physics) - reading.decrease(under)
        return total

    def _reading(self, index: int) -> Reading:
        """How the channels enter the rows of the recording with this index; cached."""
        if index not in self._readings:
            run, under = self.runs[index], self.under.physics(self.scene)
            self._readings[index] = Reading.of(run.weak, under, run.whiten.covariance, (run.jacobian, run.labels))
        return self._readings[index]


def has_equal_lags(first: Model, other: Model) -> bool:
    """Whether two models have equal lags of positions and velocities, but for `EQUAL_LAG_DIFFERENCE`."""
    a, b = _lags(first), _lags(other)
    return a.keys() == b.keys() and all(abs(a[at] - b[at]) < EQUAL_LAG_DIFFERENCE * max(a[at], b[at]) for at in a)


def _lags(model: Model) -> dict[str, float]:
    """The time constant, s, of the lag of each column of a position or velocity that has one."""
    late = [effect for effect in model.effects if effect.place is Place.CHANNEL and effect.at.startswith(("q.", "v."))]
    return {effect.at: effect.settling for effect in late if effect.settling is not None}
