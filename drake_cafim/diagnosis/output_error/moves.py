"""Changes of the effects at the joints of a model, and what an explanation costs; one change of every joint at once."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.output_error.laws import acts_as_named
from drake_cafim.diagnosis.output_error.problem import ErrorProblem, SimulationFit, at_joint
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array

CHORD_STEPS = 4
"""Most steps of a trial fit, under slopes that stay as they are."""

Move = tuple[tuple[Effect, ...], Effect]
"""Effects of a joint that are taken out, and the one that is added."""


@dataclass(frozen=True)
class Moves:
    """Explanations of a problem whose joints are chosen from the `hypotheses` of each."""

    problem: ErrorProblem[Any]
    hypotheses: tuple[tuple[Effect, ...], ...]
    excludes: Callable[[Effect, Effect], bool] = Effect.excludes
    """Whether a law cannot act beside one that is present."""

    def costs(self, found: SimulationFit) -> Array:
        """(c,) the criterion of each joint."""
        prices = [
            sum(self.price(effect) for effect in found.model.effects if at_joint(effect.at, joint))
            for joint in self.problem.joints
        ]
        return np.asarray(found.costs + np.array(prices), dtype=float)

    def price(self, effect: Effect) -> float:
        """k ln N + 2 ln H of an effect, and −2 ln of its prior odds."""
        joint = self.problem.joints.index(effect.at.removeprefix("q."))
        return (
            effect.surprise
            + len(effect.strengths) * float(np.log(max(self.problem.errors.likelihood.independent[joint], 2.0)))
            + 2.0 * float(np.log(len(self.hypotheses[joint])))
        )

    def acts(self, model: Model, effect: Effect) -> bool:
        """Whether an effect of the model acts as its name says."""
        return acts_as_named(self.problem, model, effect)

    def model_without(self, model: Model, effects: Sequence[Effect]) -> Model:
        keys = {effect.key for effect in effects}
        return replace(model, effects=tuple(effect for effect in model.effects if effect.key not in keys))

    def without(self, best: SimulationFit, effects: Sequence[Effect]) -> SimulationFit:
        """The errors of `best` without `effects`, nothing fitted again."""
        model = self.model_without(best.model, effects)
        return replace(best, model=model, errors=self.problem.errors_of(model))

    def chord(self, best: SimulationFit, moves: Sequence[Move | None]) -> SimulationFit:
        """A quick fit of `best` with a move of each joint: only the slopes by new strengths are computed."""
        problem = self.problem
        dropped = [effect for move in moves if move is not None for effect in move[0]]
        model = self.changed(best.model, moves)
        kept = best.slopes_without(dropped)
        start = problem.errors_of(model)
        slopes = []
        fresh = problem.slopes_of(model, start, [move[1] for move in moves if move is not None])
        for own, new in zip(kept, fresh, strict=True):
            slopes.append(np.concatenate([own, new], axis=1))
        return problem.fit(model, slopes, CHORD_STEPS)

    def changed(
        self,
        model: Model,
        moves: Sequence[Move | None],
        values: Model | None = None,
    ) -> Model:
        """The model with the moves made; new effects have the values of those in `values`, where it has them."""
        for move in moves:
            if move is None:
                continue
            dropped = {effect.key for effect in move[0]}
            kept = tuple(effect for effect in model.effects if effect.key not in dropped)
            new = self.problem.sized(move[1]) if values is None else with_values_of(values, move[1])
            model = replace(model, effects=(*kept, new))
        return model


def with_others(model: Model, others: Sequence[Effect | None]) -> Model:
    """The model with `others` in the place of its effects of the same keys."""
    own = {other.key: other for other in others if other is not None}
    return replace(model, effects=tuple(own.get(effect.key, effect) for effect in model.effects))


def with_values_of(model: Model, effect: Effect) -> Effect:
    """The effect of the model with the same key, or `effect` itself where it has none."""
    return next((own for own in model.effects if own.key == effect.key), effect)
