"""Linear looks at what a contact or its surface may do beyond the model."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields

import numpy as np

from drake_cafim.contact.change import Touch
from drake_cafim.diagnosis.problem import Problem, Run
from drake_cafim.effects.contact import ContactEffect
from drake_cafim.effects.effect import Effect
from drake_cafim.effects.surface import SurfaceEffect
from drake_cafim.scenario.physics import Physics
from drake_cafim.typing import Array


def contact_looks(
    problem: Problem, physics: Physics, effect: ContactEffect | SurfaceEffect
) -> Iterator[tuple[Array, Callable[[Array], Effect | None]]]:
    """Whitened columns (R, c) of the effect's looks, and the effect that coefficients stand for."""
    contact = next((one for one in physics.contacts if effect.meets(one)), None)
    if contact is None:
        return
    touches = [contact.touch(run.weak.motion(physics)) for run in problem.runs]
    looks = list(effect.looks(contact, _joined(touches)))
    if not looks:
        return
    parts = []
    for run in problem.runs:
        here = run.weak.contact_rows(physics)
        columns = []
        for step in (step for look in looks for step in look.steps):
            ahead = _rows(run, physics, effect, step.ahead)
            behind = here if step.behind is None else _rows(run, physics, effect, step.behind)
            columns.append((ahead - behind) / step.size)
        parts.append(run.whitened(np.stack(columns, axis=-1)))
    rows = np.concatenate(parts)
    first = 0
    for look in looks:
        stop = first + len(look.steps)
        yield rows[:, first:stop], look.build
        first = stop


def _rows(run: Run, physics: Physics, effect: ContactEffect | SurfaceEffect, values: Mapping[str, float]) -> Array:
    return run.weak.contact_rows(physics.with_effects([effect.with_values(values)]))


def _joined(touches: list[Touch]) -> Touch:
    """The touches of several recordings, one after the other."""
    names = [one.name for one in fields(Touch) if one.name != "axes"]
    together = {name: np.concatenate([getattr(touch, name) for touch in touches]) for name in names}
    return Touch(**together, axes=touches[0].axes)
