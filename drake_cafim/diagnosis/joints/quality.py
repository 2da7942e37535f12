"""How well a model does on recordings of joints: innovations, simulations, and residuals of inverse dynamics."""

from collections.abc import Sequence
from functools import partial

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.doubts import doubts
from drake_cafim.diagnosis.predict.forecast import HORIZON, SHORT_HORIZON, forecasts
from drake_cafim.diagnosis.predict.innovations import Innovations, innovations
from drake_cafim.diagnosis.predict.inverse_dynamics import effort_residuals
from drake_cafim.diagnosis.predict.quality import quality_of
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.verdict import Quality
from drake_cafim.numerics.computed import NotComputable, computed
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


def qualities(groups: Sequence[list[WeakForm]], scene: Scene, model: Model, covariance: Array) -> list[Quality]:
    """Of each group of recordings under `model`; all are simulated side by side.

    `covariance` (n, n) is of its unknowns.
    """
    physics = model.physics(scene)
    forms = [form for group in groups for form in group]
    filtered = computed(lambda: innovations(forms, physics, doubts(scene, model, covariance)))
    simulated, shortly = (computed(partial(forecasts, forms, physics, horizon)) for horizon in (HORIZON, SHORT_HORIZON))
    result, first = [], 0
    for group in groups:
        own = slice(first, first + len(group))
        likelihoods = filtered if isinstance(filtered, NotComputable) else _likelihoods(group, filtered[own])
        long = simulated if isinstance(simulated, NotComputable) else simulated[own]
        short = shortly if isinstance(shortly, NotComputable) else shortly[own]
        effort = computed(partial(effort_residuals, group, physics))
        result.append(quality_of(likelihoods, long, short, effort))
        first = own.stop
    return result


def _likelihoods(forms: Sequence[WeakForm], filtered: Sequence[Innovations]) -> list[Array] | NotComputable:
    """−ln of the likelihood of each recording's samples.

    A recording whose filter failed has none, and a mean over the other recordings would not be the group's.
    """
    for form, innovation in zip(forms, filtered, strict=True):
        if innovation.lost is not None:
            name = form.samples.recording.name
            return NotComputable(f"the filter's covariance is singular at {innovation.lost:.6g} s of {name}")
    return [innovation.negative_log_likelihood for innovation in filtered]
