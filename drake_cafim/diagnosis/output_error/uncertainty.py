"""Standard deviations of what is fitted to output errors: by curvature, the scale of efforts, and other unknowns."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.output_error.problem import OutputErrorProblem, SimulationFit
from drake_cafim.diagnosis.output_error.scale import ScaleProfile
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations (n,) of a scene's `unknown` parameters, and (k,) of each effect's strengths by its key."""

    unknown: Array
    strengths: Mapping[Key, Array]

    def of(self, model: Model) -> Array:
        """(n + k,) those of a model's numbers."""
        return np.concatenate([self.unknown, *(self.strengths[effect.key] for effect in model.effects)])

    def with_strengths(self, known: Mapping[Key, Array]) -> "Uncertainty":
        """The same with those of effects that are `known` otherwise."""
        return replace(self, strengths={**self.strengths, **known})


def uncertainty(problem: OutputErrorProblem, found: SimulationFit, scale: ScaleProfile) -> Uncertainty:
    """The standard deviations of all numbers of a fit.

    The sum of three variances: of the fit's curvature or of blocks of the recordings (`NormalEquations.covariance`), of
    the `scale` of all efforts at the joint, to which the others adapt, and of what the priors of the
    scene's other unknowns, as masses, let each number vary by. None of an unknown is wider than its prior's.
    """
    numbers = problem.numbers(found.model)
    moved = _moved_by_others(problem, found)
    vector, prior = found.model.vector, problem.scene.priors.std
    std = np.concatenate([prior, np.zeros(len(vector) - len(prior))])
    for j, (own, system) in enumerate(zip(numbers, found.equations, strict=True)):
        at = np.array(list(own.values()), dtype=np.int64)
        std[at] = np.sqrt(system.std**2 + (scale.std[j] * scale.along[j]) ** 2 + moved[j])
    n, start, strengths = len(prior), len(prior), dict[Key, Array]()
    for effect in found.model.effects:
        strengths[effect.key] = std[start : start + len(effect.strengths)]
        start += len(effect.strengths)
    return Uncertainty(np.minimum(std[:n], prior), strengths)


def _moved_by_others(problem: OutputErrorProblem, found: SimulationFit) -> list[Array]:
    """For each joint (m,), the variances of its numbers by the unknowns of the scene that are no joint's numbers."""
    own = {i for numbers in problem.numbers(found.model) for i in numbers.values()}
    variances = [np.zeros(len(names)) for names in found.names]
    for i, std in enumerate(problem.scene.priors.std):
        if i in own:
            continue
        beside = found.model.vector.copy()
        beside[i] += std
        change = problem.errors_of(found.model.at(beside)) - found.errors
        for j, system in enumerate(found.equations):
            variances[j] += np.linalg.solve(system.information, system.weight * system.J.T @ change[:, j]) ** 2
    return variances
