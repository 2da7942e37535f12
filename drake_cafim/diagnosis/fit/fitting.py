"""Maximum a posteriori fits of a model's numbers to whitened rows."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.thresholds import (
    CORRECTION_COST_ALLOWANCE,
    REGRESSOR_SIGNAL_SHARE,
    UNKNOWN_REACH_IN_PRIOR_STDS,
    VISIBLE_ROW_CHANGE,
)
from drake_cafim.typing import Array

ROUNDS, CORRECTED = 5, 0.1
"""Corrections for shared noise, at most, and the part of a standard deviation that ends them."""
STRIDE = 3.0
"""Times the size of a number, or its typical one, that a step changes it by at most."""
NOTHING_KNOWN = 1e12
"""Variance of numbers that are an echo of noise."""
LEAST_KNOWN = 1e-13
"""Of the information on what is known best; what is less is rounding."""


@dataclass(frozen=True)
class Fit:
    """A fitted model: `residual` whitened rows and prior rows, `jacobian` of them, `covariance` of the numbers."""

    model: Model
    residual: Array
    jacobian: Array
    covariance: Array
    """(n + k, n + k) of unknowns and strengths, under the stated noise."""
    data_rows: int
    unbiased: bool = False
    """Whether the noise that regressors share with the residual was reckoned with."""
    echo: bool = False
    """Whether what was fitted is an echo of noise, of which nothing is known; it explains nothing."""
    penalty: float = 0.0
    """What is paid beside the rows, see `Problem.penalty`."""

    @property
    def chi_square(self) -> float:
        """Σ of squared whitened rows, priors included, and what is paid beside them."""
        value = float(self.residual @ self.residual) + self.penalty
        # what is beyond numbers fits worse than anything else
        return float("inf") if np.isnan(value) else value

    @property
    def reduced_chi_square(self) -> float:
        """χ² per degree of freedom; NaN where no rows are left beside the strengths."""
        return self.chi_square / self.degrees_of_freedom if self.degrees_of_freedom > 0 else float("nan")

    @property
    def strengths(self) -> int:
        """How many numbers beside the unknowns that have priors were fitted."""
        return len(self.model.vector) - len(self.model.unknown) + len(self.model.free)

    @property
    def degrees_of_freedom(self) -> int:
        """Data rows less the strengths; an unknown and its prior row cancel."""
        return self.data_rows - self.strengths

    @property
    def std(self) -> Array:
        """(n + k,) of unknowns and strengths; of what the rows do not see, that of nothing known."""
        known = np.sqrt(np.clip(np.diag(self.covariance), 0.0, None))
        return np.where(_unseen(self.model, self.jacobian), np.sqrt(NOTHING_KNOWN), known)


def fit(problem: Problem, model: Model, iterations: int = 12) -> Fit:
    """The model's numbers at the nearest minimum of χ², by damped Gauss–Newton (Levenberg, Marquardt).

    Quick, and biased towards zero where the regressors are noisy; `unbiased_fit` mends that.
    """
    model, residual, jacobian = _minimised(problem, model, np.zeros(len(model.vector)), iterations)
    seen = jacobian[: problem.rows]
    covariance = _posterior(problem, model, seen.T @ seen)
    return Fit(model, residual, jacobian, covariance, problem.rows, penalty=problem.penalty(model))


def unbiased_fit(problem: Problem, model: Model, iterations: int = 12) -> Fit:
    """`fit`, corrected for the noise that the regressors share with the residual.

    With measurement noise e both the residual z and its Jacobian J are noisy, and E[Jᵀz] at the truth is not zero but
    b = E[ΔJᵀΔz] (errors in variables; Fuller, Measurement Error Models, 1987, §1). b is taken from the difference
    that one more dose of noise makes, and Jᵀz = b is solved instead; likewise E[ΔJᵀΔJ] is taken off the information.
    A controller hands the noise on to the efforts, and so to what they drive (closed-loop identification; Ljung,
    System Identification, 1999, §13.4).
    """
    if not problem.regressors_noisy:
        return replace(fit(problem, model, iterations), unbiased=True)
    n = len(model.vector)
    model, residual, jacobian = _minimised(problem, model, np.zeros(n), iterations)
    excess = np.zeros((n, n))
    worth = _worth(problem, model, residual)
    first = model.vector
    for _ in range(ROUNDS if n else 0):
        before = model.vector
        offset, excess = problem.shared_noise(model, residual, jacobian)
        corrected = _minimised(problem, model, offset, 4, worth)
        if not float(offset @ (corrected[0].vector - first)) < worth:
            nothing = _posterior(problem, model, np.zeros((n, n)))
            paid = problem.penalty(model)
            return Fit(model, residual, jacobian, nothing, problem.rows, unbiased=True, echo=True, penalty=paid)
        model, residual, jacobian = corrected
        # the noise that is shared grows with the numbers themselves, so a large correction is made again
        if np.all(np.abs(model.vector - before) * np.linalg.norm(jacobian, axis=0) < CORRECTED):
            break
    seen = jacobian[: problem.rows]
    raw = np.einsum("ij,ij->j", seen, seen)
    empty = raw - np.diag(excess) < REGRESSOR_SIGNAL_SHARE * raw
    covariance = _posterior(problem, model, _without(_less(seen.T @ seen, excess), empty, raw))
    paid = problem.penalty(model)
    found = Fit(model, residual, jacobian, covariance, problem.rows, unbiased=True, penalty=paid)
    return replace(found, echo=_owed_to_noise(found, empty))


def _owed_to_noise(found: Fit, empty: np.ndarray[Any, np.dtype[np.bool_]]) -> bool:
    """Whether the explanation lives by numbers whose regressors are noise, `empty` (n + k,).

    It does where those take more off χ² than a criterion asks of as many numbers, ln R each over R rows (Schwarz, Ann.
    Statist. 6(2), 1978); what they take off is what χ² rises by, to first order, where they are at their nominal values
    and the other numbers follow. A direction that no row sees, as of a push along a link, takes off nothing.
    """
    change = _to_absent(found.model)
    echoing = empty & np.isfinite(change)
    if not np.any(echoing):
        return False
    without = found.residual + found.jacobian[:, echoing] @ change[echoing]
    others = found.jacobian[:, ~echoing]
    size = np.linalg.norm(others, axis=0)
    basis = others / np.where(size > 0.0, size, 1.0)
    left = without - basis @ np.linalg.lstsq(basis, without, rcond=None)[0]
    scale = max(1.0, found.chi_square / max(found.degrees_of_freedom, 1))
    gained = float(left @ left - found.residual @ found.residual) / scale
    return gained > int(np.count_nonzero(echoing)) * float(np.log(max(found.data_rows, 2)))


def _to_absent(model: Model) -> Array:
    """(n + k,) how far each number is from where its effect is absent, by its slope here; NaN of all others."""
    far = [np.nan] * len(model.unknown)
    for effect in model.effects:
        for s, value in zip(effect.strengths, effect.vector, strict=True):
            # to first order in its inverse, what is absent at infinity is its own value away
            far.append((value if s.inverse else s.nominal - value) if s.amplitude else np.nan)
    return np.array(far)


def _worth(problem: Problem, model: Model, residual: Array) -> float:
    """Half of what the effects take off χ²; a correction that would cost more finds them to be noise altogether."""
    if not model.effects:
        return np.inf
    without = problem.residual(replace(model, effects=()))
    return 0.5 * float(without @ without - residual @ residual) + CORRECTION_COST_ALLOWANCE


def _less(information: Array, excess: Array) -> Array:
    """The information less what noise in the regressors adds to it, of which each direction keeps a fifth.

    Where gaps close, one more dose of noise makes more of a difference than the noise that is there has made; with all
    of it taken off, a direction of numbers that each are known would count as not known at all.
    """
    if not np.any(information):
        return information
    size = np.sqrt(np.diag(information))
    size = np.where(size > 0.0, size, 1.0)
    known, axes = np.linalg.eigh(information / np.outer(size, size))
    root = np.sqrt(np.maximum(known, LEAST_KNOWN * np.max(known, initial=0.0)))
    whitened = (axes / root).T @ (excess / np.outer(size, size)) @ (axes / root)
    share, turned = np.linalg.eigh(0.5 * (whitened + whitened.T))
    factor = (axes * root) @ turned * np.sqrt(np.maximum(1.0 - share, REGRESSOR_SIGNAL_SHARE))
    return np.asarray((factor @ factor.T) * np.outer(size, size))


def _without(information: Array, empty: np.ndarray[Any, np.dtype[np.bool_]], raw: Array) -> Array:
    """The information without what the `empty` numbers owe to noise in their own regressors, of sizes `raw`².

    A gain of a channel that holds nothing but noise is such a number: nothing is known of it.
    """
    if not np.any(empty):
        return information
    kept = information.copy()
    kept[empty, :] = 0.0
    kept[:, empty] = 0.0
    kept[empty, empty] = 1e-12 * raw[empty]
    return kept


def _posterior(problem: Problem, model: Model, information: Array) -> Array:
    """(n + k, n + k) covariance by the `information` of the data rows and the priors of the unknowns.

    Noise in the regressors takes away what recordings say, and nothing of what was known before them: no unknown is
    known less well than by its prior. Of a strength there is none, so that its variance is `NOTHING_KNOWN` at most.
    """
    known = np.zeros(len(information))
    known[: len(model.unknown)] = problem.prior_std(model) ** -2.0
    if not np.any(information) or not np.all(np.isfinite(information)):
        return np.diag(1.0 / np.where(known > 0.0, known, 1.0 / NOTHING_KNOWN))
    return _inverse(information + np.diag(known))


def _inverse(information: Array) -> Array:
    # numbers in their own units differ by many powers of ten: a cubic stiffness beside a coefficient of friction
    size = np.sqrt(np.abs(np.diag(information)))
    size[size == 0.0] = 1.0
    known, axes = np.linalg.eigh(information / np.outer(size, size))
    # of what is not seen nothing is known, which is the opposite of a pseudoinverse's zero
    least = LEAST_KNOWN * float(np.max(known, initial=0.0))
    known = np.maximum(known, least if least > 0.0 else 1.0 / NOTHING_KNOWN)
    return np.asarray((axes / known) @ axes.T / np.outer(size, size), dtype=float)


def _minimised(
    problem: Problem, model: Model, offset: Array, iterations: int, most: float = np.inf
) -> tuple[Model, Array, Array]:
    """Model, residual and Jacobian where ½ z·z − offset·numbers is smallest nearby, the second part at most `most`."""
    # what begins beyond its bounds begins at them: there is no slope outside
    model = model.at(model.vector)
    residual, jacobian = problem.residual(model), problem.jacobian(model)
    start, damping = model.vector, 1e-6
    for _ in range(iterations):
        if jacobian.shape[1] == 0:
            break
        trial, trial_residual, damping = _step(problem, model, residual, jacobian, offset, damping)
        if trial is None:
            break
        if float(offset @ (trial.vector - start)) > most:
            return trial, trial_residual, jacobian
        gained = residual @ residual - trial_residual @ trial_residual
        model, residual = trial, trial_residual
        jacobian = problem.jacobian(model)
        if abs(gained) < 2.0 * _least_gain(problem, residual) + 1e-5 * (residual @ residual) / len(residual):
            break
    return model, residual, jacobian


def _step(
    problem: Problem, model: Model, residual: Array, jacobian: Array, offset: Array, damping: float
) -> tuple[Model | None, Array, float]:
    """A model with a smaller objective, or None where no damping finds one."""
    scale = np.linalg.norm(jacobian, axis=0)
    # what the rows do not see stays where it is: its slope is rounding
    unseen = _unseen(model, jacobian)
    scale[unseen] = 1.0
    scaled = np.where(unseen, 0.0, jacobian / scale)
    normal, gradient = scaled.T @ scaled, np.where(unseen, 0.0, scaled.T @ residual - offset / scale)
    start = 0.5 * float(residual @ residual)
    least_gain, reach = _least_gain(problem, residual), _reach(model)
    for _ in range(8):
        damped = normal + damping * np.eye(len(scale))
        step = -np.linalg.solve(damped, gradient)
        if -float(gradient @ step) < least_gain:
            break
        step = np.clip(step, -reach * scale, reach * scale)
        trial = _kept_near(problem, model.at(model.vector + step / scale))
        taken = (trial.vector - model.vector) * scale
        stopped = np.abs(taken - step) > 1e-9 * (1.0 + np.abs(step))
        if np.any(stopped) and not np.all(stopped):
            # what met its bound stays there; the others then have another best step
            free = ~stopped
            toward = gradient[free] + damped[np.ix_(free, stopped)] @ taken[stopped]
            taken[free] = -np.linalg.solve(damped[np.ix_(free, free)], toward)
            trial = _kept_near(problem, model.at(model.vector + taken / scale))
        if not all(effect.plausible() for effect in trial.effects):
            damping = max(damping * 10.0, problem.least_damping)
            continue
        trial_residual = problem.residual(trial)
        moved = float(offset @ (trial.vector - model.vector))
        if np.all(np.isfinite(trial_residual)) and 0.5 * float(trial_residual @ trial_residual) - moved < start:
            return trial, trial_residual, max(damping * 0.1, 1e-9)
        damping = max(damping * 10.0, problem.least_damping)
    return None, residual, damping


def _least_gain(problem: Problem, residual: Array) -> float:
    """Of χ²: what a step must promise to be worth taking."""
    beyond = max(float(residual @ residual) - len(residual), 0.0)
    return problem.least_gain + problem.slack * beyond


def _reach(model: Model) -> Array:
    """How far a step may take each number: where little is known of one, its slope says nothing from afar."""
    return STRIDE * _sizes(model)


def _unseen(model: Model, jacobian: Array) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Which strengths hardly move a row at their usual size; unknowns always have a prior's."""
    effect = np.linalg.norm(jacobian[:, len(model.unknown) :], axis=0) * _sizes(model)[len(model.unknown) :]
    return np.concatenate([np.zeros(len(model.unknown), dtype=bool), effect < VISIBLE_ROW_CHANGE])


def _sizes(model: Model) -> Array:
    """The typical size of each number, or its own if that is larger; infinite for unknowns, which have priors."""
    sizes = [max(s.typical, abs(effect.values[s.name])) for effect in model.effects for s in effect.strengths]
    return np.array([np.inf] * len(model.unknown) + sizes)


def _kept_near(problem: Problem, model: Model) -> Model:
    """The model with its unknowns within `FARTHEST` of their priors and inside their physical bounds."""
    priors = problem.scene.priors
    reach = UNKNOWN_REACH_IN_PRIOR_STDS * problem.prior_std(model)
    near = np.clip(model.unknown, priors.mean - reach, priors.mean + reach)
    return replace(model, unknown=priors.clip(near))
