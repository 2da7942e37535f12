"""The numbers that a likelihood is maximised over: unknowns, strengths and shapes of a model, with their priors."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.thresholds import UNKNOWN_REACH_IN_PRIOR_STDS
from drake_cafim.effects.effect import Effect, Strength
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

DIFFERENCE = 1e-4
"""Displacement of a parameter, of its size."""
SHAPE_STD = np.log(10.0)
"""Prior standard deviation of the logarithm of a shape parameter, as the width of a change of sign: a factor of ten."""


@dataclass(frozen=True)
class Coordinates:
    """x (n + k + h): n unknowns, k strengths, and the logarithms of h shape parameters, about the model `start`."""

    scene: Scene
    start: Model

    @cached_property
    def shapes(self) -> tuple[tuple[int, Strength], ...]:
        """The positive shape parameters, each with its effect's position in the model."""
        return tuple(
            (position, shape)
            for position, effect in enumerate(self.start.effects)
            for shape in effect.shapes
            if shape.lower > 0.0 and not shape.choices
        )

    @property
    def first(self) -> Model:
        """The model to start from: `start`, but with its shapes as wide as they come.

        What changes within a hair's breadth of v = 0 has no slope elsewhere by which it could be found.
        """
        x = self.of(self.start)
        widest = [np.log(max((*shape.grid, np.exp(at)))) for (_, shape), at in self._with_shapes(x)]
        return self.model(np.concatenate([x[: len(self.start.vector)], widest]))

    def _with_shapes(self, x: Array) -> Iterator[tuple[tuple[int, Strength], float]]:
        return zip(self.shapes, x[len(self.start.vector) :].tolist(), strict=True)

    def of(self, model: Model) -> Array:
        """The coordinates of a model."""
        logs = [np.log(_value(model.effects[position], shape)) for position, shape in self.shapes]
        return np.concatenate([model.vector, logs])

    def model(self, x: Array) -> Model:
        """The model at x, within the bounds of strengths and shapes and the reach of unknowns from their priors."""
        plain = len(self.start.vector)
        found = self.start.at(x[:plain])
        effects = list(found.effects)
        for (position, shape), log in zip(self.shapes, x[plain:], strict=True):
            effect = effects[position]
            value = float(np.clip(np.exp(log), shape.lower, shape.upper))
            effects[position] = type(effect)(effect.at, {**effect.values, shape.name: value})
        priors = self.scene.priors
        reach = UNKNOWN_REACH_IN_PRIOR_STDS * priors.std * self.start.prior_std_ratios(self.scene)
        unknown = priors.clip(np.clip(found.unknown, priors.mean - reach, priors.mean + reach))
        return replace(found, unknown=unknown, effects=tuple(effects))

    @cached_property
    def prior_mean(self) -> Array:
        """(n + k + h,); of strengths, which have no prior, zero."""
        unknown = self.scene.priors.mean
        return np.concatenate([unknown, self.of(self.start)[len(unknown) :]])

    @cached_property
    def prior_information(self) -> Array:
        """(n + k + h,) inverse variances of the priors."""
        unknown = (self.scene.priors.std * self.start.prior_std_ratios(self.scene)) ** -2.0
        strengths = np.zeros(len(self.start.vector) - len(unknown))
        return np.concatenate([unknown, strengths, np.full(len(self.shapes), SHAPE_STD**-2.0)])

    def displaced(self, model: Model) -> list[tuple[Physics, float]]:
        """The physics with each coordinate displaced in turn, away from its bounds, and by how much."""
        return [(other.physics(self.scene), size) for other, size in self._moved(model)]

    def _moved(self, model: Model) -> Iterator[tuple[Model, float]]:
        x = self.of(model)
        for index, size in enumerate(self._sizes(model)):
            for sign in (1.0, -1.0):
                step = np.zeros(len(x))
                step[index] = sign * DIFFERENCE * size
                other = self.model(x + step)
                taken = float(self.of(other)[index] - x[index])
                if taken != 0.0:
                    yield other, taken
                    break
            else:
                raise ArithmeticError(f"parameter {index} cannot be displaced within its bounds")

    def _sizes(self, model: Model) -> Array:
        strengths = [
            max(0.1 * s.typical, min(s.typical, abs(value - s.nominal)))
            for effect in model.effects
            for s, value in zip(effect.strengths, effect.vector, strict=True)
        ]
        return np.concatenate([self.scene.priors.std, strengths, np.ones(len(self.shapes))])


def _value(effect: Effect, shape: Strength) -> float:
    return effect.values.get(shape.name, shape.nominal)
