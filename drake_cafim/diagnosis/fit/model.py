"""A candidate explanation: the unknown nominal parameters and the effects, all with values."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.effects.effect import Effect
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Model:
    """`unknown` (n,) values of the scene's unknown parameters, and `effects` beyond the nominal model."""

    unknown: Array
    effects: tuple[Effect, ...] = ()

    @property
    def vector(self) -> Array:
        """Unknowns, then each effect's strengths."""
        return np.concatenate([self.unknown, *(effect.vector for effect in self.effects)])

    def at(self, vector: Array) -> "Model":
        """The model with the numbers of `vector`, clipped to the bounds of the strengths."""
        n = len(self.unknown)
        effects, start = [], n
        for effect in self.effects:
            k = len(effect.strengths)
            lower = np.array([s.lower for s in effect.strengths])
            upper = np.array([s.upper for s in effect.strengths])
            effects.append(effect.with_values(np.clip(vector[start : start + k], lower, upper)))
            start += k
        return Model(vector[:n].copy(), tuple(effects))

    def with_effects(self, effects: Sequence[Effect]) -> "Model":
        return replace(self, effects=(*self.effects, *effects))

    def physics(self, scene: Scene) -> Physics:
        """What the model says acts."""
        return scene.physics_at(self.unknown).with_effects(self.effects)
