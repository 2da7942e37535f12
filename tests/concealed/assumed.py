"""Fits the true effect, at its true place, where it was not named: how well the data determine its strength."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from drake_cafim.commands.inputs import read_all
from drake_cafim.diagnosis.fit.evidence import scale_of
from drake_cafim.diagnosis.fit.fitting import fit, unbiased_fit
from drake_cafim.diagnosis.fit.intervals import standard_deviations
from drake_cafim.diagnosis.fit.screening import screen
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.preparation import prepare
from drake_cafim.diagnosis.search.law_shapes import fit_shapes
from drake_cafim.scene.scene import Scene

from .alike import same_place

ROUNDS = 2
"""Of reckoning the noise anew, which the effects move."""

Strengths = dict[str, tuple[float, float]]
"""Value and std by the parameter's name."""


def assumed(folder: Path, recordings: Sequence[str], effects: Sequence[Mapping[str, Any]]) -> list[Strengths]:
    """Of each of the effects; none where no look at one of them says anything.

    It is what the diagnosis does with an effect that it has chosen, without the choice.
    """
    scene = Scene.load(str(folder / "scenario.yaml"))
    problem: SearchProblem = prepare(scene, read_all(scene, [str(folder / name) for name in recordings])).problem()
    every = problem.hypotheses()
    best = unbiased_fit(problem, problem.nominal())
    for wanted in effects:
        named = [
            candidate
            for candidate in every
            if candidate.name == wanted["effect"] and same_place(candidate.at, wanted["at"])
        ]
        looks = screen(problem, best, named)
        if not looks:
            return []
        best = fit_shapes(problem, fit(problem, best.model.with_effects([looks[0].effect])))
    for _ in range(ROUNDS):
        problem = problem.rewhitened(best.model)
        best = unbiased_fit(problem, fit_shapes(problem, fit(problem, best.model)).model)
    std = iter(standard_deviations(problem, best, scale_of(best))[len(best.model.unknown) :])
    return [
        {strength.name: (effect.values[strength.name], float(next(std))) for strength in effect.strengths}
        for effect in best.model.effects
    ]
