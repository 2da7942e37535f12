"""The judgement on what a search by output errors found at joints whose servos have unknown parameters."""

import numpy as np

from drake_cafim.diagnosis.fit.adequacy import adequacy
from drake_cafim.diagnosis.fit.evidence import leaves_noise
from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.output_error.decisions import SEARCH, record_errors
from drake_cafim.diagnosis.output_error.found import Found
from drake_cafim.diagnosis.search.decisions import record_descent
from drake_cafim.diagnosis.search.decisions_by_place import record_shared
from drake_cafim.diagnosis.search.determined import Descent, undetermined
from drake_cafim.diagnosis.search.given_effects import fit_given
from drake_cafim.diagnosis.search.judgement import Judgement
from drake_cafim.diagnosis.search.search import Outcome
from drake_cafim.diagnosis.search.state import Settings
from drake_cafim.diagnosis.thresholds import ALARM_P_VALUE_CERTAIN, LEAST_PROBABILITY, MISFIT_REDUCED_CHI_SQUARE
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.effects.effect import Effect
from drake_cafim.numerics.computation import compute
from drake_cafim.numerics.rounding import short


def judge_found(problem: SearchProblem, found: Found, settings: Settings, trace: Trace) -> Judgement:
    """The judgement that names the effects of `found`, with their values by simulations.

    It is `explained` where simulations miss the positions by no more than the noise. Then, or where the equations of
    motion hold with the effects, the values are those that satisfy these, which tell more, as long as they leave little
    more than noise and the simulations with them are as good.
    """
    alone = _at(problem, found.alone.model, found)
    p_value = min(1.0, 2.0 * adequacy(problem, alone.residual, 0).p_value)
    chance = _chance_of_errors(found, settings.adequacy_level, trace)
    withheld = _withheld(found, trace)
    explained = chance > settings.adequacy_level and not withheld
    if chance > ALARM_P_VALUE_CERTAIN and not withheld:
        by_equations = compute(lambda: _by_equations(problem, found, explained, settings.adequacy_level))
        if isinstance(by_equations, tuple):
            own, fitted = by_equations
            outcome = Outcome(own, problem, alone, fitted, (fitted,), 1, (), p_value, found.probability)
            return Judgement(outcome, fitted, "explained", search=SEARCH, rivals=found.rivals, corrected=fitted)
    whole = _at(problem, found.fitted.model, found)
    named = tuple(effect for effect in found.fitted.model.effects if effect not in withheld)
    best = _at(problem, Model(found.fitted.model.unknown, named), found)
    return Judgement(
        Outcome(problem, problem, alone, whole, (whole,), 1, (), p_value, found.probability),
        best,
        "explained" if explained else "unexplained",
        search=SEARCH,
        withheld=withheld,
        rivals=found.rivals,
        std=found.uncertainty.of(best.model),
        corrected=whole,
    )


def _by_equations(
    problem: SearchProblem, found: Found, explained: bool, level: float
) -> tuple[SearchProblem, Fit] | None:
    """The fit to the equations of motion, where they hold with what was found and predict as well."""
    own, fitted = fit_given(problem, found.fitted.model)
    nearly = explained and fitted.reduced_chi_square < MISFIT_REDUCED_CHI_SQUARE
    holds = nearly or leaves_noise(own, fitted, level)
    return (own, fitted) if holds and _predicts_as_well(found, fitted.model) else None


def _withheld(found: Found, trace: Trace) -> tuple[Effect, ...]:
    """The effects that get no name: another law explains the same as well, or nothing is known of a strength."""
    model, kept = found.fitted.model, list[Effect]()
    for effect in model.effects:
        probability = found.probability.get(effect.key, 1.0)
        std = found.uncertainty.strengths[effect.key]
        wide = undetermined(effect, std, std)
        if probability < LEAST_PROBABILITY:
            trace.add(record_shared(model, effect, probability, LEAST_PROBABILITY))
        elif wide is not None:
            strength, deviation, size = wide
            reason = f"the standard deviation of its {strength} is {short(deviation)}, and it may span {short(size)}"
            trace.add(record_descent(model, Descent(effect, reason, None)))
        else:
            kept.append(effect)
    return tuple(effect for effect in model.effects if effect not in kept)


def _chance_of_errors(found: Found, level: float, trace: Trace) -> float:
    """The smallest probability of a joint that noise alone makes such errors of its simulations."""
    errors, fits = found.problem.errors, (found.fitted, found.alone)
    p_values = errors.p_values(found.fitted.errors)
    rms = [np.sqrt(errors.mean_squares(fit.errors)).tolist() for fit in fits]
    for joint, error, before, p in zip(found.problem.joints, *rms, p_values.tolist(), strict=True):
        trace.add(record_errors(joint, error, before, p, level))
    return float(np.min(p_values))


def _at(problem: SearchProblem, model: Model, found: Found) -> Fit:
    """The rows at a model, as if fitted: its covariance is that of the simulations."""
    std = found.uncertainty.of(model)
    return Fit(
        model,
        problem.residual(model),
        problem.jacobian(model),
        np.diag(std**2),
        problem.rows,
        unbiased=True,
        penalty=problem.penalty(model),
    )


def _predicts_as_well(found: Found, model: Model) -> bool:
    """Whether a model simulates as well as the fit to simulations, but for one of −2 ln p for each number."""
    errors = found.problem.errors
    costs, best = (errors.likelihood.costs(e) for e in (found.problem.errors_of(model), found.fitted.errors))
    allowed = np.array([len(names) for names in found.fitted.names])
    return bool(np.all(costs - best <= allowed))
