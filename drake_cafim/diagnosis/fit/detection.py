"""The p-value of the nominal model: the probability of so large a misfit, or so good a candidate, by noise alone."""

from collections.abc import Sequence

from scipy.stats import chi2

from drake_cafim.diagnosis.fit.adequacy import adequacy
from drake_cafim.diagnosis.fit.evidence import luck_p_value, refit_under_noise_of
from drake_cafim.diagnosis.fit.fitting import Fit, unbiased_fit
from drake_cafim.diagnosis.fit.robust_covariance import wald_p_value
from drake_cafim.diagnosis.fit.screening import Candidate
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.thresholds import (
    ALARM_P_VALUE_CERTAIN,
    ALARM_P_VALUE_WORTH_FITTING,
    CANDIDATES_FITTED_FOR_ALARM,
)


def detection_p_value(problem: SearchProblem, nominal: Fit, screened: Sequence[Candidate], trials: int) -> float:
    """p-value of "nothing is missing": twice the smaller p-value of two, of goodness of fit and of the candidates.

    The latter is the smallest p-value of a candidate of `screened`, times the number of `trials` (Bonferroni).
    """
    fit_quality = adequacy(problem, nominal.residual, 0).p_value
    if fit_quality < ALARM_P_VALUE_CERTAIN:
        # no candidate can change the outcome any more
        return 2.0 * fit_quality
    score = 1.0
    for candidate in screened[:CANDIDATES_FITTED_FOR_ALARM]:
        p = float(chi2.sf(candidate.gain, candidate.strengths)) * trials
        if p < ALARM_P_VALUE_WORTH_FITTING:
            # the first-order test shares noise with the residual: only an unbiased fit may raise an alarm
            corrected = unbiased_fit(problem, nominal.model.with_effects([candidate.effect]))
            gained = nominal.chi_square - corrected.chi_square
            p = trials * max(
                wald_p_value(problem, corrected, candidate.effect.key), luck_p_value(gained, candidate.strengths)
            )
            if p < ALARM_P_VALUE_WORTH_FITTING:
                # an effect that changes the noise covariance must gain under its own covariance too
                before, after = refit_under_noise_of(problem, nominal, corrected)
                p = max(p, trials * luck_p_value(before.chi_square - after.chi_square, candidate.strengths))
        score = min(score, p)
        if score < ALARM_P_VALUE_CERTAIN:
            break
    return float(min(1.0, 2.0 * min(fit_quality, score)))
