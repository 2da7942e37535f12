"""Compares each effect found under unknown forces with the other laws at its place, and gives their probabilities."""

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.fit.beside import Beside, strengths_at
from drake_cafim.diagnosis.fit.evidence import cost_of, criterion, leaves_noise
from drake_cafim.diagnosis.fit.fitting import CONVERGED, Fit, fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.places import ELSEWHERE, joint_of
from drake_cafim.diagnosis.fit.rivals import (
    FITTED_LEAD,
    REPLACING_LEAD,
    Lead,
    Rivals,
    act_alike,
    is_alike_elsewhere,
    is_dry,
    is_nonlinear_rival,
    noise_changed,
    prior_odds,
)
from drake_cafim.diagnosis.fit.robust_covariance import blockwise_std, wald_statistics
from drake_cafim.diagnosis.fit.screening import screen
from drake_cafim.diagnosis.fit.without_effects import residual_left_by_others, share_of_excess
from drake_cafim.diagnosis.search import decisions_by_place as decisions
from drake_cafim.diagnosis.search.determined import reasons_against, strength_at_bound, undetermined_in
from drake_cafim.diagnosis.search.friction_by_joint import Friction, choose_friction, is_friction
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from drake_cafim.diagnosis.search.law_shapes import fit_shape_beside, fit_shapes
from drake_cafim.diagnosis.search.nested_laws import drop_superseded
from drake_cafim.diagnosis.search.pairs_by_place import pairs_in_place
from drake_cafim.diagnosis.thresholds import LEAST_PROBABILITY, NAMED_EXCESS_SHARE, RIVALS_FITTED_PER_PARENT
from drake_cafim.diagnosis.trace import Record
from drake_cafim.effects.effect import Effect
from drake_cafim.parallel.forked import map_forked

ROUNDS = 2
"""Largest number of comparisons, each after another law was preferred at some place."""
MOST_ALONE = 4
"""Largest number of laws that are put in the places of others one by one."""
MOST_PAIRS = 4
"""Largest number of pairs of laws that are put in the places of two others."""


@dataclass(frozen=True)
class Compared:
    """Explanations in which another law replaces an effect, and the probability of each effect and each such law.

    Effects that were dropped since they fail a test have none.
    """

    others: tuple[Fit, ...]
    probability: dict[Key, float]
    unsupported: tuple[Effect, ...]
    """Effects that were dropped since they explain less than is left at their places."""
    rivals: Rivals | None = None
    """The laws that the effects were compared with."""


def compare_by_place(growth: GrowthByPlace, supported: Collection[Key] = (), known: Rivals | None = None) -> Compared:
    """Replaces effects of `growth.best` by better laws at their joints, and drops those that share their evidence.

    The effects `supported` are known to explain more than is left at their places. Rivals that are `known`, of an
    earlier comparison under other noise, are not looked for again where nothing has changed.
    """
    growth.converge()
    drop_superseded(growth)
    standing = choose_friction(growth)
    growth.drop_failing(1.0)
    growth.failed.clear()
    found = _all_contenders(growth, known.at(growth.best, whitened=True) if known else {})
    rivals = Rivals.of(growth.best, found)
    tried: dict[tuple[Key, Key], float] = {}
    for _ in range(ROUNDS):
        first = {key: leads[0] for key, leads in found.items() if leads}
        better = {
            key: law for key, (lead, _, law) in first.items() if lead < -REPLACING_LEAD and (key, law.key) not in tried
        }
        tried |= {(key, law.key): 0.0 for key, law in better.items()}
        before = growth.best.model.keys
        replaced = better and _replace(growth, sorted(better, key=lambda key: found[key][0][0]), better, tried)
        if not replaced and not _replace_two(growth, found):
            break
        # beside other laws they may rise less
        tried = dict.fromkeys(tried, -np.inf)
        _fit_widths(growth, growth.best.model.keys - before)
        growth.converge()
        standing = choose_friction(growth)
        found = _all_contenders(growth, rivals.at(growth.best, whitened=False))
        rivals = Rivals.of(growth.best, found)
    # a law that fails a test once all is fitted is none of those that the recordings support
    found = {key: [lead for lead in leads if lead[2].key not in growth.failed] for key, leads in found.items()}
    found = {key: _as_tried(key, leads, tried) for key, leads in found.items()}
    probability = probabilities_by_place(growth, found)
    sisters = _sisters(growth, standing, probability)
    for effect in growth.best.model.effects:
        of_it = probability[effect.key]
        growth.trace.add(decisions.record_shared(growth.best.model, effect, of_it, LEAST_PROBABILITY))
    shared = [effect for effect in growth.best.model.effects if probability[effect.key] < LEAST_PROBABILITY]
    if shared:
        growth.drop(shared)
    had = growth.best.model.keys
    _drop_undetermined(growth)
    stood = growth.best.model.effects
    _drop_unsupported(growth, supported)
    unsupported = tuple(effect for effect in stood if effect.key not in growth.best.model.keys)
    _drop_unknown(growth)
    # what was dropped for its own sake is no rival of what stands
    probability = {key: value for key, value in probability.items() if key not in had - growth.best.model.keys}
    others = (*(other for leads in found.values() for _, other, _ in leads), *sisters)
    return Compared(others, probability, unsupported, rivals)


Tried = dict[tuple[Key, Key], float]
"""Laws that were put in the place of an effect in vain: by how much the criterion rose, under the forces they leave."""


def _as_tried(key: Key, leads: Sequence[Lead], tried: Tried) -> list[Lead]:
    """The laws in the place of an effect, those that did not come to stand there with the criterion that they had.

    Under the noise of the effect, a law that leaves as much may seem better, and no law have half of the probability.
    """
    return [(max(lead, tried.get((key, law.key), lead)), other, law) for lead, other, law in leads]


def _replace(growth: GrowthByPlace, order: Sequence[Key], better: Mapping[Key, Effect], tried: Tried) -> bool:
    """Whether laws of `better` take the places of effects: all of them or, where that fails, those that do one by one.

    Together one may fail by another's fault. All that do not fail a test are tried before, and one by one the first of
    the `order` come first.
    """
    if _settle_with(growth, better):
        return True
    if len(order) == 1:
        tried[order[0], better[order[0]].key] = growth.settled_lead
        return False
    stand = {key: law for key, law in better.items() if law.key not in growth.failed}
    if 1 < len(stand) < len(better) and _settle_with(growth, stand):
        return True
    growth.failed.clear()
    replaced = False
    for key in order[:MOST_ALONE]:
        if _settle_with(growth, {key: better[key]}):
            replaced = True
        else:
            tried[key, better[key].key] = growth.settled_lead
    return replaced


def _replace_two(growth: GrowthByPlace, found: Mapping[Key, Sequence[Lead]]) -> bool:
    """Whether two laws take the places of two effects, each of which alone fits worse beside the other effect."""
    failed = set(growth.failed)
    for pair in itertools.islice(pairs_in_place(found), MOST_PAIRS):
        effects = tuple(pair.get(effect.key, effect) for effect in growth.best.model.effects)
        both = fit(growth.problem, replace(growth.best.model, effects=effects), tolerance=CONVERGED)
        lead = criterion(both, 1.0, growth.trials) - criterion(growth.best, 1.0, growth.trials)
        if lead < -REPLACING_LEAD and _settle_with(growth, pair):
            return True
        # what fails beside the other law of a pair may stand alone
        growth.failed = set(failed)
    return False


def _settle_with(growth: GrowthByPlace, better: Mapping[Key, Effect]) -> bool:
    effects = tuple(better.get(effect.key, effect) for effect in growth.best.model.effects)
    # two effects may prefer the same law
    effects = tuple({effect.key: effect for effect in effects}.values())
    # where another law fails a test, the one that it would replace stays
    needed = {law.key for law in better.values()}
    return growth.settle(Model(growth.best.model.unknown, effects, growth.best.model.free), needed)


def _fit_widths(growth: GrowthByPlace, keys: Collection[Key]) -> None:
    """Fits the widths of the dry frictions `keys` under the explanation's noise: they were chosen under another law's.

    A law that is compared with them now would win by its width alone.
    """
    dry = {effect.key for effect in growth.best.model.effects if effect.key in keys and is_dry(effect)}
    model = fit_shapes(growth.problem, growth.best, dry, CONVERGED).model
    if model is not growth.best.model:
        growth.lead_of(model, accept=True)


def _drop_undetermined(growth: GrowthByPlace) -> None:
    """Drops effects of which the recordings do not determine a strength, the least determined first.

    The growth judges that by the stated noise and the unknown forces. Where the residual is correlated, blocks of time
    determine less, and what makes up for something unknown may stand out with nothing known of its size.
    """
    while growth.best.model.effects:
        problem, best = growth.problem, growth.best
        if leaves_noise(problem, best, growth.settings.adequacy_level):
            return
        std = np.maximum(best.std, blockwise_std(problem, best))
        told = [(undetermined_in(best, effect, std), effect) for effect in best.model.effects]
        wide = [(found[1] / found[2], effect, found) for found, effect in told if found is not None]
        if not wide:
            return
        _, least, found = max(wide, key=lambda entry: entry[0])
        growth.trace.add(decisions.record_undetermined(best.model, least, *found))
        growth.drop([least])


def _drop_unsupported(growth: GrowthByPlace, supported: Collection[Key] = ()) -> None:
    """Drops effects that explain less than is left at their places, the least of them first, and one at each joint.

    Those `supported` stay, unless they fail a test. Where noise alone is left, only these tests are made.
    """
    while growth.best.model.effects:
        growth.drop_failing()
        problem, best = growth.problem, growth.best
        if leaves_noise(problem, best, growth.settings.adequacy_level):
            return
        shares = sorted(
            ((_share(growth, _together(best.model, effect)), effect) for effect in best.model.effects),
            key=lambda entry: (entry[0], _share(growth, [entry[1]])),
        )
        least: dict[str, tuple[float, Effect]] = {}
        for share, effect in shares:
            if share < NAMED_EXCESS_SHARE and effect.key not in supported:
                least.setdefault(joint_of(effect), (share, effect))
        # what acts elsewhere moves the rows of many joints, so that it goes alone
        told = list(least.values())[:1] if next(iter(least), "") == ELSEWHERE else list(least.values())
        told = [entry for entry in told if len(told) == 1 or joint_of(entry[1]) != ELSEWHERE] or shares
        growth.trace.add(*(decisions.record_support(best.model, it, of, NAMED_EXCESS_SHARE) for of, it in told))
        if not least:
            return
        growth.drop([effect for _, effect in told])


def _share(growth: GrowthByPlace, effects: Sequence[Effect]) -> float:
    """Share of the excess over noise that `effects` remove from the rows they explain best, where all others adapt.

    Or from the rows of the priors, where these say clearly that unknowns do not make up for the effects: a rotor that
    a model lacks leaves little where links may become as heavy.
    """
    problem, best = growth.problem, growth.best
    without = residual_left_by_others(problem, best, *effects)
    share = share_of_excess(problem, best.residual, without)
    left, had = (float(np.sum(rows[problem.rows :] ** 2)) for rows in (best.residual, without))
    clear = had - left > growth.threshold(sum(len(effect.strengths) for effect in effects))
    return max(share, 1.0 - left / had) if clear else share


def _together(model: Model, effect: Effect) -> list[Effect]:
    """The effects that are one phenomenon with `effect`: of friction all that of its joint, or else itself alone.

    Viscous friction may explain less than dry friction does, and beside it is no less sure.
    """
    if not is_friction(effect):
        return [effect]
    return [other for other in model.effects if is_friction(other) and other.at == effect.at]


def _drop_unknown(growth: GrowthByPlace) -> None:
    """Drops effects whose size is not known by the standard deviations that a report gives, beyond linearisation."""
    best = growth.best
    if not best.model.effects or leaves_noise(growth.problem, best, growth.settings.adequacy_level):
        return
    reasons = reasons_against(growth.problem, best)
    growth.trace.add(*(decisions.record_unknown(best.model, effect, reason) for effect, reason in reasons))
    if reasons:
        growth.drop([effect for effect, _ in reasons])


def _all_contenders(growth: GrowthByPlace, known: Mapping[Key, list[Lead]]) -> dict[Key, list[Lead]]:
    """`_contenders` of each effect, of some of which they are `known`."""
    effects = growth.best.model.effects
    growth.progress(f"comparing {len(effects)} effects with other laws at their joints")
    new = [effect for effect in effects if effect.key not in known]
    found = dict(known)
    compared = map_forked(lambda number: _contenders(growth, new[number]), len(new), growth.settings.jobs)
    for effect, (leads, records) in zip(new, compared, strict=True):
        found[effect.key] = leads
        growth.trace.add(*records)
    return {effect.key: found[effect.key] for effect in effects}


def _contenders(growth: GrowthByPlace, effect: Effect) -> tuple[list[Lead], list[Record]]:
    """The best laws in the place of `effect`, fitted exactly where to first order they come near it, the best first.

    And the records of how they compare.
    """
    problem, best = growth.problem, growth.best
    rest = best.model.without(effect)
    position, residual = best.model.effects.index(effect), problem.residual(rest)
    beside = replace(Beside.of(problem, best, position), position=len(rest.effects))
    kept = np.delete(np.arange(len(best.model.vector)), strengths_at(best.model, position))
    at_rest = Fit(rest, residual, beside.slopes, best.covariance[np.ix_(kept, kept)], best.data_rows)
    here = joint_of(effect)
    laws = [
        other
        for other in growth.beside(rest)
        if other.key != effect.key
        and (joint_of(other) == here or _is_alike_elsewhere(effect, other))
        # which law of dry friction a joint has is chosen before, of all at once
        and not (is_dry(other) and is_dry(effect))
    ]
    unit = evidence_unit(growth, effect)
    left = residual - beside.basis @ (beside.basis.T @ residual)
    lost = float(left @ left) - best.chi_square
    own = cost_of(best, effect)
    found: list[Lead] = []
    records: list[Record] = []
    by_noise: dict[str, float] = {}
    price = {law.key: cost_of(best, law) for law in laws}
    looks = sorted(screen(problem, best, laws, at_rest), key=lambda look: price[look.effect.key] - look.gain)
    near = [look for look in looks if lost - look.gain + price[look.effect.key] - own <= FITTED_LEAD * unit]
    near = near[:RIVALS_FITTED_PER_PARENT]
    if not is_dry(effect):
        # under another law's noise dry friction near rest looks as if it predicted badly; the simplest law stands for
        # all, of which one is chosen afterwards
        dry = sorted((look for look in looks if is_dry(look.effect)), key=lambda look: len(look.effect.strengths))
        near = [*dry[:1], *(look for look in near if not is_dry(look.effect))]
    # what is far from linear, such as a delay of half a period, is hardly seen to first order
    hidden = [look for look in looks if look not in near and is_nonlinear_rival(effect, look.effect)]
    near += {look.effect.name: look for look in reversed(hidden)}.values()
    for candidate in near:
        added = beside.fit(rest.with_effects([candidate.effect]), CONVERGED)
        other = fit_shape_beside(beside, added, CONVERGED)
        law = other.model.effects[-1]
        alone = Model(rest.unknown, (law,))
        if strength_at_bound(law) or undetermined_in(other, law) or not growth.nominal.plausible(alone):
            continue
        lead = (criterion(other, 1.0, growth.trials) - criterion(best, 1.0, growth.trials)) / unit
        if noise_changed(law) != noise_changed(effect) and (is_dry(law) or lead <= FITTED_LEAD):
            # laws of one group have about the same noise
            kind = law.group or law.name
            if kind not in by_noise:
                by_noise[kind] = growth.lead_of(other.model) / unit - lead
            lead += by_noise[kind]
        odds = prior_odds(best.model, effect, law)
        lead -= 2.0 * float(np.log(odds))
        records.append(decisions.record_contender(best.model, effect, law.key, lead, odds))
        # of many explanations, the slopes would take gigabytes
        found.append((lead, replace(other, jacobian=other.jacobian[:0]), law))
    return sorted(found, key=lambda entry: entry[0]), records


def _is_alike_elsewhere(effect: Effect, law: Effect) -> bool:
    """Whether two laws at different places may be one: a raised surface and a biased position are the same touch."""
    if effect.name != law.name:
        return law.of_contact != effect.of_contact and act_alike(effect, law)
    return is_alike_elsewhere(effect)


def _sisters(
    growth: GrowthByPlace, standing: Mapping[str, Sequence[Friction]], probability: dict[Key, float]
) -> list[Fit]:
    """The fits with other laws of dry friction than those named, which get their share of these laws' `probability`.

    The laws are one phenomenon: what speaks for any of them speaks for the one that is named.
    """
    fits = []
    for effect in growth.best.model.effects:
        options = [option for option in standing.get(effect.at, ()) if effect.group == option.dry.group]
        if not options:
            continue
        unit = evidence_unit(growth, effect)
        costs = np.array([criterion(option.found, 1.0, growth.trials) for option in options]) / unit
        weights = np.exp(-0.5 * (costs - np.min(costs)))
        for option, weight in zip(options, weights / np.sum(weights), strict=True):
            key = option.dry.key
            if key != effect.key:
                probability[key] = probability.get(key, 0.0) + float(weight) * probability[effect.key]
                fits.append(replace(option.found, jacobian=option.found.jacobian[:0]))
    return fits


def evidence_unit(growth: GrowthByPlace, effect: Effect) -> float:
    """How many times less the blocks of time tell of an effect than independent rows would, at least 1.

    What remains is correlated, so that differences of χ² are larger than their evidence by this factor (composite
    likelihood; Varin, Vidoni, Biometrika 92(3), 2005).
    """
    by_noise, _ = wald_statistics(growth.problem, growth.best, effect.key)
    shown = growth.shown(growth.problem, growth.best, effect.key, *effect.vanishing())
    return max(1.0, by_noise / shown) if shown > 0.0 else 1.0


def probabilities_by_place(growth: GrowthByPlace, found: Mapping[Key, Sequence[Lead]]) -> dict[Key, float]:
    """By effect: P ∝ exp(−Δ/2), Δ its criterion beyond the best one's, over the laws at its place and none of them."""
    probability: dict[Key, float] = {}
    for effect in growth.best.model.effects:
        none = growth.wald(growth.problem, growth.best, effect)[0] - growth.price(effect)
        leads = [(effect.key, 0.0), *((law.key, lead) for lead, _, law in found[effect.key])]
        weights = np.array([np.exp(-0.5 * max(lead, 0.0)) for _, lead in leads])
        total = float(weights.sum()) + float(np.exp(-0.5 * max(none, 0.0)))
        for (key, _), weight in zip(leads, weights, strict=True):
            probability[key] = max(probability.get(key, 0.0), float(weight) / total)
    return probability
