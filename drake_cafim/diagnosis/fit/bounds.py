"""The bounds of a model's parameters, and least squares within them."""

from dataclasses import replace

import numpy as np
from scipy.optimize import lsq_linear

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.thresholds import UNKNOWN_REACH_IN_PRIOR_STDS
from drake_cafim.scenario.inertials import INERTIALS
from drake_cafim.typing import Array, Flags

AT_BOUND = 1e-6
"""Distance from a bound, as a share of the distance between the bounds, up to which an unknown counts as at it."""
IN_VAIN, ROUNDING = 3, 1e-12
"""Exchanges of many parameters that may follow each other without fewer violations, and relative rounding errors."""


def bounds(problem: Problem, model: Model) -> tuple[Array, Array]:
    """The least and the largest value (n + k,) of each parameter.

    An unknown stays within `UNKNOWN_REACH_IN_PRIOR_STDS` of its prior and in its physical bounds.
    """
    priors, strengths = problem.scene.priors, [strength for effect in model.effects for strength in effect.strengths]
    reach = UNKNOWN_REACH_IN_PRIOR_STDS * problem.prior_std(model)
    lower = [*priors.clip(priors.mean - reach), *(strength.lower for strength in strengths)]
    upper = [*priors.clip(priors.mean + reach), *(strength.upper for strength in strengths)]
    return np.array(lower, dtype=float), np.array(upper, dtype=float)


def clip_unknowns(problem: Problem, model: Model) -> Model:
    """The model with its unknowns within their bounds."""
    n = len(model.unknown)
    lower, upper = bounds(problem, model)
    return replace(model, unknown=np.clip(model.unknown, lower[:n], upper[:n]))


def steps_within(problem: Problem, model: Model) -> tuple[Array, Array]:
    """The least and the largest step (n + k,) of each parameter of a model to its bounds."""
    lower, upper = bounds(problem, model)
    # the model itself is within its bounds but for rounding
    return np.minimum(lower - model.vector, 0.0), np.maximum(upper - model.vector, 0.0)


def inertials_at_bound(problem: Problem, model: Model) -> Flags:
    """(n,) whether an unknown is one of a link's inertial parameters and at a bound."""
    lower, upper = (step[: len(model.unknown)] for step in steps_within(problem, model))
    reach = AT_BOUND * (upper - lower)
    inertial = np.array([unknown.kind == INERTIALS for unknown in problem.scene.unknown], dtype=bool)
    return inertial & ((-lower <= reach) | (upper <= reach))


def solve_within(triangle: Array, seen: Array, lower: Array, upper: Array) -> tuple[Array, float]:
    """The step d (m,) that minimises |R d + s|² with `lower` ≤ d ≤ `upper`, (m,) each, and half of that minimum.

    J = Q R are slopes with their `triangle` R (m, m), s = Qᵀ z a residual `seen` (m,) along them. A step that is cut
    off at a bound is not the best one within: what moves together with it is left behind.
    """
    step, free = np.zeros(len(lower)), lower < upper
    if np.any(free):
        found = _exchange(triangle[:, free], seen, lower[free], upper[free])
        if found is None:
            found = lsq_linear(triangle[:, free], -seen, (lower[free], upper[free]), method="bvls").x
        step[free] = found
    left = triangle @ step + seen
    return step, 0.5 * float(left @ left)


def _exchange(R: Array, s: Array, lower: Array, upper: Array) -> Array | None:
    """The step d (m,) of least |R d + s|² within its bounds, by block principal pivoting; None where it does not end.

    All free parameters beyond a bound are fixed there at once, and all fixed ones are freed whose slope leads inward;
    where that leads nowhere, the last of them alone, which ends where R has full rank (Portugal, Júdice, Vicente,
    Mathematics of Computation 63(208), 1994, §4). An active set that changes by one parameter at a time takes as many
    solutions as there are parameters; this takes a few.
    """
    low, high = np.zeros(len(lower), dtype=bool), np.zeros(len(lower), dtype=bool)
    reach = ROUNDING * float(np.max(np.abs(R.T @ s), initial=0.0))
    fewest, patience = len(lower) + 1, IN_VAIN
    for _ in range(10 * len(lower)):
        free = ~low & ~high
        d = np.where(low, lower, np.where(high, upper, 0.0))
        if np.any(free):
            d[free] = np.linalg.lstsq(R[:, free], -(s + R[:, ~free] @ d[~free]), rcond=None)[0]
        slope = R.T @ (R @ d + s)
        below, above = free & (d < lower), free & (d > upper)
        freed = (low & (slope < -reach)) | (high & (slope > reach))
        wrong = np.flatnonzero(below | above | freed)
        if not len(wrong):
            return d
        patience = IN_VAIN if len(wrong) < fewest else patience - 1
        fewest = min(fewest, len(wrong))
        change = np.zeros(len(lower), dtype=bool)
        change[wrong if patience >= 0 else wrong[-1:]] = True
        low, high = (low | (below & change)) & ~(freed & change), (high | (above & change)) & ~(freed & change)
    return None


def minimise_within(curvature: Array, slope: Array, lower: Array, upper: Array) -> Array:
    """The step d (m,) that minimises ½ dᵀ H d + gᵀ d with `lower` ≤ d ≤ `upper`, (m,) each.

    H is the positive definite `curvature` (m, m), g the `slope` (m,).
    """
    sizes, axes = np.linalg.eigh(curvature)
    root = np.sqrt(np.maximum(sizes, np.finfo(float).eps * sizes[-1]))
    return solve_within((axes * root).T, axes.T @ slope / root, lower, upper)[0]
