"""Strengths refitted without a part of the recordings and without some of what was found, to first order.

With z the whitened rows of the fit, J their Jacobian and c_i their change when item i is taken out (exact, not
linearised), the rows without the items not kept are z + Σ c_i + J δ. Without part p the step δ solves

    (Σ_{q≠p} J_qᵀ J_q + P) δ = −(Σ_{q≠p} J_qᵀ (z + Σ c_i)_q + P (x − μ)) + S b

over the kept columns, P the information of the priors and b the gradient that the fit ended with, which is not zero
where it was corrected for noise in the regressors or where a strength is at its bound; S is diagonal, the share that
the other parts have of each parameter's information: none of what acts in part p alone. Only products of the columns of
each part are needed, so that any choice of items costs a solution of this equation a part.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model, step_from
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.left_out.parts import Part
from drake_cafim.diagnosis.thresholds import LEFT_OUT_SEEN_CHI_SQUARE, UNKNOWN_REACH_IN_PRIOR_STDS
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array, Flags

UNKNOWNS = -1
"""The item that stands for all unknowns at their fitted values instead of those given."""
RIDGE = 1e-9
"""Share of a column's information that is added, so that what the other parts do not show keeps its value."""
Items = frozenset[int]
"""Numbers of effects of the fitted model, and `UNKNOWNS`."""


@dataclass(frozen=True)
class Refits:
    """The products of the rows' columns, part by part."""

    fitted: Fit
    given: Array
    """(n,) the unknowns of the scene as given, which a search may have set to others."""
    prior_mean: Array
    prior_information: Array
    """(n,) 1/σ² of each unknown."""
    items: tuple[int, ...]
    products: Array
    """(p, m, m) of the columns [J, c, z] in each part."""
    scene: Scene

    @classmethod
    def of(cls, problem: Problem, fitted: Fit, parts: Sequence[Part], given: Array | None = None) -> "Refits":
        """The refits of `fitted`, a fit to `problem`, whose prior means are those `given` (n,) unless stated."""
        model, rows = fitted.model, problem.rows
        z, jacobian = fitted.residual[:rows], fitted.jacobian[:rows]
        items = tuple(range(len(model.effects)))
        moved = len(model.unknown) > 0 and not np.array_equal(model.unknown, problem.scene.priors.mean)
        items = (*items, *([UNKNOWNS] if moved else []))
        changes = [problem.rows_of(without(model, item, problem.scene.priors.mean)) - z for item in items]
        # rows that diverge without an item are as bad as can be told
        bounded = [np.nan_to_num(change, nan=1e6, posinf=1e6, neginf=-1e6) for change in changes]
        columns = np.column_stack([jacobian, *bounded, z])
        masks = [part.rows(problem.runs) for part in parts]
        products = np.stack([columns[mask].T @ columns[mask] for mask in masks])
        information = problem.prior_std(model) ** -2.0
        mean = problem.scene.priors.mean
        return cls(fitted, mean if given is None else given, mean, information, items, products, problem.scene)

    @cached_property
    def _start(self) -> Array:
        """(k,) number of the first column of each effect's strengths, and of the column after the last one."""
        sizes = [len(effect.strengths) for effect in self.fitted.model.effects]
        return len(self.prior_mean) + np.cumsum([0, *sizes])

    def _free(self, kept: Items) -> Flags:
        """(n + k,) whether each parameter is fitted."""
        free = np.zeros(len(self.fitted.model.vector), dtype=bool)
        free[: len(self.prior_mean)] = UNKNOWNS in kept
        for item in kept - {UNKNOWNS}:
            free[self._start[item] : self._start[item + 1]] = True
        return free

    def _chosen(self, kept: Items) -> Array:
        """(m,) the combination of the columns that is z + Σ c_i."""
        width = len(self.fitted.model.vector)
        taken = [float(item not in kept) for item in self.items]
        return np.concatenate([np.zeros(width), taken, [1.0]])

    def step(self, kept: Items, part: int) -> Array:
        """δ (n + k,) by the rows of all parts but `part`."""
        width, n = len(self.fitted.model.vector), len(self.prior_mean)
        others = np.sum(np.delete(self.products, part, axis=0), axis=0)
        whole = np.sum(self.products, axis=0)
        prior = np.zeros(width)
        prior[:n] = self.prior_information
        pulled = np.zeros(width)
        pulled[:n] = self.prior_information * (self.fitted.model.unknown - self.prior_mean)
        ended = whole[:width, -1] + pulled
        seen = np.diag(whole)[:width]
        share = np.diag(others)[:width] / np.where(seen > 0.0, seen, 1.0)
        gradient = others[:width] @ self._chosen(kept) + pulled - share * ended
        step, free = np.zeros(width), self._free(kept)
        if np.any(free):
            information = others[:width, :width] + np.diag(prior + RIDGE * np.diag(whole[:width, :width]))
            own = information[np.ix_(free, free)]
            size = np.sqrt(np.diag(own))
            size = np.where(size > 0.0, size, 1.0)
            step[free] = -np.linalg.lstsq(own / np.outer(size, size), gradient[free] / size, rcond=None)[0] / size
        return step

    def chi_square(self, kept: Items) -> Array:
        """(p,) χ² of the rows of each part, by what the other parts say with the `kept` items alone."""
        found = []
        for part in range(len(self.products)):
            combined = self._chosen(kept)
            combined[: len(self.fitted.model.vector)] = self.step(kept, part)
            found.append(float(combined @ self.products[part] @ combined))
        return np.array(found)

    def shown(self, item: int) -> Flags:
        """(p,) whether both the rows of each part and those outside it show the item: else the part cannot judge it."""
        column = len(self.fitted.model.vector) + self.items.index(item)
        own = self.products[:, column, column]
        return np.asarray(np.minimum(own, np.sum(own) - own) > LEFT_OUT_SEEN_CHI_SQUARE)

    def model(self, kept: Items, part: int) -> Model:
        """The model of the `kept` items, refitted without `part`; the one given where nothing is kept."""
        if not kept:
            return replace(self.fitted.model, unknown=self.given, effects=())
        model = step_from(self.scene, self.fitted.model, self.step(kept, part))
        # parts that tell little may lead to where no link has such inertials
        reach = UNKNOWN_REACH_IN_PRIOR_STDS * self.prior_information**-0.5
        within = np.clip(model.unknown, self.prior_mean - reach, self.prior_mean + reach)
        unknown = within if UNKNOWNS in kept else self.prior_mean
        effects = tuple(effect for k, effect in enumerate(model.effects) if k in kept)
        return replace(model, unknown=unknown, effects=effects)

    def models(self, kept: Items) -> list[Model]:
        """`model` of each part."""
        return [self.model(kept, part) for part in range(len(self.products))]


def without(model: Model, item: int, given: Array) -> Model:
    """The model without an item: an effect, or the fitted unknowns, which then have the values `given`."""
    if item == UNKNOWNS:
        return replace(model, unknown=given, free=())
    return model.without(model.effects[item])
