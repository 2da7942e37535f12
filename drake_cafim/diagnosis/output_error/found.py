"""What a search by output errors found, and a scene whose servos are settled by it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.diagnosis.fit.model import Key
from drake_cafim.diagnosis.output_error.problem import OutputErrorProblem, SimulationFit
from drake_cafim.diagnosis.output_error.uncertainty import Uncertainty
from drake_cafim.scene.scene import Scene


@dataclass(frozen=True)
class Found:
    """What was found: the fit, its `uncertainty`, the probability of each effect, and laws that explain the same."""

    problem: OutputErrorProblem
    fitted: SimulationFit
    alone: SimulationFit
    """The fit of the unknowns alone, from which the search began."""
    uncertainty: Uncertainty
    probability: Mapping[Key, float] = field(default_factory=dict)
    rivals: Mapping[Key, float] = field(default_factory=dict)

    def error(self, fitted: SimulationFit) -> float:
        """Geometric mean over the joints of the root mean square error of simulations by a fit, rad (m)."""
        return float(np.exp(0.5 * np.mean(np.log(self.problem.errors.mean_squares(fitted.errors)))))


def settled(scene: Scene, found: Found) -> Scene:
    """The scene with the priors of its servos' unknowns at what simulations of the recordings tell of them.

    None is wider than its stated prior. Such a prior is not set aside by a search.
    """
    fitted = {i for numbers in found.problem.numbers(found.fitted.model) for i in numbers.values()}
    known = zip(scene.unknown, found.fitted.model.unknown, found.uncertainty.unknown, strict=True)
    return replace(
        scene,
        unknown=tuple(
            replace(unknown, prior=replace(unknown.prior, mean=float(value), std=float(std)), settled=True)
            if i in fitted
            else unknown
            for i, (unknown, value, std) in enumerate(known)
        ),
    )
