"""A candidate explanation: the unknown nominal parameters and the effects, all with values."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.effects.effect import Effect
from drake_cafim.effects.joint import JointForce
from drake_cafim.scenario.inertials import stepped
from drake_cafim.scenario.physics import Physics
from drake_cafim.scenario.unknown import UnknownParameter, inertials
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

FREE_PRIOR_STD_RATIO = 1e4
"""Prior std of an unknown without prior, over the stated one: so wide that any recording determines it better, and
finite, so that the information stays regular where none does."""
HELD_PRIOR_STD_RATIO = 1e-6
"""Prior std of unknowns that are held at their prior means, over the stated one."""

Key = tuple[str, str]
"""Name of an effect or a parameter, and its place."""


@dataclass(frozen=True)
class Model:
    """`unknown` (n,) values of the scene's unknown parameters, and `effects` beyond the nominal model."""

    unknown: Array
    effects: tuple[Effect, ...] = ()
    free: tuple[UnknownParameter, ...] = ()
    """Unknowns that are fitted without their priors."""
    held: bool = False
    """Whether the unknowns stay at their prior means, as a scenario gives them."""
    _physics: list[tuple[Scene, Physics]] = field(default_factory=list, init=False, repr=False, compare=False)
    """Cache: the physics in the last scene, always the same object, by which others cache what follows from it."""

    def __getstate__(self) -> dict[str, object]:
        """Without the cache, which holds a scene, for processes that give models back."""
        return {**vars(self), "_physics": []}

    @property
    def keys(self) -> frozenset[Key]:
        """(effect, place) of each effect, (parameter, place) of each unknown whose prior is set aside."""
        return frozenset(
            {*(effect.key for effect in self.effects), *((unknown.parameter, unknown.at) for unknown in self.free)}
        )

    @property
    def named(self) -> bool:
        """Whether it says more than the nominal model with its unknowns within their priors."""
        return bool(self.effects or self.free)

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
        return replace(self, unknown=vector[:n].copy(), effects=tuple(effects))

    def with_effects(self, effects: Sequence[Effect]) -> "Model":
        """The model with further effects."""
        return replace(self, effects=(*self.effects, *effects))

    def without(self, effect: Effect) -> "Model":
        """The model without `effect`, which is one of its own."""
        return replace(self, effects=tuple(other for other in self.effects if other is not effect))

    def without_prior(self, unknown: UnknownParameter) -> "Model":
        """The model with `unknown` fitted as if its prior said nothing."""
        return replace(self, free=(*self.free, unknown))

    def with_prior(self, unknown: UnknownParameter) -> "Model":
        """The model with the prior of `unknown` applied again."""
        return replace(self, free=tuple(other for other in self.free if other != unknown))

    def prior_std_ratios(self, scene: Scene) -> Array:
        """(n,) factors by which the priors' standard deviations are widened."""
        if self.held:
            return np.full(len(scene.unknown), HELD_PRIOR_STD_RATIO)
        return np.array([FREE_PRIOR_STD_RATIO if unknown in self.free else 1.0 for unknown in scene.unknown])

    def physics(self, scene: Scene) -> Physics:
        """The scene's physics at these unknowns, with the effects."""
        if not self._physics or self._physics[0][0] is not scene:
            self._physics[:] = [(scene, scene.physics_at(self.unknown).with_effects(self.effects))]
        return self._physics[0][1]

    def physics_before(self, scene: Scene, law: JointForce) -> Physics:
        """`physics`, but without a law that bounds its servo's effort: where it acts shows before it has bounded it."""
        physics = self.physics(scene)
        return self.without(law).physics(scene) if physics.bounds_servo(law) else physics


def step_from(scene: Scene, model: Model, step: Array) -> Model:
    """The model after a `step` (n + k,), along which the inertial parameters of links change linearly; see `stepped`.

    All other parameters change by it. It is clipped to the bounds of strengths.
    """
    vector = model.vector + step
    for link, own in inertials(scene.unknown).items():
        if np.any(step[own]):
            body = (scene.bare or scene.physics).tree.body(link)
            vector[own] = stepped(body, model.vector[own], step[own])
    return model.at(vector)


def weakened(model: Model, keys: Collection[Key], share: float) -> Model:
    """`model` with the effects `keys` at a `share` of what sets them apart from none; see `Effect.vanishing`."""
    parts = [model.unknown]
    for effect in model.effects:
        difference, slope = effect.vanishing()
        step = np.linalg.lstsq(slope, difference, rcond=None)[0]
        parts.append(effect.vector - (1.0 - share) * step if effect.key in keys else effect.vector)
    return model.at(np.concatenate(parts))
