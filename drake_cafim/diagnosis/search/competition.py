"""The competition of explanations: rivals, equivalent laws, unknowns far from their priors, and smaller ones."""

import itertools
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from drake_cafim.diagnosis.fit.evidence import scale_of
from drake_cafim.diagnosis.fit.fitting import CONVERGED, Fit, fit, unbiased_fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.rivals import REPLACING_LEAD, act_alike
from drake_cafim.diagnosis.fit.screening import screen
from drake_cafim.diagnosis.search import decisions
from drake_cafim.diagnosis.search.far_unknowns import far_unknowns, free_priors
from drake_cafim.diagnosis.search.law_shapes import fit_shapes
from drake_cafim.diagnosis.search.state import ROUNDS, State
from drake_cafim.diagnosis.thresholds import (
    CONTENDER_CRITERION_REACH,
    CONTENDERS_FITTED_UNBIASED,
    GAIN_SHARE_FAR_LESS,
    MISFIT_SHARE_TO_EXPLAIN,
    RIVALS_FITTED_PER_PARENT,
)
from drake_cafim.effects.effect import Effect
from drake_cafim.parallel.forked import map_forked


def compete(state: State, best: Fit) -> Fit:
    """The most probable of `best` and the explanations that may replace it or a part of it; these are fitted here."""
    _fit_rivals(state, best)
    new = best.model.effects
    for _ in range(ROUNDS):
        _fit_equivalents(state, best, new)
        _fit_far_unknowns(state, best)
        _fit_instead_of_far_unknowns(state, best)
        chosen = _most_probable(state, best)
        _fit_smaller(state, chosen)
        chosen = _most_probable(state, chosen)
        if chosen.model.keys <= best.model.keys:
            return chosen
        # the effects that another explanation brings have simpler laws of their own, which must be fitted as well
        new = tuple(effect for effect in chosen.model.effects if effect.key not in best.model.keys)
        best = chosen
    return best


def more_likely_alike(state: State, best: Fit) -> Fit | None:
    """An explanation with a law in one place that acts alike, and is more likely, each under the noise that it implies.

    A late command under a wrong law moves the estimated motion, and with it the rows of the right one: a delay left a
    quarter more than noise under the noise of a lag, and noise alone under its own. Only what leaves little of what is
    explained is asked.
    """
    problem, scale = state.problem, scale_of(best)
    if not problem.whitened_by_model:
        return None
    found: tuple[float, Fit | None] = -REPLACING_LEAD, None
    own: float | None = None
    for other in list(state.pool.fits.values()):
        pair = _alike_in_one_place(best, other)
        if pair is None:
            continue
        lost = state.rest(best.model.without(pair[0])).chi_square - best.chi_square
        if other.chi_square - best.chi_square > MISFIT_SHARE_TO_EXPLAIN * lost:
            continue
        own = _evidence(state, best, scale) if own is None else own
        lead = _evidence(state, other, scale) - own
        state.trace.add(decisions.record_own_noise(best.model, *pair, lead, REPLACING_LEAD))
        found = min(found, (lead, other), key=lambda it: it[0])
    return found[1]


def _alike_in_one_place(best: Fit, other: Fit) -> tuple[Effect, Effect] | None:
    """The effect of `best` and the one of `other` in its place that acts alike, where nothing else differs.

    Laws of one group have about the same noise; which of them is named is chosen in `nested_laws`.
    """
    gone = [effect for effect in best.model.effects if effect.key not in other.model.keys]
    come = [effect for effect in other.model.effects if effect.key not in best.model.keys]
    if len(gone) != 1 or len(come) != 1 or best.model.free != other.model.free:
        return None
    alike = gone[0].at == come[0].at and act_alike(gone[0], come[0]) and not gone[0].excludes(come[0])
    return (gone[0], come[0]) if alike else None


def _evidence(state: State, found: Fit, scale: float) -> float:
    """The criterion with χ² + ln det C for χ², the rows whitened by what the explanation itself implies."""
    problem = state.problem.rewhitened(found.model)
    problem = problem.rewhitened(fit(problem, found.model, tolerance=CONVERGED).model)
    fitted = fit(problem, found.model, tolerance=CONVERGED)
    return state.cost(scale)(fitted) + problem.log_determinant / scale


def _fit_rivals(state: State, best: Fit) -> None:
    """Fit explanations in which another effect replaces an accepted one, and the runners-up with one more effect."""
    if not best.model.effects:
        return
    state.progress("fitting rivals")
    parents = [state.rest(best.model.without(effect)) for effect in best.model.effects]
    size = len(best.model.effects)
    parents += [other for other in state.frontier if other is not best and len(other.model.effects) <= size]
    state.screen_all(parents)
    models = []
    for parent in parents:
        needed = parent.chi_square - best.chi_square
        for candidate in state.screen(parent)[:RIVALS_FITTED_PER_PARENT]:
            model = parent.model.with_effects([candidate.effect])
            # an exact fit does not make up for a first-order gain far below what was lost with the effect
            if model.keys not in state.pool.fits and candidate.gain > GAIN_SHARE_FAR_LESS * needed:
                models.append(model)
    for found in map_forked(lambda number: _fitted(state, models[number]), len(models), state.settings.jobs):
        if found is not None and found.model.keys not in state.pool.fits:
            state.pool.add(found)


def _fit_equivalents(state: State, best: Fit, effects: Iterable[Effect]) -> None:
    """Fit what may be equivalent to some of the accepted `effects`, each at its place.

    These are the simpler laws of its group, and pairs of effects with as many strengths together.
    """
    for effect in effects:
        rest = best.model.without(effect)
        looks = {look.effect.key: look.effect for look in state.screen(state.rest(rest))}
        for simpler in looks.values():
            if effect.excludes(simpler) and len(simpler.strengths) < len(effect.strengths):
                state.pool.add(fit_shapes(state.problem, fit(state.problem, rest.with_effects([simpler]))))
        alike = [other for other in state.effects if other.name in effect.alike and other.at == effect.at]
        for first, second in itertools.combinations(alike, 2):
            if len(first.strengths) + len(second.strengths) != len(effect.strengths) or first.key not in looks:
                continue
            beside = fit(state.problem, rest.with_effects([looks[first.key]]))
            found = screen(state.problem, beside, [second])
            if found:
                _add(state, fit_shapes(state.problem, fit(state.problem, beside.model.with_effects([found[0].effect]))))


def _fit_far_unknowns(state: State, best: Fit) -> None:
    """Fit models without the prior of an unknown: without effects, with those of `best`, and without each of these."""
    scene = state.problem.scene
    if not scene.unknown:
        return
    alone = Model(best.model.unknown, free=best.model.free)
    parents = {model.keys: model for model in (alone, *map(best.model.without, best.model.effects))}
    for model in parents.values():
        if model.keys == best.model.keys:
            continue
        parent = state.rest(model)
        needed = parent.chi_square - best.chi_square
        _add_far(state, free_priors(scene, parent, GAIN_SHARE_FAR_LESS * needed))
    # with all effects of `best`, it has to lower χ² by as much as the criterion asks of an effect
    _add_far(state, free_priors(scene, best, CONTENDER_CRITERION_REACH * scale_of(best)))


def _fit_instead_of_far_unknowns(state: State, best: Fit) -> None:
    """Fit effects that may replace an unknown whose prior is set aside."""
    problem, priors = state.problem, state.problem.scene.priors
    for unknown in best.model.free:
        i, values = problem.scene.unknown.index(unknown), best.model.unknown.copy()
        values[i] = priors.mean[i]
        model = replace(best.model.with_prior(unknown), unknown=values)
        residual = problem.residual(model)
        # with the unknown's own column among the nuisance, an effect that moves the rows alike would gain nothing
        jacobian = np.delete(problem.jacobian(model), i, axis=1)
        at_prior = Fit(model, residual, jacobian, best.covariance, best.data_rows)
        free = [effect for effect in state.effects if not any(effect.excludes(o) for o in model.effects)]
        for candidate in screen(problem, at_prior, free)[:RIVALS_FITTED_PER_PARENT]:
            other = model.with_effects([candidate.effect])
            needed = at_prior.chi_square - best.chi_square
            if other.keys not in state.pool.fits and candidate.gain > GAIN_SHARE_FAR_LESS * needed:
                _add(state, fit_shapes(problem, fit(problem, other)))


def _add_far(state: State, models: Iterable[Model]) -> None:
    scene = state.problem.scene
    for model in models:
        if model.keys not in state.pool.fits:
            found = unbiased_fit(state.problem, model)
            # an unknown that stays near its prior is no mismatch, so its prior must not be set aside
            if set(found.model.free) <= set(far_unknowns(scene, found.model)):
                _add(state, found)


def _fitted(state: State, model: Model) -> Fit | None:
    """The fit of a model with its laws' shapes; None where an effect then acts otherwise than its name says."""
    found = fit_shapes(state.problem, fit(state.problem, model))
    return found if state.problem.plausible(found.model) else None


def _add(state: State, found: Fit) -> None:
    if state.problem.plausible(found.model):
        state.pool.add(found)


def _fit_smaller(state: State, best: Fit) -> None:
    """Fit the explanation without each of its parts.

    Strengths that were fitted beside an effect may explain the recordings without it: a tilt across a plane shows in
    second order only, so that its fit may need another effect, such as a gain, to start from.
    """
    model, cost = best.model, state.cost(scale_of(best))
    if len(model.keys) < 2:
        return
    smaller = [(effect.key, model.without(effect)) for effect in model.effects]
    smaller += [((known.parameter, known.at), model.with_prior(known)) for known in model.free]
    for key, rest in smaller:
        without = unbiased_fit(state.problem, rest)
        known = state.pool.fits.get(rest.keys)
        if known is not None and known.unbiased and known.chi_square <= without.chi_square:
            without = known
        if not without.echo:
            state.pool.add(without)
            state.trace.add(decisions.record_pruning(best, key, cost(without) - cost(best)))


def _most_probable(state: State, best: Fit) -> Fit:
    """The explanation with the least criterion among those no larger than `best`, each fitted without bias.

    Biased fits do not compare: a law that bends where a channel is noisy gains by the noise that its regressors share
    with the residual. Larger explanations are left out, since they would have to pass the tests of `checks`.
    """
    for _ in range(ROUNDS):
        cost = state.cost(scale_of(best))
        for _ in range(CONTENDERS_FITTED_UNBIASED):
            alike = _as_small(state, best)
            reach = min(map(cost, alike)) + CONTENDER_CRITERION_REACH
            near = sorted((other for other in alike if not other.unbiased and cost(other) < reach), key=cost)
            if not near:
                break
            state.pool.add(unbiased_fit(state.problem, near[0].model))
        # another explanation has another χ² per degree of freedom, the criterion's unit: it must be best in its own
        before, best = best, min((other for other in _as_small(state, best) if other.unbiased), key=cost)
        if best is before:
            break
    return best


def _as_small(state: State, best: Fit) -> list[Fit]:
    """The explanations with at most as many effects as `best`, or as many parts: effects and unknowns without prior."""
    effects, parts = len(best.model.effects), len(best.model.keys)
    fits = state.pool.fits.values()
    return [other for other in fits if len(other.model.effects) <= effects or len(other.model.keys) <= parts]
