"""Locations of an explanation's pushes: each at its body, over its fitted interval.

Blocks of time whose residual exceeds noise are shorter than a weak push, whose ends vanish in the noise, and longer
than a strong one, since they have a fixed width; the fitted interval has neither error.
"""

from dataclasses import replace

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.verdict import Location
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array


def locate_named(problem: SearchProblem, best: Model, lacking: Model) -> tuple[Location, ...]:
    """Where recordings differ from the model `lacking`, strongest first; each push of `best` is a location of its own.

    The share of a push is its part of the decrease of χ² by `best`, and 0 where `lacking` contains the push.
    """
    pushes = tuple(effect for effect in best.effects if effect.episode is not None)
    if not pushes:
        return problem.locate(lacking)
    shares = np.zeros(len(pushes))
    if not any(push in lacking.effects for push in pushes):
        shares = _shares(problem, best, lacking, pushes)
        lacking = lacking.with_effects(pushes)
    rest = [
        replace(location, share=location.share * (1.0 - float(np.sum(shares)))) for location in problem.locate(lacking)
    ]
    named = [_location(push, float(share)) for push, share in zip(pushes, shares, strict=True)]
    return tuple(sorted([*named, *rest], key=lambda location: -location.share))


def _shares(problem: Problem, best: Model, lacking: Model, pushes: tuple[Effect, ...]) -> Array:
    """(p,) share of each push in the decrease of χ² by `best`; they sum to the share of all pushes together."""
    before = _chi_square(problem, lacking)
    explained = before - _chi_square(problem, best)
    together = before - _chi_square(problem, lacking.with_effects(pushes))
    gains = np.array([max(before - _chi_square(problem, lacking.with_effects([push])), 0.0) for push in pushes])
    if not (explained > 0.0 and np.any(gains > 0.0)):
        return np.zeros(len(pushes))
    return np.asarray(np.clip(together / explained, 0.0, 1.0) * gains / np.sum(gains))


def _chi_square(problem: Problem, model: Model) -> float:
    rows = problem.rows_of(model)
    return float(rows @ rows)


def _location(push: Effect, share: float) -> Location:
    episode = push.episode
    assert episode is not None
    return Location(push.place.value, push.at, share, ((episode.start, episode.stop),), episode.recording)
