"""How well a model does on recordings of joints: innovations, simulations, and residuals of inverse dynamics."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.doubts import OFF, doubts
from drake_cafim.diagnosis.predict.forecast import HORIZON, SHORT_HORIZON, Forecast, counted_together, forecasts
from drake_cafim.diagnosis.predict.innovations import Innovations, innovations
from drake_cafim.diagnosis.predict.inverse_dynamics import effort_residuals
from drake_cafim.diagnosis.predict.quality import qualities_of
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.verdict import Quality
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.parallel.forked import map_forked
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

_Simulated = Sequence[Forecast] | NotComputable


def qualities(
    groups: Sequence[list[WeakForm]], scene: Scene, models: Sequence[tuple[Model, Array]], jobs: int = 1
) -> list[list[Quality]]:
    """For each of the `models`, with the covariance (n, n) of its unknowns, its figures of fit of each group.

    All recordings are simulated at once, each model over each time by one of `jobs` processes. The errors of
    simulations are of the same samples for all models.
    """
    forms = [form for group in groups for form in group]
    physics = [model.physics(scene) for model, _ in models]

    def forecast(number: int) -> _Simulated:
        return compute(partial(forecasts, forms, physics[number // 2], (HORIZON, SHORT_HORIZON)[number % 2]))

    def filtered(number: int) -> list[Innovations] | NotComputable:
        return compute(partial(_filtered, forms, scene, *models[number]))

    all_forecasts = list(map_forked(forecast, 2 * len(models), jobs))
    simulated, shortly = _compared(all_forecasts[::2]), _compared(all_forecasts[1::2])
    all_filtered = map_forked(filtered, len(models), jobs)
    found = []
    for known, samples, own, short in zip(physics, all_filtered, simulated, shortly, strict=True):
        likelihoods = samples if isinstance(samples, NotComputable) else _likelihoods(forms, samples)
        efforts = [compute(partial(effort_residuals, group, known)) for group in groups]
        found.append(qualities_of([len(group) for group in groups], likelihoods, own, short, efforts))
    return found


def _filtered(forms: Sequence[WeakForm], scene: Scene, model: Model, covariance: Array) -> list[Innovations]:
    """Innovations of a model of whose unknowns the `covariance` (n, n) is known."""
    return innovations(forms, model.physics(scene), doubts(scene, model, covariance), OFF)


def _compared(found: Sequence[_Simulated]) -> list[_Simulated]:
    """The simulations by each model, compared as long as none of them diverges."""
    together = iter(counted_together([own for own in found if not isinstance(own, NotComputable)]))
    return [own if isinstance(own, NotComputable) else next(together) for own in found]


def surprisal(
    forms: Sequence[WeakForm], scene: Scene, model: Model, covariance: Array, within: tuple[float, float]
) -> float:
    """−ln likelihood of innovations, the mean over samples from `within[0]` to before `within[1]`, s.

    NaN where there is none, infinite where the filter is lost, since the simulation runs away.
    """
    filtered = compute(partial(_filtered, forms, scene, model, covariance))
    if isinstance(filtered, NotComputable) or any(found.lost is not None for found in filtered):
        return float("inf")
    own = [found.negative_log_likelihood[(found.time >= within[0]) & (found.time < within[1])] for found in filtered]
    together = np.concatenate(own)
    return float(np.mean(together)) if len(together) else float("nan")


def _likelihoods(forms: Sequence[WeakForm], filtered: Sequence[Innovations]) -> list[Array | NotComputable]:
    """−ln likelihood of each recording's samples; not computable where its filter failed."""
    found: list[Array | NotComputable] = []
    for form, innovation in zip(forms, filtered, strict=True):
        if innovation.lost is None:
            found.append(innovation.negative_log_likelihood)
        else:
            name = form.samples.recording.name
            found.append(NotComputable(f"the filter's covariance is singular at {innovation.lost:.6g} s of {name}"))
    return found
