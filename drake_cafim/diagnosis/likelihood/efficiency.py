"""How well an interval uses what the recordings hold: its information over that of their likelihood.

With F = Σ Vᵀ S⁻¹ V the Fisher information of all recordings about unknowns, strengths and shapes x, their initial
states projected out (see `smoother`), and the priors' P, no unbiased estimate of xᵢ has a smaller variance than
bᵢ² = [(F + P)⁻¹]ᵢᵢ (Cramér, Rao). An interval of standard deviation σᵢ has the efficiency bᵢ²/σᵢ²: 1 says that it is as
narrow as these recordings allow, less that more could be told from them, more than 1 that it claims too much.
"""

from collections.abc import Sequence

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.likelihood.coordinates import Coordinates
from drake_cafim.diagnosis.likelihood.linearised import linearise
from drake_cafim.diagnosis.likelihood.whole_recordings import first_states, inverse, refuses
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.numerics.computation import NotComputable, compute
from drake_cafim.parallel.forked import map_forked
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


def bounds(
    scene: Scene, forms: Sequence[WeakForm], model: Model, states: Sequence[Array] | None = None, jobs: int = 1
) -> Array | NotComputable:
    """(n + k,) least standard deviations of unknowns and strengths, or why there are none.

    The model is linearised along `states` (N, 2n) of each recording, by default the recorded motion, smoothed. The time
    that it takes is proportional to the number of samples; `jobs` processes share the recordings, -1 for one per core.
    """
    if reason := refuses(scene, forms, model):
        return NotComputable(reason)
    return compute(lambda: _bounds(scene, forms, model, states, jobs))


def _bounds(scene: Scene, forms: Sequence[WeakForm], model: Model, states: Sequence[Array] | None, jobs: int) -> Array:
    at = Coordinates(scene, model)
    physics, displaced = model.physics(scene), at.displaced(model)
    along = states or [first_states(form, model, scene) for form in forms]

    def told_by(number: int) -> Array:
        return linearise(forms[number], physics, displaced, along[number]).filtered.information

    information = sum(map_forked(told_by, len(forms), jobs), start=np.diag(at.prior_information))
    if not np.all(np.isfinite(information)):
        raise ArithmeticError("the sensitivities grow beyond what floating point holds")
    return np.sqrt(np.diag(inverse(information)))[: len(model.vector)]


def efficiencies(bound: Array, std: Array) -> Array:
    """(n + k,) of intervals of standard deviations `std` (n + k,); NaN where nothing is known of a parameter."""
    known = np.isfinite(bound) & np.isfinite(std) & (std > 0.0)
    return np.asarray(np.divide(bound, std, out=np.full(len(bound), np.nan), where=known) ** 2)
