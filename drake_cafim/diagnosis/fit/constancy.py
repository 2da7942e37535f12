"""Whether a law has one strength throughout the recordings: a score test of strengths of its own in each part.

A law of physics holds with the same strengths in every recording, at its beginning and at its end. What stands in for
another law takes its share of the misfit with other strengths wherever the motion is another one.
"""

from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.fit.beside import strengths_at
from drake_cafim.diagnosis.fit.columns import Nuisance
from drake_cafim.diagnosis.fit.evidence import law_inaccuracy, luck_p_value
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.fit.robust_covariance import wald_statistics
from drake_cafim.diagnosis.fit.screening import solve_beside
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Constancy:
    """What an effect explains with strengths that are the same throughout, and what more with others in each part."""

    effect: Effect
    common: float
    """χ² of its difference from no effect, the same throughout."""
    varying: float
    """Further decrease of χ², to first order, by strengths of its own in each half of each recording."""
    p_value: float
    """Probability that noise alone varies so much."""

    @property
    def share(self) -> float:
        """The part of both that the common strengths explain."""
        return self.common / (self.common + self.varying) if self.varying > 0.0 else 1.0


def constancy_of(problem: Problem, found: Fit) -> list[Constancy]:
    """The constancy of each effect of a fit that lasts; a push acts in one part only.

    With the Jacobian J of all parameters and J_p that of the effect's strengths in the rows of part p, zero elsewhere,
    the decrease is that by the columns J_1 … J_{P−1} beside J: zᵀX (XᵀMX)⁻¹ Xᵀz, M the projection off J. On noise it is
    χ² with k (P − 1) degrees of freedom for k strengths (Rao, Proc. Camb. Philos. Soc. 44(1), 1948). Variation within
    the accuracy of the laws counts as none.
    """
    nuisance = Nuisance.of(found)
    inaccuracy = law_inaccuracy(problem, found)
    tested = []
    for position, effect in enumerate(found.model.effects):
        if effect.episode is not None:
            continue
        columns = _in_parts(problem, found.jacobian[:, strengths_at(found.model, position)])
        solved = solve_beside(columns, nuisance)
        varying = max((0.0 if solved is None else solved[1]) - inaccuracy, 0.0)
        common, _ = wald_statistics(problem, found, effect.key)
        tested.append(Constancy(effect, common, varying, luck_p_value(varying, columns.shape[1])))
    return tested


def _in_parts(problem: Problem, columns: Array) -> Array:
    """(R + n, k (P − 1)) the `columns` (R + n, k) in each half of each recording but the last half, zero elsewhere."""
    parts, start = [], 0
    for _, rows in by_run(problem, columns[: problem.rows, 0]):
        for own in np.array_split(np.arange(start, start + rows.size).reshape(rows.shape), 2):
            part = np.zeros_like(columns)
            part[own.ravel()] = columns[own.ravel()]
            parts.append(part)
        start += rows.size
    return np.hstack(parts[:-1])
