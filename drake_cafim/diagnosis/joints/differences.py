"""Derivatives of whitened rows by differences: by the unknowns, and by strengths whose slopes no law says."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.rows.initial_uncertainty import has_unknown_start
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.whitened_run import Run
from drake_cafim.effects.effect import Effect
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Differences:
    """Of the whitened rows (R,) of all `runs`, then of the prior rows (n,) that `prior_rows` says of a model."""

    scene: Scene
    runs: Sequence[Run]
    prior_rows: Callable[[Model], Array]
    _unknown_columns: dict[int, tuple[Any, Array]] = field(default_factory=dict, repr=False, compare=False)

    def by_unknown(self, model: Model, i: int) -> Array:
        """(R + n,) by one of the unknowns."""
        if any(one.kind == "effect" for one in self.scene.unknown):
            # a delay or a gap is not linear in the rows: each model has its own slopes
            return self._difference(model, i, 1e-2 * self.scene.priors.std[i])
        if self.scene.unknown[i].kind == "contact" and any(one.of_contact for one in model.effects):
            # another surface is touched at other times, and another friction has other numbers
            return self._contact_difference(model, i, 1e-2 * self.scene.priors.std[i])
        # rows are linear in masses and all but linear in the rest: one look a whitening serves every later step; but
        # that look holds the channels' noise, which a sensor that is late moves to another time
        late = tuple(
            (effect.key, *(float(f"{value:.2g}") for value in effect.values.values()))
            for effect in model.effects
            if effect.late
        )
        kind = late, model.free
        if self._unknown_columns.get(i, (None,))[0] != kind:
            # nor may the least change of a mass make an impact come earlier
            smooth = replace(model, effects=tuple(one for one in model.effects if not one.impacts))
            self._unknown_columns[i] = kind, self._difference(smooth, i, 1e-2 * self.scene.priors.std[i])
        return self._unknown_columns[i][1]

    def by_strength(self, model: Model, position: int, k: int) -> Array:
        """(R + n,) by one strength of the effect at `position`."""
        effect: Effect = model.effects[position]
        index = len(model.unknown) + sum(len(e.strengths) for e in model.effects[:position]) + k
        strength, value = effect.strengths[k], float(effect.vector[k])
        # what is absent at infinity has no scale but its own
        size = abs(value) if strength.inverse else strength.typical
        if effect.of_contact:
            return self._contact_difference(model, index, effect.difference_step * size)
        return self._difference(model, index, effect.difference_step * size)

    def _difference(self, model: Model, index: int, step: float) -> Array:
        up, down, taken = _either_side(model, index, step)
        if not has_unknown_start(up.physics(self.scene)):
            return self._apart(up, down, WeakForm.residual) / taken
        ahead, widths = self._begun(up, [None] * len(self.runs))
        # the likelihood is at its largest in the widths: it has the slope that it has while they stay as they are
        behind, _ = self._begun(down, widths)
        # beside what is impossible there is no slope to follow
        possible = np.all(np.isfinite(ahead)) and np.all(np.isfinite(behind))
        return (ahead - behind) / taken if possible else np.zeros(len(ahead))

    def _apart(self, up: Model, down: Model, rows: Callable[[WeakForm, Physics], Array]) -> Array:
        """What `rows` (M, r) of each recording, whitened, and prior rows differ by between two models."""
        ahead, behind = up.physics(self.scene), down.physics(self.scene)
        parts = []
        for run in self.runs:
            change = rows(run.weak, ahead) - rows(run.weak, behind)
            # most of what is tried leaves some recordings alone
            parts.append(run.whitened(change) if np.any(change) else np.zeros(run.rows))
        return np.concatenate([*parts, self.prior_rows(up) - self.prior_rows(down)])

    def _begun(self, model: Model, widths: Sequence[Array | None]) -> tuple[Array, list[Array | None]]:
        """Residual with the doubts of each recording's start as wide as `widths` or as is likeliest; and how wide."""
        physics = model.physics(self.scene)
        begun = [run.marginalise_start(physics, own) for run, own in zip(self.runs, widths, strict=True)]
        return np.concatenate([*(one.rows for one in begun), self.prior_rows(model)]), [one.widths for one in begun]

    def _contact_difference(self, model: Model, index: int, step: float) -> Array:
        """The same for a number that only contacts know of."""
        up, down, taken = _either_side(model, index, step)
        return self._apart(up, down, WeakForm.contact_rows) / taken


def _either_side(model: Model, index: int, step: float) -> tuple[Model, Model, float]:
    """The model with one number a step ahead and behind, and the step between them that bounds have left."""
    vector = model.vector
    ahead, behind = vector.copy(), vector.copy()
    ahead[index] += step
    behind[index] -= step
    up, down = model.at(ahead), model.at(behind)
    return up, down, float(up.vector[index] - down.vector[index])
