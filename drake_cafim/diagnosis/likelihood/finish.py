"""Finishes an estimate: from the whitened rows that a search needs to the likelihood of whole recordings."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from drake_cafim.diagnosis.fit.fitting import Fit
from drake_cafim.diagnosis.likelihood.whole_recordings import WholeFit, fit_whole
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.thresholds import MISFIT_P_VALUE, NOISE_STD_TOLERANCE
from drake_cafim.numerics.computation import NotComputable
from drake_cafim.scene.scene import Scene


def finish(scene: Scene, forms: Sequence[WeakForm], fitted: Fit) -> Fit | NotComputable:
    """The fit with the values and the covariance of highest likelihood, or why it stays as it is.

    Rows are local in time: they need no trajectory, and so they show what a wrong model lacks. What builds up slowly
    over a recording shows in whole trajectories alone, which a right model follows. Residual and Jacobian stay those of
    the rows at the fit before.
    """
    if not len(fitted.model.vector):
        return NotComputable("there is no parameter")
    found = fit_whole(scene, forms, fitted.model)
    if isinstance(found, NotComputable):
        return found
    if not found.settled:
        return NotComputable("the likelihood has no maximum nearby")
    if not follows(found):
        return NotComputable("the recordings as a whole do not follow the model")
    scale = max(1.0, found.reduced_chi_square)
    return replace(fitted, model=found.model, covariance=scale * found.covariance)


def follows(found: WholeFit) -> bool:
    """Whether χ² is as the noise predicts, whose std may be a little understated."""
    allowed = found.chi_square / (1.0 + NOISE_STD_TOLERANCE) ** 2
    return bool(np.isfinite(allowed) and chi2.sf(allowed, found.degrees_of_freedom) > MISFIT_P_VALUE)
