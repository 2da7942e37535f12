"""Maximum a posteriori fits of a model's unknowns and strengths to whitened rows, by Levenberg–Marquardt."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.diagnosis.fit.bounds import (
    clip_unknowns,
    inertials_at_bound,
    minimise_within,
    solve_within,
    steps_within,
)
from drake_cafim.diagnosis.fit.model import Model, step_from, weakened
from drake_cafim.diagnosis.fit.posterior import (
    LEAST_INFORMATION,
    NOTHING_KNOWN,
    drop_empty,
    posterior,
    subtract_excess,
)
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.thresholds import (
    CORRECTION_COST_ALLOWANCE,
    REGRESSOR_SIGNAL_SHARE,
    VISIBLE_ROW_CHANGE,
)
from drake_cafim.typing import Array, Flags

MOST_CORRECTIONS, CORRECTION_TOLERANCE = 5, 0.1
"""Largest number of corrections for shared noise, and their size, in standard deviations, at which they end."""
LARGEST_STEP = 3.0
"""Largest change of a parameter in one step, over its size or, if that is larger, its typical size."""
ROUGHLY = 1e-2, 100.0
"""Least damping after a step that failed, and its growth from one to the next, where a fit has a tolerance: what slopes
that are not exact promise in vain is then found out by few residuals."""
CONVERGED = 0.1
"""Decrease of χ², over the mean square of the rows where that is above 1, below which a search fits no further."""
WEAK = 0.1
"""Share of the strengths of effects that are too strong together, with which a fit begins again."""


@dataclass(frozen=True)
class Fit:
    """A fitted model, with its whitened rows and prior rows `residual` (R + n,) and their `jacobian` (R + n, n + k)."""

    model: Model
    residual: Array
    jacobian: Array
    covariance: Array
    """(n + k, n + k) of n unknowns and k strengths, under the stated noise."""
    data_rows: int
    unbiased: bool = False
    """Whether it is corrected for the noise that regressors share with the residual, see `unbiased_fit`."""
    echo: bool = False
    """Whether its decrease of χ² is an artefact of noise in the regressors: then it explains nothing."""
    penalty: float = 0.0
    """Addition to χ² beside the rows, see `Problem.penalty`."""
    left_without: dict[object, tuple[Callable[[], Problem | None], Array]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    """Cache: the rows (R + n,) that are left without some of the effects, by what is left out, and of which problem."""

    def __getstate__(self) -> dict[str, object]:
        """Without the cache, for processes that give fits back."""
        return {**vars(self), "left_without": {}}

    @property
    def chi_square(self) -> float:
        """Σ of squared whitened rows and prior rows, plus `penalty`; infinite where that is no number."""
        value = float(self.residual @ self.residual) + self.penalty
        # an overflow fits worse than anything else
        return float("inf") if np.isnan(value) else value

    @property
    def reduced_chi_square(self) -> float:
        """χ² per degree of freedom; NaN where no rows are left beside the strengths."""
        return self.chi_square / self.degrees_of_freedom if self.degrees_of_freedom > 0 else float("nan")

    @property
    def strengths(self) -> int:
        """Number of fitted parameters, the unknowns whose prior applies not counted."""
        return len(self.model.vector) - len(self.model.unknown) + len(self.model.free)

    @property
    def degrees_of_freedom(self) -> int:
        """Number of data rows less `strengths`; an unknown and its prior row cancel."""
        return self.data_rows - self.strengths

    @property
    def std(self) -> Array:
        """(n + k,) standard deviations; √`NOTHING_KNOWN` of strengths that do not move the rows."""
        known = np.sqrt(np.clip(np.diag(self.covariance), 0.0, None))
        return np.where(_unseen(self.model, self.jacobian), np.sqrt(NOTHING_KNOWN), known)


def fit(problem: Problem, model: Model, iterations: int = 12, tolerance: float = 0.0, own_noise: bool = True) -> Fit:
    """The fit at the nearest minimum of χ², by damped Gauss–Newton (Levenberg, Marquardt).

    It is quick, but biased towards zero where the regressors are noisy; `unbiased_fit` corrects that. It ends where a
    step would lower χ² by less than `tolerance`, times the mean square of the rows where that is above 1, or by next to
    nothing. Without `own_noise` its penalty is not that of another inertia's noise, for which the rows are whitened
    again.
    """
    # what was fitted to first order may begin beyond a bound
    start, no_offset = _off_saddle(problem, clip_unknowns(problem, model)), np.zeros(len(model.vector))
    found = _minimise_inside(problem, start, no_offset, iterations, tolerance)
    bent = _off_flat_slopes(problem, *found)
    if bent is not None:
        found = min(found, _minimise(problem, bent, no_offset, iterations, tolerance=tolerance), key=_squares)
    model, residual, jacobian = found
    seen = jacobian[: problem.rows]
    covariance = posterior(problem, model, seen.T @ seen)
    paid = problem.penalty(model, own_noise)
    return Fit(model, residual, jacobian, covariance, problem.rows, penalty=paid)


def fit_at_first_order(problem: Problem, found: Fit, model: Model, columns: Sequence[Array]) -> Fit:
    """One Gauss-Newton step of `model`, which is that of `found` with effects added.

    `columns` (R + n, k) are the derivatives by the strengths of each of these; the others are those of `found`.
    """
    residual, jacobian = problem.residual(model), np.concatenate([found.jacobian, *columns], axis=1)
    scale = np.linalg.norm(jacobian, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    step = -np.linalg.lstsq(jacobian / scale, residual, rcond=LEAST_INFORMATION)[0] / scale
    lower, upper = steps_within(problem, model)
    if np.any(step < lower) or np.any(step > upper):
        basis, triangle = np.linalg.qr(jacobian / scale)
        step = solve_within(triangle, basis.T @ residual, lower * scale, upper * scale)[0] / scale
    moved = clip_unknowns(problem, step_from(problem.scene, model, step))
    residual = residual + jacobian @ step
    seen = jacobian[: problem.rows]
    covariance = posterior(problem, moved, seen.T @ seen)
    return Fit(moved, residual, jacobian, covariance, problem.rows, penalty=found.penalty)


def fit_beside(problem: Problem, before: Fit, model: Model) -> Fit:
    """The quick fit of `model`, which has effects that `before` lacks, each as strong as it would be alone.

    Together they may be far too much, and the fit may end worse than without them: then it begins again with `WEAK`
    shares of them.
    """
    found = fit(problem, model, tolerance=CONVERGED, own_noise=False)
    # by the rows alone: the penalty of another inertia's noise is that of one of the two
    worse = float(found.residual @ found.residual) > float(before.residual @ before.residual)
    if before.model.keys < model.keys and worse:
        weak = weakened(model, model.keys - before.model.keys, WEAK)
        found = min(found, fit(problem, weak, tolerance=CONVERGED, own_noise=False), key=lambda each: each.chi_square)
    return found


def unbiased_fit(problem: Problem, model: Model, iterations: int = 12) -> Fit:
    """`fit`, corrected for the noise that the regressors share with the residual.

    With measurement noise e both the residual z and its Jacobian J are noisy, and E[Jᵀz] at the truth is not zero but
    b = E[ΔJᵀΔz] (errors in variables; Fuller, Measurement Error Models, 1987, §1). b is estimated by adding noise
    once more, and Jᵀz = b is solved instead; likewise E[ΔJᵀΔJ] is subtracted from the information.
    A controller passes the noise on to the efforts, and so to the motion that they drive (closed-loop identification;
    Ljung, System Identification, 1999, §13.4).
    """
    if not problem.regressors_noisy:
        return replace(fit(problem, model, iterations), unbiased=True)
    n = len(model.vector)
    model, residual, jacobian = _minimise_inside(problem, _off_saddle(problem, model), np.zeros(n), iterations)
    excess = np.zeros((n, n))
    most = _largest_correction(problem, model, residual)
    first = model.vector
    for _ in range(MOST_CORRECTIONS if n else 0):
        before = model.vector
        offset, excess = problem.shared_noise(model, residual, jacobian)
        corrected = _minimise(problem, model, offset, 4, most)
        # a correction that costs about what the effects gained: they were fitted to noise
        if not float(offset @ (corrected[0].vector - first)) < most:
            nothing = posterior(problem, model, np.zeros((n, n)))
            paid = problem.penalty(model)
            return Fit(model, residual, jacobian, nothing, problem.rows, unbiased=True, echo=True, penalty=paid)
        model, residual, jacobian = corrected
        # the shared noise grows with the parameters themselves, so a large correction is repeated
        if np.all(np.abs(model.vector - before) * np.linalg.norm(jacobian, axis=0) < CORRECTION_TOLERANCE):
            break
    seen = jacobian[: problem.rows]
    raw = np.einsum("ij,ij->j", seen, seen)
    empty = raw - np.diag(excess) < REGRESSOR_SIGNAL_SHARE * raw
    covariance = posterior(problem, model, drop_empty(subtract_excess(seen.T @ seen, excess), empty, raw))
    paid = problem.penalty(model)
    found = Fit(model, residual, jacobian, covariance, problem.rows, unbiased=True, penalty=paid)
    return replace(found, echo=_is_echo(found, empty))


def _is_echo(found: Fit, empty: Flags) -> bool:
    """Whether the fit depends on parameters whose regressors are only noise, `empty` (n + k,).

    It does where these lower χ² by more than ln R each over R rows, which an information criterion requires of as many
    parameters (Schwarz, Ann. Statist. 6(2), 1978). Their decrease of χ² is its rise, to first order, when they are set
    to their nominal values and the other parameters adapt. One that moves no row, as a push along a link, has none.
    """
    change = _change_to_absent(found.model)
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


def _change_to_absent(model: Model) -> Array:
    """(n + k,) change of each amplitude that removes its effect; NaN of unknowns and of other strengths."""
    far = [np.nan] * len(model.unknown)
    for effect in model.effects:
        for s, value in zip(effect.strengths, effect.vector, strict=True):
            # an effect that is absent at infinity, as a stiffness: to first order in 1/value the change is the value
            far.append((value if s.inverse else s.nominal - value) if s.amplitude else np.nan)
    return np.array(far)


def _largest_correction(problem: Problem, model: Model, residual: Array) -> float:
    """Half of the decrease of χ² by the effects, plus an allowance: a correction may cost no more."""
    if not model.effects:
        return np.inf
    without = problem.residual(replace(model, effects=()))
    return 0.5 * float(without @ without - residual @ residual) + CORRECTION_COST_ALLOWANCE


def _minimise(
    problem: Problem, model: Model, offset: Array, iterations: int, most: float = np.inf, tolerance: float = 0.0
) -> tuple[Model, Array, Array]:
    """Model, residual and Jacobian at the nearest minimum of ½ |z|² − bᵀx over the parameters x, b the `offset`.

    It ends early where bᵀ(x − x₀) exceeds `most`.
    """
    # start inside the bounds: there are no slopes outside
    model = model.at(model.vector)
    residual, jacobian = problem.residual(model), problem.jacobian(model)
    start, damping = model.vector, 1e-6
    for _ in range(iterations):
        if jacobian.shape[1] == 0 or not np.all(np.isfinite(residual)):
            # where the rows diverge they have no slopes
            break
        least = _least_gain(problem, residual, tolerance)
        harder = ROUGHLY if tolerance else (problem.least_damping, 10.0)
        trial, trial_residual, damping = _step(problem, model, residual, jacobian, offset, damping, least, harder)
        if trial is None:
            break
        if float(offset @ (trial.vector - start)) > most:
            return trial, trial_residual, jacobian
        gained = residual @ residual - trial_residual @ trial_residual
        model, residual = trial, trial_residual
        jacobian = problem.jacobian(model)
        enough = 2.0 * _least_gain(problem, residual, tolerance)
        if abs(gained) < enough + 1e-5 * (residual @ residual) / len(residual):
            break
    return model, residual, jacobian


def _minimise_inside(
    problem: Problem, model: Model, offset: Array, iterations: int, tolerance: float = 0.0
) -> tuple[Model, Array, Array]:
    """`_minimise`, begun once more at the prior means where unknown inertials end at a bound, if that finds less.

    Rows are linear in a link's inertial parameters, and these one-to-one with the log-Cholesky ones: χ² has one minimum
    inside the bounds. At these it may have others, where unknowns made up for effects that were not in the model yet.
    """
    found = _minimise(problem, model, offset, iterations, tolerance=tolerance)
    if not np.any(inertials_at_bound(problem, found[0])):
        return found
    inside = replace(found[0], unknown=problem.scene.priors.mean)
    again = _minimise(problem, _off_saddle(problem, inside), offset, iterations, tolerance=tolerance)
    return min(found, again, key=_squares)


def _squares(found: tuple[Model, Array, Array]) -> float:
    return float(found[1] @ found[1])


def _off_saddle(problem: Problem, model: Model) -> Model:
    """The model whose unknown factors, as the mass of a load whose place is unknown, are not zero.

    Where one is, the rows have no slope by what it is multiplied by. It then begins one prior standard deviation away.
    """
    multiplied = [parameter for parameter in problem.scene.unknown if parameter.through]
    if not multiplied:
        return model
    unknown, names = model.unknown.copy(), [parameter.key for parameter in problem.scene.unknown]
    for parameter in multiplied:
        factor = (parameter.through, parameter.at, parameter.effect)
        if factor in names and unknown[names.index(factor)] == 0.0:
            unknown[names.index(factor)] = problem.scene.priors.std[names.index(factor)]
    return replace(model, unknown=problem.scene.priors.clip(unknown))


def _off_flat_slopes(problem: Problem, model: Model, residual: Array, jacobian: Array) -> Model | None:
    """The model with strengths of their typical size that have no slope where it is, but move the rows from there.

    Gravity that leans across the plane of an arm acts by the cosine of its angle, which has no slope at zero. None
    where no strength is like that.
    """
    flat = _unseen(model, jacobian)
    if not np.any(flat):
        return None
    moved = model.at(np.where(flat, model.vector + _sizes(model), model.vector))
    if not all(effect.plausible() for effect in moved.effects):
        return None
    change = problem.residual(moved) - residual
    visible = np.all(np.isfinite(change)) and float(np.linalg.norm(change)) > VISIBLE_ROW_CHANGE
    return moved if visible else None


def _step(
    problem: Problem,
    model: Model,
    residual: Array,
    jacobian: Array,
    offset: Array,
    damping: float,
    least_gain: float,
    harder: tuple[float, float],
) -> tuple[Model | None, Array, float]:
    """A model with a smaller objective, or None where no damping finds one, or only one smaller by `least_gain`.

    `harder` is the least damping after a step that failed, and the factor by which it then grows.
    """
    scale = np.linalg.norm(jacobian, axis=0)
    # a strength that does not move the rows keeps its value: its slope is rounding error
    unseen = _unseen(model, jacobian)
    scale[unseen] = 1.0
    scaled = np.where(unseen, 0.0, jacobian / scale)
    normal, gradient = scaled.T @ scaled, np.where(unseen, 0.0, scaled.T @ residual - offset / scale)
    start = 0.5 * float(residual @ residual)
    lower, upper = (scale * bound for bound in allowed_steps(problem, model))
    for _ in range(8):
        damped = normal + damping * np.eye(len(scale))
        step = -np.linalg.solve(damped, gradient)
        if np.any(step < lower) or np.any(step > upper):
            # parameters that reach their bounds stay there, and the others are solved for with them
            step = minimise_within(damped, gradient, lower, upper)
        if -float(gradient @ step) < least_gain:
            break
        trial = clip_unknowns(problem, step_from(problem.scene, model, step / scale))
        if not all(effect.plausible() for effect in trial.effects):
            damping = max(damping * harder[1], harder[0])
            continue
        trial_residual = problem.residual(trial)
        moved = float(offset @ (trial.vector - model.vector))
        if np.all(np.isfinite(trial_residual)) and 0.5 * float(trial_residual @ trial_residual) - moved < start:
            return trial, trial_residual, max(damping * 0.1, 1e-9)
        damping = max(damping * harder[1], harder[0])
    return None, residual, damping


def _least_gain(problem: Problem, residual: Array, tolerance: float) -> float:
    """Smallest predicted decrease of the objective for which a step is taken."""
    beyond = max(float(residual @ residual) - len(residual), 0.0)
    return max(problem.least_gain + problem.slack * beyond, 0.5 * tolerance * (1.0 + beyond / max(len(residual), 1)))


def allowed_steps(problem: Problem, model: Model) -> tuple[Array, Array]:
    """The least and the largest step (n + k,) of each parameter: to its bounds, and while its slope is valid.

    The slope of a weakly determined one is not valid far away.
    """
    reach, (lower, upper) = LARGEST_STEP * _sizes(model), steps_within(problem, model)
    return np.maximum(lower, -reach), np.minimum(upper, reach)


def _unseen(model: Model, jacobian: Array) -> Flags:
    """(n + k,) whether a strength of its typical size hardly moves the rows; False of unknowns, which have priors."""
    effect = np.linalg.norm(jacobian[:, len(model.unknown) :], axis=0) * _sizes(model)[len(model.unknown) :]
    return np.concatenate([np.zeros(len(model.unknown), dtype=bool), effect < VISIBLE_ROW_CHANGE])


def _sizes(model: Model) -> Array:
    """(n + k,) typical size of each strength, or its value if that is larger; infinite for unknowns."""
    sizes = [max(s.typical, abs(effect.values[s.name])) for effect in model.effects for s in effect.strengths]
    return np.array([np.inf] * len(model.unknown) + sizes)
