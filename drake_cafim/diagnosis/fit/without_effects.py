"""What a fit leaves without some of its effects, to first order, and the shares of the misfit that these remove."""

import weakref
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.fit.beside import strengths_at
from drake_cafim.diagnosis.fit.bounds import clip_unknowns, minimise_within, steps_within
from drake_cafim.diagnosis.fit.evidence import shows_difference
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import step_from
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.thresholds import LEFT_OUT_SEEN_CHI_SQUARE
from drake_cafim.effects.effect import Effect
from drake_cafim.typing import Array, Flags

QUARTERS = 4
"""Number of parts into which recordings are cut where there are fewer."""


def residual_without(found: Fit, *effects: Effect) -> Array:
    """(R + n,) whitened rows without `effects`, to first order, all other parameters adapting."""
    return np.asarray(found.residual + found.jacobian @ _change_without(found, effects)[0])


def residual_left_by_others(problem: SearchProblem, found: Fit, *effects: Effect) -> Array:
    """(R + n,) whitened rows without `effects`, all other parameters adapting to first order, within their bounds.

    What saturates or sticks is far from linear in its strengths, so that without it other rows are left than
    `residual_without` tells; that is given where the model without them cannot be simulated.
    """
    asked = tuple(effect.key for effect in effects)
    of, rows = found.left_without.get(asked, (None, None))
    # several tests ask in turn; under another problem the same fit leaves other rows
    if rows is None or of is None or of() is not problem:
        rows = _left_by_others(problem, found, *effects)
        found.left_without[asked] = weakref.ref(problem), rows
    return rows


def _left_by_others(problem: SearchProblem, found: Fit, *effects: Effect) -> Array:
    model, kept = found.model, np.ones(len(found.model.vector), dtype=bool)
    for effect in effects:
        kept[strengths_at(found.model, found.model.effects.index(effect))] = False
        model = model.without(effect)
    rows, slopes = problem.residual(model), found.jacobian[:, kept]
    if not np.all(np.isfinite(rows)):
        return residual_without(found, *effects)
    slope = slopes.T @ rows
    step = -_change_without(found, effects)[1][np.ix_(kept, kept)] @ slope
    lower, upper = steps_within(problem, model)
    if np.any(step < lower) or np.any(step > upper):
        # beyond them others would explain more than with the effects
        size = np.linalg.norm(slopes, axis=0)
        size = np.where(size > 0.0, size, 1.0)
        curvature = slopes.T @ slopes / np.outer(size, size)
        step = minimise_within(curvature, slope / size, lower * size, upper * size) / size
    return np.asarray(rows + slopes @ step)


def fit_without(problem: SearchProblem, found: Fit, effects: Sequence[Effect]) -> Fit:
    """The fit without `effects`, to first order, all other parameters adapting."""
    change, covariance = _change_without(found, effects)
    kept = np.ones(len(change), dtype=bool)
    for position, effect in enumerate(found.model.effects):
        if effect in effects:
            kept[strengths_at(found.model, position)] = False
    moved = clip_unknowns(problem, step_from(problem.scene, found.model, change))
    rest = tuple(it for it, was in zip(moved.effects, found.model.effects, strict=True) if was not in effects)
    return replace(
        found,
        model=replace(moved, effects=rest),
        residual=found.residual + found.jacobian @ change,
        jacobian=found.jacobian[:, kept],
        covariance=covariance[np.ix_(kept, kept)],
    )


def _change_without(found: Fit, effects: Sequence[Effect]) -> tuple[Array, Array]:
    """The change (n + k,) of all parameters that makes `effects` vanish, and their covariance where these are absent.

    x − C Sᵀ (S C Sᵀ)⁻¹ d makes the effects vanish, with the covariance C of all parameters x and the effects'
    difference d from none, S its derivative; that of the others is then C − C Sᵀ (S C Sᵀ)⁻¹ S C.
    """
    differences, slopes = [], []
    for position, effect in enumerate(found.model.effects):
        if effect in effects:
            difference, slope = effect.vanishing()
            seen = np.zeros((len(difference), found.jacobian.shape[1]))
            seen[:, strengths_at(found.model, position)] = slope
            differences.append(difference)
            slopes.append(seen)
    all_slopes = np.concatenate(slopes)
    along = found.covariance @ all_slopes.T
    among = all_slopes @ along
    # one that changes nothing in the recordings has a variance beside which the others would count as zero
    std = np.sqrt(np.maximum(np.diag(among), np.finfo(float).tiny))
    sought = np.column_stack([np.concatenate(differences), along.T]) / std[:, None]
    solved = np.linalg.lstsq(among / np.outer(std, std), sought, rcond=None)[0] / std[:, None]
    return -along @ solved[:, 0], found.covariance - along @ solved[:, 1:]


def share_removed(problem: SearchProblem, residual: Array, without: Array) -> float:
    """Share of squares by which `residual` is less than `without`, in the kind of rows where that is largest."""
    return float(np.max(_shares_removed(_apart(problem, residual), _apart(problem, without))))


def share_of_excess(problem: SearchProblem, residual: Array, without: Array) -> float:
    """Share of the excess over noise that `without` has and `residual` lacks, in the kind of rows where that is most.

    With the rows z′ and z and their variance n by the noise of the channels, Σ (z′² − z²)/Σ (z′² − n), 1 at most.
    """
    left, had, noise = (
        np.concatenate([z for _, z in by_run(problem, rows)])
        for rows in (
            problem.apart(residual[: problem.rows]),
            problem.apart(without[: problem.rows]),
            problem.noise_share,
        )
    )
    removed, excess = np.sum(had**2 - left**2, axis=0), np.sum(had**2 - noise, axis=0)
    most = np.argmax(removed)
    return float(removed[most] / max(excess[most], removed[most], 1e-300))


def _shares_removed(left: Sequence[Array], had: Sequence[Array]) -> Array:
    """(r,) share of squares by which the rows (M, r) `left` of each recording are less than those it `had`."""
    least, most = (np.sum([np.sum(z**2, axis=0) for z in rows], axis=0) for rows in (left, had))
    return np.asarray(1.0 - least / np.maximum(most, 1e-300))


def _apart(problem: SearchProblem, rows: Array) -> list[Array]:
    """(M, r) rows of each recording's windows, each taken apart: whitened ones share what is left at other joints."""
    return [z for _, z in by_run(problem, problem.apart(rows[: problem.rows]))]


def noise_beside(problem: SearchProblem, found: Fit, effect: Effect) -> float:
    """Root mean square of the whitened rows that an effect of a fit explains best, 1 at most.

    Where unknown forces are as large as what is left without the effect, it is what they are too large by beside it.
    """
    left, had = (
        np.concatenate([z for _, z in by_run(problem, rows[: problem.rows])]) ** 2
        for rows in (found.residual, residual_without(found, effect))
    )
    return min(1.0, float(np.sqrt(np.mean(left[:, np.argmax(np.sum(had - left, axis=0))]))))


def share_improved(problem: SearchProblem, residual: Array, without: Array) -> float:
    """Share of the recordings, or of the quarters of fewer than four, in which `residual` is less than `without`.

    In the kind of rows where it is less by the largest share: in others, chance and what else is missing decide. Of the
    parts that show the difference, since where a joint sticks it hardly makes any; of all where none shows it.
    """
    cut = 1 if len(problem.runs) >= QUARTERS else QUARTERS
    left, had = _apart(problem, residual), _apart(problem, without)
    best = int(np.argmax(_shares_removed(left, had)))
    shown, better = [], []
    for own, other in zip(left, had, strict=True):
        for a, b in zip(np.array_split(own[:, best], cut), np.array_split(other[:, best], cut), strict=True):
            shown.append(shows_difference(a, b))
            better.append(np.sum(b**2) > np.sum(a**2))
    return float(np.mean(np.array(better)[shown if any(shown) else slice(None)]))


def parts_that_show(problem: SearchProblem, found: Fit, effect: Effect) -> Flags:
    """(P,) whether each part of the recordings shows an effect of a fit; parts are quarters of fewer than three.

    That is by three standard deviations, to first order, for changes of its strengths by their own sizes.
    """
    own = strengths_at(found.model, found.model.effects.index(effect))
    cut = 1 if len(problem.runs) > 2 else QUARTERS
    columns = (found.jacobian[:, own] * effect.vector).T
    changes = np.sum([sum_by_part(problem, column, cut) for column in columns], axis=0)
    return np.asarray(changes > LEFT_OUT_SEEN_CHI_SQUARE)


def sum_by_part(problem: SearchProblem, rows: Array, cut: int) -> Array:
    """(P,) sums of squares of whitened `rows`, each recording cut into `cut` parts."""
    whole = (own for _, own in by_run(problem, rows[: problem.rows]))
    return np.array([float(np.sum(part**2)) for own in whole for part in np.array_split(own, cut)])
