"""A model's figures of fit on a group of recordings (nll, rmse, effort), each reported even if another one fails."""

from collections.abc import Mapping, Sequence

import numpy as np

from drake_cafim.diagnosis.predict.forecast import Forecast, divergence, root_mean_square
from drake_cafim.diagnosis.verdict import EffortResidual, Quality
from drake_cafim.numerics.computed import NotComputable
from drake_cafim.typing import Array

NO_SAMPLE = NotComputable("there is no sample after the 50 ms that a prediction starts from")
TOO_LARGE = NotComputable("a number is beyond what floating point holds")
RAN_AWAY = "the simulation runs away at once, or nothing was measured there"


def quality_of(
    likelihoods: Sequence[Array] | NotComputable,
    simulated: Sequence[Forecast] | NotComputable,
    shortly: Sequence[Forecast] | NotComputable = (),
    effort: Mapping[str, EffortResidual] | NotComputable | None = None,
) -> Quality:
    """The quality of a model on some recordings.

    `likelihoods` are −ln p of each recording's samples (K,), `simulated` and `shortly` its simulations over 1 s and
    0.1 s, and `effort` the residual of inverse dynamics by joint.
    """
    missing: list[str] = []
    nll = _mean(likelihoods)
    if isinstance(nll, NotComputable):
        missing.append(f"nll cannot be computed: {nll.reason}")
        nll = float("nan")
    rmse, rmse_short = _errors("rmse", simulated, missing), _errors("rmse_short", shortly, missing)
    if isinstance(effort, NotComputable):
        missing.append(f"effort cannot be computed: {effort.reason}")
        effort = None
    diverges = {} if isinstance(simulated, NotComputable) else divergence(simulated)
    return Quality(nll, rmse, rmse_short, effort or {}, diverges, tuple(missing))


def _mean(likelihoods: Sequence[Array] | NotComputable) -> float | NotComputable:
    """The mean over all samples of all recordings, or why there is none."""
    if isinstance(likelihoods, NotComputable):
        return likelihoods
    values = np.concatenate(likelihoods)
    if len(values) == 0:
        return NO_SAMPLE
    mean = float(np.mean(values))
    return mean if np.isfinite(mean) else TOO_LARGE


def _errors(name: str, simulated: Sequence[Forecast] | NotComputable, missing: list[str]) -> dict[str, float]:
    """The root mean square error by column; appends to `missing` each figure that cannot be computed, and why."""
    if isinstance(simulated, NotComputable):
        missing.append(f"{name} cannot be computed: {simulated.reason}")
        return {}
    errors = root_mean_square(simulated) if simulated else {}
    lost = [column for column, error in errors.items() if not np.isfinite(error)]
    missing += [f"{name}.{column} cannot be computed: {RAN_AWAY}" for column in lost]
    return errors
