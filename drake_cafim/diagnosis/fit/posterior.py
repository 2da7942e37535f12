"""The covariance of a model's parameters by the information of the rows and the priors of its unknowns."""

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.thresholds import REGRESSOR_SIGNAL_SHARE
from drake_cafim.typing import Array, Flags

NOTHING_KNOWN = 1e12
"""Variance of a parameter of which the rows contain no information."""
LEAST_INFORMATION = 1e-13
"""Eigenvalue of the scaled information over the largest one, below which it is rounding error."""


def posterior(problem: Problem, model: Model, information: Array) -> Array:
    """(n + k, n + k) covariance by the `information` of the data rows and the priors of the unknowns.

    Noise in the regressors takes away what recordings say, and nothing of what was known before them: no unknown is
    known less well than by its prior. Of a strength there is none, so that its variance is `NOTHING_KNOWN` at most.
    """
    known = np.append(problem.prior_std(model) ** -2.0, np.zeros(len(information) - len(model.unknown)))
    if not np.any(information) or not np.all(np.isfinite(information)):
        return np.diag(1.0 / np.where(known > 0.0, known, 1.0 / NOTHING_KNOWN))
    return _inverse(information + np.diag(known))


def subtract_excess(information: Array, excess: Array) -> Array:
    """The information I − E, of which each direction keeps at least the share `REGRESSOR_SIGNAL_SHARE` of I.

    E is the `excess` by noise in the regressors. At closing gaps, noise that is added changes more than the noise that
    is in the recordings did; without the bound, parameters that are known would count as unknown.
    """
    if not np.any(information):
        return information
    size = np.sqrt(np.diag(information))
    size = np.where(size > 0.0, size, 1.0)
    known, axes = np.linalg.eigh(information / np.outer(size, size))
    root = np.sqrt(np.maximum(known, LEAST_INFORMATION * np.max(known, initial=0.0)))
    whitened = (axes / root).T @ (excess / np.outer(size, size)) @ (axes / root)
    share, turned = np.linalg.eigh(0.5 * (whitened + whitened.T))
    factor = (axes * root) @ turned * np.sqrt(np.maximum(1.0 - share, REGRESSOR_SIGNAL_SHARE))
    return np.asarray((factor @ factor.T) * np.outer(size, size))


def drop_empty(information: Array, empty: Flags, raw: Array) -> Array:
    """The information without that on `empty` parameters, whose regressors are noise; `raw` (n + k,) is its diagonal.

    Such a parameter is the gain of a channel that contains only noise: nothing is known of it.
    """
    if not np.any(empty):
        return information
    kept = information.copy()
    kept[empty, :] = kept[:, empty] = 0.0
    kept[empty, empty] = 1e-12 * raw[empty]
    return kept


def _inverse(information: Array) -> Array:
    # parameters differ by many powers of ten: a cubic stiffness beside a coefficient of friction
    size = np.sqrt(np.abs(np.diag(information)))
    size[size == 0.0] = 1.0
    known, axes = np.linalg.eigh(information / np.outer(size, size))
    # a direction without information has an infinite variance; a pseudoinverse would make it zero
    least = LEAST_INFORMATION * float(np.max(known, initial=0.0))
    known = np.maximum(known, least if least > 0.0 else 1.0 / NOTHING_KNOWN)
    return np.asarray((axes / known) @ axes.T / np.outer(size, size), dtype=float)
