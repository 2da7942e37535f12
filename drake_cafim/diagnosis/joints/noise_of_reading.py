"""What a model gains by how it reads the channels: lags that let less noise through, and values between samples."""

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
    """Of `runs` that are whitened `under` a model."""

    scene: Scene
    runs: Sequence[Run]
    under: Model
    _readings: dict[int, Reading] = field(default_factory=dict, repr=False, compare=False)
    """How channels enter each recording's rows, where an explanation reads them between their samples."""

    def gained(self, model: Model) -> float:
        """What χ² is too small by where channels are read between their samples, against those of the whitening."""
        physics, under = model.physics(self.scene), self.under.physics(self.scene)
        total = 0.0
        for index, run in enumerate(self.runs):
            if shifts_of(run.weak.samples, physics) != shifts_of(run.weak.samples, under):
                reading = self._reading(index)
                total += reading.gained(physics) - reading.gained(under)
        return total

    def _reading(self, index: int) -> Reading:
        """What a recording's rows take from the samples, kept."""
        if index not in self._readings:
            run, under = self.runs[index], self.under.physics(self.scene)
            self._readings[index] = Reading.of(run.weak, under, run.whiten.covariance, (run.jacobian, run.labels))
        return self._readings[index]


def as_late(one: Model, other: Model) -> bool:
    """Whether the two have the same lags of positions and velocities, within a part of their time constants."""
    first, second = (_lags(model) for model in (one, other))
    return first.keys() == second.keys() and all(
        abs(first[at] - second[at]) < EQUAL_LAG_DIFFERENCE * max(first[at], second[at]) for at in first
    )


def _lags(model: Model) -> dict[str, float]:
    """The time constant, s, of the lag of each column of a position or velocity that has one."""
    late = [effect for effect in model.effects if effect.place is Place.CHANNEL and effect.at.startswith(("q.", "v."))]
    return {effect.at: effect.settling for effect in late if effect.settling is not None}
