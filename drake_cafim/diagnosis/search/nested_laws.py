"""Of nested laws the simplest one that explains as much is named, of two that act alike the one that predicts better.

Each is compared under the noise that it implies.

A law may fit better by its noise alone: friction with a large static torque leaves much to chance near rest, and so
takes little account of the rows there, though its static torque may be anything.
"""

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2

from drake_cafim.diagnosis.fit.evidence import leaves_noise, scale_of
from drake_cafim.diagnosis.fit.fitting import CONVERGED, Fit, fit, unbiased_fit
from drake_cafim.diagnosis.fit.model import Key, Model
from drake_cafim.diagnosis.fit.places import ELSEWHERE, joint_of
from drake_cafim.diagnosis.fit.rivals import act_alike, is_dry, noise_changed
from drake_cafim.diagnosis.fit.screening import screen
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.search.determined import Descent, is_simpler, reason_against
from drake_cafim.diagnosis.search.friction_by_joint import is_friction
from drake_cafim.diagnosis.search.growth_by_place import GrowthByPlace
from drake_cafim.diagnosis.search.law_shapes import fit_shapes
from drake_cafim.effects.effect import Effect

Whitened = tuple[SearchProblem, Fit]
"""A problem whitened with the noise that an explanation implies, and its fit there."""


def simplify(
    problem: SearchProblem, found: Fit, rate: float, adequacy_level: float
) -> tuple[SearchProblem, Fit, list[Descent]]:
    """The explanation with the simplest laws that explain as much, the problem under its noise, and what was replaced.

    A law's simpler ones are those of its group that have fewer strengths. It stands if −2 ln likelihood, χ² + ln det C,
    is lower with it by more than noise alone makes of as many strengths more, but with a probability of `rate`; or if
    it alone leaves only noise, by the `adequacy_level`. Where the recordings do not determine its strengths, it stands
    only if it alone leaves noise.
    """
    descents: list[Descent] = []
    grouped = any(effect.group and len(effect.strengths) > 1 for effect in found.model.effects)
    laws = problem.hypotheses() if grouped else ()
    for key in [effect.key for effect in found.model.effects]:
        present = next(effect for effect in found.model.effects if effect.key == key)
        simpler = [law for law in laws if is_simpler(law, present)]
        instead = _simplest(problem, found.model, present, simpler, rate, adequacy_level) if simpler else None
        if instead is not None:
            (problem, found), descent = instead
            descents.append(descent)
    return problem, found, descents


def _simplest(
    problem: SearchProblem, model: Model, present: Effect, simpler: Sequence[Effect], rate: float, adequacy_level: float
) -> tuple[Whitened, Descent] | None:
    """The explanation with the simplest law in the place of the `present` one, and why; None where that one stands."""
    larger = _under_own_noise(problem, model)
    others = [other for law in simpler if (other := _with_law(problem, model, present, law)) is not None]
    adequate = [other for other in others if leaves_noise(*other, adequacy_level)]
    if leaves_noise(*larger, adequacy_level):
        others = adequate
    alike = [other for other in others if _gain(larger, other) < _luck(larger, other, rate)]
    if alike:
        best = min(alike, key=lambda other: (other[1].strengths, _misfit(*other)))
        gain, luck = max(_gain(larger, best), 0.0), _luck(larger, best, rate)
        return best, Descent(present, "", best[1].model.effects[-1], gain, luck)
    fitted = next(effect for effect in larger[1].model.effects if effect.key == present.key)
    unknown = reason_against(*larger, fitted) if adequate else None
    if unknown is None:
        return None
    best = min(adequate, key=lambda other: _misfit(*other))
    return best, Descent(present, unknown, best[1].model.effects[-1])


def _with_law(problem: SearchProblem, model: Model, present: Effect, law: Effect) -> Whitened | None:
    """The explanation with a simpler `law` in the place of the `present` one; None where its size is not known."""
    rest = fit(problem, model.without(present))
    looks = screen(problem, rest, [law])
    if not looks:
        return None
    begun = fit_shapes(problem, fit(problem, rest.model.with_effects([looks[0].effect]), tolerance=CONVERGED))
    own, found = _under_own_noise(problem, begun.model)
    replaced = found.model.effects[-1]
    if found.echo or not own.plausible(found.model) or reason_against(own, found, replaced) is not None:
        return None
    return own, found


def _under_own_noise(problem: SearchProblem, model: Model) -> Whitened:
    """The problem whitened under a `model`, and the fit that begins with it, the shapes of its laws included."""
    own = problem.rewhitened(model)
    shaped = fit_shapes(own, fit(own, model, tolerance=CONVERGED), None, CONVERGED)
    return own, unbiased_fit(own, shaped.model)


def _gain(larger: Whitened, other: Whitened) -> float:
    """By how much −2 ln likelihood is lower with the larger law, in units of what the other explanation leaves."""
    return (_misfit(*other) - _misfit(*larger)) / scale_of(other[1])


def _luck(larger: Whitened, other: Whitened, rate: float) -> float:
    """What noise alone makes of the strengths that the larger law has more, but with a probability of `rate`."""
    return float(chi2.isf(rate, larger[1].strengths - other[1].strengths))


def _misfit(problem: SearchProblem, found: Fit) -> float:
    """−2 ln likelihood but for a constant."""
    return found.chi_square + problem.log_determinant


def drop_superseded(growth: GrowthByPlace) -> None:
    """Drops one of two laws at a joint that act alike, where without it the samples are predicted better.

    Of two that explain the same, the one that was found first stays beside the other, and takes its part of what that
    one explains, if only one of them changes the noise of motion in the equations. So each alone is compared with both
    under its own noise, dry friction with the width that it has alone.
    """
    for a, b in itertools.combinations(growth.best.model.effects, 2):
        if joint_of(a) != joint_of(b) or joint_of(a) == ELSEWHERE or not act_alike(a, b):
            continue
        if noise_changed(a) == noise_changed(b) or not {a.key, b.key} <= growth.best.model.keys:
            continue
        # which friction a joint has is chosen of all its laws at once
        if is_friction(a) and is_friction(b):
            continue
        alone = [_refitted_without(growth, effect.key) for effect in (a, b)]
        leads = [growth.lead_of(model) for model in alone]
        if min(leads) < 0.0:
            growth.lead_of(alone[int(np.argmin(leads))], accept=True)


def _refitted_without(growth: GrowthByPlace, key: Key) -> Model:
    """The explanation without one of its effects, fitted again with the widths of dry frictions at its joint."""
    model = growth.best.model
    effect = next(effect for effect in model.effects if effect.key == key)
    rest = fit(growth.problem, model.without(effect), tolerance=CONVERGED)
    here = {other.key for other in rest.model.effects if is_dry(other) and joint_of(other) == joint_of(effect)}
    return fit_shapes(growth.problem, rest, here, CONVERGED).model
