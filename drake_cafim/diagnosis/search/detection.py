"""Whether anything is missing at all: the p-value of the nominal model."""

from collections.abc import Sequence

from scipy.stats import chi2

from drake_cafim.diagnosis.fit.adequacy import adequacy
from drake_cafim.diagnosis.fit.evidence import luck, under_its_noise
from drake_cafim.diagnosis.fit.fitting import Fit, unbiased_fit
from drake_cafim.diagnosis.fit.robust_covariance import wald_p_value
from drake_cafim.diagnosis.fit.search_problem import SearchProblem
from drake_cafim.diagnosis.search.screening import Candidate
from drake_cafim.diagnosis.thresholds import (
    ALARM_P_VALUE_CERTAIN,
    ALARM_P_VALUE_WORTH_FITTING,
    CANDIDATES_FITTED_FOR_ALARM,
)


def detection_p_value(problem: SearchProblem, nominal: Fit, screened: Sequence[Candidate], trials: int) -> float:
    """p-value of "nothing is missing": the strongest score, or the worst of the goodness of fit."""
    fit_quality = adequacy(problem, nominal.residual, 0).p_value
    if fit_quality < ALARM_P_VALUE_CERTAIN:
        # whatever a look would say is no news
        return 2.0 * fit_quality
    score = 1.0
    for candidate in screened[:CANDIDATES_FITTED_FOR_ALARM]:
        p = float(chi2.sf(candidate.gain, candidate.strengths)) * trials
        if p < ALARM_P_VALUE_WORTH_FITTING:
            # the linear look shares noise with the residual: only an unbiased fit may raise an alarm
            one = unbiased_fit(problem, nominal.model.with_effects([candidate.effect]))
            gained = nominal.chi_square - one.chi_square
            p = trials * max(wald_p_value(problem, one, candidate.effect.key), luck(gained, candidate.strengths))
            if p < ALARM_P_VALUE_WORTH_FITTING:
                before, after = under_its_noise(problem, nominal, one)
                p = max(p, trials * luck(before.chi_square - after.chi_square, candidate.strengths))
        score = min(score, p)
        if score < ALARM_P_VALUE_CERTAIN:
            break
    return float(min(1.0, 2.0 * min(fit_quality, score)))
