"""Fits what joints often lack, and the unknowns, to recordings at once, to first order about the model as given."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drake_cafim.diagnosis.fit.bounds import solve_within, steps_within
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.diagnosis.thresholds import UNKNOWN_FAR_IN_PRIOR_STDS
from drake_cafim.typing import Array

COMMON = ("joint_viscous_friction", "joint_coulomb_friction", "actuator_bias")
"""What joints lack so often that a mistake of one file must explain more than it."""


@dataclass(frozen=True)
class FirstOrderFit:
    """The `change` (n + k,) of the unknowns and of the strengths of `model`, which begin at none, and its `std`.

    `left` is the χ² per row of each recording with it, `cost` that of all with what priors make of the change.
    """

    model: Model
    change: Array
    std: Array
    left: tuple[float, ...]
    cost: float

    def of(self, name: str) -> dict[str, tuple[float, float]]:
        """By place, the change of an effect's only strength, and its standard deviation."""
        found, at = {}, len(self.model.unknown)
        for effect in self.model.effects:
            if effect.name == name:
                found[effect.at] = float(self.change[at]), float(self.std[at])
            at += len(effect.strengths)
        return found


def fit_to_first_order(
    problems: Sequence[WeakProblem], names: Collection[str], free: Mapping[str, float] | None = None, *, bounded: bool
) -> FirstOrderFit:
    """The fit of the effects of these `names`, wherever they can act, to the rows of all `problems` together.

    If `bounded`, parameters stay within their bounds, and unknowns as near to their priors as is no mismatch. The
    strengths of effects in `free` have no bounds, but a prior with that standard deviation, so that those that nothing
    tells apart have large ones. Standard deviations are scaled by what is left, and zero at a bound.
    """
    first, free = problems[0], free or {}
    named = [effect for effect in first.hypotheses() if effect.name in names]
    effects = tuple(effect.with_values(np.array([it.nominal for it in effect.strengths])) for effect in named)
    model = Model(first.scene.priors.mean, effects)
    rows = [problem.rows_of(model) for problem in problems]
    columns = [problem.jacobian(model) for problem in problems]
    deviation = np.array([free.get(effect.name, np.inf) for effect in effects for _ in effect.strengths])
    held = np.concatenate([np.zeros(len(model.unknown)), 1.0 / deviation])
    slopes = [own[: len(left)] for own, left in zip(columns, rows, strict=True)]
    stacked = np.concatenate([*slopes, columns[0][first.rows :], np.diag(held)])
    wanted = np.concatenate([*rows, first.prior_rows(model), np.zeros(len(held))])
    size = np.linalg.norm(stacked, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    Q, R = np.linalg.qr(stacked / size)
    lower, upper = steps_within(first, model)
    near = UNKNOWN_FAR_IN_PRIOR_STDS * np.concatenate([first.prior_std(model), np.full(len(deviation), np.inf)])
    lower, upper = np.maximum(lower, -near), np.minimum(upper, near)
    loose = (held > 0.0) | (not bounded)
    lower, upper = np.where(loose, -np.inf, lower * size), np.where(loose, np.inf, upper * size)
    scaled, _ = solve_within(R, Q.T @ wanted, lower, upper)
    change, inside = scaled / size, (lower < scaled) & (scaled < upper)
    left = [own + by @ change for own, by in zip(rows, slopes, strict=True)]
    _, singular, rotation = np.linalg.svd(R[:, inside], full_matrices=False)
    singular = np.maximum(singular, np.finfo(float).eps * np.max(singular, initial=0.0))
    std = np.zeros(len(size))
    std[inside] = np.linalg.norm(rotation.T / singular, axis=1) / size[inside]
    squares = [float(np.mean(own**2)) if len(own) else 0.0 for own in left]
    whole = float(np.sum((wanted + stacked @ change) ** 2)) / max(sum(map(len, left)), 1)
    return FirstOrderFit(model, change, np.sqrt(max(1.0, *squares)) * std, tuple(squares), whole)
