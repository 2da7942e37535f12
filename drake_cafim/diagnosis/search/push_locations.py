"""Where and when the pushes were that an explanation names: by their own ends.

Blocks of time that stand out above noise end where a push sinks into it, so that they are shorter than a weak push and
longer than a strong one; its fitted ends are neither.
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
    """Where recordings differ from `lacking`, strongest first, each push of `best` at its body and over its interval.

    A push has its part of all χ² that `best` takes off, and none where `lacking`
    holds it already.
    """
    pushes = tuple(effect for effect in best.effects if effect.episode is not None)
    if not pushes:
        return problem.locate(lacking)
    shares = np.zeros(len(pushes))
    if not any(push in lacking.effects for push in pushes):
        shares = _shares(problem, best, lacking, pushes)
        lacking = lacking.with_effects(pushes)
    rest = [replace(one, share=one.share * (1.0 - float(np.sum(shares)))) for one in problem.locate(lacking)]
    named = [_location(push, float(share)) for push, share in zip(pushes, shares, strict=True)]
    return tuple(sorted([*named, *rest], key=lambda one: -one.share))


def _shares(problem: Problem, best: Model, lacking: Model, pushes: tuple[Effect, ...]) -> Array:
    """Of each push, of what `best` takes off χ²; they sum to what all of them take off, at most 1."""
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
