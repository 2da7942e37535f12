"""A task with the choices that the paper prints, where they can be made; `diagrams/departures.md` lists ours."""

from dataclasses import fields, replace
from typing import Any

import numpy as np

from drake_cafim.parameters import Parameters
from drake_cafim.tasks.task import Task

PRINTED: dict[str, Any] = {"law": "paper", "seeking": 0.0}
"""Fields of the packaged models at the paper's values; those that a model lacks do not concern it."""


def as_printed(task: Task) -> Task:
    """The task with the paper's contact law, without our reward for approaching, and with its numbers.

    In hefting the palm does not damp (C = 0). In pinching the prior's 100 and 10 are variances, as printed.
    """
    model: Any = task.model
    own = {field.name for field in fields(model)}
    changes = {name: value for name, value in PRINTED.items() if name in own}
    if task.name == "hefting":
        changes["damping"] = 0.0
    if task.name == "pinching":
        items = [replace(parameter, std=float(np.sqrt(parameter.std))) for parameter in model.parameters]
        changes["parameters"] = Parameters.of(items)
    return replace(task, model=replace(model, **changes), law=str(changes.get("law", task.law)), others=())
