"""A model's figures of fit on a group of recordings (nll, rmse, effort), each reported even if another one fails."""

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

from drake_cafim.diagnosis.predict.forecast import Forecast, divergence, root_mean_square
from drake_cafim.diagnosis.verdict import EffortResidual, Quality
from drake_cafim.numerics.computation import NotComputable
from drake_cafim.typing import Array

Figure = TypeVar("Figure")

NO_SAMPLE = NotComputable("there is no sample after the 50 ms that a prediction starts from")
TOO_LARGE = NotComputable("a number is beyond what floating point holds")
RAN_AWAY = "the simulation runs away at once, or nothing was measured there"


def qualities_of(
    sizes: Sequence[int],
    likelihoods: Sequence[Array | NotComputable] | NotComputable,
    simulated: Sequence[Forecast] | NotComputable,
    shortly: Sequence[Forecast] | NotComputable | None = None,
    efforts: Sequence[Mapping[str, EffortResidual] | NotComputable] | None = None,
) -> list[Quality]:
    """The quality of a model on each group of recordings; the groups follow each other and have `sizes` recordings.

    By recording: `likelihoods` are −ln p of its samples (K,), `simulated` and `shortly` its simulations over 1 s and
    0.1 s. By group: `efforts` are the residuals of inverse dynamics by joint. A group's nll is the mean over all its
    samples, which it has not where one of its recordings has no likelihood.
    """
    result, first = [], 0
    for group, size in enumerate(sizes):
        own = slice(first, first + size)
        missing: list[str] = []
        nll = _mean(_part(likelihoods, own))
        if isinstance(nll, NotComputable):
            missing.append(f"nll cannot be computed: {nll.reason}")
            nll = float("nan")
        long, short = _part(simulated, own), _part(() if shortly is None else shortly, own)
        rmse, rmse_short = _errors("rmse", long, missing), _errors("rmse_short", short, missing)
        effort = {} if efforts is None else efforts[group]
        if isinstance(effort, NotComputable):
            missing.append(f"effort cannot be computed: {effort.reason}")
            effort = {}
        diverges = {} if isinstance(long, NotComputable) else divergence(long)
        result.append(Quality(nll, rmse, rmse_short, effort, diverges, tuple(missing)))
        first = own.stop
    return result


def _part(figures: Sequence[Figure] | NotComputable, own: slice) -> Sequence[Figure] | NotComputable:
    return figures if isinstance(figures, NotComputable) else figures[own]


def _mean(likelihoods: Sequence[Array | NotComputable] | NotComputable) -> float | NotComputable:
    if isinstance(likelihoods, NotComputable):
        return likelihoods
    known: list[Array] = []
    for values in likelihoods:
        if isinstance(values, NotComputable):
            return values
        known.append(values)
    together = np.concatenate(known)
    if len(together) == 0:
        return NO_SAMPLE
    mean = float(np.mean(together))
    return mean if np.isfinite(mean) else TOO_LARGE


def _errors(name: str, simulated: Sequence[Forecast] | NotComputable, missing: list[str]) -> dict[str, float]:
    """The root mean square error by column; appends to `missing` each figure that cannot be computed, and why."""
    if isinstance(simulated, NotComputable):
        missing.append(f"{name} cannot be computed: {simulated.reason}")
        return {}
    if simulated and not any(len(forecast.time) for forecast in simulated):
        missing.append(f"{name} cannot be computed: {NO_SAMPLE.reason}")
        return {}
    errors = root_mean_square(simulated) if simulated else {}
    lost = [column for column, error in errors.items() if not np.isfinite(error)]
    missing += [f"{name}.{column} cannot be computed: {RAN_AWAY}" for column in lost]
    return errors
